"""Between two levels: restriction by P^T, prolongation by P, and both fused with the smoothing beside them.

A large level is bound by memory, and every pass is made once. A small one is bound by the time of a launch: there the
residual is computed where it is restricted, and a prolonged value where it is smoothed, three times over.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from oneform_warp.solvers.multigrid.lanes import launch_rows, sum_over_lanes
from oneform_warp.solvers.multigrid.prolongation import Prolongation
from oneform_warp.solvers.multigrid.smoothing import FIRST, product_of_lane
from oneform_warp.solvers.rows import LaplacianRows

__all__ = ["prolong", "prolong_and_step", "restrict", "restrict_residual"]

COLUMN_LANES = 8
"""Threads that share one column of P, with its thirty entries."""

RESIDUAL_LANES = 32
"""The same where each entry takes a row of the matrix."""

ROW_LANES = 8


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


def restrict(p: Prolongation, r: wp.array[wp.vec3], coarse_out: wp.array[wp.vec3]) -> None:
    """P^T r."""
    launch_rows(_restrict, p.coarse_count, COLUMN_LANES, [*_columns(p), r], [coarse_out], r.device)


@wp.kernel(enable_backward=False)
def _restrict_residual(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    column_offsets: wp.array[wp.int32],
    row_of: wp.array[wp.int32],
    column_values: wp.array[wp.float32],
    r: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
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
            i = row_of[k]
            if inverse_diagonal[i] > 0.0:
                product = product_of_lane(offsets, neighbours, weight, attachment, x, i, 0, 1)
                part += column_values[k] * (r[i] - product)
    total = sum_over_lanes(part, lanes)
    if lane == 0 and c < coarse_out.shape[0]:
        coarse_out[c] = total


def restrict_residual(
    rows: LaplacianRows, p: Prolongation, r: wp.array[wp.vec3], x: wp.array[wp.vec3], coarse_out: wp.array[wp.vec3]
) -> None:
    """P^T (r - A x)."""
    inputs = [*rows.arguments(), *_columns(p), r, x]
    launch_rows(_restrict_residual, p.coarse_count, RESIDUAL_LANES, inputs, [coarse_out], r.device)


@wp.func
def prolonged(
    p_offsets: wp.array[wp.int32],
    p_columns: wp.array[wp.int32],
    p_values: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    coarse: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
    i: int,
) -> wp.vec3:
    """X_i + (P coarse)_i; what does not move stays."""
    total = x[i]
    if inverse_diagonal[i] > 0.0:
        for k in range(p_offsets[i], p_offsets[i + 1]):
            total += p_values[k] * coarse[p_columns[k]]
    return total


@wp.kernel(enable_backward=False)
def _prolong(
    # In:
    p_offsets: wp.array[wp.int32],
    p_columns: wp.array[wp.int32],
    p_values: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    coarse: wp.array[wp.vec3],
    # Out:
    x_out: wp.array[wp.vec3],
):
    i = wp.tid()
    x_out[i] = prolonged(p_offsets, p_columns, p_values, inverse_diagonal, coarse, x_out, i)


def prolong(rows: LaplacianRows, p: Prolongation, coarse: wp.array[wp.vec3], x_out: wp.array[wp.vec3]) -> None:
    """X <- x + P coarse."""
    inputs = [p.rows.offsets, p.rows.columns, p.values, rows.inverse_diagonal, coarse]
    wp.launch(_prolong, dim=x_out.shape[0], inputs=inputs, outputs=[x_out], device=x_out.device)


@wp.kernel(enable_backward=False)
def _prolong_and_step(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    p_offsets: wp.array[wp.int32],
    p_columns: wp.array[wp.int32],
    p_values: wp.array[wp.float32],
    coarse: wp.array[wp.vec3],
    r: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
    lanes: int,
    # Out:
    d_out: wp.array[wp.vec3],
    x_out: wp.array[wp.vec3],
):
    t = wp.tid()
    i = t // lanes
    lane = t - i * lanes
    x_i = wp.vec3()
    part = wp.vec3()
    if i < r.shape[0]:
        x_i = prolonged(p_offsets, p_columns, p_values, inverse_diagonal, coarse, x, i)
        for h in range(offsets[i] + lane, offsets[i + 1], lanes):
            x_j = prolonged(p_offsets, p_columns, p_values, inverse_diagonal, coarse, x, neighbours[h])
            part += weight[h] * (x_i - x_j)
        if lane == 0 and attachment.shape[0] > 0:
            part += attachment[i] * x_i
    product = sum_over_lanes(part, lanes)
    if lane == 0 and i < r.shape[0]:
        d = FIRST * inverse_diagonal[i] * (r[i] - product)
        d_out[i] = d
        x_out[i] = x_i + d


def prolong_and_step(
    rows: LaplacianRows,
    p: Prolongation,
    coarse: wp.array[wp.vec3],
    r: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
    d_out: wp.array[wp.vec3],
    x_out: wp.array[wp.vec3],
) -> None:
    """The first smoothing step from x + P coarse towards A^-1 r, and its direction d."""
    inputs = [*rows.arguments(), p.rows.offsets, p.rows.columns, p.values, coarse, r, x]
    launch_rows(_prolong_and_step, r.shape[0], ROW_LANES, inputs, [d_out, x_out], r.device)


def _columns(p: Prolongation) -> list[Any]:
    return [p.column_offsets, p.row_of, p.column_values]
