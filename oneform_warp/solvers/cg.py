"""Conjugate gradients with the Jacobi preconditioner, each component and column with its own alpha and beta."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.segments import launch_chunks, launch_components, sum_of_chunks
from oneform_warp.solvers.goals import Goals, attainable
from oneform_warp.solvers.loop import Loop
from oneform_warp.solvers.precision import FLOAT32, in_both_precisions, precision_named
from oneform_warp.solvers.refinement import Correction, Refining, State, Watch
from oneform_warp.solvers.rows import LaplacianRows, scaled_right_hand_side
from oneform_warp.solvers.system import System
from oneform_warp.solvers.validation import check_limits

__all__ = ["CG"]

Scalar = wp.float32
Vector = wp.vec3

BATCH = 8
"""Iterations between two looks at the residual from the host."""


@in_both_precisions
def _start(
    chunk_offsets: wp.array[wp.int32],
    # In:
    inverse_diagonal: wp.array[Scalar],
    r: wp.array[Vector],
    # Out:
    e_out: wp.array[wp.vec3d],
    p_out: wp.array[Vector],
    rz_out: wp.array[wp.vec3d],
    rr_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    rz = wp.vec3d()
    rr = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        z = inverse_diagonal[i] * r[i]
        e_out[i] = wp.vec3d()
        p_out[i] = z
        rz += wp.vec3d(wp.cw_mul(r[i], z))
        rr += wp.vec3d(wp.cw_mul(r[i], r[i]))
    wp.tile_store(rz_out, wp.tile_sum(wp.tile(rz, preserve_type=True)), offset=k)
    wp.tile_store(rr_out, wp.tile_sum(wp.tile(rr, preserve_type=True)), offset=k)


@in_both_precisions
def product_and_dot(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[Scalar],
    attachment: wp.array[Scalar],
    inverse_diagonal: wp.array[Scalar],
    # In:
    p: wp.array[Vector],
    # Out:
    q_out: wp.array[Vector],
    pq_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    pq = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        q = Vector()
        p_i = p[i]
        if inverse_diagonal[i] > Scalar(0.0):
            for h in range(offsets[i], offsets[i + 1]):
                q += weight[h] * (p_i - p[neighbours[h]])
            if attachment.shape[0] > 0:
                q += attachment[i] * p_i
        q_out[i] = q
        pq += wp.vec3d(wp.cw_mul(p_i, q))
    wp.tile_store(pq_out, wp.tile_sum(wp.tile(pq, preserve_type=True)), offset=k)


@wp.kernel(enable_backward=False)
def alpha_of_components(
    component_chunks: wp.array[wp.int32],
    # In:
    pq_partial: wp.array[wp.vec3d],
    rz: wp.array[wp.vec3d],
    rr: wp.array[wp.vec3d],
    aim: wp.array[wp.vec3d],
    # Out:
    alpha_out: wp.array[wp.vec3d],
):
    c, lane = wp.tid()
    pq = wp.tile_extract(sum_of_chunks(component_chunks, pq_partial, c, lane), 0)
    alpha = wp.vec3d()
    for d in range(3):
        # A column that has arrived stands still; so does one with nothing left to search along.
        if rr[c][d] > aim[c][d] and pq[d] != wp.float64(0.0):
            alpha[d] = rz[c][d] / pq[d]
    if lane == 0:
        alpha_out[c] = alpha


@in_both_precisions
def _step(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    inverse_diagonal: wp.array[Scalar],
    # In:
    alpha: wp.array[wp.vec3d],
    p: wp.array[Vector],
    q: wp.array[Vector],
    # Out:
    e_out: wp.array[wp.vec3d],
    r_out: wp.array[Vector],
    rz_out: wp.array[wp.vec3d],
    rr_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    a = Vector(alpha[chunk_component[k]])
    rz = wp.vec3d()
    rr = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        r = r_out[i] - wp.cw_mul(a, q[i])
        e_out[i] = e_out[i] + wp.cw_mul(wp.vec3d(a), wp.vec3d(p[i]))
        r_out[i] = r
        square = wp.cw_mul(r, r)
        rz += wp.vec3d(inverse_diagonal[i] * square)
        rr += wp.vec3d(square)
    wp.tile_store(rz_out, wp.tile_sum(wp.tile(rz, preserve_type=True)), offset=k)
    wp.tile_store(rr_out, wp.tile_sum(wp.tile(rr, preserve_type=True)), offset=k)


@wp.kernel(enable_backward=False)
def _beta(
    component_chunks: wp.array[wp.int32],
    # In:
    rz_partial: wp.array[wp.vec3d],
    rr_partial: wp.array[wp.vec3d],
    floor: wp.float64,
    # Out:
    rz_out: wp.array[wp.vec3d],
    rr_out: wp.array[wp.vec3d],
    aim_out: wp.array[wp.vec3d],
    peak_out: wp.array[wp.vec3d],
    beta_out: wp.array[wp.vec3d],
):
    c, lane = wp.tid()
    rz = wp.tile_extract(sum_of_chunks(component_chunks, rz_partial, c, lane), 0)
    rr = wp.tile_extract(sum_of_chunks(component_chunks, rr_partial, c, lane), 0)
    if lane == 0:
        beta = wp.vec3d()
        for d in range(3):
            if rz_out[c][d] != wp.float64(0.0):
                beta[d] = rz[d] / rz_out[c][d]
        peak = wp.max(peak_out[c], rr)
        beta_out[c] = beta
        rz_out[c] = rz
        rr_out[c] = rr
        peak_out[c] = peak
        aim_out[c] = attainable(aim_out[c], peak, floor)


@in_both_precisions
def _direction(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    inverse_diagonal: wp.array[Scalar],
    # In:
    beta: wp.array[wp.vec3d],
    r: wp.array[Vector],
    # Out:
    p_out: wp.array[Vector],
):
    k, lane = wp.tid()
    b = Vector(beta[chunk_component[k]])
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        p_out[i] = inverse_diagonal[i] * r[i] + wp.cw_mul(b, p_out[i])


class _Iteration:
    """The vectors of one system, allocated once, and the launches of one iteration."""

    def __init__(self, goals: Goals, rows: LaplacianRows) -> None:
        self.goals, self.rows = goals, rows
        self.floor = rows.precision.floor
        self.r, self.p, self.q = (rows.vectors() for _ in range(3))
        segments = rows.segments
        # Adding up e in float32 would round it, and the residual of that rounding is far above the goal.
        self.e = wp.zeros(self.r.shape[0], dtype=wp.vec3d, device=segments.device)
        self.pq, self.rz, self.rr = (segments.partials() for _ in range(3))
        self.alpha, self.beta, self.rz_sum = (segments.zeros() for _ in range(3))
        self.loop = Loop(self._iterate, goals.size, goals.aim, batch=BATCH, device=segments.device)

    def correct(self, r: wp.array[wp.vec3d], budget: int, watch: Watch | None) -> Correction:
        """See `refinement.Inner`."""
        goals = self.goals
        rows, segments = self.rows, self.rows.segments
        scaled_right_hand_side(rows, r, goals.unit, self.r)
        launch_chunks(
            _start(rows.precision),
            segments,
            [rows.inverse_diagonal, self.r],
            [self.e, self.p, self.rz, self.rr],
        )
        self._measure()
        done = self.loop.run(budget, None if watch is None else lambda count: watch(count, goals.norms()))
        return Correction(self.e, rows.scale, goals.unit, done)

    def _measure(self) -> None:
        goals, inputs = self.goals, [self.rz, self.rr, self.floor]
        outputs = [self.rz_sum, goals.size, goals.aim, goals.peak, self.beta]
        launch_components(_beta, self.rows.segments, inputs, outputs)

    def _iterate(self) -> None:
        goals, rows, segments, precision = self.goals, self.rows, self.rows.segments, self.rows.precision
        diagonal = rows.inverse_diagonal
        launch_chunks(product_and_dot(precision), segments, [*rows.arguments(), self.p], [self.q, self.pq])
        launch_components(alpha_of_components, segments, [self.pq, self.rz_sum, goals.size, goals.aim], [self.alpha])
        launch_chunks(
            _step(precision),
            segments,
            [segments.chunk_component, diagonal, self.alpha, self.p, self.q],
            [self.e, self.r, self.rz, self.rr],
        )
        self._measure()
        launch_chunks(
            _direction(precision), segments, [segments.chunk_component, diagonal, self.beta, self.r], [self.p]
        )


@dataclass(frozen=True)
class CG(Refining):
    """Preconditioned conjugate gradients: |codiff(v - dx)| <= tol |codiff v| per component and column.

    tol: relative to |codiff v|. max_iterations: over all restarts. dtype: of the inner iterations; positions and the
    deciding residual are float64 in any case.
    """

    tol: float = 1.0e-6
    max_iterations: int = 20_000
    dtype: Any = "float32"

    def __post_init__(self) -> None:
        check_limits(self.tol, self.max_iterations)
        precision_named(self.dtype)

    def prepare(self, graph: Graph, pinned: NDArray[np.bool_], attachment: NDArray[np.float64] | None = None) -> State:
        """What depends on the graph and its pinned (n,) or attached (n,) nodes alone; serves any v and start."""
        precision = precision_named(self.dtype)
        # In float64 the drift of a single pin is far below any tol.
        system = System.of(graph, pinned, attachment, anchored=precision is FLOAT32)
        return State(system, _Iteration(system.goals, LaplacianRows.of(system, precision)))
