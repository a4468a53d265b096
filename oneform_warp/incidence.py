"""Edges made unique and sorted, and their CSR incidence; on the device."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import warp as wp

from oneform_warp.errors import InputError
from oneform_warp.sorting import group_starts, row_offsets, scan, sort_by_key

__all__ = ["LOOP", "Incidence", "UniqueEdges", "check_limits", "incidence", "sorted_edges", "unique_edges"]

INT32_LIMIT = 2**31 - 1
LOOP = np.iinfo(np.int32).min
"""The edge of a listed pair whose ends are one node."""

NO_EDGE = wp.constant(wp.int64(2**62))


class UniqueEdges(NamedTuple):
    """Undirected edges without loops or repeats, each with the listed pairs that it came from."""

    low: wp.array[wp.int32]
    """The smaller end, (m,); edges are in lexicographic order of (low, high)."""
    high: wp.array[wp.int32]
    offsets: wp.array[wp.int32]
    """Edge e came from the listed pairs listed[offsets[e]] to listed[offsets[e + 1]], (m + 1,)."""
    listed: wp.array[wp.int32]


class Incidence(NamedTuple):
    """CSR rows of half-edges: node i has the half-edges offsets[i] to offsets[i + 1]."""

    offsets: wp.array[wp.int32]
    neighbours: wp.array[wp.int32]
    incident: wp.array[wp.int32]
    """The edge e of a half-edge that runs along it, ~e of one that runs against it."""


def check_limits(node_count: int, edge_count: int) -> None:
    """InputError, before anything is allocated, when half-edges cannot be numbered by int32."""
    if max(node_count, 2 * edge_count) > INT32_LIMIT:
        raise InputError(
            f"{node_count} vertices and {edge_count} edges are more than int32 can number",
            where="graph",
            fix="split the mesh into pieces below 2^31 half-edges",
        )


@wp.kernel(enable_backward=False)
def _edge_keys(
    # In:
    first: wp.array[wp.int32],
    second: wp.array[wp.int32],
    count: wp.int64,
    # Out:
    key_out: wp.array[wp.int64],
):
    k = wp.tid()
    low = wp.min(first[k], second[k])
    high = wp.max(first[k], second[k])
    key_out[k] = wp.where(low == high, NO_EDGE, wp.int64(low) * count + wp.int64(high))


@wp.kernel(enable_backward=False)
def _edges_from_keys(
    # In:
    key: wp.array[wp.int64],
    start: wp.array[wp.int32],
    offset: wp.array[wp.int32],
    count: wp.int64,
    # Out:
    low_out: wp.array[wp.int32],
    high_out: wp.array[wp.int32],
    first_out: wp.array[wp.int32],
):
    k = wp.tid()
    if start[k] == 1:
        low_out[offset[k]] = wp.int32(key[k] / count)
        high_out[offset[k]] = wp.int32(key[k] % count)
        first_out[offset[k]] = k


@wp.kernel(enable_backward=False)
def _count_proper(
    # In:
    key: wp.array[wp.int64],
    # Out:
    proper_out: wp.array[wp.int32],
):
    k = wp.tid()
    last = key[k] < NO_EDGE
    if k + 1 < key.shape[0]:
        last = last and key[k + 1] == NO_EDGE
    if last:
        proper_out[0] = k + 1


def unique_edges(first: wp.array[wp.int32], second: wp.array[wp.int32], node_count: int) -> UniqueEdges:
    """Listed pairs (k,) of node numbers -> UniqueEdges. InputError when int32 cannot number them."""
    check_limits(max(node_count, first.shape[0]), 0)
    device, listed = first.device, first.shape[0]
    key = wp.empty(listed, dtype=wp.int64, device=device)
    wp.launch(_edge_keys, dim=listed, inputs=[first, second, node_count], outputs=[key], device=device)
    key, place = sort_by_key(key)
    starts = group_starts(key, 2**62)
    numbers, total = scan(starts)
    check_limits(node_count, total)
    low, high = (wp.empty(total, dtype=wp.int32, device=device) for _ in range(2))
    offsets = wp.empty(total + 1, dtype=wp.int32, device=device)
    inputs = [key, starts, numbers, max(node_count, 1)]
    wp.launch(_edges_from_keys, dim=listed, inputs=inputs, outputs=[low, high, offsets], device=device)
    # Loops stand at the end of the order, after the last edge's pairs.
    wp.launch(_count_proper, dim=listed, inputs=[key], outputs=[offsets[total:]], device=device)
    if total == 0:
        offsets.zero_()
    return UniqueEdges(low, high, offsets, place)


@wp.kernel(enable_backward=False)
def _renumbered(
    # In:
    low: wp.array[wp.int32],
    high: wp.array[wp.int32],
    node: wp.array[wp.int32],
    count: wp.int64,
    # Out:
    key_out: wp.array[wp.int64],
):
    e = wp.tid()
    i = node[low[e]]
    j = node[high[e]]
    key_out[e] = wp.int64(wp.min(i, j)) * count + wp.int64(wp.max(i, j))


@wp.kernel(enable_backward=False)
def _ends(
    # In:
    key: wp.array[wp.int64],
    count: wp.int64,
    # Out:
    tail_out: wp.array[wp.int32],
    head_out: wp.array[wp.int32],
):
    e = wp.tid()
    tail_out[e] = wp.int32(key[e] / count)
    head_out[e] = wp.int32(key[e] % count)


def sorted_edges(
    edges: UniqueEdges, node: wp.array[wp.int32]
) -> tuple[wp.array[wp.int32], wp.array[wp.int32], wp.array[wp.int32]]:
    """(tail, head, the unique edge each was) in the order of the nodes, tail < head."""
    total, count, device = edges.low.shape[0], node.shape[0], node.device
    key = wp.empty(total, dtype=wp.int64, device=device)
    inputs = [edges.low, edges.high, node, max(count, 1)]
    wp.launch(_renumbered, dim=total, inputs=inputs, outputs=[key], device=device)
    key, place = sort_by_key(key)
    tail, head = (wp.empty(total, dtype=wp.int32, device=device) for _ in range(2))
    wp.launch(_ends, dim=total, inputs=[key, max(count, 1)], outputs=[tail, head], device=device)
    return tail, head, place


@wp.kernel(enable_backward=False)
def _half_edges(
    # In:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    # Out:
    origin_out: wp.array[wp.int32],
):
    e = wp.tid()
    origin_out[e] = head[e]
    origin_out[tail.shape[0] + e] = tail[e]


@wp.kernel(enable_backward=False)
def _filled(
    # In:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    place: wp.array[wp.int32],
    # Out:
    neighbour_out: wp.array[wp.int32],
    incident_out: wp.array[wp.int32],
):
    h = wp.tid()
    e = place[h]
    if e < tail.shape[0]:
        neighbour_out[h] = tail[e]
        incident_out[h] = ~e
    else:
        neighbour_out[h] = head[e - tail.shape[0]]
        incident_out[h] = e - tail.shape[0]


def incidence(tail: wp.array[wp.int32], head: wp.array[wp.int32], node_count: int) -> Incidence:
    """Edges tail -> head, sorted -> Incidence; each row has its neighbours in ascending order."""
    total, device = tail.shape[0], tail.device
    origin = wp.empty(2 * total, dtype=wp.int32, device=device)
    wp.launch(_half_edges, dim=total, inputs=[tail, head], outputs=[origin], device=device)
    origin, place = sort_by_key(origin)
    neighbours, incident = (wp.empty(2 * total, dtype=wp.int32, device=device) for _ in range(2))
    wp.launch(_filled, dim=2 * total, inputs=[tail, head, place], outputs=[neighbours, incident], device=device)
    return Incidence(row_offsets(origin, node_count), neighbours, incident)
