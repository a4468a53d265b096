"""Many small meshes: meshes a second, one by one and together.

`python -m bench.many [--full] [--device cuda:0] [--sizes 100 1000]`
"""

from __future__ import annotations

from typing import Any

import numpy as np

import oneform_warp as ow
from bench.edit import handles
from bench.options import Options, options
from bench.table import calm, report, timed

VERTICES = 2_000
ALONE = 20
"""Meshes that are deformed one by one; their rate is that of all."""


def small_meshes(count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Bars of about VERTICES, each a little different."""
    x, faces = ow.shapes.bar(segments=46, sides=10)
    rng = np.random.default_rng(0)
    return [(x * rng.uniform(0.8, 1.2, 3) + 1e-3 * rng.normal(size=x.shape), faces) for _ in range(count)]


def row(count: int, device: Any) -> dict[str, Any]:
    meshes = small_meshes(count)
    angles = np.random.default_rng(1).uniform(-90.0, 90.0, (2, count))
    chosen = [[handles(x, angle) for (x, _), angle in zip(meshes, some, strict=True)] for some in angles]
    calm()
    alone, one_by_one = timed(
        lambda: [ow.deform(x, f, h, device=device) for (x, f), h in zip(meshes[:ALONE], chosen[0], strict=False)]
    )
    together, made = timed(lambda: ow.Deformers(meshes, device=device))
    first, solved = timed(lambda: together.deform(chosen[0]))
    _, again = timed(lambda: together.solve(chosen[1], start="previous"))
    box = np.ptp(meshes[0][0], axis=0).max()
    return {
        "meshes": count,
        "vertices": together.graph.vertex_count,
        "one by one/s": min(ALONE, count) / one_by_one.wall,
        "together/s": count / (made.wall + solved.wall),
        "again/s": count / again.wall,
        "make s": made.wall,
        "first s": solved.wall,
        "again s": again.wall,
        "differ by": max(float(np.abs(a - b).max()) for a, b in zip(alone, first, strict=False)) / box,
    }


def main(given: Options) -> None:
    device = given.device
    counts = given.counts([10, 100, 1000] if device.is_cuda or given.full else [10, 100])
    row(2, device)  # loads every kernel
    claim = (
        f"meshes of about {VERTICES} vertices on {device.name}: a second, one by one, together, and a changed rotation"
    )
    report(f"many-{'cuda' if device.is_cuda else 'cpu'}", claim, [row(count, device) for count in counts])


if __name__ == "__main__":
    main(options())
