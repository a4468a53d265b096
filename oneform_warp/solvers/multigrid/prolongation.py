"""Smoothed prolongation P = (I - 0.85 D^-1 A) T over the strong edges, T the aggregates' indicator columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import warp as wp

from oneform_warp.solvers.multigrid.compact import Rows, compact, insert
from oneform_warp.solvers.rows import LaplacianRows
from oneform_warp.sorting import row_offsets, scan, sort_by_key

__all__ = ["Prolongation", "smoothed_prolongation"]

DAMPING = wp.constant(wp.float32(0.85))


@dataclass(frozen=True, eq=False)
class Prolongation:
    """P (n x coarse) by rows, and by columns for P^T; every row sums to one, or is empty where nothing moves."""

    rows: Rows
    values: wp.array[wp.float32]
    coarse_count: int
    column_offsets: wp.array[wp.int32]
    """Column c has the entries column_offsets[c] to column_offsets[c + 1] of the two arrays below, by row."""
    row_of: wp.array[wp.int32]
    column_values: wp.array[wp.float32]


@wp.kernel(enable_backward=False)
def _bounds(
    # Graph:
    offsets: wp.array[wp.int32],
    # Out:
    bound_out: wp.array[wp.int32],
):
    i = wp.tid()
    bound_out[i] = offsets[i + 1] - offsets[i] + 1


@wp.kernel(enable_backward=False)
def _patterns(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    strong: wp.array[wp.uint8],
    # In:
    aggregate: wp.array[wp.int32],
    wide_offsets: wp.array[wp.int32],
    # Out:
    wide_out: wp.array[wp.int32],
    count_out: wp.array[wp.int32],
):
    i = wp.tid()
    count = int(0)
    if aggregate[i] >= 0:
        count = insert(wide_out, wide_offsets[i], count, aggregate[i])
        for h in range(offsets[i], offsets[i + 1]):
            if strong[h] != wp.uint8(0):
                count = insert(wide_out, wide_offsets[i], count, aggregate[neighbours[h]])
    count_out[i] = count


@wp.kernel(enable_backward=False)
def _values(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    strong: wp.array[wp.uint8],
    # In:
    aggregate: wp.array[wp.int32],
    p_offsets: wp.array[wp.int32],
    p_columns: wp.array[wp.int32],
    # Out:
    value_out: wp.array[wp.float32],
):
    i = wp.tid()
    total = wp.float32(0.0)
    for h in range(offsets[i], offsets[i + 1]):
        if strong[h] != wp.uint8(0):
            total += weight[h]
    for k in range(p_offsets[i], p_offsets[i + 1]):
        value = wp.float32(0.0)
        for h in range(offsets[i], offsets[i + 1]):
            if strong[h] != wp.uint8(0) and aggregate[neighbours[h]] == p_columns[k]:
                value += weight[h]
        if total > 0.0:
            value = DAMPING * value / total
            if p_columns[k] == aggregate[i]:
                value += 1.0 - DAMPING
        else:
            value = wp.float32(1.0)
        value_out[k] = value


@wp.kernel(enable_backward=False)
def _rows_of_entries(
    # In:
    p_offsets: wp.array[wp.int32],
    # Out:
    row_out: wp.array[wp.int32],
):
    i = wp.tid()
    for k in range(p_offsets[i], p_offsets[i + 1]):
        row_out[k] = i


@wp.kernel(enable_backward=False)
def _columns(
    # In:
    entry: wp.array[wp.int32],
    row: wp.array[wp.int32],
    values: wp.array[wp.float32],
    # Out:
    row_out: wp.array[wp.int32],
    value_out: wp.array[wp.float32],
):
    k = wp.tid()
    row_out[k] = row[entry[k]]
    value_out[k] = values[entry[k]]


def smoothed_prolongation(
    rows: LaplacianRows, strong: wp.array[wp.uint8], aggregate: wp.array[wp.int32], coarse_count: int
) -> Prolongation:
    """P with about three entries a row; weak edges are left out of A, so that P keeps constants."""
    device, count = strong.device, aggregate.shape[0]
    table: list[Any] = [rows.offsets, rows.neighbours]
    bounds, counts = (wp.zeros(count + 1, dtype=wp.int32, device=device) for _ in range(2))
    wp.launch(_bounds, dim=count, inputs=[rows.offsets], outputs=[bounds], device=device)
    wide_offsets, room = scan(bounds)
    wide = wp.empty(room, dtype=wp.int32, device=device)
    wp.launch(
        _patterns, dim=count, inputs=[*table, strong, aggregate, wide_offsets], outputs=[wide, counts], device=device
    )
    pattern = compact(wide_offsets, wide, counts, device)
    values = wp.empty(pattern.count, dtype=wp.float32, device=device)
    inputs = [*table, rows.weight, strong, aggregate, pattern.offsets, pattern.columns]
    wp.launch(_values, dim=count, inputs=inputs, outputs=[values], device=device)
    return Prolongation(pattern, values, coarse_count, *_transposed(pattern, values, count, coarse_count))


def _transposed(
    pattern: Rows, values: wp.array[wp.float32], count: int, coarse_count: int
) -> tuple[wp.array[wp.int32], wp.array[wp.int32], wp.array[wp.float32]]:
    """(column offsets, rows, values) by columns: a stable sort, so that sums over a column have a fixed order."""
    total, device = pattern.count, values.device
    row, row_of = (wp.empty(total, dtype=wp.int32, device=device) for _ in range(2))
    column_values = wp.empty(total, dtype=wp.float32, device=device)
    wp.launch(_rows_of_entries, dim=count, inputs=[pattern.offsets], outputs=[row], device=device)
    columns, entry = sort_by_key(pattern.columns)
    wp.launch(_columns, dim=total, inputs=[entry, row, values], outputs=[row_of, column_values], device=device)
    return row_offsets(columns, coarse_count), row_of, column_values
