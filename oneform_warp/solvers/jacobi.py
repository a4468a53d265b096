"""Damped Jacobi sweeps: slow as a solver, exact as a smoother whose amount is counted in sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.graph import Graph
from oneform_warp.segments import launch_chunks, sum_chunks
from oneform_warp.solvers.goals import Goals
from oneform_warp.solvers.loop import Loop
from oneform_warp.solvers.precision import in_both_precisions, precision_named
from oneform_warp.solvers.refinement import Correction, Refining, State, Watch
from oneform_warp.solvers.rows import LaplacianRows, scaled_right_hand_side
from oneform_warp.solvers.system import System
from oneform_warp.solvers.validation import check_limits

__all__ = ["Jacobi"]

Scalar = wp.float32
Vector = wp.vec3

BATCH = 8
"""Sweeps between two looks at the residual from the host."""


@in_both_precisions
def _residual(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[Scalar],
    attachment: wp.array[Scalar],
    inverse_diagonal: wp.array[Scalar],
    # In:
    b: wp.array[Vector],
    e: wp.array[Vector],
    # Out:
    r_out: wp.array[Vector],
    rr_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    rr = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        r = Vector()
        if inverse_diagonal[i] > Scalar(0.0):
            r = b[i]
            for h in range(offsets[i], offsets[i + 1]):
                r += weight[h] * (e[neighbours[h]] - e[i])
            if attachment.shape[0] > 0:
                r -= attachment[i] * e[i]
        r_out[i] = r
        rr += wp.vec3d(wp.cw_mul(r, r))
    wp.tile_store(rr_out, wp.tile_sum(wp.tile(rr, preserve_type=True)), offset=k)


@in_both_precisions
def _relax(
    # In:
    inverse_diagonal: wp.array[Scalar],
    damping: Scalar,
    r: wp.array[Vector],
    # Out:
    e_out: wp.array[Vector],
):
    i = wp.tid()
    e_out[i] = e_out[i] + damping * inverse_diagonal[i] * r[i]


class _Sweep:
    """The vectors of one system, allocated once, and the launches of one sweep."""

    def __init__(self, goals: Goals, rows: LaplacianRows, damping: float) -> None:
        self.goals, self.rows, self.damping = goals, rows, damping
        self.floor = rows.precision.floor
        self.b, self.e, self.r = (rows.vectors() for _ in range(3))
        self.rr = rows.segments.partials()
        self.loop = Loop(self._iterate, goals.size, goals.aim, batch=BATCH, device=rows.segments.device)

    def correct(self, r: wp.array[wp.vec3d], budget: int, watch: Watch | None) -> Correction:
        """See `refinement.Inner`."""
        goals = self.goals
        scaled_right_hand_side(self.rows, r, goals.unit, self.b)
        self.e.zero_()
        done = self.loop.run(budget, None if watch is None else lambda count: watch(count, goals.norms()))
        return Correction(self.e, self.rows.scale, goals.unit, done)

    def _iterate(self) -> None:
        rows, precision = self.rows, self.rows.precision
        launch_chunks(_residual(precision), rows.segments, [*rows.arguments(), self.b, self.e], [self.r, self.rr])
        wp.launch(
            _relax(precision),
            dim=self.e.shape[0],
            inputs=[rows.inverse_diagonal, self.damping, self.r],
            outputs=[self.e],
            device=rows.segments.device,
        )
        sum_chunks(rows.segments, self.rr, self.goals.size)


@dataclass(frozen=True)
class Jacobi(Refining):
    """Sweeps x_i <- x_i + damping / L_ii * codiff(v - dx)_i, all nodes at once.

    damping: 2/3 converges on every graph; 1 never does on a bipartite one, whose checkerboard it turns over.
    tol 0 and max_iterations k: k sweeps of smoothing, status max_iterations.
    """

    tol: float = 1.0e-6
    max_iterations: int = 20_000
    damping: float = 2.0 / 3.0
    dtype: Any = "float32"

    def __post_init__(self) -> None:
        check_limits(self.tol, self.max_iterations)
        precision_named(self.dtype)
        if not 0.0 < self.damping <= 1.0:
            raise InputError(f"damping is {self.damping}", where="solver", fix="give a number in (0, 1], as 2/3")

    def prepare(self, graph: Graph, pinned: NDArray[np.bool_], attachment: NDArray[np.float64] | None = None) -> State:
        """What depends on the graph and its pinned (n,) or attached (n,) nodes alone; serves any v and start."""
        system = System.of(graph, pinned, attachment)
        return State(system, _Sweep(system.goals, LaplacianRows.of(system, precision_named(self.dtype)), self.damping))
