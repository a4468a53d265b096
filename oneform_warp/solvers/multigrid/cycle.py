"""One cycle: smoothing, the coarse correction, and the same smoothing again.

Symmetric, so that conjugate gradients may use it; everything in float32, since it only preconditions. The third level
is visited twice: it costs a hundredth of the first and saves a fifth of the iterations.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from oneform_warp.segments import LANES
from oneform_warp.solvers.multigrid.hierarchy import Hierarchy
from oneform_warp.solvers.multigrid.lanes import launch_rows, sum_over_lanes
from oneform_warp.solvers.multigrid.prolongation import Prolongation
from oneform_warp.solvers.multigrid.smoothing import residual, smooth, smooth_from_zero

__all__ = ["Cycle"]

COLUMN_LANES = 8
"""Threads that share one column of P, with its thirty entries, in a restriction."""

ROW_LANES = 8
"""Threads that share one row of a level too small to fill a GPU with one each."""

CROWDED = 40_000
"""Rows from which one thread each is best."""


@wp.kernel(enable_backward=False)
def _restrict(
    # In:
    column_offsets: wp.array[wp.int32],
    row_of: wp.array[wp.int32],
    column_values: wp.array[wp.float32],
    r: wp.array[wp.vec3],
    lanes: int,
    # Out:
    coarse_out: wp.array[wp.vec3],
):
    t = wp.tid()
    c = t // lanes
    lane = t - c * lanes
    part = wp.vec3()
    if c < coarse_out.shape[0]:
        for k in range(column_offsets[c] + lane, column_offsets[c + 1], lanes):
            part += column_values[k] * r[row_of[k]]
    total = sum_over_lanes(part, lanes)
    if lane == 0 and c < coarse_out.shape[0]:
        coarse_out[c] = total


@wp.kernel(enable_backward=False)
def _prolong(
    # In:
    p_offsets: wp.array[wp.int32],
    p_columns: wp.array[wp.int32],
    values: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    coarse: wp.array[wp.vec3],
    # Out:
    x_out: wp.array[wp.vec3],
):
    i = wp.tid()
    if inverse_diagonal[i] > 0.0:
        total = x_out[i]
        for k in range(p_offsets[i], p_offsets[i + 1]):
            total += values[k] * coarse[p_columns[k]]
        x_out[i] = total


@wp.kernel(enable_backward=False)
def _dense_product(
    # In:
    inverse: wp.array[wp.float32],
    moving: wp.array[wp.int32],
    r: wp.array[wp.vec3],
    # Out:
    x_out: wp.array[wp.vec3],
):
    k, lane = wp.tid()
    size = moving.shape[0]
    part = wp.vec3()
    for n in range(lane, size, wp.block_dim()):
        part += inverse[k * size + n] * r[moving[n]]
    total = wp.tile_extract(wp.tile_sum(wp.tile(part, preserve_type=True)), 0)
    if lane == 0:
        x_out[moving[k]] = total


class Cycle:
    """The vectors of every level, allocated once, and the launches of one cycle."""

    def __init__(self, levels: Hierarchy) -> None:
        self.hierarchy = levels
        self.device = levels.levels[0].segments.device
        counts = [rows.inverse_diagonal.shape[0] for rows in levels.levels]
        self.x, self.r, self.d, self.t = (
            [wp.zeros(count, dtype=wp.vec3, device=self.device) for count in counts] for _ in range(4)
        )
        self.lanes = [1 if count >= CROWDED else ROW_LANES for count in counts]
        # On a GPU a launch on a small level costs more than its work.
        self.twice = {2} if self.device.is_cuda else set(range(2, len(counts)))

    def run(self) -> None:
        """x[0] <- M r[0], about A^-1 r[0] where nodes move and zero where they do not."""
        self._solve(0)

    def _solve(self, level: int) -> None:
        """x[level] <- M r[level], from zero."""
        if level == len(self.hierarchy.structure.prolongations):
            self._coarsest(level)
            return
        self._improve(level, from_zero=True)
        if level in self.twice:
            self._improve(level, from_zero=False)

    def _improve(self, level: int, *, from_zero: bool) -> None:
        rows, lanes = self.hierarchy.levels[level], self.lanes[level]
        p = self.hierarchy.structure.prolongations[level]
        r, x, d, t = self.r[level], self.x[level], self.d[level], self.t[level]
        if from_zero:
            smooth_from_zero(rows, lanes, r, x)
        else:
            smooth(rows, lanes, r, x, d, t)
        residual(rows, lanes, r, x, t)
        launch_rows(_restrict, p.coarse_count, COLUMN_LANES, [*_columns(p), t], [self.r[level + 1]], self.device)
        self._solve(level + 1)
        inputs = [p.rows.offsets, p.rows.columns, p.values, rows.inverse_diagonal, self.x[level + 1]]
        wp.launch(_prolong, dim=x.shape[0], inputs=inputs, outputs=[x], device=self.device)
        smooth(rows, lanes, r, x, d, t)

    def _coarsest(self, level: int) -> None:
        moving = self.hierarchy.moving
        if moving.shape[0]:
            inputs = [self.hierarchy.inverse, moving, self.r[level]]
            outputs = [self.x[level]]
            wp.launch_tiled(
                _dense_product,
                dim=[moving.shape[0]],
                inputs=inputs,
                outputs=outputs,
                block_dim=LANES,
                device=self.device,
            )
            return
        smooth_from_zero(self.hierarchy.levels[level], self.lanes[level], self.r[level], self.x[level])


def _columns(p: Prolongation) -> list[Any]:
    return [p.column_offsets, p.row_of, p.column_values]
