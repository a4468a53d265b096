"""The paper's least squares step as one call on arrays."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from oneform_warp.arrays import read_rows, to_device, vertex_mask
from oneform_warp.centroids import keep_centroids
from oneform_warp.errors import InputError
from oneform_warp.graph import Graph
from oneform_warp.solvers.choice import default_solver
from oneform_warp.solvers.solution import Progress, Solution
from oneform_warp.solvers.solver import Solver

__all__ = ["solve"]


def solve(
    graph: Graph,
    v: Any,
    *,
    start: Any = None,
    fixed: Any = None,
    solver: Solver | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Min over x of phi(x) = sum mu_ij |x_j - x_i - v_ij|^2, one graph Laplacian and D right-hand sides.

    v: (m, D) on `graph.edges`. start: (V, D), default zero. fixed: vertices, by index or mask, that stay where `start`
    has them; a component without any keeps the centroid that it has in `start`. solver: default by size.
    -> Solution, its x (V, D) of v's dtype and kind of array. Raises InputError for bad rows, NaN, wrong shapes.
    """
    form = read_rows(v, graph.edge_count, "v")
    where = np.zeros((graph.vertex_count, form.dimension)) if start is None else start
    rows = read_rows(where, graph.vertex_count, "start")
    if rows.dimension != form.dimension:
        raise InputError(
            f"start has D = {rows.dimension} and v has D = {form.dimension}",
            where="start",
            fix="give both the same D",
        )
    pinned = np.zeros(graph.node_count, dtype=bool)
    pinned[graph.node_of[vertex_mask(fixed, graph.vertex_count)]] = True
    chosen = default_solver(graph) if solver is None else solver
    state = chosen.prepare(graph, pinned)
    x = graph.nodes_from(rows.data)
    solution = chosen.solve(state, to_device(form.data, graph.device), x, progress=progress)
    keep_centroids(graph, state.floating, solution.x, x)
    return replace(
        solution,
        x=form.like(graph.vertices_from(solution.x)),
        residual=solution.residual[:, : form.dimension],
        goal=solution.goal[:, : form.dimension],
    )
