"""Distance along a graph by heat: the integral of a 1-form of length one. Source: Crane, Weischedel, Wardetzky 2013.

u                                       heat from the sources, after the time t = (mean edge)^2 / 2
X = - grad u / |grad u|                 on each patch: away from the sources
v_ij = X (x_j - x_i)                    the 1-form that the distance has
min sum mu_ij |d_j - d_i - v_ij|^2      the distance d

Heat falls nearly as exp(-d / sqrt(t)), so the gradient of its logarithm is what patches can tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows, vertex_numbers
from oneform_warp.errors import InputError
from oneform_warp.forms import vertex_areas
from oneform_warp.graph import Graph
from oneform_warp.heat import LEAST, heat
from oneform_warp.patches import Patches
from oneform_warp.solvers import Solution, Solver, States, default_solver

__all__ = ["COLUMNS", "Distances", "geodesic_distance"]

COLUMNS = 3
"""Sets of sources that one solve serves."""

FIRST = np.sqrt(0.5)
"""The first sqrt(t) over the mean edge: longer, and heat that came around a limb turns the direction; shorter, and it
follows the edges."""

GROWTH = 3.0
"""From one sqrt(t) to the next, where heat has not arrived after the first: beyond some 400 mean edges."""

STEPS = 10
"""Of growth at most."""

STEEPEST = 1.5
"""Heat falls by no more than exp(-1.5 d / sqrt(t)), in a volume too."""

FLAT = 1.0e-9
"""Part of a patch's size that its thickness counts as: across a flat patch nothing rises, and this divides it."""


@wp.func
def patch_gradient(
    nodes: wp.array[wp.int32],
    begin: int,
    end: int,
    x: wp.array[wp.vec3d],
    u: wp.array[wp.vec3d],
    least: wp.float64,
) -> wp.mat33d:
    """Gradients of log u over a patch by least squares, one in each row: it is nearly linear, u itself is not."""
    centre = wp.vec3d()
    for k in range(begin, end):
        centre += x[nodes[k]] / wp.float64(end - begin)
    spread = wp.mat33d()
    rise = wp.mat33d()
    for k in range(begin, end):
        arm = x[nodes[k]] - centre
        spread += wp.outer(arm, arm)
        level = wp.max(u[nodes[k]], wp.vec3d(least))
        rise += wp.outer(wp.vec3d(wp.log(level[0]), wp.log(level[1]), wp.log(level[2])), arm)
    size = wp.trace(spread)
    if size == wp.float64(0.0):
        return wp.mat33d()
    return rise * wp.inverse(spread / size + wp.float64(FLAT) * wp.identity(n=3, dtype=wp.float64))


@wp.kernel(enable_backward=False)
def _directions(
    # Graph:
    offsets: wp.array[wp.int32],
    nodes: wp.array[wp.int32],
    polygons: int,
    # In:
    x: wp.array[wp.vec3d],
    source: wp.array[wp.vec3d],
    u: wp.array[wp.vec3d],
    trusted: wp.float64,
    # Out:
    direction_out: wp.array[wp.mat33d],
):
    p = wp.tid()
    begin = offsets[p]
    end = offsets[p + 1]
    known = direction_out[p]
    least = u[nodes[begin]]
    inside = source[nodes[begin]]
    for k in range(begin, end):
        least = wp.min(least, u[nodes[k]])
        # From the middle of a star no direction leads away: it counts by its centre, a polygon by all corners.
        if p < polygons:
            inside = wp.min(inside, source[nodes[k]])
    gradient = patch_gradient(nodes, begin, end, x, u, trusted)
    for c in range(3):
        # Columns that are known from a shorter time, that heat has not reached, or inside the sources, stay.
        if wp.length(known[c]) == wp.float64(0.0) and least[c] > trusted and inside[c] < wp.float64(1.0):
            known[c] = -wp.normalize(gradient[c])
    direction_out[p] = known


@wp.kernel(enable_backward=False)
def _unit_form(
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    along_offsets: wp.array[wp.int32],
    along: wp.array[wp.int32],
    # In:
    x: wp.array[wp.vec3d],
    source: wp.array[wp.vec3d],
    direction: wp.array[wp.mat33d],
    # Out:
    v_out: wp.array[wp.vec3d],
):
    e = wp.tid()
    dx = x[head[e]] - x[tail[e]]
    total = wp.vec3d()
    count = wp.vec3d()
    for k in range(along_offsets[e], along_offsets[e + 1]):
        away = direction[along[k]]
        total += away * dx
        for c in range(3):
            count[c] += wp.length_sq(away[c])  # 1, or 0 where it is not known
    between = wp.cw_mul(source[tail[e]], source[head[e]])
    for c in range(3):
        if between[c] > wp.float64(0.0) or count[c] == wp.float64(0.0):
            total[c] = wp.float64(0.0)
    v_out[e] = wp.cw_div(total, wp.max(count, wp.vec3d(wp.float64(1.0))))


