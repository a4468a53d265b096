"""What short cycles miss: how far a 1-form is from exact, in two passes over the nodes.

    q    sum |c_i|^2 / sum |w|^2,  c_i the sum of v around one triangle or quadrangle at node i, w = v - dx on its edges
    rho  correlation of c_i (x) a_i with that of the neighbours, a_i the cycle's area vector

Noise has rho near 0, and around a large cycle its misses add up as a random walk does. What is smooth has rho near 1:
the misses of all small cycles inside a large one add up, in proportion to its area.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.replay import Replay

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


class _Recorded:
    """The launches on one graph, which are recorded, and what they leave: a vec3d per chunk. The graph is not kept."""

    def __init__(self, graph: Graph) -> None:
        self.segments, self.device = graph.segments, graph.device
        self.near = [graph.offsets, graph.neighbours, graph.incident]
        self.ends, self.mu = [graph.tail, graph.head], graph.mu
        self.partial = graph.segments.partials()
        self.first = graph.segments.component_chunks.numpy()[:-1].copy()

    @cached_property
    def misses(self) -> Replay:
        count = self.near[0].shape[0] - 1
        cycle: wp.array[wp.vec4i] = wp.empty(count, dtype=wp.vec4i, device=self.device)
        for kernel in (_triangles, _quadrangles):
            wp.launch(kernel, dim=count, inputs=self.near, outputs=[cycle], device=self.device)
        return self._record(_misses, [*self.ends, cycle], ["x", "v", "miss_out", "area_out"])

    @cached_property
    def agreement(self) -> Replay:
        return self._record(_agreement, self.near[:2], ["miss", "area"])

    @cached_property
    def energies(self) -> Replay:
        return self._record(_energies, [*self.near, self.mu], ["x", "y", "v"])

    def _record(self, kernel: wp.Kernel, fixed: Sequence[Any], changing: Sequence[str]) -> Replay:
        """A kernel over chunks: arrays that stay, rows of vec3d that change, and the partial sums."""
        rows = [wp.empty(0, dtype=wp.vec3d, device=self.device) for _ in changing]
        inputs = [self.segments.chunk_offsets, *fixed, *rows, self.partial]
        launch = wp.launch_tiled(
            kernel,
            dim=[self.segments.chunk_count],
            inputs=inputs,
            block_dim=self.segments.lanes,
            device=self.device,
            record_cmd=True,
        )
        return Replay(launch, changing, keep=inputs)

    def sums(self) -> NDArray[np.float64]:
        """The partial sums by component, (C, 3), in an order that other components do not change."""
        total: NDArray[np.float64] = np.add.reduceat(self.partial.numpy(), self.first)
        return total


_KNOWN: WeakKeyDictionary[Graph, _Recorded] = WeakKeyDictionary()


def _recorded(graph: Graph) -> _Recorded:
    """For the graph's life."""
    if graph not in _KNOWN:
        _KNOWN[graph] = _Recorded(graph)
    return _KNOWN[graph]


class Misses(NamedTuple):
    """Per component with edges, on the host, (C,) each."""

    q: NDArray[np.float64]
    rho: NDArray[np.float64]
    change: NDArray[np.float64]
    """sum |v - dx|^2 over the edges of the cycles."""


def short_cycle_misses(graph: Graph, x: wp.array[wp.vec3d], v: wp.array[wp.vec3d]) -> Misses:
    """q and rho of a 1-form v (m,) and positions x (n,); zero where a component has no short cycle, or v = dx."""
    recorded = _recorded(graph)
    miss, area = wp.empty_like(x), wp.empty_like(x)
    recorded.misses(x, v, miss, area)
    missed, change, _ = recorded.sums().T
    recorded.agreement(miss, area)
    same, most, _ = recorded.sums().T
    return Misses(_ratio(missed, change), _ratio(same, most), change)


def _ratio(part: NDArray[np.float64], whole: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0.0)


def node_energies(
    graph: Graph, x: wp.array[wp.vec3d], y: wp.array[wp.vec3d], v: wp.array[wp.vec3d]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """sum mu_ij |x_j - x_i - v_ij|^2 of each component with edges, (C,), and the same of y.

    Summed in an order that other components do not change.
    """
    recorded = _recorded(graph)
    recorded.energies(x, y, v)
    first, second, _ = recorded.sums().T
    return first, second
