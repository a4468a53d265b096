"""Where the solve starts from: the rest pose, the previous solution, the integral along a tree, or zero."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np
import warp as wp

from oneform_warp.arrays import read_rows
from oneform_warp.errors import InputError
from oneform_warp.forms import node_differential
from oneform_warp.graph import Graph
from oneform_warp.tree import SpanningTree, integrate_nodes, spanning_tree

__all__ = ["STARTS", "Problem", "Start", "read_start"]

Start = Any
"""One of STARTS, or positions (V, D)."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What a start can be made from, per node."""

    graph: Graph
    rest: wp.array[wp.vec3d]
    v: wp.array[wp.vec3d]
    previous: wp.array[wp.vec3d] | None


def _rest(problem: Problem) -> wp.array[wp.vec3d]:
    return problem.rest


def _previous(problem: Problem) -> wp.array[wp.vec3d]:
    return problem.rest if problem.previous is None else problem.previous


def _zero(problem: Problem) -> wp.array[wp.vec3d]:
    return wp.zeros_like(problem.rest)


def _min_depth(problem: Problem) -> wp.array[wp.vec3d]:
    return _along(problem, spanning_tree(problem.graph))


def _maximal(problem: Problem) -> wp.array[wp.vec3d]:
    return _along(problem, spanning_tree(problem.graph, -_edge_energy(problem)))


def _minimal(problem: Problem) -> wp.array[wp.vec3d]:
    return _along(problem, spanning_tree(problem.graph, _edge_energy(problem)))


def _edge_energy(problem: Problem) -> Any:
    """mu_ij |x_j - x_i - v_ij|^2 with x undeformed: the paper's measure of how wrong the rest pose is on an edge."""
    difference = node_differential(problem.graph, problem.rest).numpy() - problem.v.numpy()
    return problem.graph.mu.numpy() * np.einsum("ij,ij->i", difference, difference)


def _along(problem: Problem, tree: SpanningTree) -> wp.array[wp.vec3d]:
    return integrate_nodes(tree, problem.v, problem.rest).to(problem.graph.device)


STARTS: dict[str, Callable[[Problem], wp.array[wp.vec3d]]] = {
    "rest": _rest,
    "previous": _previous,
    "min_depth": _min_depth,
    "maximal": _maximal,
    "minimal": _minimal,
    "zero": _zero,
}


def read_start(
    start: Start, graph: Graph, dimension: int, to_rest_units: Callable[[Any], Any]
) -> Callable[[Problem], wp.array[wp.vec3d]]:
    """The one place that reads `start`: a name of STARTS, or positions (V, D) in the caller's units.

    -> what makes the start, rows per node, once the problem is there. Trees are rooted near each component's centre,
    where x has its rest position. Raises InputError at once.
    """
    if isinstance(start, str):
        if start not in STARTS:
            near = get_close_matches(start, STARTS, n=1) or ["rest"]
            raise InputError(
                f"there is no start {start!r}",
                where="start",
                fix=f"did you mean {near[0]!r}? starts: {', '.join(STARTS)}, or positions (V, D)",
            )
        return STARTS[start]
    rows = read_rows(start, graph.vertex_count, "start")
    if rows.dimension != dimension:
        raise InputError(
            f"rows of {rows.dimension} numbers, x has {dimension}", where="start", fix="give the shape of x"
        )
    return lambda problem: graph.nodes_from(to_rest_units(rows.data))
