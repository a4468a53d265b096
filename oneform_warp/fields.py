"""Fields: a rotation vector omega and a stretch sigma at every vertex, spread from handles over the graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows
from oneform_warp.errors import InputError
from oneform_warp.falloff import Falloff, Smoothing, read_falloff
from oneform_warp.forms import node_transformed_differential, read_fields
from oneform_warp.graph import Graph
from oneform_warp.grip import Grip, Pins
from oneform_warp.handles import Handle
from oneform_warp.solvers import Solution, Solver, States, default_solver
from oneform_warp.stretches import LogStretch, read_stretch

__all__ = ["JUMP_LIMIT", "Fields", "NodeFields", "Smoothing", "fast_edges", "smooth_fields"]

JUMP_LIMIT = np.radians(45.0)
"""A rotation that changes by more than this along one edge is coarsely sampled; at 180 degrees a turn is lost."""


@dataclass(frozen=True, eq=False)
class Fields:
    """omega in radians ((V, 3); D = 2: (V,); D = 1: None), and sigma > 0 (V,) or stretch (V, D, D), per vertex."""

    omega: Any = None
    sigma: Any = None
    """Factors. Of a given stretch the geometric mean comes out; only one of the two can be given."""
    stretch: Any = None
    """Symmetric positive tensors S in the rest pose, v = R(omega) S dx; None where sigma says it all."""


@dataclass(frozen=True, eq=False)
class NodeFields:
    """The same per node, on the graph's device, and the solves that made them."""

    omega: wp.array[wp.vec3d]
    sigma: wp.array[wp.float64]
    solutions: tuple[Solution, ...] = ()
    log_stretch: LogStretch | None = None
    """Where stretches differ by direction; sigma is then their geometric mean, and not used."""

    @classmethod
    def of(cls, graph: Graph, fields: Fields, dimension: int) -> NodeFields:
        """Checked fields per vertex -> per node."""
        omega, sigma = read_fields(graph, fields.omega, fields.sigma, dimension)
        turns = graph.nodes_from(omega)
        if fields.stretch is None:
            return cls(turns, wp.array(sigma[graph.vertex_at], dtype=wp.float64, device=graph.device))
        if fields.sigma is not None:
            raise InputError("sigma and stretch are both given", where="fields", fix="give one of them")
        log_stretch = LogStretch.of(graph, read_stretch(fields.stretch, graph.vertex_count, dimension))
        return cls(turns, log_stretch.sigma(dimension), (), log_stretch)

    def form(self, graph: Graph, x: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
        """v_ij = sigma_ij R(omega_ij) (x_j - x_i), with S_ij in place of sigma_ij where stretches have directions."""
        if self.log_stretch is None:
            return node_transformed_differential(graph, x, self.omega, self.sigma)
        return self.log_stretch.transformed_differential(graph, x, self.omega)

    def unturned(self) -> NodeFields:
        """The stretches alone, with omega = 0."""
        return replace(self, omega=wp.zeros_like(self.omega))

    def per_vertex(self, graph: Graph, dimension: int) -> Fields:
        """As `Fields` on the host, in the shapes of dimension D."""
        omega = graph.vertices_from(self.omega)
        shaped = {1: None, 2: omega[:, 2], 3: omega}[dimension]
        tensors = None if self.log_stretch is None else self.log_stretch.tensors(graph)[:, :dimension, :dimension]
        return Fields(shaped, self.sigma.numpy()[graph.node_of], tensors)


@wp.kernel(enable_backward=False)
def _exponential(
    # In:
    log_sigma: wp.array[wp.vec3d],
    # Out:
    sigma_out: wp.array[wp.float64],
):
    i = wp.tid()
    sigma_out[i] = wp.exp(log_sigma[i][0])


def node_fields(
    grip: Grip,
    handles: Sequence[Handle],
    *,
    dimension: int,
    falloff: Falloff,
    x: wp.array[wp.vec3d],
    states: States,
) -> NodeFields:
    """omega and sigma per node from handles; log sigma is what is smoothed, so that sigma stays positive.

    Where a handle stretches by three factors, it is the six numbers of log S.
    """
    graph = grip.graph
    turns, tensors = grip.rotations(handles, dimension), grip.log_tensors(handles, dimension)
    logs = grip.log_stretches(handles) if tensors is None else tensors

    def spread(pins: Pins, values: NDArray[np.float64]) -> wp.array[wp.vec3d]:
        if not values.any():
            return wp.zeros(graph.node_count, dtype=wp.vec3d, device=graph.device)
        form, found = falloff.spread(pins, values, x, states)
        solutions.extend(each for each in found if each not in solutions)
        return form

    solutions: list[Solution] = []
    omega = spread(grip.turned, turns)
    if isinstance(logs, tuple):
        log_stretch = LogStretch(*(spread(grip.stretched, each) for each in logs))
        return NodeFields(omega, log_stretch.sigma(dimension), tuple(solutions), log_stretch)
    log_sigma = spread(grip.stretched, logs)
    sigma = wp.empty(graph.node_count, dtype=wp.float64, device=graph.device)
    wp.launch(_exponential, dim=graph.node_count, inputs=[log_sigma], outputs=[sigma], device=graph.device)
    return NodeFields(omega, sigma, tuple(solutions))


def smooth_fields(
    graph: Graph,
    handles: Sequence[Handle],
    *,
    x: Any = None,
    dimension: int = 3,
    sweeps: int | None = None,
    length: float | None = None,
    falloff: Falloff | None = None,
    solver: Solver | None = None,
) -> Fields:
    """omega and log sigma, harmonic on the graph: min sum mu_ij |omega_j - omega_i|^2 with the handles' values.

    x: (V, D) rest positions, needed by all falloffs but the harmonic one, sweeps and paint; sweeps, length: see
    `Smoothing`; falloff: another one, see `falloff`. -> Fields per vertex.
    A component where no handle sets a rotation (stretch) gets omega = 0 (sigma = 1).
    Raises InputError for handles that are empty, contradict each other or turn what D cannot.
    """
    spreading = read_falloff(falloff, sweeps, length)
    if spreading.measures and x is None:
        which, where = ("this falloff", "falloff") if length is None else ("a screening length", "length")
        raise InputError(f"{which} needs positions", where=where, fix="pass x as well")
    data = np.zeros((graph.vertex_count, 3)) if x is None else read_rows(x, graph.vertex_count, "x").data
    nodes = node_fields(
        Grip.of(graph, handles),
        handles,
        dimension=dimension,
        falloff=spreading,
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
