"""Laplacian smoothing as the solver stopped early: v = 0, and a number of damped Jacobi sweeps.

With v = 0 and equal weights a sweep is x_i += 2/3 (mean of the neighbours - x_i), the classic smoothing step.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.sparse import coo_array

import oneform_warp as ow
from meshes import Floats, box
from pictures import figure_folder, report, save_row


def noisy_sphere(level: int = 4, noise: float = 0.02) -> tuple[ow.Graph, Floats, Floats]:
    """-> graph with equal weights, positions of a sphere with noise along the radius, faces."""
    x, faces = ow.shapes.sphere(level)
    x = x * (1.0 + noise * np.random.default_rng(0).standard_normal((len(x), 1)))
    return ow.Graph.from_faces(x, faces, weights="uniform"), x, faces


def smooth(graph: ow.Graph, x: Floats, sweeps: int) -> Floats:
    """The positions after some sweeps; the centroid stays."""
    zero = np.zeros((graph.edge_count, 3))
    return ow.solve(graph, zero, start=x, solver=ow.Jacobi(tol=0.0, max_iterations=sweeps)).x


def smooth_by_numpy(graph: ow.Graph, x: Floats, sweeps: int) -> Floats:
    """The same by the formula."""
    i, j = graph.edges.T
    ends = (np.concatenate([i, j]), np.concatenate([j, i]))
    adjacency = coo_array((np.ones(2 * len(i)), ends), shape=(len(x), len(x))).tocsr()
    degree = adjacency.sum(axis=1)[:, None]
    y = x.copy()
    for _ in range(sweeps):
        y += 2.0 / 3.0 * (adjacency @ y / degree - y)
    return y - y.mean(axis=0) + x.mean(axis=0)


def roughness(x: Floats) -> float:
    """The standard deviation of the radius over its mean: 0 for a sphere."""
    radius = np.linalg.norm(x - x.mean(axis=0), axis=1)
    return float(radius.std() / radius.mean())


def numbers(sweeps: int = 20) -> dict[str, float]:
    graph, x, _ = noisy_sphere()
    y = smooth(graph, x, sweeps)
    return {
        "distance from NumPy's sweeps / box": float(np.abs(y - smooth_by_numpy(graph, x, sweeps)).max() / box(x)),
        "roughness before": roughness(x),
        "roughness after": roughness(y),
    }


def main(folder: Path) -> None:
    report(numbers())
    graph, x, faces = noisy_sphere()
    items = [(f"sweeps: {sweeps}", smooth(graph, x, sweeps), faces) for sweeps in (0, 1, 3, 10)]
    save_row(folder / "laplacian_smoothing.png", items, height=400)


if __name__ == "__main__":
    main(figure_folder())
