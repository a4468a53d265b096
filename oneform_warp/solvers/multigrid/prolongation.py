"""Smoothed prolongation P = (I - 0.85 D^-1 A) T over the strong edges, T the aggregates' indicator columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import warp as wp

from oneform_warp.solvers.multigrid.compact import Rows, compact, insert, scan
from oneform_warp.solvers.rows import LaplacianRows

__all__ = ["Prolongation", "smoothed_prolongation"]

DAMPING = wp.constant(wp.float32(0.85))


@dataclass(frozen=True, eq=False)
class Prolongation:
    """P (n x coarse) by rows, and by columns for P^T; every row sums to one, or is empty where nothing moves."""

    rows: Rows
    values: wp.array[wp.float32]
    coarse_count: int
    column_offsets: wp.array[wp.int32]
    """Column c has the entries by_column[column_offsets[c]] to by_column[column_offsets[c + 1]]."""
    by_column: wp.array[wp.int32]
    """Entries (places in `values`) in the order of their columns, ties by row."""
    row_of: wp.array[wp.int32]
    """The row of each entry in by_column."""


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
def _sort_keys(
    # In:
    p_offsets: wp.array[wp.int32],
    p_columns: wp.array[wp.int32],
    # Out:
    key_out: wp.array[wp.int32],
    entry_out: wp.array[wp.int32],
    row_out: wp.array[wp.int32],
):
    i = wp.tid()
    for k in range(p_offsets[i], p_offsets[i + 1]):
        key_out[k] = p_columns[k]
        entry_out[k] = k
        row_out[k] = i


@wp.kernel(enable_backward=False)
def _column_starts(
    # In:
    key: wp.array[wp.int32],
    count: int,
    # Out:
    offset_out: wp.array[wp.int32],
):
    # Binary search: the first place whose key is not below this column.
    c = wp.tid()
    low = int(0)
    high = int(count)
    while low < high:
        middle = (low + high) / 2
        if key[middle] < c:
            low = middle + 1
        else:
            high = middle
    offset_out[c] = low


@wp.kernel(enable_backward=False)
def _rows_of(
    # In:
    entry: wp.array[wp.int32],
    row: wp.array[wp.int32],
    # Out:
    entry_out: wp.array[wp.int32],
    row_out: wp.array[wp.int32],
):
    k = wp.tid()
    entry_out[k] = entry[k]
    row_out[k] = row[entry[k]]


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
    return Prolongation(pattern, values, coarse_count, *_transposed(pattern, count, coarse_count, device))


def _transposed(
    pattern: Rows, count: int, coarse_count: int, device: Any
) -> tuple[wp.array[wp.int32], wp.array[wp.int32], wp.array[wp.int32]]:
    """(column offsets, entries by column, their rows): a stable sort, so that sums over a column have a fixed order."""
    total = pattern.count
    key, entry = (wp.empty(2 * total, dtype=wp.int32, device=device) for _ in range(2))
    row = wp.empty(total, dtype=wp.int32, device=device)
    wp.launch(
        _sort_keys, dim=count, inputs=[pattern.offsets, pattern.columns], outputs=[key, entry, row], device=device
    )
    if total:
        wp.utils.radix_sort_pairs(key, entry, total)
    offsets = wp.empty(coarse_count + 1, dtype=wp.int32, device=device)
    wp.launch(_column_starts, dim=coarse_count + 1, inputs=[key, total], outputs=[offsets], device=device)
    by_column, row_of = (wp.empty(total, dtype=wp.int32, device=device) for _ in range(2))
    wp.launch(_rows_of, dim=total, inputs=[entry, row], outputs=[by_column, row_of], device=device)
    return offsets, by_column, row_of
