"""The graph G = (V, E) with weights mu on which 0-forms and 1-forms live, laid out for the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp import incidence as rows
from oneform_warp.arrays import read_rows, to_device
from oneform_warp.errors import InputError
from oneform_warp.polygons import Faces, Polygons, as_polygons, polygon_edges
from oneform_warp.segments import Segments
from oneform_warp.weights import Weights, check_weights, edge_weights
from oneform_warp.weld import weld as weld_positions

__all__ = ["Graph"]


@dataclass(frozen=True, eq=False, repr=False)
class Graph:
    """Vertices as the caller numbers them, nodes as the solver does, and the edges between nodes.

    A node is one vertex, or several welded ones, in an order that keeps neighbours close. Functions of this package
    take and return values per vertex; edge forms have one row per `edges` row, from its first vertex to its second.
    """

    vertex_count: int
    node_of: NDArray[np.int64]
    """The node of each vertex, (V,)."""
    vertex_at: NDArray[np.int64]
    """The first vertex of each node, (n,)."""
    node_component: NDArray[np.int64]
    """The component of each node, (n,), non-decreasing; components without an edge come last."""
    solved_components: int
    """How many components have edges; the others are single nodes."""
    tail: wp.array[wp.int32]
    """The node where each edge starts, (m,)."""
    head: wp.array[wp.int32]
    mu: wp.array[wp.float64]
    """Edge weights, (m,)."""
    offsets: wp.array[wp.int32]
    """Node i has the half-edges offsets[i] to offsets[i + 1], (n + 1,)."""
    neighbours: wp.array[wp.int32]
    """The other node of each half-edge, (2 m,)."""
    incident: wp.array[wp.int32]
    """The edge e of each half-edge that runs along it, ~e of one that runs against it, (2 m,)."""
    segments: Segments
    device: Any
    listed_edge: NDArray[np.int64]
    """For each edge as it was listed (polygon corners, then extra edges): e, ~e, or for a loop LOOP, (k,)."""
    listed_mu: NDArray[np.float64] | None
    polygons: Polygons | None
    """The faces, in nodes."""

    LOOP = np.iinfo(np.int64).min

    # ------------------------------------------------------------------ where graphs come from

    @classmethod
    def from_faces(
        cls,
        x: Any,
        faces: Faces,
        *,
        weights: Weights = "cotangent",
        weld: float | None = 0.0,
        extra_edges: Any = None,
        extra_weight: float = 1.0,
        device: Any = None,
    ) -> Graph:
        """The polygons' own edges, with mu from the rest positions x.

        x: (V, D); faces: (F, k) array, list of polygons, or (indices, offsets), n-gons welcome. weights: "cotangent",
        "uniform", "inverse_length". weld: join vertices at equal positions (0.0), within a length, or never (None).
        extra_edges: (k, 2) vertex numbers, each of weight extra_weight on top. device: None for Warp's current one.
        """
        positions = read_rows(x, None, "x")
        vertex_count = len(positions.data)
        polygons = as_polygons(faces, vertex_count)
        extra = _pairs(extra_edges, vertex_count, "extra_edges")
        groups = weld_positions(positions.data, weld)
        polygons = Polygons(groups[polygons.indices], polygons.offsets)
        listed = np.concatenate([polygon_edges(polygons), groups[extra]])
        graph = cls._build(groups, listed, polygons, device)
        graph = replace(graph, listed_mu=check_weights(np.full(len(extra), float(extra_weight)), len(extra)))
        return graph.with_weights(weights, positions.data)

    @classmethod
    def from_edges(cls, vertex_count: int, edges: Any, *, weights: Any = None, device: Any = None) -> Graph:
        """A graph from a list of edges (k, 2); weights (k,) > 0, default 1. Parallel edges become one, mu added."""
        listed = _pairs(edges, vertex_count, "edges")
        mu = np.ones(len(listed)) if weights is None else np.asarray(weights, dtype=np.float64)
        graph = cls._build(np.arange(vertex_count), listed, None, device)
        return replace(graph, listed_mu=check_weights(mu, len(listed)))._weighted(graph._listed_sums(mu))

    @classmethod
    def from_points(cls, x: Any, *, neighbours: int = 8, device: Any = None) -> Graph:
        """Each point joined to its k nearest neighbours, uniform mu. x: (V, D), V > neighbours > 0."""
        from scipy.spatial import cKDTree

        data = read_rows(x, None, "x").data
        if not 0 < neighbours < len(data):
            raise InputError(
                f"{neighbours} neighbours among {len(data)} points", where="neighbours", fix="give 1 to V - 1"
            )
        nearest = cKDTree(data).query(data, k=neighbours + 1)[1]
        # A point is usually its own nearest; among coincident points it need not be, so drop it by number.
        own = nearest == np.arange(len(data))[:, None]
        own[~own.any(axis=1), -1] = True
        pairs = np.stack([np.repeat(np.arange(len(data)), neighbours), nearest[~own]], axis=1)
        return cls.from_edges(len(data), np.unique(np.sort(pairs, axis=1), axis=0), device=device)

    @classmethod
    def from_grid(cls, shape: Sequence[int], *, device: Any = None) -> Graph:
        """The pixels of an image or voxels of a volume joined along the axes; vertices in C order of `shape`."""
        numbers = np.arange(int(np.prod(shape))).reshape(tuple(shape))
        pairs = [
            np.stack(
                [np.moveaxis(numbers, axis, 0)[:-1].ravel(), np.moveaxis(numbers, axis, 0)[1:].ravel()],
                axis=1,
            )
            for axis in range(numbers.ndim)
        ]
        return cls.from_edges(numbers.size, np.concatenate(pairs), device=device)

    @classmethod
    def from_polyline(cls, vertex_count: int, *, closed: bool = False, device: Any = None) -> Graph:
        """Vertices in a row, each joined to the next, the last to the first where closed."""
        numbers = np.arange(vertex_count)
        pairs = np.stack([numbers, np.roll(numbers, -1)], axis=1)
        return cls.from_edges(vertex_count, pairs if closed else pairs[:-1], device=device)

    # ------------------------------------------------------------------ what a graph knows

    @property
    def node_count(self) -> int:
        """Vertices after welding."""
        return len(self.vertex_at)

    @property
    def edge_count(self) -> int:
        """Unique undirected edges, m."""
        return int(self.tail.shape[0])

    @property
    def component_count(self) -> int:
        """Connected components, isolated vertices included."""
        return int(self.node_component[-1]) + 1 if self.node_count else 0

    @cached_property
    def edges(self) -> NDArray[np.int64]:
        """Each edge as (first vertex, second vertex), (m, 2): row e of a 1-form points from the first to the second."""
        return np.stack([self.vertex_at[self.tail.numpy()], self.vertex_at[self.head.numpy()]], axis=1)

    @cached_property
    def components(self) -> NDArray[np.int64]:
        """The component of each vertex, (V,)."""
        return self.node_component[self.node_of]

    @cached_property
    def component_offsets(self) -> NDArray[np.int64]:
        """Component c has the nodes component_offsets[c] to component_offsets[c + 1]."""
        return np.searchsorted(self.node_component, np.arange(self.component_count + 1))

    @cached_property
    def largest_weight(self) -> float:
        """The largest mu, 0 without edges."""
        return float(self.mu.numpy().max(initial=0.0))

    @cached_property
    def copies(self) -> wp.array[wp.float64]:
        """How many vertices each node stands for, (n,)."""
        counts = np.bincount(self.node_of, minlength=self.node_count)
        return wp.array(counts, dtype=wp.float64, device=self.device)

    def __repr__(self) -> str:
        return (
            f"Graph({self.vertex_count} vertices, {self.node_count} nodes, {self.edge_count} edges, "
            f"{self.component_count} components, on {self.device})"
        )

    # ------------------------------------------------------------------ vertices <-> nodes

    def nodes_from(self, data: NDArray[np.float64]) -> wp.array[wp.vec3d]:
        """Rows per vertex (V, 3) -> rows per node on the device; of welded vertices the first counts."""
        return to_device(data[self.vertex_at], self.device)

    def vertices_from(self, nodes: wp.array[wp.vec3d]) -> NDArray[np.float64]:
        """Rows per node -> rows per vertex (V, 3) on the host."""
        values: NDArray[np.float64] = nodes.numpy()[self.node_of]
        return values

    # ------------------------------------------------------------------ weights

    def with_weights(self, weights: Weights, x: Any = None) -> Graph:
        """The same graph with other mu: a kind ("cotangent", "uniform", "inverse_length") or (m,) values > 0.

        x: the rest positions (V, D) that "cotangent" and "inverse_length" measure.
        """
        positions = None if x is None else read_rows(x, self.vertex_count, "x").data[self.vertex_at]
        pairs = np.stack([self.tail.numpy(), self.head.numpy()], axis=1)
        edge_of = np.where(self.listed_edge >= 0, self.listed_edge, ~self.listed_edge)
        edge_of[self.listed_edge == self.LOOP] = -1
        if self.polygons is None:
            return self._weighted(edge_weights(weights, positions, pairs))
        corners = len(self.polygons.indices)
        mu = edge_weights(weights, positions, pairs, self.polygons, edge_of[:corners])
        if isinstance(weights, str) and self.listed_mu is not None and len(self.listed_mu):
            has_face = np.isin(np.arange(self.edge_count), edge_of[:corners])
            extra, kept = edge_of[corners:], edge_of[corners:] >= 0
            mu = mu * has_face + np.bincount(extra[kept], self.listed_mu[kept], self.edge_count)
        return self._weighted(mu)

    def merge(self, values: Any) -> Any:
        """A 1-form on the edges as listed -> one on `edges`: turned to their direction, parallel ones averaged.

        values: (k, D), row l along listed edge l, or along polygon corner l -> (m, D). The average is by mu.
        """
        form = read_rows(values, len(self.listed_edge), "values")
        kept = self.listed_edge != self.LOOP
        sign = np.where(self.listed_edge >= 0, 1.0, -1.0)[kept]
        edge = np.where(self.listed_edge >= 0, self.listed_edge, ~self.listed_edge)[kept]
        own = self.listed_mu is not None and len(self.listed_mu) == len(self.listed_edge)
        weight = self.listed_mu[kept] if own and self.listed_mu is not None else np.ones(int(kept.sum()))
        total = np.bincount(edge, weight, self.edge_count)
        sums = [np.bincount(edge, weight * sign * column, self.edge_count) for column in form.data[kept].T]
        return form.like(np.stack(sums, axis=1) / total[:, None])

    # ------------------------------------------------------------------ assembly

    @classmethod
    def _build(
        cls, groups: NDArray[np.int64], listed: NDArray[np.int64], polygons: Polygons | None, device: Any
    ) -> Graph:
        group_count = int(groups.max()) + 1 if len(groups) else 0
        unique = rows.unique_edges(listed, group_count)
        order, component, solved = rows.locality_order(unique.pairs, group_count)
        node = np.empty(group_count, dtype=np.int64)
        node[order] = np.arange(group_count)
        ends = np.sort(node[unique.pairs], axis=1)
        edge_order = np.lexsort((ends[:, 1], ends[:, 0]))
        edge = np.empty(len(ends), dtype=np.int64)
        edge[edge_order] = np.arange(len(ends))
        tail, head = ends[edge_order].T
        table = rows.incidence(tail, head, group_count)
        first_vertex = np.unique(groups, return_index=True)[1]
        loops = unique.edge_of < 0
        along = node[listed[:, 0]] < node[listed[:, 1]]
        listed_edge = np.where(along, edge[unique.edge_of], ~edge[unique.edge_of]) if len(edge) else unique.edge_of
        offsets = np.searchsorted(component, np.arange(solved + 1))
        device = wp.get_device(device)

        def upload(values: NDArray[Any]) -> wp.array[wp.int32]:
            return wp.array(values.astype(np.int32), dtype=wp.int32, device=device)

        return cls(
            vertex_count=len(groups),
            node_of=node[groups],
            vertex_at=first_vertex[order],
            node_component=component,
            solved_components=solved,
            tail=upload(tail),
            head=upload(head),
            mu=wp.ones(len(tail), dtype=wp.float64, device=device),
            offsets=upload(table.offsets),
            neighbours=upload(table.neighbours),
            incident=upload(table.incident),
            segments=Segments.from_offsets(offsets, device),
            device=device,
            listed_edge=np.where(loops, cls.LOOP, listed_edge),
            listed_mu=None,
            polygons=None if polygons is None else Polygons(node[polygons.indices], polygons.offsets),
        )

    def _listed_sums(self, mu: NDArray[np.float64]) -> NDArray[np.float64]:
        kept = self.listed_edge != self.LOOP
        edge = np.where(self.listed_edge >= 0, self.listed_edge, ~self.listed_edge)
        sums: Any = np.bincount(edge[kept], mu[kept], self.edge_count)
        return sums

    def _weighted(self, mu: NDArray[np.float64]) -> Graph:
        return replace(self, mu=wp.array(mu, dtype=wp.float64, device=self.device))


def _pairs(edges: Any, vertex_count: int, name: str) -> NDArray[np.int64]:
    """Checked vertex pairs (k, 2); None is none."""
    array = np.zeros((0, 2), dtype=np.int64) if edges is None else np.asarray(edges)
    if array.ndim != 2 or array.shape[1] != 2 or (array.size and array.dtype.kind not in "iu"):
        raise InputError(f"an array of shape {array.shape}", where=name, fix="give (k, 2) vertex numbers")
    wrong = ((array < 0) | (array >= vertex_count)).any(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"edge {row} is {array[row].tolist()}, the graph has {vertex_count} vertices",
            where=name,
            fix=f"use vertex numbers from 0 to {vertex_count - 1}",
        )
    return array.astype(np.int64)
