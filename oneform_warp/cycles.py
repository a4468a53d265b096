"""What short cycles miss: how far a 1-form is from exact, in two passes over the nodes.

    q    sum |c_i|^2 / sum |w|^2,  c_i the sum of v around one triangle or quadrangle at node i, w = v - dx on its edges
    rho  correlation of c_i (x) a_i with that of the neighbours, a_i the cycle's area vector

Noise has rho near 0, and around a large cycle its misses add up as a random walk does. What is smooth has rho near 1:
the misses of all small cycles inside a large one add up, in proportion to its area.
"""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.segments import launch_chunks, sum_chunks

__all__ = ["Misses", "node_energies", "short_cycle_misses"]

ROW = wp.constant(16)
"""Neighbours that are looked at, so that the hub of a star costs no more than others."""

NOWHERE = wp.constant(2147483647)
"""In place of an edge."""


@wp.func
def half_edge_to(
    offsets: wp.array[wp.int32], neighbours: wp.array[wp.int32], incident: wp.array[wp.int32], i: int, j: int
) -> int:
    """The edge from i to j, ~e where it runs to i, NOWHERE where there is none among the first ROW."""
    for h in range(offsets[i], wp.min(offsets[i + 1], offsets[i] + ROW)):
        if neighbours[h] == j:
            return incident[h]
    return NOWHERE


@wp.kernel(enable_backward=False)
def _triangles(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    # Out:
    cycle_out: wp.array[wp.vec4i],
):
    i = wp.tid()
    first = offsets[i]
    cycle = wp.vec4i(NOWHERE, NOWHERE, NOWHERE, NOWHERE)
    for g in range(first + 1, wp.min(offsets[i + 1], first + ROW)):
        if cycle[0] == NOWHERE:
            e = half_edge_to(offsets, neighbours, incident, neighbours[first], neighbours[g])
            if e != NOWHERE:
                cycle = wp.vec4i(incident[first], e, NOWHERE, ~incident[g])
    cycle_out[i] = cycle


@wp.kernel(enable_backward=False)
def _quadrangles(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    # Out:
    cycle_out: wp.array[wp.vec4i],
):
    # Where a node has no triangle: its first neighbour j, a neighbour l of that, and back by another neighbour k.
    i = wp.tid()
    first = offsets[i]
    if cycle_out[i][0] != NOWHERE or offsets[i + 1] == first:
        return
    j = neighbours[first]
    cycle = cycle_out[i]
    for g in range(first + 1, wp.min(offsets[i + 1], first + ROW)):
        for h in range(offsets[j], wp.min(offsets[j + 1], offsets[j] + ROW)):
            if cycle[0] == NOWHERE and neighbours[h] != i:
                e = half_edge_to(offsets, neighbours, incident, neighbours[h], neighbours[g])
                if e != NOWHERE:
                    cycle = wp.vec4i(incident[first], incident[h], e, ~incident[g])
    cycle_out[i] = cycle


_KNOWN: WeakKeyDictionary[Graph, wp.array[wp.vec4i]] = WeakKeyDictionary()


def _cycles(graph: Graph) -> wp.array[wp.vec4i]:
    """A triangle or quadrangle at each node, (n,) edges in turn, ~e against their direction; for the graph's life."""
    if graph not in _KNOWN:
        found: wp.array[wp.vec4i] = wp.empty(graph.node_count, dtype=wp.vec4i, device=graph.device)
        inputs = [graph.offsets, graph.neighbours, graph.incident]
        for kernel in (_triangles, _quadrangles):
            wp.launch(kernel, dim=graph.node_count, inputs=inputs, outputs=[found], device=graph.device)
        _KNOWN[graph] = found
    return _KNOWN[graph]


@wp.kernel(enable_backward=False)
def _misses(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    cycle: wp.array[wp.vec4i],
    # In:
    x: wp.array[wp.vec3d],
    v: wp.array[wp.vec3d],
    # Out:
    miss_out: wp.array[wp.vec3d],
    area_out: wp.array[wp.vec3d],
    square_out: wp.array[wp.vec3d],
):
    chunk, lane = wp.tid()
    square = wp.vec3d()
    for i in range(chunk_offsets[chunk] + lane, chunk_offsets[chunk + 1], wp.block_dim()):
        miss = wp.vec3d()
        area = wp.vec3d()
        there = wp.vec3d()
        for k in range(4):
            code = cycle[i][k]
            if code != NOWHERE:
                e = wp.max(code, ~code)
                sign = wp.where(code < 0, wp.float64(-1.0), wp.float64(1.0))
                d = sign * (x[head[e]] - x[tail[e]])
                w = sign * v[e] - d
                miss += w
                area += wp.cross(there, d)
                there += d
                square += wp.vec3d(wp.float64(0.0), wp.length_sq(w), wp.float64(0.0))
        miss_out[i] = miss
        area_out[i] = area
        square += wp.vec3d(wp.length_sq(miss), wp.float64(0.0), wp.float64(0.0))
    wp.tile_store(square_out, wp.tile_sum(wp.tile(square, preserve_type=True)), offset=chunk)


