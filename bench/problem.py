"""Work W: a mesh, weights, pins and a twisted 1-form, as ours and every peer get it, and its float64 solution."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial import Delaunay

import oneform_warp as ow
from bench.options import vertex_count
from bench.stages import jittered_grid
from bench.table import Timing, timed
from oneform_warp.forms import node_differential, node_transform
from oneform_warp.solvers.system import System

TWIST = np.array([1.0, 2.0, 3.0])
"""Radians along the axes per unit of height: far from exact."""


@dataclass(frozen=True)
class Case:
    """A line of Work W, by name."""

    mesh: str
    """"sphere:7" (an icosphere of level 7), "delaunay:100k" or "grid:100k"."""
    weights: str = "cotangent"
    pins: str = "one"
    """"one" vertex, or "tenth" of them, at random."""

    def __str__(self) -> str:
        return f"{self.mesh}, {self.weights}, {self.pins} pinned"


def mesh(name: str) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    """Positions (V, 3) and faces (F, 3)."""
    kind, size = name.split(":")
    if kind == "sphere":
        return ow.shapes.sphere(int(size))
    if kind == "grid":
        return jittered_grid(vertex_count(size))
    count = vertex_count(size)
    side = round(count**0.5)
    rng = np.random.default_rng(0)
    cell = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    points = (cell + rng.uniform(-0.4, 0.4, cell.shape)) * (2.0 / side) - 1.0
    return np.column_stack([points, np.zeros(len(points))]), Delaunay(points).simplices


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything is per node, in the order of the graph, which keeps neighbours close: the peers get it for free."""

    case: Case
    graph: ow.Graph
    graph_time: Timing
    pinned: NDArray[np.bool_]
    start: wp.array[wp.vec3d]
    """The undeformed positions, (n,)."""
    v: wp.array[wp.vec3d]
    """The 1-form, (m,)."""

    @classmethod
    def of(cls, case: Case, device: Any) -> Problem:
        x, faces = mesh(case.mesh)
        given = x, faces
        if device.is_cuda:
            # A mesh that is on the device already, as a pipeline there has it.
            given = (wp.array(x, dtype=wp.vec3d), wp.array(faces.astype(np.int32), dtype=wp.vec3i))
        graph, took = timed(lambda: ow.Graph.from_faces(*given, weights=case.weights, weld=None, device=device))
        pinned = np.zeros(graph.node_count, dtype=bool)
        if case.pins == "tenth":
            pinned[np.random.default_rng(1).permutation(len(pinned))[: len(pinned) // 10]] = True
        else:
            pinned[graph.node_of[0]] = True
        start = graph.nodes_from(x)
        height = x[:, 2] if np.ptp(x[:, 2]) > 0.0 else x[:, 0]
        omega = graph.nodes_from(height[:, None] * TWIST)
        sigma = wp.ones(graph.node_count, dtype=wp.float64, device=graph.device)
        v = node_transform(graph, node_differential(graph, start), omega, sigma)
        return cls(case, graph, took, pinned, start, v)

    @cached_property
    def free(self) -> NDArray[np.int64]:
        """The nodes that are not pinned."""
        return np.flatnonzero(~self.pinned)

    @cached_property
    def matrix(self) -> csr_matrix:
        """The graph Laplacian over the free nodes, float64 with int32 indices."""
        graph = self.graph
        offsets, neighbours = graph.offsets.numpy(), graph.neighbours.numpy()
        incident = graph.incident.numpy()
        mu = graph.mu.numpy()[np.where(incident < 0, ~incident, incident)]
        count = graph.node_count
        weights = csr_matrix((-mu, neighbours, offsets), shape=(count, count))
        diagonal = csr_matrix((-weights.sum(axis=1).A1, (np.arange(count), np.arange(count))), shape=(count, count))
        inside = (weights + diagonal).tocsr()[self.free][:, self.free].tocsr()
        inside.sort_indices()
        inside.indices, inside.indptr = inside.indices.astype(np.int32), inside.indptr.astype(np.int32)
        return inside

    @cached_property
    def right_hand_side(self) -> NDArray[np.float64]:
        """The residual codiff(v - dx) of the start over the free nodes, (free, 3): peers solve for a displacement."""
        r = wp.zeros_like(self.start)
        System.of(self.graph, self.pinned).residual(self.start, self.v, self.start, r)
        return r.numpy()[self.free]

    @cached_property
    def reference(self) -> NDArray[np.float64]:
        """The minimiser, iterated in float64 to 1e-12."""
        solver = ow.Multigrid(tol=1e-12, dtype="float64")
        solution = solver.solve(solver.prepare(self.graph, self.pinned), self.v, self.start)
        x = solution.x.numpy()
        print(f"  reference: {solution.status.word} after {solution.iterations} iterations in float64", flush=True)
        return x

    def moved(self, displacement: Any) -> NDArray[np.float64]:
        """Positions (n, 3) from a displacement of the free nodes, (free, 3)."""
        x = self.start.numpy().copy()
        x[self.free] += displacement
        return x

    def error(self, x: NDArray[np.float64]) -> float:
        """|x - x_ref| / |x_ref - mean|, Euclidean norms over all nodes and columns."""
        spread = np.linalg.norm(self.reference - self.reference.mean(axis=0))
        return float(np.linalg.norm(x - self.reference) / spread)
