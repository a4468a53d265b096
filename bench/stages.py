"""Where the time goes: each stage from faces to positions, by size."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import warp as wp

import oneform_warp as ow
from bench.table import median_seconds, report


def jittered_grid(count: int) -> tuple[np.ndarray, np.ndarray]:
    """About `count` vertices of a jittered, randomly numbered triangle grid: the order that a scan comes in."""
    side = round(count**0.5)
    x, faces = ow.shapes.grid(side - 1, side - 1)
    rng = np.random.default_rng(0)
    x = x + rng.uniform(-0.3, 0.3, x.shape) * [1.0 / side, 1.0 / side, 0.0]
    shuffled = rng.permutation(len(x))
    y = np.empty_like(x)
    y[shuffled] = x
    return y, shuffled[faces]


def stages(count: int, device: Any) -> dict[str, Any]:
    x, faces = jittered_grid(count)
    began = time.perf_counter()
    graph = ow.Graph.from_faces(x, faces, weights="uniform", device=device)
    seconds: dict[str, Any] = {"vertices": len(x), "graph": time.perf_counter() - began}
    seconds["cotangents"] = median_seconds(lambda: graph.with_weights("cotangent", x), 3)
    graph = graph.with_weights("cotangent", x)
    t = x[:, 0]
    handles = [ow.Handle(t < 0.05, held=True), ow.Handle(t > 0.95, axis="z", angle=90)]
    solution = ow.Deformer(x, graph).solve(handles)
    energy = ow.edge_energy(graph, x, solution.v)
    seconds["min depth tree"] = median_seconds(lambda: ow.spanning_tree(graph), 3)
    seconds["maximal tree"] = median_seconds(lambda: ow.spanning_tree(graph, -energy), 3)
    tree = ow.spanning_tree(graph)
    seconds["integrate tree"] = median_seconds(lambda: ow.integrate_tree(tree, solution.v), 3)
    seconds.update({stage: solution.seconds[stage] for stage in ("fields", "1-form", "solve")})
    seconds["iterations"] = solution.iterations
    return seconds


def main(full: bool = False) -> None:
    sizes = [10_000, 100_000, 1_000_000] if full else [10_000, 40_000, 100_000]
    device = wp.get_device()
    report("stages", f"seconds of each stage on {device.name}", [stages(n, device) for n in sizes])


if __name__ == "__main__":
    main()
