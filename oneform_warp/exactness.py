"""Is a 1-form the differential of something? Integrals along paths, and what cycles miss."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows
from oneform_warp.errors import InputError
from oneform_warp.forms import differential
from oneform_warp.graph import Graph
from oneform_warp.tree import integrate_tree, spanning_tree

__all__ = ["cycle_residual", "is_exact", "path_integral"]


def path_integral(graph: Graph, v: Any, path: Sequence[int]) -> NDArray[np.float64]:
    """The sum of v along a path of vertices, each joined to the next by an edge -> (D,).

    Raises InputError at the first step that is not an edge.
    """
    rows = read_rows(v, graph.edge_count, "v")
    nodes = graph.node_of[np.asarray(path, dtype=np.int64)]
    offsets, neighbours, incident = (a.numpy() for a in (graph.offsets, graph.neighbours, graph.incident))
    total = np.zeros(3)
    for step, (i, j) in enumerate(pairwise(nodes)):
        if i == j:
            continue
        row = slice(offsets[i], offsets[i + 1])
        at = np.flatnonzero(neighbours[row] == j)
        if not len(at):
            raise InputError(
                f"vertices {path[step]} and {path[step + 1]} have no edge",
                where=f"step {step} of the path",
                fix="list neighbouring vertices",
            )
        half_edge = incident[row][at[0]]
        total += rows.data[half_edge] if half_edge >= 0 else -rows.data[~half_edge]
    return total[: rows.dimension]


def cycle_residual(graph: Graph, v: Any) -> NDArray[np.float64]:
    """|v_ij - (x_j - x_i)| of every edge, x the integral of v along a spanning tree: what each closing edge misses.

    v: (m, D) -> (m,) float64 in v's unit; zero on the tree's own edges, and everywhere when v is exact.
    """
    rows = read_rows(v, graph.edge_count, "v")
    x = integrate_tree(spanning_tree(graph), rows.data)
    return np.linalg.norm(rows.data - differential(graph, x), axis=1)


def is_exact(graph: Graph, v: Any, *, tolerance: float = 1e-9) -> bool:
    """Whether v = dx for some x: no cycle misses by more than tolerance times the root mean square of |v|."""
    rows = read_rows(v, graph.edge_count, "v")
    scale = float(np.sqrt((rows.data**2).sum(axis=1).mean())) if graph.edge_count else 0.0
    return bool((cycle_residual(graph, v) <= tolerance * scale).all())
