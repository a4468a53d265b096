"""e = L^-1 load: how nodes give way to a load on them, by the inner solver of a state."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.assembly import gather
from oneform_warp.centroids import keep_centroids
from oneform_warp.segments import launch_chunks, sum_chunks
from oneform_warp.solvers.refinement import State, corrected

__all__ = ["Response"]

CORRECTIONS = 10
"""One is usual in float64, and in float32 down to 1e-6."""

ITERATIONS = 20_000
"""Of all corrections together, as many as CG has by default."""


@wp.kernel(enable_backward=False)
def _total(
    chunk_offsets: wp.array[wp.int32],
    # In:
    load: wp.array[wp.vec3d],
    # Out:
    total_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    total = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        total += load[i]
    wp.tile_store(total_out, wp.tile_sum(wp.tile(total, preserve_type=True)), offset=k)


@wp.kernel(enable_backward=False)
def _balanced(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    # In:
    spread: wp.array[wp.float64],
    anchor: wp.array[wp.int32],
    total: wp.array[wp.vec3d],
    # Out:
    load_out: wp.array[wp.vec3d],
    square_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    c = chunk_component[k]
    square = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        load = load_out[i] - spread[c] * total[c]
        if i == anchor[c]:
            load -= total[c]
        load_out[i] = load
        square += wp.cw_mul(load, load)
    wp.tile_store(square_out, wp.tile_sum(wp.tile(square, preserve_type=True)), offset=k)


@wp.kernel(enable_backward=False)
def _remaining(
    chunk_offsets: wp.array[wp.int32],
    # In:
    load: wp.array[wp.vec3d],
    # Out:
    r_out: wp.array[wp.vec3d],
    square_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    square = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        r = r_out[i] + load[i]
        r_out[i] = r
        square += wp.cw_mul(r, r)
    wp.tile_store(square_out, wp.tile_sum(wp.tile(square, preserve_type=True)), offset=k)


@wp.kernel(enable_backward=False)
def _add_at(
    # In:
    node: wp.array[wp.int32],
    value: wp.array[wp.vec3d],
    pinned: wp.array[wp.int32],
    # Out:
    load_out: wp.array[wp.vec3d],
):
    k = wp.tid()
    if pinned[node[k]] == 0:
        load_out[node[k]] = load_out[node[k]] + value[k]


class Response:
    """Displacements e with L e = load at the nodes that may move, to |L e - load| <= tol |load| per component.

    A load on a floating component is balanced by an equal share on every node, and e keeps its centroid.
    """

    def __init__(self, state: State, tol: float) -> None:
        self.state, self.tol = state, tol
        graph, system = state.system.graph, state.system
        count, device = graph.node_count, graph.device
        sizes = np.diff(graph.component_offsets[: graph.solved_components + 1])
        self._spread = wp.array(system.floating / np.maximum(sizes, 1), dtype=wp.float64, device=device)
        self._nowhere = wp.zeros(count, dtype=wp.vec3d, device=device)
        self._no_form = wp.zeros(0, dtype=wp.vec3d, device=device)
        self._r = wp.zeros(count, dtype=wp.vec3d, device=device)
        self._square = graph.segments.partials()
        self._no_square = graph.segments.partials()
        self._sum = graph.segments.zeros()

    def add_load(self, load: wp.array[wp.vec3d], at: wp.array[wp.int32], values: NDArray[np.float64]) -> None:
        """Adds values (k, 3) to the load, in place, at the nodes `at` (k,), each listed once, that may move."""
        inputs = [at, wp.array(values, dtype=wp.vec3d, device=load.device), self.state.system.pinned]
        wp.launch(_add_at, dim=at.shape[0], inputs=inputs, outputs=[load], device=load.device)

    def balance(self, load: wp.array[wp.vec3d]) -> NDArray[np.float64]:
        """Makes the load on each component without pins sum to zero, in place -> its norms, (components, 3).

        What floats takes the difference on all nodes, what hangs on one pin takes it there.
        """
        system, segments = self.state.system, self.state.system.graph.segments
        launch_chunks(_total, segments, [load], [self._square])
        total = sum_chunks(segments, self._square, segments.zeros())
        inputs = [segments.chunk_component, self._spread, system.anchors.node, total]
        launch_chunks(_balanced, segments, inputs, [load, self._square])
        norms: NDArray[np.float64] = np.sqrt(sum_chunks(segments, self._square, self._sum).numpy())
        return norms

    def displacement(self, load: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
        """L^-1 load, (n,); the load is balanced in place."""
        state, graph = self.state, self.state.system.graph
        e: wp.array[wp.vec3d] = wp.zeros_like(load)
        waiting = self.balance(load)
        if not waiting.any():
            return e
        system, goals = state.system, state.system.goals
        goals.set([self._square, self._square, self._no_square], self.tol)
        wp.copy(self._r, load)
        for _ in range(CORRECTIONS):
            goals.take_aim(state.inner.floor)
            e = corrected(graph, e, state.inner.correct(self._r, ITERATIONS, None))
            system.residual(e, self._no_form, self._nowhere, self._r)
            launch_chunks(_remaining, graph.segments, [load], [self._r, self._square])
            goals.measure(self._square)
            norm, _, goal = goals.account()
            before, waiting = waiting, np.where(norm > goal, norm, 0.0)
            # One that no longer halves what is left is at the limit of its precision.
            if not (waiting[waiting > 0.0] <= 0.5 * before[waiting > 0.0]).any():
                break
        system.anchors.restore(e, self._nowhere)
        keep_centroids(graph, system.floating, e, self._nowhere)
        return e

    def to_forms(self, forms: Any, nodes: NDArray[np.int64]) -> NDArray[np.float64]:
        """<form_p, L^-1 form_q> of scalar 0-forms (nodes, k), a csc_array over these nodes -> (k, k)."""
        device = self.state.system.graph.device
        at: wp.array[wp.int32] = wp.array(nodes, dtype=wp.int32, device=device)
        count = forms.shape[1]
        table = np.zeros((count, count))
        for first in range(0, count, 3):
            some = forms[:, first : first + 3].toarray()
            loaded = np.flatnonzero(some.any(axis=1))
            values = np.zeros((len(loaded), 3))
            values[:, : some.shape[1]] = some[loaded]
            load: wp.array[wp.vec3d] = wp.zeros_like(self._nowhere)
            self.add_load(load, wp.array(nodes[loaded], dtype=wp.int32, device=device), values)
            moved = gather(self.displacement(load), at).numpy()[:, : some.shape[1]]
            table[:, first : first + 3] = forms.T @ moved
        return table
