"""Where the solve starts from: the rest pose, the previous solution, the integral along a tree, or zero.

The rule `auto` is measured and explained in docs/tree-study.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows
from oneform_warp.cycles import node_energies, short_cycle_misses
from oneform_warp.errors import InputError
from oneform_warp.forms import node_differential
from oneform_warp.graph import Graph
from oneform_warp.rings import Rings
from oneform_warp.solvers import CG, Jacobi, Multigrid, Solver
from oneform_warp.tree import SpanningTree, integrate_nodes, spanning_tree

__all__ = ["STARTS", "Problem", "Start", "read_start", "worthwhile"]

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
    """Nodes whose place is given, (n,); None where others are only drawn to one."""
    placed: wp.array[wp.vec3d] | None = None
    """The rest pose with the pinned nodes where they are to be; None where that is the rest pose itself."""
    gain: float = 0.0
    """See `worthwhile`."""

    @property
    def begin(self) -> wp.array[wp.vec3d]:
        """The rest pose with the pinned nodes where they are to be."""
        return self.rest if self.placed is None else self.placed


WALK = 10.0
"""Energy of the integral over rings, over q, where misses add up as a random walk: 1.5 to 32 were seen."""

AREA = 4.0
"""The same over n q where they add up by area: 0.5 to 95 were seen up to 90 degrees, 0.5 to 9 on bars."""

COHERENT = 0.25
"""rho above which misses add up: noise has -0.1 to 0, smooth forms up to 90 degrees 0.8 to 1."""


def worthwhile(solver: Solver, device: Any) -> float:
    """The energy of an integral, in parts of the rest pose's, from which on starting there saves time; 0 is never.

    Jacobi and CG, which are slow in what is smooth: 1. Multigrid: 0.03, what one iteration leaves. Direct solvers start
    anywhere. On CUDA: 0, since the integral is made on the host: with copies to and fro it takes 2 to 17 whole solves.
    """
    if device.is_cuda:
        return 0.0
    return {CG: 1.0, Jacobi: 1.0, Multigrid: 0.03}.get(type(solver), 0.0)


def _auto(problem: Problem) -> wp.array[wp.vec3d]:
    """The rest pose, or in a component where that is worthwhile the integral over rings.

    For Jacobi and CG: of the two the one of less energy. Of smooth forms CG took 0.93 of the iterations from an
    integral of less energy (median of 43 cases, 0.54 to 1.07), 1.06 from one of more. For multigrid it is not even made
    unless what short cycles miss, q and rho (see `cycles`), predicts little energy: in parts of the rest pose's 10 q
    for noise and 4 n q for smooth forms. Where it was taken it saved 1 to 5 of 7 to 12 iterations, all where a form is
    exact. See docs/tree-study.md.
    """
    graph, start = problem.graph, problem.begin
    if problem.gain == 0.0 or problem.pinned is None or not graph.solved_components:
        return start
    hopeful = np.ones(graph.solved_components, dtype=bool)
    if problem.gain < 1.0:
        found = short_cycle_misses(graph, start, problem.v)
        sizes = np.diff(graph.component_offsets)[: graph.solved_components]
        hopeful = found.q * np.where(found.rho > COHERENT, AREA * sizes, WALK) < problem.gain
        if not (hopeful.any() and (node_energies(graph, start, start, problem.v)[0][hopeful] > 0.0).any()):
            return start
    rings = _rings(problem)
    resting, own = node_energies(graph, start, rings, problem.v)
    chosen = hopeful & (own < problem.gain * resting)
    if not chosen.any():
        return start
    if chosen.all() and graph.solved_components == graph.component_count:
        return rings
    taken = np.append(chosen, False)[np.minimum(graph.node_component, graph.solved_components)]
    rows = np.where(taken[:, None], rings.numpy(), start.numpy())
    return wp.array(rows, dtype=wp.vec3d, device=graph.device)


_KNOWN: WeakKeyDictionary[Graph, tuple[NDArray[np.bool_], Rings]] = WeakKeyDictionary()
"""The last pins of a graph, and the rings around them."""


def _around(graph: Graph, pinned: NDArray[np.bool_]) -> Rings:
    """The rings around the pinned nodes, kept for the pins that come again."""
    known = _KNOWN.get(graph)
    if known is None or not np.array_equal(known[0], pinned):
        rings = Rings(spanning_tree(graph, roots=graph.vertex_at[pinned]))
        known = _KNOWN[graph] = pinned.copy(), rings
    return known[1]


def _rings(problem: Problem) -> wp.array[wp.vec3d]:
    """The integral from what is pinned outwards, ring by ring; from the centres of what has no pins."""
    graph = problem.graph
    pinned = np.zeros(graph.node_count, dtype=bool) if problem.pinned is None else problem.pinned
    return _around(graph, pinned).integrate(problem.v, problem.begin).to(graph.device)


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
    "rings": _rings,
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
