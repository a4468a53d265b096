"""Where the solve starts from: the rest pose, the previous solution, the integral along a tree, or zero.

The rule `auto` is measured and explained in docs/tree-study.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows
from oneform_warp.cycles import node_energies, short_cycle_misses
from oneform_warp.errors import InputError
from oneform_warp.forms import node_differential
from oneform_warp.graph import Graph
from oneform_warp.tree import SpanningTree, integrate_nodes, integrate_rings, spanning_tree

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
    pinned: NDArray[np.bool_] | None = None
    """Nodes whose place is given, (n,); None where others are only drawn to one: `auto` is then the rest pose."""
    placed: wp.array[wp.vec3d] | None = None
    """The rest pose with the pinned nodes where they are to be; None where that is the rest pose itself."""


GAIN = 1.0e-3
"""The energy of a tree's estimate over that of the rest pose from which on it saves two iterations of multigrid."""

WALK = 10.0
"""Energy of an estimate over q where misses add up as a random walk: 4 to 18 were seen."""

COHERENT = 0.25
"""rho above which misses add up: noise has -0.2 to 0.05, smooth rotations and stretches 0.6 to 1."""


def _auto(problem: Problem) -> wp.array[wp.vec3d]:
    """The rest pose, except in components whose 1-form is nearly exact: there the integral along a tree.

    Cheap enough to run always: what short cycles miss, q and rho (see `cycles`), predicts the energy of a tree's
    estimate in parts of the rest pose's, 10 q for noise and n q for smooth forms. Where that is below 1e-3, and the
    estimate's own energy then is, the estimate is taken. On CUDA it is the rest pose: trees are made on the host, and
    that takes longer than the iterations that they save.
    """
    graph = problem.graph
    start = problem.rest if problem.placed is None else problem.placed
    if problem.pinned is None or graph.device.is_cuda or not graph.solved_components:
        return start
    found = short_cycle_misses(graph, start, problem.v)
    sizes = np.diff(graph.component_offsets)[: graph.solved_components]
    predicted = found.q * np.where(found.rho > COHERENT, sizes, WALK)
    if not (predicted < GAIN).any():
        return start
    resting = node_energies(graph, start, problem.v)
    if not ((predicted < GAIN) & (resting > 0.0)).any():
        return start
    tree = spanning_tree(graph, roots=graph.vertex_at[problem.pinned])
    estimate = integrate_rings(tree, problem.v, start)
    chosen = (predicted < GAIN) & (node_energies(graph, estimate, problem.v) < GAIN * resting)
    if not chosen.any():
        return start
    taken = np.append(chosen, False)[np.minimum(graph.node_component, graph.solved_components)] & ~problem.pinned
    rows = np.where(taken[:, None], estimate.numpy(), start.numpy())
    return wp.array(rows, dtype=wp.vec3d, device=graph.device)


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
    "auto": _auto,
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
