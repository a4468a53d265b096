"""`python -m bench [--full]`: every benchmark in turn."""

from __future__ import annotations

import sys

import warp as wp

from bench import iteration, stages


def main() -> None:
    wp.config.quiet = True
    full = "--full" in sys.argv[1:]
    for script in (stages, iteration):
        script.main(full)


if __name__ == "__main__":
    main()
