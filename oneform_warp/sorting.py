"""Sorting, scanning and grouping on the device: what graphs and hierarchies are built from."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import warp as wp

__all__ = ["group_starts", "iota", "last", "row_offsets", "scan", "sort_by_key"]


FEW = 4_000
"""Keys below which NumPy sorts them faster than Warp's radix sort empties and sums up its 65,536 counters."""


@wp.kernel(enable_backward=False)
def _iota(
    # Out:
    number_out: wp.array[wp.int32],
):
    i = wp.tid()
    number_out[i] = i


def iota(count: int, device: Any) -> wp.array[wp.int32]:
    """0, 1, ..., count - 1."""
    numbers = wp.empty(count, dtype=wp.int32, device=device)
    wp.launch(_iota, dim=count, outputs=[numbers], device=device)
    return numbers


@cache
def _letter_box(device: str) -> tuple[wp.array[wp.int32], np.ndarray]:
    """One number of pinned memory, which a GPU writes without a detour, and NumPy's view of it."""
    word = wp.empty(1, dtype=wp.int32, device="cpu", pinned=True)
    return word, word.numpy()


def last(numbers: wp.array[wp.int32]) -> int:
    """The last of some numbers, on the host; waits for the device."""
    device: Any = numbers.device
    if not device.is_cuda:
        return int(numbers.numpy()[-1])
    word, seen = _letter_box(device.alias)
    wp.copy(word, numbers, src_offset=numbers.shape[0] - 1, count=1)
    wp.synchronize_stream(device.stream)
    return int(seen[0])


def scan(counts: wp.array[wp.int32]) -> tuple[wp.array[wp.int32], int]:
    """Counts per row, (n + 1,) with the last one zero -> (offsets (n + 1,), their total)."""
    offsets = wp.empty_like(counts)
    wp.utils.array_scan(counts, offsets, inclusive=False)
    return offsets, last(offsets)


def sort_by_key(keys: wp.array[Any]) -> tuple[wp.array[Any], wp.array[wp.int32]]:
    """Keys (int32 or int64, >= 0) -> (sorted keys, the place each came from), stable."""
    device: Any = keys.device
    count = keys.shape[0]
    if count == 0:
        return keys, wp.zeros(0, dtype=wp.int32, device=device)
    if not device.is_cuda and count < FEW:
        order = np.argsort(keys.numpy(), kind="stable")
        return wp.array(keys.numpy()[order], device=device), wp.array(order.astype(np.int32), device=device)
    # The radix sort works in the second half of its arrays.
    wide, places = wp.empty(2 * count, dtype=keys.dtype, device=device), wp.empty(2 * count, dtype=int, device=device)
    wp.copy(wide, keys, count=count)
    wp.launch(_iota, dim=count, outputs=[places], device=device)
    wp.utils.radix_sort_pairs(wide, places, count)
    return wide[:count], places[:count]


@wp.kernel(enable_backward=False)
def _starts(
    # In:
    key: wp.array[wp.int64],
    limit: wp.int64,
    # Out:
    start_out: wp.array[wp.int32],
):
    k = wp.tid()
    new = key[k] < limit
    if k > 0:
        new = new and key[k] != key[k - 1]
    start_out[k] = wp.where(new, 1, 0)


def group_starts(sorted_keys: wp.array[wp.int64], limit: int = np.iinfo(np.int64).max) -> wp.array[wp.int32]:
    """1 where a run of equal keys below `limit` begins, (count + 1,) with a zero at the end: ready for `scan`."""
    count, device = sorted_keys.shape[0], sorted_keys.device
    starts = wp.zeros(count + 1, dtype=wp.int32, device=device)
    wp.launch(_starts, dim=count, inputs=[sorted_keys, limit], outputs=[starts], device=device)
    return starts


@wp.kernel(enable_backward=False)
def _row_offsets(
    # In:
    key: wp.array[wp.int32],
    count: int,
    # Out:
    offset_out: wp.array[wp.int32],
):
    # Binary search: the first place whose key is not below this row.
    row = wp.tid()
    low = int(0)
    high = int(count)
    while low < high:
        middle = (low + high) / 2
        if key[middle] < row:
            low = middle + 1
        else:
            high = middle
    offset_out[row] = low


def row_offsets(sorted_rows: wp.array[wp.int32], row_count: int) -> wp.array[wp.int32]:
    """Where each row begins among sorted row numbers, (row_count + 1,)."""
    device = sorted_rows.device
    offsets = wp.empty(row_count + 1, dtype=wp.int32, device=device)
    inputs = [sorted_rows, sorted_rows.shape[0]]
    wp.launch(_row_offsets, dim=row_count + 1, inputs=inputs, outputs=[offsets], device=device)
    return offsets
