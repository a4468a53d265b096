"""The graph G = (V, E) with weights mu on which 0-forms and 1-forms live, laid out for the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import read_pairs, read_rows, to_device
from oneform_warp.assembly import Assembly, assemble, gather, listed_edges, on_corners
from oneform_warp.errors import InputError
from oneform_warp.incidence import UniqueEdges
from oneform_warp.intake import faces_on, positions_on
from oneform_warp.order import Boxes, along_a_curve, as_numbered, by_breadth
from oneform_warp.polygons import Faces
from oneform_warp.segments import Segments, largest
from oneform_warp.weights import (
    Weights,
    check_weights,
    cotangent_weights,
    inverse_length_weights,
    kind_named,
    with_listed_weights,
)
from oneform_warp.weld import weld as weld_positions

__all__ = ["Graph"]


@dataclass(frozen=True, eq=False, repr=False)
class Graph(Assembly):
    """Vertices as the caller numbers them, nodes as the solver does, and the edges between nodes.

    A node is one vertex, or several welded ones, in an order that keeps neighbours close. Functions of this package
    take and return values per vertex; edge forms have one row per `edges` row, from its first vertex to its second.
    """

    mu: wp.array[wp.float64]
    """Edge weights, (m,)."""
    listed_mu: wp.array[wp.float64] | None
    """The weights of the listed pairs after the polygons' corners."""

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
        extra_weight: Any = 1.0,
        mesh_of: Any = None,
        device: Any = None,
    ) -> Graph:
        """The polygons' own edges, with mu from the rest positions x.

        x: (V, D); faces: (F, k) array, list of polygons, or (indices, offsets), n-gons welcome. weights: "cotangent",
        "uniform", "inverse_length". weld: join vertices at equal positions (0.0), within a length, or never (None).
        extra_edges: (k, 2) vertex numbers, on top; extra_weight: their mu, one number or (k,). mesh_of: the number of
        each vertex's mesh, (V,) non-decreasing: meshes are not welded to each other, and the nodes of each stand in
        the order that they have alone. device: None for Warp's current one.
        """
        device = wp.get_device(device)
        positions, low, high = positions_on(x, device)
        count = positions.shape[0]
        polygons = faces_on(faces, count, device)
        extra = read_pairs(extra_edges, count, "extra_edges")
        extra_mu = np.asarray(extra_weight, dtype=np.float64)
        extra_mu = np.full(len(extra), extra_mu) if extra_mu.ndim == 0 else extra_mu
        extra_mu = check_weights(extra_mu, len(extra), "extra_weight")
        if not isinstance(weights, str):
            raise InputError(
                "values per edge need the edges first",
                where="weights",
                fix="make the graph by a kind of weights, look at graph.edges, and use graph.with_weights(values)",
            )
        kind_named(weights, faces=True)
        boxes = Boxes(low[None], high[None], wp.zeros(0, dtype=wp.int32, device=device))
        if mesh_of is not None:
            meshes = np.asarray(mesh_of, dtype=np.int32)
            if meshes.shape != (count,) or (np.diff(meshes, prepend=0) < 0).any():
                raise InputError(f"mesh_of is {meshes.shape}", where="mesh_of", fix="give (V,) numbers, ascending")
            boxes = Boxes.of(positions.numpy(), meshes, device)
        groups = weld_positions(positions, weld, None if mesh_of is None else boxes.mesh)
        pairs = on_corners(polygons, extra, groups, device)

        def closeness(edges: UniqueEdges, count: int) -> wp.array[wp.int32]:
            # Breadth-first rings stream through a CPU's caches, a product takes 3/4 of the time; the GPU has no host.
            if device.is_cuda:
                return along_a_curve(positions, groups.first, boxes)
            return by_breadth(edges, count, None if mesh_of is None else boxes.mesh.numpy()[groups.first.numpy()])

        made = assemble(groups, pairs, closeness)
        listed_mu: Any = wp.array(extra_mu, dtype=wp.float64, device=device) if len(extra) else None
        graph = cls(**vars(made), mu=wp.ones(made.edge_count, dtype=wp.float64, device=device), listed_mu=listed_mu)
        return graph._weighted(weights, positions)

    @classmethod
    def from_edges(cls, vertex_count: int, edges: Any, *, weights: Any = None, device: Any = None) -> Graph:
        """A graph from a list of edges (k, 2); weights (k,) > 0, default 1. Parallel edges become one, mu added."""
        return cls._listed(vertex_count, edges, weights, device, by_breadth)

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
        axes = [np.moveaxis(numbers, axis, 0) for axis in range(numbers.ndim)]
        pairs = [np.stack([along[:-1].ravel(), along[1:].ravel()], axis=1) for along in axes]
        return cls._listed(numbers.size, np.concatenate(pairs), None, device, as_numbered)

    @classmethod
    def from_polyline(cls, vertex_count: int, *, closed: bool = False, device: Any = None) -> Graph:
        """Vertices in a row, each joined to the next, the last to the first where closed."""
        numbers = np.arange(vertex_count)
        pairs = np.stack([numbers, np.roll(numbers, -1)], axis=1)
        return cls._listed(vertex_count, pairs if closed else pairs[:-1], None, device, as_numbered)

    @classmethod
    def _listed(cls, vertex_count: int, edges: Any, weights: Any, device: Any, closeness: Any) -> Graph:
        vertex_count = int(vertex_count)
        listed = read_pairs(edges, vertex_count, "edges")
        mu = np.ones(len(listed)) if weights is None else np.asarray(weights, dtype=np.float64)
        mu = check_weights(mu, len(listed))
        device = wp.get_device(device)
        groups = weld_positions(wp.zeros(vertex_count, dtype=wp.vec3d, device=device), None)
        made = assemble(groups, on_corners(None, listed, groups, device), closeness)
        listed_mu: Any = wp.array(mu, dtype=wp.float64, device=device)
        graph = cls(**vars(made), mu=wp.ones(made.edge_count, dtype=wp.float64, device=device), listed_mu=listed_mu)
        return replace(graph, mu=with_listed_weights(graph.listing, 0, listed_mu, graph.mu))

    # ------------------------------------------------------------------ what a graph knows

    @cached_property
    def edges(self) -> NDArray[np.int64]:
        """Each edge as (first vertex, second vertex), (m, 2): row e of a 1-form points from the first to the second."""
        ends = np.stack([self.tail.numpy(), self.head.numpy()], axis=1)
        return self.vertex_at[ends].astype(np.int64)

    @cached_property
    def components(self) -> NDArray[np.int64]:
        """The component of each vertex, (V,)."""
        return self.node_component[self.node_of].astype(np.int64)

    @cached_property
    def edge_segments(self) -> Segments:
        """All edges as one segment, for sums over them."""
        return Segments.from_offsets(np.array([0, self.edge_count]), self.device)

    @cached_property
    def largest_weight(self) -> float:
        """The largest mu, 0 without edges."""
        return largest(self.mu)

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
        return gather(to_device(data, self.device), self.first_vertex)

    def vertices_from(self, nodes: wp.array[wp.vec3d]) -> NDArray[np.float64]:
        """Rows per node -> rows per vertex (V, 3) on the host."""
        values: NDArray[np.float64] = gather(nodes.to(self.device), self.node_of_vertex).numpy()
        return values

    # ------------------------------------------------------------------ weights

    def with_weights(self, weights: Weights, x: Any = None) -> Graph:
        """The same graph with other mu: a kind ("cotangent", "uniform", "inverse_length") or (m,) values > 0.

        x: the rest positions (V, D) that "cotangent" and "inverse_length" measure.
        """
        positions = None if x is None else to_device(read_rows(x, self.vertex_count, "x").data, self.device)
        return self._weighted(weights, positions)

    def _weighted(self, weights: Weights, x: wp.array[wp.vec3d] | None) -> Graph:
        """The one place that reads `weights`; x per vertex."""
        if not isinstance(weights, str):
            mu = check_weights(np.asarray(weights, dtype=np.float64), self.edge_count)
            return replace(self, mu=wp.array(mu, dtype=wp.float64, device=self.device))
        kind = kind_named(weights, faces=self.faces is not None)
        if kind != "uniform" and x is None:
            raise InputError(f"{weights!r} needs rest positions", where="weights", fix="pass x as well")
        nodes: Any = None if x is None else gather(x, self.first_vertex)
        if kind == "cotangent" and self.faces is not None:
            made = cotangent_weights(self.listing, self.faces, nodes)
        elif kind == "inverse_length":
            made = inverse_length_weights(self.tail, self.head, nodes)
        else:
            made = wp.ones(self.edge_count, dtype=wp.float64, device=self.device)
        if self.faces is not None and self.listed_mu is not None:
            made = with_listed_weights(self.listing, self.faces.corners.shape[0], self.listed_mu, made)
        return replace(self, mu=made)

    def merge(self, values: Any) -> Any:
        """A 1-form on the edges as listed -> one on `edges`: turned to their direction, parallel ones averaged.

        values: (k, D), row l along listed edge l, or along polygon corner l -> (m, D). The average is by mu.
        """
        form = read_rows(values, int(self.listing.first.shape[0]), "values")
        edge, sign = listed_edges(self)
        kept = edge >= 0
        own = self.faces is None and self.listed_mu is not None
        weight = self.listed_mu.numpy()[kept] if own and self.listed_mu is not None else np.ones(int(kept.sum()))
        total = np.bincount(edge[kept], weight, self.edge_count)
        sums = [np.bincount(edge[kept], weight * sign[kept] * column, self.edge_count) for column in form.data[kept].T]
        return form.like(np.stack(sums, axis=1) / total[:, None])
