"""Between two levels: restriction by P^T and prolongation by P."""

from __future__ import annotations

import warp as wp

from oneform_warp.solvers.multigrid.lanes import launch_rows, sum_over_lanes
from oneform_warp.solvers.multigrid.prolongation import Prolongation
from oneform_warp.solvers.rows import LaplacianRows

__all__ = ["prolong", "restrict"]

COLUMN_LANES = 8
"""Threads that share one column of P, with its thirty entries."""


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
    launch_rows(
        _restrict,
        p.coarse_count,
        COLUMN_LANES,
        [p.column_offsets, p.row_of, p.column_values, r],
        [coarse_out],
        r.device,
    )


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
    if inverse_diagonal[i] > 0.0:
        total = x_out[i]
        for k in range(p_offsets[i], p_offsets[i + 1]):
            total += p_values[k] * coarse[p_columns[k]]
        x_out[i] = total


def prolong(rows: LaplacianRows, p: Prolongation, coarse: wp.array[wp.vec3], x_out: wp.array[wp.vec3]) -> None:
    """X <- x + P coarse, where nodes move."""
    inputs = [p.rows.offsets, p.rows.columns, p.values, rows.inverse_diagonal, coarse]
    wp.launch(_prolong, dim=x_out.shape[0], inputs=inputs, outputs=[x_out], device=x_out.device)
