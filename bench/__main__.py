"""`python -m bench [--full] [--device cuda:0]`: every benchmark in turn; then the plots."""

from __future__ import annotations

from dataclasses import replace

from bench import chain, edit, iteration, many, plots, roofline, scale, solve, stages
from bench.options import options
from bench.tree import study


def main() -> None:
    given = options()
    for script in (stages, iteration):
        script.main(given.full)
    for script in (edit, many, scale, roofline, chain):
        script.main(replace(given, sizes=()))
    solve.main(given)
    study.main(replace(given, sizes=(), methods=()))
    plots.main()


if __name__ == "__main__":
    main()
