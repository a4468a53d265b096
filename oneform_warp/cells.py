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
from oneform_warp.sorting import group_starts, row_offsets, scan, sort_by_key
from oneform_warp.weights import COTANGENT_RANGE

__all__ = ["Cells", "Meetings", "edge_cells", "face_cells"]

AGREES = 1.0e-6
"""Relative: by how much mu may differ from cotangents that it was made of."""


LARGEST = 64
"""Corners of a cell: all of them are coupled with each other, so that a face of thousands would cost millions."""


@dataclass(frozen=True, eq=False)
class Meetings:
    """Ordered pairs of nodes that meet in a cell, by first node, and the corners with which they do."""

    offsets: wp.array[wp.int32]
    """Node i meets the nodes other[offsets[i]] to other[offsets[i + 1]], (n + 1,)."""
    other: wp.array[wp.int32]
    """(p,), ascending for each node; a node meets itself where a cell has it twice."""
    begin: wp.array[wp.int32]
    """Pair h meets by the corners own[begin[h]] and beside[begin[h]] to those of begin[h + 1], (p + 1,)."""
    own: wp.array[wp.int32]
    """A corner at the first node."""
    beside: wp.array[wp.int32]
    """A corner of the same cell at the second."""


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
    cell: wp.array[wp.int32]
    """The cell of each corner, (C,)."""

    @property
    def count(self) -> int:
        """How many cells there are."""
        return int(self.offsets.shape[0]) - 1

    @cached_property
    def along(self) -> tuple[wp.array[wp.int32], wp.array[wp.int32]]:
        """Where the corners of each edge begin, (m + 1,), in a list where those of one edge stand together."""
        device = self.graph.device
        keys = wp.empty_like(self.edge)
        wp.launch(_undirected, dim=keys.shape[0], inputs=[self.edge], outputs=[keys], device=device)
        ordered, corners = sort_by_key(keys)
        return row_offsets(ordered, self.graph.edge_count), corners

    @cached_property
    def meetings(self) -> Meetings:
        """Who meets whom, and where."""
        device, count = self.graph.device, self.graph.node_count
        sizes = np.diff(self.offsets.numpy()).astype(np.int64)
        ends = np.cumsum(sizes * (sizes - 1))
        begins: wp.array[wp.int32] = wp.array(ends - sizes * (sizes - 1), dtype=wp.int32, device=device)
        total = int(ends[-1]) if len(ends) else 0
        key = wp.empty(total, dtype=wp.int64, device=device)
        pairs = [wp.empty(total, dtype=wp.int32, device=device) for _ in range(2)]
        inputs = [self.offsets, self.corners, begins, max(count, 1)]
        wp.launch(_pairs, dim=self.count, inputs=inputs, outputs=[key, *pairs], device=device)
        key, place = sort_by_key(key)
        starts = group_starts(key)
        number, found = scan(starts)
        node, other, begin = (wp.empty(k, dtype=wp.int32, device=device) for k in (found, found, found + 1))
        own, beside = (wp.empty(total, dtype=wp.int32, device=device) for _ in range(2))
        inputs = [key, place, starts, number, max(count, 1), *pairs]
        wp.launch(_met, dim=total, inputs=inputs, outputs=[node, other, begin, own, beside], device=device)
        begin[found:].fill_(total)
        return Meetings(row_offsets(node, count), other, begin, own, beside)

    @cached_property
    def segments(self) -> Segments:
        """All nodes as one segment, for sums over them."""
        return Segments.from_offsets(np.array([0, self.graph.node_count]), self.graph.device)

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
        order = sort_by_key(upload(first))[1].numpy()
        sizes = sizes[order]
        at = np.repeat(begins[order] - (np.cumsum(sizes) - sizes), sizes) + np.arange(len(corners))
        return cls(
            graph,
            upload(np.concatenate([[0], np.cumsum(sizes)])),
            upload(corners[at]),
            upload(edge[at]),
            wp.array(weight[at], dtype=wp.float64, device=graph.device),
            upload(np.repeat(np.arange(len(sizes)), sizes)),
        )


@wp.kernel(enable_backward=False)
def _undirected(
    # In:
    edge: wp.array[wp.int32],
    # Out:
    edge_out: wp.array[wp.int32],
):
    k = wp.tid()
    edge_out[k] = wp.max(edge[k], ~edge[k])


