"""Fields: a rotation vector omega and a stretch sigma at every vertex, spread from handles over the graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows
from oneform_warp.errors import InputError
from oneform_warp.forms import read_fields
from oneform_warp.graph import Graph
from oneform_warp.grip import Grip, Pins
from oneform_warp.handles import Handle
from oneform_warp.influence import influence
from oneform_warp.solvers import Jacobi, Solution, Solver, States, default_solver

__all__ = ["JUMP_LIMIT", "Fields", "NodeFields", "Smoothing", "fast_edges", "smooth_fields"]

JUMP_LIMIT = np.radians(45.0)
"""A rotation that changes by more than this along one edge is coarsely sampled; at 180 degrees a turn is lost."""


@dataclass(frozen=True, eq=False)
class Fields:
    """omega in radians ((V, 3); D = 2: (V,); D = 1: None) and sigma > 0 (V,), per vertex."""

    omega: Any = None
    sigma: Any = None


@dataclass(frozen=True, eq=False)
class NodeFields:
    """The same per node, on the graph's device, and the solves that made them."""

    omega: wp.array[wp.vec3d]
    sigma: wp.array[wp.float64]
    solutions: tuple[Solution, ...] = ()

    @classmethod
    def of(cls, graph: Graph, fields: Fields, dimension: int) -> NodeFields:
        """Checked fields per vertex -> per node."""
        omega, sigma = read_fields(graph, fields.omega, fields.sigma, dimension)
        return cls(graph.nodes_from(omega), wp.array(sigma[graph.vertex_at], dtype=wp.float64, device=graph.device))

    def per_vertex(self, graph: Graph, dimension: int) -> Fields:
        """As `Fields` on the host, in the shapes of dimension D."""
        omega = graph.vertices_from(self.omega)
        shaped = {1: None, 2: omega[:, 2], 3: omega}[dimension]
        return Fields(shaped, self.sigma.numpy()[graph.node_of])


@dataclass(frozen=True)
class Smoothing:
    """How far handles reach: to the harmonic limit, for a number of sweeps, or over a screening length.

    sweeps: damped Jacobi sweeps from zero, as strokes of a brush blur. length: in the unit of x; fields decay to the
    identity over it: (L + a / length^2) omega = 0 with the area a_i = 1/4 sum_j mu_ij |dx_ij|^2 of each vertex.
    """

    sweeps: int | None = None
    length: float | None = None

    def __post_init__(self) -> None:
        if self.sweeps is not None and self.length is not None:
            raise InputError("sweeps and length are both given", where="smoothing", fix="give one, or none")
        if self.sweeps is not None and (self.sweeps != int(self.sweeps) or self.sweeps < 0):
            raise InputError(f"sweeps is {self.sweeps!r}", where="smoothing", fix="give a whole number >= 0")
        if self.length is not None and not (np.isfinite(self.length) and self.length > 0.0):
            raise InputError(f"length is {self.length}", where="smoothing", fix="give a length > 0")


@wp.kernel(enable_backward=False)
def _exponential(
    # In:
    log_sigma: wp.array[wp.vec3d],
    # Out:
    sigma_out: wp.array[wp.float64],
):
    i = wp.tid()
    sigma_out[i] = wp.exp(log_sigma[i][0])


@wp.kernel(enable_backward=False)
def _areas(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    x: wp.array[wp.vec3d],
    # Out:
    area_out: wp.array[wp.float64],
):
    i = wp.tid()
    area = wp.float64(0.0)
    for h in range(offsets[i], offsets[i + 1]):
        area += mu[wp.max(incident[h], ~incident[h])] * wp.length_sq(x[neighbours[h]] - x[i])
    area_out[i] = area / wp.float64(4.0)


def vertex_areas(graph: Graph, x: wp.array[wp.vec3d]) -> NDArray[np.float64]:
    """a_i = 1/4 sum_j mu_ij |x_j - x_i|^2 per node: the Voronoi area where mu are cotangents."""
    area = wp.empty(graph.node_count, dtype=wp.float64, device=graph.device)
    inputs = [graph.offsets, graph.neighbours, graph.incident, graph.mu, x]
    wp.launch(_areas, dim=graph.node_count, inputs=inputs, outputs=[area], device=graph.device)
    return area.numpy()