class Distances:
    """Distances on a graph at rest, from three sets of nodes at a time.

    x: (n,), any unit. states: with the solver that integrates.
    """

    def __init__(self, graph: Graph, x: wp.array[wp.vec3d], states: States) -> None:
        self.graph, self.x, self.states = graph, x, states
        self._floating = np.zeros(graph.node_count, dtype=bool)

    @cached_property
    def _areas(self) -> NDArray[np.float64]:
        return vertex_areas(self.graph, self.x)

    @cached_property
    def patches(self) -> Patches:
        """Where gradients are taken."""
        return Patches.of(self.graph)

    @cached_property
    def lengths(self) -> NDArray[np.float64]:
        """The mean length of the edges of each component, (components,); 0 where there are none."""
        graph, x = self.graph, self.x.numpy()
        tail, head = graph.tail.numpy(), graph.head.numpy()
        component, count = graph.node_component[tail], graph.component_count
        total = np.bincount(component, np.linalg.norm(x[head] - x[tail], axis=1), count)
        return total / np.maximum(np.bincount(component, minlength=count), 1)

    def of(
        self, sources: Sequence[NDArray[np.integer[Any]]], reach: float = np.inf
    ) -> tuple[NDArray[np.float64], Solution]:
        """(n, 3): the distance to each set of nodes, in the unit of x; infinite in components without a source.

        reach: what is farther away may be less accurate. Columns without a set are infinite.
        """
        graph = self.graph
        mask = np.zeros((graph.node_count, COLUMNS))
        for column, nodes in enumerate(sources):
            mask[nodes, column] = 1.0
        source = wp.array(mask, dtype=wp.vec3d, device=graph.device)
        direction = self._directions(source, mask, reach)
        v = wp.empty(graph.edge_count, dtype=wp.vec3d, device=graph.device)
        inputs = [graph.tail, graph.head, self.patches.along_offsets, self.patches.along, self.x, source, direction]
        wp.launch(_unit_form, dim=graph.edge_count, inputs=inputs, outputs=[v], device=graph.device)
        start = wp.zeros(graph.node_count, dtype=wp.vec3d, device=graph.device)
        solution = self.states.solver.solve(self.states.of(self._floating), v, start)
        return self._from_sources(solution.x.numpy(), mask > 0.0), solution

    def _directions(self, source: wp.array[wp.vec3d], mask: NDArray[np.float64], reach: float) -> wp.array[wp.mat33d]:
        """Unit vectors away from the sources on each patch, in rows by column."""
        graph, patches = self.graph, self.patches
        direction: wp.array[wp.mat33d] = wp.zeros(patches.count, dtype=wp.mat33d, device=graph.device)
        extended = self.lengths > 0.0
        expected = (self._starts(mask > 0.0) & extended[:, None])[graph.node_component]
        length = np.where(extended, self.lengths, np.inf)
        for step in range(STEPS if extended.any() else 0):
            root = FIRST * length * GROWTH**step
            least = max(float(np.exp(-STEEPEST * reach / root.min())), LEAST)
            rate = self._areas / root[graph.node_component] ** 2
            u = heat(graph, wp.array(rate, dtype=wp.float64, device=graph.device), source, least)
            inputs = [patches.offsets, patches.nodes, patches.polygons, self.x, source, u, LEAST]
            wp.launch(_directions, dim=patches.count, inputs=inputs, outputs=[direction], device=graph.device)
            if least > LEAST or (u.numpy() > LEAST)[expected].all():
                break
        return direction

    def _starts(self, sources: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether a component has a source, (components, 3); the distance from others is not known there."""
        starts = np.zeros((self.graph.component_count, COLUMNS), dtype=bool)
        for column in range(COLUMNS):
            starts[self.graph.node_component[sources[:, column]], column] = True
        return starts

    def _from_sources(self, d: NDArray[np.float64], sources: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The integral, with the constant of each component that makes its sources 0."""
        component, count = self.graph.node_component, self.graph.component_count
        result = np.full_like(d, np.inf)
        for column, chosen in enumerate(sources.T):
            sizes = np.bincount(component[chosen], minlength=count)
            with np.errstate(invalid="ignore"):
                means = np.bincount(component[chosen], d[chosen, column], count) / sizes
            known = sizes[component] > 0
            result[known, column] = np.maximum(d[known, column] - means[component[known]], 0.0)
            result[chosen, column] = 0.0
        return result


def geodesic_distance(graph: Graph, x: Any, vertices: Any, *, solver: Solver | None = None) -> NDArray[np.float64]:
    """The distance d of each vertex from `vertices` along the graph: |grad d| = 1, by heat.

    x: rest positions (V, D), any unit; vertices: by number or by mask (V,). -> (V,), in the unit of x, exactly 0 at
    the vertices and infinite in components without them. solver: as for `Deformer`. Raises InputError for no vertices.
    """
    data = read_rows(x, graph.vertex_count, "x").data
    chosen = vertex_numbers(vertices, graph.vertex_count, "vertices")
    if not len(chosen):
        raise InputError("no vertex is given", where="vertices", fix="name one at least to measure from")
    states = States(default_solver(graph) if solver is None else solver, graph)
    distances, _ = Distances(graph, graph.nodes_from(data), states).of([graph.node_of[chosen]])
    return np.asarray(distances[graph.node_of, 0])