@wp.kernel(enable_backward=False)
def _pairs(
    # Graph:
    offsets: wp.array[wp.int32],
    corners: wp.array[wp.int32],
    # In:
    begins: wp.array[wp.int32],
    count: wp.int64,
    # Out:
    key_out: wp.array[wp.int64],
    own_out: wp.array[wp.int32],
    beside_out: wp.array[wp.int32],
):
    c = wp.tid()
    t = begins[c]
    for k in range(offsets[c], offsets[c + 1]):
        for l in range(offsets[c], offsets[c + 1]):
            if k != l:
                key_out[t] = wp.int64(corners[k]) * count + wp.int64(corners[l])
                own_out[t] = k
                beside_out[t] = l
                t += 1


@wp.kernel(enable_backward=False)
def _met(
    # In:
    key: wp.array[wp.int64],
    place: wp.array[wp.int32],
    start: wp.array[wp.int32],
    number: wp.array[wp.int32],
    count: wp.int64,
    own: wp.array[wp.int32],
    beside: wp.array[wp.int32],
    # Out:
    node_out: wp.array[wp.int32],
    other_out: wp.array[wp.int32],
    begin_out: wp.array[wp.int32],
    own_out: wp.array[wp.int32],
    beside_out: wp.array[wp.int32],
):
    t = wp.tid()
    own_out[t] = own[place[t]]
    beside_out[t] = beside[place[t]]
    if start[t] == 1:
        h = number[t]
        node_out[h] = wp.int32(key[t] / count)
        other_out[h] = wp.int32(key[t] % count)
        begin_out[h] = t


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
    """Every polygon a cell, or several where it is large, and every edge that was listed besides: spokes and rims.

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
    sides = np.where(edge[:on_faces] < 0, 0, directed[:on_faces])
    sizes, corners, sides, weight = _in_runs(np.diff(offsets), corners, sides, weight)
    return Cells.of(
        graph,
        np.concatenate([sizes, np.full(len(own), 2)]),
        np.concatenate([corners, pairs.ravel()]),
        np.concatenate([sides, np.stack([own, ~own], axis=1).ravel()]),
        np.concatenate([weight, np.stack([mu, np.zeros(len(own))], axis=1).ravel()]),
    )


def _in_runs(
    sizes: NDArray[np.int64], corners: NDArray[np.int64], edge: NDArray[np.int64], weight: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Sizes of rings and their corners, edges and weights, with rings of more than LARGEST corners cut into runs.

    A run ends with the corner where the next one begins, and is closed by a chord of weight 0.
    """
    if sizes.max(initial=0) <= LARGEST:
        return sizes, corners, edge, weight
    ends = np.cumsum(sizes)
    rings: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]] = []
    for begin, end in zip((ends - sizes).tolist(), ends.tolist(), strict=True):
        if end - begin <= LARGEST:
            rings.append((corners[begin:end], edge[begin:end], weight[begin:end]))
            continue
        for first in range(begin, end, LARGEST - 1):
            last = min(first + LARGEST - 1, end)
            closing = corners[begin if last == end else last]
            rings.append(
                (
                    np.append(corners[first:last], closing),
                    np.append(edge[first:last], 0),
                    np.append(weight[first:last], 0.0),
                )
            )
    return (
        np.array([len(ring[0]) for ring in rings]),
        np.concatenate([ring[0] for ring in rings]),
        np.concatenate([ring[1] for ring in rings]),
        np.concatenate([ring[2] for ring in rings]),
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
    k = np.arange(len(corners))
    after_two, before = np.minimum(first + 2, last), np.maximum(last - 1, first)
    opposite = np.where(k == first, after_two, np.where(k == last, before, first))
    following = np.where(k == last, first, k + 1)
    # By column: a cross product of rows takes four times as long.
    columns = [np.ascontiguousarray(column) for column in x.T]
    apex, here, there = corners[opposite], corners, corners[following]
    (a, b, c), (p, q, r) = ([column[end] - column[apex] for column in columns] for end in (here, there))
    u, v, w = b * r - c * q, c * p - a * r, a * q - b * p
    with np.errstate(divide="ignore", invalid="ignore"):
        halves = 0.5 * (a * p + b * q + c * r) / np.sqrt(u * u + v * v + w * w)
    return np.where(np.isfinite(halves), halves, 0.0)
