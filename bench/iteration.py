"""One CG iteration costs at most 3 times one three-column product with the graph Laplacian."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

import oneform_warp as ow
from bench.stages import jittered_grid
from bench.table import median_seconds, report
from oneform_warp.segments import launch_chunks
from oneform_warp.solvers import cg

REPLAYS = 20


def replayed(launches: Callable[[], None], device: Any) -> float:
    """Seconds of one recorded run of `launches`."""
    launches()
    with wp.ScopedCapture(device=device) as capture:
        for _ in range(REPLAYS):
            launches()
    return median_seconds(lambda: wp.capture_launch(capture.graph)) / REPLAYS


def row(count: int, device: Any) -> dict[str, Any]:
    x, faces = jittered_grid(count)
    graph = ow.Graph.from_faces(x, faces, device=device)
    iteration = ow.CG().prepare(graph, np.zeros(graph.node_count, dtype=bool)).inner
    assert isinstance(iteration, cg._Iteration)
    rows, product = iteration.rows, cg.product_and_dot(iteration.rows.precision)
    one = replayed(
        lambda: launch_chunks(product, rows.segments, [*rows.arguments(), iteration.p], [iteration.q, iteration.pq]),
        device,
    )
    whole = replayed(iteration._iterate, device)
    return {"vertices": len(x), "product us": 1e6 * one, "iteration us": 1e6 * whole, "ratio": whole / one}


def main(full: bool = False) -> None:
    device = wp.get_device()
    sizes = [10_000, 100_000, 1_000_000] if full else [10_000, 100_000]
    report("iteration", f"a CG iteration against one product, on {device.name}", [row(n, device) for n in sizes])


if __name__ == "__main__":
    main()
