"""What every benchmark shares: honest repeats, one printed table, one JSON file."""

from __future__ import annotations

import json
import math
import os
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from bench import THREADS

RESULTS = Path(__file__).parent / "results"


def median_seconds(work: Callable[[], Any], repeats: int = 5) -> float:
    """The median wall time of `repeats` warm runs, the device's queue empty before and after each."""
    work()
    times = []
    for _ in range(repeats):
        wp.synchronize()
        began = time.perf_counter()
        work()
        wp.synchronize()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


@dataclass(frozen=True)
class Timing:
    """Seconds on the clock, and seconds that all cores together worked."""

    wall: float
    cpu: float

    @classmethod
    def median(cls, timings: Sequence[Timing]) -> Timing:
        return cls(statistics.median(t.wall for t in timings), statistics.median(t.cpu for t in timings))

    def __add__(self, other: Timing) -> Timing:
        return Timing(self.wall + other.wall, self.cpu + other.cpu)


def timed(work: Callable[[], Any]) -> tuple[Any, Timing]:
    """What `work` returns, and how long it took; the device's queue is empty before and after."""
    wp.synchronize()
    wall, cpu = time.perf_counter(), time.process_time()
    value = work()
    wp.synchronize()
    return value, Timing(time.perf_counter() - wall, time.process_time() - cpu)


_QUIET = {"best": math.inf}


def calm(patience: float = 1.0) -> None:
    """Waits until a small piece of work takes little longer than it ever did: cores may be shared with others."""
    numbers = np.arange(1_000_000.0)
    until = time.perf_counter() + patience
    while time.perf_counter() < until:
        began = time.perf_counter()
        for _ in range(8):
            numbers @ numbers
            np.sqrt(numbers)
        took = time.perf_counter() - began
        _QUIET["best"] = min(took, _QUIET["best"])
        if took < 1.2 * _QUIET["best"]:
            return
        time.sleep(0.3)


def report(name: str, claim: str, rows: Sequence[dict[str, Any]], device: Any = None) -> None:
    """Prints the rows as one table and writes them to results/NAME.json."""
    print(f"\n{claim}")
    show(rows)
    save(name, claim, rows, device)


def show(rows: Sequence[dict[str, Any]]) -> None:
    """Prints the rows as one table; lists and dictionaries are for the JSON only."""
    columns = list(dict.fromkeys(c for row in rows for c in row if not isinstance(row[c], list | dict)))
    cells = [[_text(row.get(c, "")) for c in columns] for row in rows]
    widths = [max(len(c), *(len(line[k]) for line in cells)) for k, c in enumerate(columns)]
    for line in [columns, *cells]:
        print("  ".join(text.rjust(width) for text, width in zip(line, widths, strict=True)), flush=True)


def save(name: str, claim: str, rows: Sequence[dict[str, Any]], device: Any = None) -> None:
    """Writes the rows and what they ran on to results/NAME.json."""
    RESULTS.mkdir(exist_ok=True)
    where = wp.get_device(device)
    about = {
        "claim": claim,
        "device": where.name,
        "cuda": where.is_cuda,
        "cores": os.cpu_count(),
        "threads": int(THREADS),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "warp": wp.__version__,
    }
    (RESULTS / f"{name}.json").write_text(json.dumps({**about, "rows": list(rows)}, indent=1) + "\n")


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
