"""One cycle: smoothing, the coarse correction, and the same smoothing again.

Symmetric, so that conjugate gradients may use it; everything in float32, since it only preconditions. The third level
is visited twice: it costs a hundredth of the first and saves a fifth of the iterations.
"""

from __future__ import annotations

import warp as wp

from oneform_warp.segments import LANES
from oneform_warp.solvers.multigrid.hierarchy import Hierarchy
from oneform_warp.solvers.multigrid.smoothing import first_step, residual, second_step, smooth_from_zero
from oneform_warp.solvers.multigrid.transfer import prolong, restrict

__all__ = ["Cycle"]

ROW_LANES = 8
"""Threads that share one row of a level too small to fill a GPU with one each."""

CROWDED = 40_000
"""Rows from which one thread each is best."""


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
            first_step(rows, lanes, r, x, d, t)
            second_step(rows, lanes, r, t, d, x)
        residual(rows, lanes, r, x, t)
        restrict(p, t, self.r[level + 1])
        self._solve(level + 1)
        prolong(rows, p, self.x[level + 1], x)
        first_step(rows, lanes, r, x, d, t)
        second_step(rows, lanes, r, t, d, x)

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
