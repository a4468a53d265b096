"""The command line that every benchmark has."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp


@dataclass(frozen=True)
class Options:
    """full: the long form. device: where ours and the peers run. sizes: in place of the script's own, if any."""

    full: bool
    device: Any
    sizes: tuple[str, ...]
    methods: tuple[str, ...]

    def counts(self, default: Sequence[int]) -> list[int]:
        """The sizes as vertex counts, as 100k or 2M."""
        return [vertex_count(size) for size in self.sizes] or list(default)


def vertex_count(size: str) -> int:
    """10_000 from "10k"."""
    factor = {"k": 1_000, "M": 1_000_000}.get(size[-1], 1)
    return int(float(size.rstrip("kM")) * factor)


def options(words: Sequence[str] | None = None) -> Options:
    """Reads the command line and makes its device Warp's current one."""
    parser = argparse.ArgumentParser(description="One benchmark: prints a table, writes bench/results/NAME.json.")
    parser.add_argument("--full", action="store_true", help="all sizes")
    parser.add_argument("--device", help="a Warp device, as cpu or cuda:0; default: Warp's own choice")
    parser.add_argument("--sizes", nargs="*", default=(), help="sizes in place of the script's own, as 100k")
    parser.add_argument("--methods", nargs="*", default=(), help="only methods with one of these words in their name")
    given = parser.parse_args(words)
    wp.config.log_level = wp.LOG_WARNING
    wp.set_device(wp.get_device(given.device))
    return Options(given.full, wp.get_device(), tuple(given.sizes), tuple(given.methods))
