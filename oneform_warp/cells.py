"""Cells: what turns as one in the ARAP energy, polygons (spokes and rims) or single edges (spokes)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.assembly import listed_edges
from oneform_warp.graph import Graph
from oneform_warp.segments import Segments
from oneform_warp.sorting import row_offsets, sort_by_key
from oneform_warp.weights import COTANGENT_RANGE

__all__ = ["Cells", "edge_cells", "face_cells"]

AGREES = 1.0e-6
"""Relative: by how much mu may differ from cotangents that it was made of."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Closed rings of corners; the edge from each corner to the next has this cell's weight w.

    A single edge is a ring of two corners, whose second one has weight 0. The weights of an edge sum to its mu, or to
    less where a cotangent has been clamped.
    """

    graph: Graph
    offsets: wp.array[wp.int32]
    """Cell c has the corners offsets[c] to offsets[c + 1], (cells + 1,)."""
    corners: wp.array[wp.int32]
    """The node of each corner, (C,)."""
    edge: wp.array[wp.int32]
    """The edge from each corner to the next, ~e where it runs against it, (C,); of a loop any, with weight 0."""
    weight: wp.array[wp.float64]
    """(C,)"""
    around_offsets: wp.array[wp.int32]
    """Node i has the corners around[around_offsets[i]] to around[around_offsets[i + 1]], (n + 1,)."""
    around: wp.array[wp.int32]
    cell: wp.array[wp.int32]
    """The cell of each corner, (C,)."""
    along_offsets: wp.array[wp.int32]
    """Edge e has the corners along[along_offsets[e]] to along[along_offsets[e + 1]], (m + 1,)."""
    along: wp.array[wp.int32]

    @property
    def count(self) -> int:
        """How many cells there are."""
        return int(self.offsets.shape[0]) - 1

    @cached_property
    def segments(self) -> Segments:
        """All cells as one segment, for sums over them."""
        return Segments.from_offsets(np.array([0, self.count]), self.graph.device)

    @classmethod
    def of(
        cls,
        graph: Graph,
        sizes: NDArray[np.int64],
        corners: NDArray[np.int64],
        edge: NDArray[np.int64],
        weight: NDArray[np.float64],
    ) -> Cells:
        """sizes: corners of each cell; corners, edge (~e against it) and weight: one for each corner."""

        def upload(values: NDArray[np.int64]) -> wp.array[wp.int32]:
            return wp.array(values.astype(np.int32), dtype=wp.int32, device=graph.device)

        begins = np.cumsum(sizes) - sizes
        # In the order of their first nodes neighbours are close in memory.
        first = np.minimum.reduceat(corners, begins) if len(sizes) else begins
        order = sort_by_key(upload(first))[1].numpy().astype(np.int64)
        sizes = sizes[order]
        at = np.repeat(begins[order] - (np.cumsum(sizes) - sizes), sizes) + np.arange(len(corners))
        ring = upload(corners[at])
        around_offsets, around = _grouped(ring, graph.node_count)
        along_offsets, along = _grouped(upload(np.maximum(edge, ~edge)[at]), graph.edge_count)
        return cls(
            graph,
            upload(np.concatenate([[0], np.cumsum(sizes)])),
            ring,
            upload(edge[at]),
            wp.array(weight[at], dtype=wp.float64, device=graph.device),
            around_offsets,
            around,
            upload(np.repeat(np.arange(len(sizes)), sizes)),
            along_offsets,
            along,
        )


def _grouped(keys: wp.array[wp.int32], count: int) -> tuple[wp.array[wp.int32], wp.array[wp.int32]]:
    """Where the places of each key begin, (count + 1,), and the places, those of one key together."""
    ordered, places = sort_by_key(keys)
    return row_offsets(ordered, count), places


def edge_cells(graph: Graph) -> Cells:
    """Every edge a cell of its own: E = sum_ij mu_ij / 2 (|d_ij - R_i s_ij|^2 + |d_ij - R_j s_ij|^2), the spokes."""
    ends = np.stack([graph.tail.numpy(), graph.head.numpy()], axis=1).astype(np.int64)
    edges = np.arange(graph.edge_count)
    weight = np.stack([graph.mu.numpy(), np.zeros(graph.edge_count)], axis=1)
    return Cells.of(
        graph,
        np.full(graph.edge_count, 2),
        ends.ravel(),
        np.stack([edges, ~edges], axis=1).ravel(),
        weight.ravel(),
    )


def face_cells(graph: Graph, rest: wp.array[wp.vec3d]) -> Cells:
    """Every polygon a cell, and every edge that was listed besides: spokes and rims.

    Where mu are cotangents each triangle has those of its own angles, clamped or not: its part of the energy is then
    Dirichlet's, which is never negative. Otherwise the polygons of an edge have equal shares of its mu. rest: positions
    (n,). A graph without polygons has edges as cells.
    """
    if graph.faces is None or not graph.faces.corners.shape[0]:
        return edge_cells(graph)
    corners = graph.faces.corners.numpy().astype(np.int64)
    offsets = graph.faces.offsets.numpy().astype(np.int64)
    edge, sign = listed_edges(graph)
    on_faces = len(corners)
    listed = _listed_weights(graph, len(edge) - on_faces)
    weight = _shares(graph, corners, offsets, edge, listed, rest.numpy())
    directed = np.where(sign > 0, edge, ~edge)
    own = directed[on_faces:]
    proper = edge[on_faces:] >= 0
    pairs, own, mu = _struts(graph, own[proper]), own[proper], listed[proper]
    return Cells.of(
        graph,
        np.concatenate([np.diff(offsets), np.full(len(own), 2)]),
        np.concatenate([corners, pairs.ravel()]),
        np.concatenate([np.where(edge[:on_faces] < 0, 0, directed[:on_faces]), np.stack([own, ~own], axis=1).ravel()]),
        np.concatenate([weight, np.stack([mu, np.zeros(len(own))], axis=1).ravel()]),
    )


def _listed_weights(graph: Graph, count: int) -> NDArray[np.float64]:
    weights: NDArray[np.float64] = np.zeros(count) if graph.listed_mu is None else graph.listed_mu.numpy()
    return weights


def _struts(graph: Graph, directed: NDArray[np.int64]) -> NDArray[np.int64]:
    """The two nodes of edges, in the direction that ~ says, (k, 2)."""
    own = np.maximum(directed, ~directed)
    ends = np.stack([graph.tail.numpy()[own], graph.head.numpy()[own]], axis=1).astype(np.int64)
    return np.where((directed < 0)[:, None], ends[:, ::-1], ends)


def _shares(
    graph: Graph,
    corners: NDArray[np.int64],
    offsets: NDArray[np.int64],
    edge: NDArray[np.int64],
    listed: NDArray[np.float64],
    x: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The weight of the edge at each corner of a polygon, (C,)."""
    own, extra = edge[: len(corners)], edge[len(corners) :]
    proper = own >= 0
    at = np.where(proper, own, 0)
    mu = graph.mu.numpy() - np.bincount(extra[extra >= 0], listed[extra >= 0], graph.edge_count)
    count = np.bincount(at, proper, graph.edge_count)
    shares = (mu / np.maximum(count, 1))[at]
    halves = np.where(proper, _half_cotangents(corners, offsets, x), 0.0)
    low, high = COTANGENT_RANGE
    clamped = np.clip(np.bincount(at, halves, graph.edge_count), low, high)
    if (np.abs(clamped - mu) <= AGREES * clamped)[count > 0].all():
        sizes = np.diff(offsets)
        # A needle's cotangents have lost their digits, and sum to no Dirichlet energy.
        exact = (sizes == 3) & (np.maximum.reduceat(np.abs(halves), offsets[:-1]) < high)
        shares = np.where(np.repeat(exact, sizes), halves, shares)
    return np.where(proper, shares, 0.0)


def _half_cotangents(
    corners: NDArray[np.int64], offsets: NDArray[np.int64], x: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Half the cotangent of the angle that faces the edge at each corner, in the fan as `cotangent_weights` cuts it."""
    sizes = np.diff(offsets)
    first, last = np.repeat(offsets[:-1], sizes), np.repeat(offsets[1:] - 1, sizes)
    c = np.arange(len(corners))
    after_two, before = np.minimum(first + 2, last), np.maximum(last - 1, first)
    opposite = np.where(c == first, after_two, np.where(c == last, before, first))
    following = np.where(c == last, first, c + 1)
    apex = x[corners[opposite]]
    a, b = x[corners] - apex, x[corners[following]] - apex
    area = np.linalg.norm(np.cross(a, b), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        halves = 0.5 * np.einsum("ij,ij->i", a, b) / area
    return np.where(np.isfinite(halves), halves, 0.0)
