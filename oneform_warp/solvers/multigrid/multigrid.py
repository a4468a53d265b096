"""Conjugate gradients with a cycle of smoothed aggregation as the preconditioner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.segments import launch_chunks, launch_components, sum_of_chunks
from oneform_warp.solvers.cg import alpha_of_components, product_and_dot
from oneform_warp.solvers.goals import attainable
from oneform_warp.solvers.loop import Loop, Recording
from oneform_warp.solvers.multigrid.cycle import Cycle
from oneform_warp.solvers.multigrid.hierarchy import hierarchy
from oneform_warp.solvers.precision import FLOAT32, in_both_precisions, precision_named
from oneform_warp.solvers.refinement import Correction, Refining, State, Watch
from oneform_warp.solvers.rows import LaplacianRows, scaled_right_hand_side
from oneform_warp.solvers.system import System
from oneform_warp.solvers.validation import check_limits

__all__ = ["Multigrid"]

Scalar = wp.float32
Vector = wp.vec3


@in_both_precisions
def _rounded(
    # In:
    r: wp.array[Vector],
    # Out:
    r_out: wp.array[wp.vec3],
):
    i = wp.tid()
    r_out[i] = wp.vec3(r[i])


@in_both_precisions
def _dots(
    chunk_offsets: wp.array[wp.int32],
    # In:
    r: wp.array[Vector],
    z: wp.array[wp.vec3],
    # Out:
    rz_out: wp.array[wp.vec3d],
    z_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    rz = wp.vec3d()
    total = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        z_i = wp.vec3d(z[i])
        rz += wp.cw_mul(wp.vec3d(r[i]), z_i)
        total += z_i
    wp.tile_store(rz_out, wp.tile_sum(wp.tile(rz, preserve_type=True)), offset=k)
    wp.tile_store(z_out, wp.tile_sum(wp.tile(total, preserve_type=True)), offset=k)


@wp.kernel(enable_backward=False)
def _beta(
    component_chunks: wp.array[wp.int32],
    # In:
    mean: wp.array[wp.float64],
    rz_partial: wp.array[wp.vec3d],
    z_partial: wp.array[wp.vec3d],
    r_sum: wp.array[wp.vec3d],
    # Out:
    rz_out: wp.array[wp.vec3d],
    beta_out: wp.array[wp.vec3d],
):
    c, lane = wp.tid()
    rz = wp.tile_extract(sum_of_chunks(component_chunks, rz_partial, c, lane), 0)
    z = wp.tile_extract(sum_of_chunks(component_chunks, z_partial, c, lane), 0)
    if lane == 0:
        # Without the constants, see `_Iteration`.
        rz -= mean[c] * wp.cw_mul(r_sum[c], z)
        beta = wp.vec3d()
        for d in range(3):
            if rz_out[c][d] != wp.float64(0.0):
                beta[d] = rz[d] / rz_out[c][d]
        beta_out[c] = beta
        rz_out[c] = rz


@in_both_precisions
def _direction(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    # In:
    beta: wp.array[wp.vec3d],
    z: wp.array[wp.vec3],
    # Out:
    p_out: wp.array[Vector],
):
    k, lane = wp.tid()
    b = Vector(beta[chunk_component[k]])
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        p_out[i] = Vector(z[i]) + wp.cw_mul(b, p_out[i])


@in_both_precisions
def _step(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    # In:
    alpha: wp.array[wp.vec3d],
    p: wp.array[Vector],
    q: wp.array[Vector],
    # Out:
    e_out: wp.array[wp.vec3d],
    r_out: wp.array[Vector],
    rr_out: wp.array[wp.vec3d],
    sum_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    a = alpha[chunk_component[k]]
    rr = wp.vec3d()
    total = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        e_out[i] = e_out[i] + wp.cw_mul(a, wp.vec3d(p[i]))
        r = r_out[i] - wp.cw_mul(Vector(a), q[i])
        r_out[i] = r
        rr += wp.vec3d(wp.cw_mul(r, r))
        total += wp.vec3d(r)
    wp.tile_store(rr_out, wp.tile_sum(wp.tile(rr, preserve_type=True)), offset=k)
    wp.tile_store(sum_out, wp.tile_sum(wp.tile(total, preserve_type=True)), offset=k)


@wp.kernel(enable_backward=False)
def _size(
    component_chunks: wp.array[wp.int32],
    # In:
    mean: wp.array[wp.float64],
    rr_partial: wp.array[wp.vec3d],
    sum_partial: wp.array[wp.vec3d],
    floor: wp.float64,
    # Out:
    rr_out: wp.array[wp.vec3d],
    sum_out: wp.array[wp.vec3d],
    aim_out: wp.array[wp.vec3d],
    peak_out: wp.array[wp.vec3d],
):
    c, lane = wp.tid()
    rr = wp.tile_extract(sum_of_chunks(component_chunks, rr_partial, c, lane), 0)
    total = wp.tile_extract(sum_of_chunks(component_chunks, sum_partial, c, lane), 0)
    if lane == 0:
        # By rounding, the difference may be below zero.
        rr = wp.max(rr - mean[c] * wp.cw_mul(total, total), wp.vec3d())
        peak = wp.max(peak_out[c], rr)
        rr_out[c] = rr
        sum_out[c] = total
        peak_out[c] = peak
        aim_out[c] = attainable(aim_out[c], peak, floor)


class _Iteration:
    """The vectors of one system, allocated once, and the launches of one iteration.

    Where nothing holds a component, L cannot reach the constants, but rounding in r does, and M answers them with its
    largest gain: alpha = rz / pq would then grow without end. So they are left out of rz and rr.
    """

    def __init__(self, system: System, rows: LaplacianRows, cycle: Cycle) -> None:
        self.goals, self.rows, self.cycle = system.goals, rows, cycle
        self.floor = rows.precision.floor
        single = rows.precision is FLOAT32
        # Between two cycles q may lie where a cycle keeps its directions.
        self.r, self.p = rows.vectors(), rows.vectors()
        self.q = cycle.d[0] if single else rows.vectors()
        segments = rows.segments
        # Adding up e in float32 would round it, and the residual of that rounding is far above the goal.
        self.e = wp.zeros(self.r.shape[0], dtype=wp.vec3d, device=segments.device)
        if single:
            cycle.r[0] = self.r
        self.partials = segments.partials(), segments.partials()
        self.alpha, self.beta, self.rz, self.r_sum = (segments.zeros() for _ in range(4))
        counts = np.diff(system.graph.component_offsets)[: segments.component_count]
        self.mean = wp.array(system.floating / np.maximum(counts, 1), dtype=wp.float64, device=segments.device)
        self.begin = Recording(self._begin, segments.device)
        self.loop = Loop(self._iterate, system.goals.size, system.goals.aim, batch=1, device=segments.device)

    def correct(self, r: wp.array[wp.vec3d], budget: int, watch: Watch | None) -> Correction:
        """See `refinement.Inner`."""
        goals = self.goals
        scaled_right_hand_side(self.rows, r, goals.unit, self.r)
        self.begin.run()
        done = self.loop.run(budget, None if watch is None else lambda count: watch(count, goals.norms()))
        return Correction(self.e, self.rows.scale, goals.unit, done)

    def _begin(self) -> None:
        # With rz zero, beta is zero, and the first direction is z; r is a codifferential, its sum is zero as well.
        for vector in (self.e, self.p, self.rz, self.r_sum):
            vector.zero_()

    def _iterate(self) -> None:
        rows, segments, precision, z = self.rows, self.rows.segments, self.rows.precision, self.cycle.x[0]
        first, second = self.partials
        if precision is not FLOAT32:
            rounded = self.cycle.r[0]
            wp.launch(_rounded(precision), dim=z.shape[0], inputs=[self.r], outputs=[rounded], device=z.device)
        self.cycle.run()
        launch_chunks(_dots(precision), segments, [self.r, z], [first, second])
        launch_components(_beta, segments, [self.mean, first, second, self.r_sum], [self.rz, self.beta])
        launch_chunks(_direction(precision), segments, [segments.chunk_component, self.beta, z], [self.p])
        launch_chunks(product_and_dot(precision), segments, [*rows.arguments(), self.p], [self.q, first])
        launch_components(
            alpha_of_components, segments, [first, self.rz, self.goals.size, self.goals.aim], [self.alpha]
        )
        inputs = [segments.chunk_component, self.alpha, self.p, self.q]
        launch_chunks(_step(precision), segments, inputs, [self.e, self.r, first, second])
        inputs, goals = [self.mean, first, second, self.floor], self.goals
        launch_components(_size, segments, inputs, [goals.size, self.r_sum, goals.aim, goals.peak])


@dataclass(frozen=True)
class Multigrid(Refining):
    """CG preconditioned by smoothed aggregation: a dozen iterations at any size.

    What is used again: the structure of the hierarchy (aggregates, prolongations, patterns) belongs to the graph and
    its mu and is made once; other pins recompute the coarse matrices only; another v or start recomputes nothing.
    tol, max_iterations, dtype: as for CG; the cycle itself is float32 in any case.
    """

    tol: float = 1.0e-6
    max_iterations: int = 1_000
    dtype: Any = "float32"

    def __post_init__(self) -> None:
        check_limits(self.tol, self.max_iterations)
        precision_named(self.dtype)

    def prepare(self, graph: Graph, pinned: NDArray[np.bool_], attachment: NDArray[np.float64] | None = None) -> State:
        """The hierarchy for these pinned (n,) and attached (n,) nodes; serves any v and start."""
        precision = precision_named(self.dtype)
        # In float64 the drift of a single pin is far below any tol.
        system = System.of(graph, pinned, attachment, anchored=precision is FLOAT32)
        rows = LaplacianRows.of(system, precision)
        return State(system, _Iteration(system, rows, Cycle(hierarchy(system))))
