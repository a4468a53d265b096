"""Rows of distinct numbers on the device: where the patterns of sparse matrices come from, without a host copy."""

from __future__ import annotations

from typing import Any

import warp as wp

from oneform_warp.sorting import scan

__all__ = ["Rows", "compact", "insert"]


class Rows:
    """CSR rows of column numbers: row i has columns[offsets[i]] to columns[offsets[i + 1]]."""

    def __init__(self, offsets: wp.array[wp.int32], columns: wp.array[wp.int32]) -> None:
        self.offsets, self.columns = offsets, columns

    @property
    def count(self) -> int:
        """How many entries there are."""
        return int(self.columns.shape[0])


@wp.func
def insert(columns: wp.array[wp.int32], begin: int, count: int, column: int) -> int:
    """Adds a column to the `count` distinct ones that stand from `begin` on -> the new count."""
    for k in range(begin, begin + count):
        if columns[k] == column:
            return count
    columns[begin + count] = column
    return count + 1


@wp.kernel(enable_backward=False)
def _compact(
    # In:
    wide_offsets: wp.array[wp.int32],
    wide: wp.array[wp.int32],
    offsets: wp.array[wp.int32],
    # Out:
    columns_out: wp.array[wp.int32],
):
    i = wp.tid()
    begin = offsets[i]
    for k in range(offsets[i + 1] - begin):
        columns_out[begin + k] = wide[wide_offsets[i] + k]


def compact(
    wide_offsets: wp.array[wp.int32], wide: wp.array[wp.int32], counts: wp.array[wp.int32], device: Any
) -> Rows:
    """Rows with room at their ends -> rows without; counts (n + 1,) says how much of each is used."""
    offsets, total = scan(counts)
    columns = wp.empty(total, dtype=wp.int32, device=device)
    wp.launch(_compact, dim=counts.shape[0] - 1, inputs=[wide_offsets, wide, offsets], outputs=[columns], device=device)
    return Rows(offsets, columns)
