"""One V-cycle: Chebyshev smoothing of degree two, the coarse correction, and the same smoothing again.

Symmetric, so that conjugate gradients may use it; everything in float32, since it only preconditions.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from oneform_warp.segments import LANES
from oneform_warp.solvers.multigrid.hierarchy import Hierarchy
from oneform_warp.solvers.multigrid.prolongation import Prolongation
from oneform_warp.solvers.rows import LaplacianRows

__all__ = ["Cycle"]

COLUMN_LANES = 32
"""Threads that share one column of P in a restriction."""

# Chebyshev polynomials on [1/4, 2], the upper part of the spectrum of D^-1 A; 2 is Gershgorin's bound.
_CENTRE, _RADIUS = (2.0 + 0.25) / 2.0, (2.0 - 0.25) / 2.0
_RHO = 1.0 / (2.0 * _CENTRE / _RADIUS - _RADIUS / _CENTRE)
FIRST = wp.constant(wp.float32(1.0 / _CENTRE))
"""The first step: d_0 = FIRST D^-1 r."""
AGAIN = wp.constant(wp.float32(_RHO * _RADIUS / _CENTRE))
"""The second: d_1 = AGAIN d_0 + SECOND D^-1 r_1."""
SECOND = wp.constant(wp.float32(2.0 * _RHO / _RADIUS))


@wp.func
def product_at(
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    x: wp.array[wp.vec3],
    i: int,
) -> wp.vec3:
    """(A x)_i = sum_h w_h (x_i - x_j) + attachment_i x_i."""
    x_i = x[i]
    total = wp.vec3()
    for h in range(offsets[i], offsets[i + 1]):
        total += weight[h] * (x_i - x[neighbours[h]])
    if attachment.shape[0] > 0:
        total += attachment[i] * x_i
    return total


@wp.kernel(enable_backward=False)
def _smooth_from_zero(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    r: wp.array[wp.vec3],
    # Out:
    x_out: wp.array[wp.vec3],
):
    i = wp.tid()
    inverse = inverse_diagonal[i]
    d = FIRST * inverse * r[i]
    residual = r[i]
    for h in range(offsets[i], offsets[i + 1]):
        j = neighbours[h]
        residual -= weight[h] * (d - FIRST * inverse_diagonal[j] * r[j])
    if attachment.shape[0] > 0:
        residual -= attachment[i] * d
    x_out[i] = d + AGAIN * d + SECOND * inverse * residual


@wp.kernel(enable_backward=False)
def _first_step(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    r: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
    # Out:
    d_out: wp.array[wp.vec3],
    x_out: wp.array[wp.vec3],
):
    i = wp.tid()
    d = FIRST * inverse_diagonal[i] * (r[i] - product_at(offsets, neighbours, weight, attachment, x, i))
    d_out[i] = d
    x_out[i] = x[i] + d


@wp.kernel(enable_backward=False)
def _second_step(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    r: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
    d: wp.array[wp.vec3],
    # Out:
    x_out: wp.array[wp.vec3],
):
    i = wp.tid()
    residual = r[i] - product_at(offsets, neighbours, weight, attachment, x, i)
    x_out[i] = x[i] + AGAIN * d[i] + SECOND * inverse_diagonal[i] * residual


@wp.kernel(enable_backward=False)
def _residual(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    r: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
    # Out:
    residual_out: wp.array[wp.vec3],
):
    i = wp.tid()
    residual = wp.vec3()
    if inverse_diagonal[i] > 0.0:
        residual = r[i] - product_at(offsets, neighbours, weight, attachment, x, i)
    residual_out[i] = residual


@wp.kernel(enable_backward=False)
def _restrict(
    # In:
    column_offsets: wp.array[wp.int32],
    row_of: wp.array[wp.int32],
    column_values: wp.array[wp.float32],
    r: wp.array[wp.vec3],
    # Out:
    coarse_out: wp.array[wp.vec3],
):
    # A column has thirty entries or more: a block for each hides the latency that one thread would wait for.
    c, lane = wp.tid()
    total = wp.vec3()
    for k in range(column_offsets[c] + lane, column_offsets[c + 1], wp.block_dim()):
        total += column_values[k] * r[row_of[k]]
    wp.tile_store(coarse_out, wp.tile_sum(wp.tile(total, preserve_type=True)), offset=c)


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
    """The vectors of every level, allocated once, and the launches of one V-cycle."""

    def __init__(self, levels: Hierarchy) -> None:
        self.hierarchy = levels
        self.device = levels.levels[0].segments.device
        counts = [rows.inverse_diagonal.shape[0] for rows in levels.levels]
        self.x, self.r, self.d, self.t = (
            [wp.zeros(count, dtype=wp.vec3, device=self.device) for count in counts] for _ in range(4)
        )

    def run(self) -> None:
        """x[0] <- M r[0], about A^-1 r[0] where nodes move and zero where they do not."""
        self._descend(0)

    def _descend(self, level: int) -> None:
        rows = self.hierarchy.levels[level]
        if level == len(self.hierarchy.structure.prolongations):
            self._coarsest(level, rows)
            return
        p = self.hierarchy.structure.prolongations[level]
        self._launch(_smooth_from_zero, level, rows.arguments() + [self.r[level]], [self.x[level]])
        self._launch(_residual, level, rows.arguments() + [self.r[level], self.x[level]], [self.t[level]])
        self._launch_blocks(_restrict, p.coarse_count, COLUMN_LANES, [*_columns(p), self.t[level]], [self.r[level + 1]])
        self._descend(level + 1)
        inputs = [p.rows.offsets, p.rows.columns, p.values, rows.inverse_diagonal, self.x[level + 1]]
        self._launch(_prolong, level, inputs, [self.x[level]])
        self._smooth(level, rows)

    def _smooth(self, level: int, rows: LaplacianRows) -> None:
        r, x, d, t = self.r[level], self.x[level], self.d[level], self.t[level]
        self._launch(_first_step, level, [*rows.arguments(), r, x], [d, t])
        self._launch(_second_step, level, [*rows.arguments(), r, t, d], [x])

    def _coarsest(self, level: int, rows: LaplacianRows) -> None:
        moving = self.hierarchy.moving
        if moving.shape[0]:
            inputs = [self.hierarchy.inverse, moving, self.r[level]]
            self._launch_blocks(_dense_product, moving.shape[0], LANES, inputs, [self.x[level]])
            return
        self._launch(_smooth_from_zero, level, rows.arguments() + [self.r[level]], [self.x[level]])

    def _launch_blocks(self, kernel: wp.Kernel, count: int, lanes: int, inputs: list[Any], outputs: list[Any]) -> None:
        wp.launch_tiled(kernel, dim=[count], inputs=inputs, outputs=outputs, block_dim=lanes, device=self.device)

    def _launch(self, kernel: wp.Kernel, level: int, inputs: list[Any], outputs: list[Any]) -> None:
        wp.launch(kernel, dim=self.x[level].shape[0], inputs=inputs, outputs=outputs, device=self.device)


def _columns(p: Prolongation) -> list[Any]:
    return [p.column_offsets, p.row_of, p.column_values]
