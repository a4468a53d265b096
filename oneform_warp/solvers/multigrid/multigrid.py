"""Conjugate gradients with a V-cycle of smoothed aggregation as the preconditioner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.segments import launch_chunks, launch_components
from oneform_warp.solvers.cg import alpha_of_components, beta_of_components, product_and_dot
from oneform_warp.solvers.goals import Goals
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
def _shorten(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    # In:
    alpha: wp.array[wp.vec3d],
    q: wp.array[Vector],
    # Out:
    r_out: wp.array[Vector],
):
    k, lane = wp.tid()
    a = Vector(alpha[chunk_component[k]])
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        r_out[i] = r_out[i] - wp.cw_mul(a, q[i])


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
    rr_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    rz = wp.vec3d()
    rr = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        rz += wp.cw_mul(wp.vec3d(r[i]), wp.vec3d(z[i]))
        rr += wp.vec3d(wp.cw_mul(r[i], r[i]))
    wp.tile_store(rz_out, wp.tile_sum(wp.tile(rz, preserve_type=True)), offset=k)
    wp.tile_store(rr_out, wp.tile_sum(wp.tile(rr, preserve_type=True)), offset=k)


@in_both_precisions
def _advance(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    # In:
    alpha: wp.array[wp.vec3d],
    beta: wp.array[wp.vec3d],
    z: wp.array[wp.vec3],
    # Out:
    e_out: wp.array[wp.vec3d],
    p_out: wp.array[Vector],
):
    k, lane = wp.tid()
    a = alpha[chunk_component[k]]
    b = Vector(beta[chunk_component[k]])
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        p = p_out[i]
        e_out[i] = e_out[i] + wp.cw_mul(a, wp.vec3d(p))
        p_out[i] = Vector(z[i]) + wp.cw_mul(b, p)


class _Iteration:
    """The vectors of one system, allocated once, and the launches of one iteration."""

    def __init__(self, rows: LaplacianRows, cycle: Cycle) -> None:
        self.rows, self.cycle = rows, cycle
        self.floor = rows.precision.floor
        self.r, self.p, self.q = (rows.vectors() for _ in range(3))
        segments = rows.segments
        # Adding up e in float32 would round it, and the residual of that rounding is far above the goal.
        self.e = wp.zeros(self.r.shape[0], dtype=wp.vec3d, device=segments.device)
        if rows.precision is FLOAT32:
            cycle.r[0] = self.r
        self.pq, self.rz, self.rr = (segments.partials() for _ in range(3))
        self.alpha, self.beta, self.aim, self.rz_sum, self.rr_sum = (segments.zeros() for _ in range(5))
        self.begin = Recording(self._begin, segments.device)
        self.loop = Loop(self._iterate, self.rr_sum, self.aim, batch=1, device=segments.device)

    def correct(self, r: wp.array[wp.vec3d], goals: Goals, budget: int, watch: Watch | None) -> Correction:
        """See `refinement.Inner`."""
        rows = self.rows
        scaled_right_hand_side(rows, r, goals.unit, self.r)
        wp.copy(self.aim, goals.aim)
        self.begin.run()
        sizes = self.rr_sum
        done = self.loop.run(budget, None if watch is None else lambda count: watch(count, goals.norms(sizes)))
        return Correction(self.e, rows.scale, goals.unit, done)

    def _begin(self) -> None:
        for vector in (self.e, self.p, self.alpha, self.rz_sum):
            vector.zero_()
        # A step of length zero; and beta is zero, since rz was: the first direction is z.
        self._turn()

    def _iterate(self) -> None:
        rows, segments, precision = self.rows, self.rows.segments, self.rows.precision
        launch_chunks(product_and_dot(precision), segments, [*rows.arguments(), self.p], [self.q, self.pq])
        launch_components(alpha_of_components, segments, [self.pq, self.rz_sum, self.rr_sum, self.aim], [self.alpha])
        launch_chunks(_shorten(precision), segments, [segments.chunk_component, self.alpha, self.q], [self.r])
        self._turn()

    def _turn(self) -> None:
        """From the new residual to the next direction, after the step along the last one."""
        segments, precision, z = self.rows.segments, self.rows.precision, self.cycle.x[0]
        if precision is not FLOAT32:
            rounded = self.cycle.r[0]
            wp.launch(_rounded(precision), dim=z.shape[0], inputs=[self.r], outputs=[rounded], device=z.device)
        self.cycle.run()
        launch_chunks(_dots(precision), segments, [self.r, z], [self.rz, self.rr])
        launch_components(beta_of_components, segments, [self.rz, self.rr], [self.rz_sum, self.rr_sum, self.beta])
        inputs = [segments.chunk_component, self.alpha, self.beta, z]
        launch_chunks(_advance(precision), segments, inputs, [self.e, self.p])


@dataclass(frozen=True)
class Multigrid(Refining):
    """CG preconditioned by smoothed aggregation: a dozen iterations at any size.

    What is used again: the structure of the hierarchy (aggregates, prolongations, patterns) belongs to the graph and
    its mu and is made once; other pins recompute the coarse matrices only; another v or start recomputes nothing.
    tol, max_iterations, dtype: as for CG; the V-cycle itself is float32 in any case.
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
        return State(system, _Iteration(rows, Cycle(hierarchy(system))))
