"""`python -m bench.tree`, see `study`."""

from __future__ import annotations

from bench.options import options
from bench.tree.study import main

if __name__ == "__main__":
    main(options())