def spread(
    pins: Pins, values: NDArray[np.float64], smoothing: Smoothing, x: wp.array[wp.vec3d], states: States
) -> tuple[wp.array[wp.vec3d], Solution | None]:
    """The smooth 0-form with the pinned values: min sum mu_ij |omega_j - omega_i|^2; components without pins get 0.

    values: (handles, 3).
    """
    graph = pins.graph
    if not values.any():
        return wp.zeros(graph.node_count, dtype=wp.vec3d, device=graph.device), None
    no_form = wp.zeros(0, dtype=wp.vec3d, device=graph.device)
    nowhere = np.zeros((graph.component_count, 3))
    if smoothing.sweeps is not None:
        sweeper = Jacobi(tol=0.0, max_iterations=int(smoothing.sweeps))
        state = sweeper.prepare(graph, pins.mask)
        return sweeper.solve(state, no_form, pins.spread_out(values, nowhere)).x, None
    if smoothing.length is not None:
        state = states.of(pins.mask, vertex_areas(graph, x) / smoothing.length**2)
        target = wp.zeros(graph.node_count, dtype=wp.vec3d, device=graph.device)
        solution = states.solver.solve(state, no_form, pins.spread_out(values, nowhere), target=target)
        return solution.x, solution
    start = pins.spread_out(values, pins.means(values))
    if np.array_equal(*pins.extremes(values)):
        # Constant data spread exactly: the mean is already the answer.
        return start, None
    known = influence(pins, states)
    if known is not None:
        return known.blend(pins, values), known.solution
    solution = states.solver.solve(states.of(pins.mask), no_form, start)
    return solution.x, solution


def node_fields(
    grip: Grip,
    handles: Sequence[Handle],
    *,
    dimension: int,
    smoothing: Smoothing,
    x: wp.array[wp.vec3d],
    states: States,
) -> NodeFields:
    """omega and sigma per node from handles; log sigma is what is smoothed, so that sigma stays positive."""
    graph = grip.graph
    turns, stretches = grip.rotations(handles, dimension), grip.log_stretches(handles)
    omega, first = spread(grip.turned, turns, smoothing, x, states)
    log_sigma, second = spread(grip.stretched, stretches, smoothing, x, states)
    sigma = wp.empty(graph.node_count, dtype=wp.float64, device=graph.device)
    wp.launch(_exponential, dim=graph.node_count, inputs=[log_sigma], outputs=[sigma], device=graph.device)
    return NodeFields(omega, sigma, tuple(s for s in (first, second) if s is not None))


def smooth_fields(
    graph: Graph,
    handles: Sequence[Handle],
    *,
    x: Any = None,
    dimension: int = 3,
    sweeps: int | None = None,
    length: float | None = None,
    solver: Solver | None = None,
) -> Fields:
    """omega and log sigma, harmonic on the graph: min sum mu_ij |omega_j - omega_i|^2 with the handles' values.

    x: (V, D) rest positions, needed by `length`; sweeps, length: see `Smoothing`. -> Fields per vertex.
    A component where no handle sets a rotation (stretch) gets omega = 0 (sigma = 1).
    Raises InputError for handles that are empty, contradict each other or turn what D cannot.
    """
    smoothing = Smoothing(sweeps, length)
    if length is not None and x is None:
        raise InputError("a screening length needs positions", where="length", fix="pass x as well")
    data = np.zeros((graph.vertex_count, 3)) if x is None else read_rows(x, graph.vertex_count, "x").data
    nodes = node_fields(
        Grip.of(graph, handles),
        handles,
        dimension=dimension,
        smoothing=smoothing,
        x=graph.nodes_from(data),
        states=States(default_solver(graph) if solver is None else solver, graph),
    )
    return nodes.per_vertex(graph, dimension)


@wp.kernel(enable_backward=False)
def _fast_edges(
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    # In:
    omega: wp.array[wp.vec3d],
    limit: wp.float64,
    # Out:
    count_out: wp.array[wp.int32],
    first_out: wp.array[wp.int32],
):
    e = wp.tid()
    if wp.length(omega[head[e]] - omega[tail[e]]) > limit:
        wp.atomic_add(count_out, 0, 1)
        wp.atomic_min(first_out, 0, e)


def fast_edges(graph: Graph, omega: wp.array[wp.vec3d], limit: float) -> tuple[int, int]:
    """How many edges omega changes along by more than `limit` radians, and the first of them."""
    count = wp.zeros(1, dtype=wp.int32, device=graph.device)
    first = wp.full(1, np.iinfo(np.int32).max, dtype=wp.int32, device=graph.device)
    inputs = [graph.tail, graph.head, omega, limit]
    wp.launch(_fast_edges, dim=graph.edge_count, inputs=inputs, outputs=[count, first], device=graph.device)
    return int(count.numpy()[0]), int(first.numpy()[0])
