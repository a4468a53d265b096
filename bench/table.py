"""What every benchmark shares: honest repeats, one printed table, one JSON file."""

from __future__ import annotations

import json
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import warp as wp

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


def report(name: str, claim: str, rows: Sequence[dict[str, Any]], device: Any = None) -> None:
    """Prints the rows as one table and writes them to results/NAME.json."""
    columns = list(rows[0])
    cells = [[f"{row[c]:.4g}" if isinstance(row[c], float) else str(row[c]) for c in columns] for row in rows]
    widths = [max(len(c), *(len(line[k]) for line in cells)) for k, c in enumerate(columns)]
    print(f"\n{claim}")
    for line in [columns, *cells]:
        print("  ".join(text.rjust(width) for text, width in zip(line, widths, strict=True)))
    RESULTS.mkdir(exist_ok=True)
    where = wp.get_device(device)
    about = {"claim": claim, "device": where.name, "python": platform.python_version(), "warp": wp.__version__}
    (RESULTS / f"{name}.json").write_text(json.dumps({**about, "rows": list(rows)}, indent=1) + "\n")