@wp.kernel(enable_backward=False)
def _agreement(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    # In:
    miss: wp.array[wp.vec3d],
    area: wp.array[wp.vec3d],
    # Out:
    sum_out: wp.array[wp.vec3d],
):
    chunk, lane = wp.tid()
    total = wp.vec3d()
    for i in range(chunk_offsets[chunk] + lane, chunk_offsets[chunk + 1], wp.block_dim()):
        size = wp.length(miss[i]) * wp.length(area[i])
        for h in range(offsets[i], wp.min(offsets[i + 1], offsets[i] + ROW)):
            j = neighbours[h]
            # <c_i (x) a_i, c_j (x) a_j> does not change when a cycle is walked the other way.
            same = wp.dot(miss[i], miss[j]) * wp.dot(area[i], area[j])
            most = size * wp.length(miss[j]) * wp.length(area[j])
            total += wp.vec3d(same, most, wp.float64(0.0))
    wp.tile_store(sum_out, wp.tile_sum(wp.tile(total, preserve_type=True)), offset=chunk)


class Misses(NamedTuple):
    """Per component with edges, on the host, (C,) each."""

    q: NDArray[np.float64]
    rho: NDArray[np.float64]
    change: NDArray[np.float64]
    """sum |v - dx|^2 over the edges of the cycles."""


def short_cycle_misses(graph: Graph, x: wp.array[wp.vec3d], v: wp.array[wp.vec3d]) -> Misses:
    """q and rho of a 1-form v (m,) and positions x (n,); zero where a component has no short cycle, or v = dx."""
    segments = graph.segments
    miss, area = wp.empty_like(x), wp.empty_like(x)
    squares, sums = segments.partials(), segments.partials()
    launch_chunks(_misses, segments, [graph.tail, graph.head, _cycles(graph), x, v], [miss, area, squares])
    launch_chunks(_agreement, segments, [graph.offsets, graph.neighbours, miss, area], [sums])
    missed, change, _ = sum_chunks(segments, squares, segments.zeros()).numpy().T
    same, most, _ = sum_chunks(segments, sums, segments.zeros()).numpy().T
    return Misses(_ratio(missed, change), _ratio(same, most), change)


def _ratio(part: NDArray[np.float64], whole: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0.0)


@wp.kernel(enable_backward=False)
def _energies(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    x: wp.array[wp.vec3d],
    y: wp.array[wp.vec3d],
    v: wp.array[wp.vec3d],
    # Out:
    energy_out: wp.array[wp.vec3d],
):
    chunk, lane = wp.tid()
    energy = wp.vec3d()
    for i in range(chunk_offsets[chunk] + lane, chunk_offsets[chunk + 1], wp.block_dim()):
        for h in range(offsets[i], offsets[i + 1]):
            e = incident[h]
            j = neighbours[h]
            if e >= 0:
                first = wp.length_sq(x[j] - x[i] - v[e])
                energy += mu[e] * wp.vec3d(first, wp.length_sq(y[j] - y[i] - v[e]), wp.float64(0.0))
    wp.tile_store(energy_out, wp.tile_sum(wp.tile(energy, preserve_type=True)), offset=chunk)


def node_energies(
    graph: Graph, x: wp.array[wp.vec3d], y: wp.array[wp.vec3d], v: wp.array[wp.vec3d]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """sum mu_ij |x_j - x_i - v_ij|^2 of each component with edges, (C,), and the same of y.

    Summed in an order that other components do not change.
    """
    segments = graph.segments
    partial = segments.partials()
    inputs = [graph.offsets, graph.neighbours, graph.incident, graph.mu, x, y, v]
    launch_chunks(_energies, segments, inputs, [partial])
    first, second, _ = sum_chunks(segments, partial, segments.zeros()).numpy().T
    return first, second
