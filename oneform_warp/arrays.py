"""The boundary: the caller's arrays are checked once here and become (count, 3) float64 rows, and back again.

Inside, every 0-form and 1-form has three columns; D = 1 and D = 2 leave the others zero. A plane turned about its
normal is a special case of space, so one set of kernels serves all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.errors import InputError

__all__ = ["Rows", "as_numpy", "read_pairs", "read_rows", "to_device", "vertex_mask", "vertex_numbers"]


@dataclass(frozen=True, eq=False)
class Rows:
    """Checked rows, and how the caller spelled them."""

    data: NDArray[np.float64]
    """(count, 3), the columns past `dimension` zero."""
    dimension: int
    flat: bool
    """The caller gave shape (count,) for D = 1."""
    dtype: np.dtype[Any]
    device: Any = None
    """The Warp device of the caller's array, None for NumPy."""
    element: Any = None
    """The Warp type of the caller's rows, as wp.vec3."""

    def like(self, values: NDArray[np.float64]) -> Any:
        """(count, 3) float64 -> the caller's number of columns, dtype, and kind of array."""
        columns = values[:, 0] if self.flat else values[:, : self.dimension]
        result = np.ascontiguousarray(columns, dtype=self.dtype)
        if self.device is None:
            return result
        return wp.array(result, dtype=self.element, device=self.device)


def read_rows(values: Any, count: int | None, name: str) -> Rows:
    """NumPy or Warp rows of D = 1, 2 or 3 numbers -> Rows; `count` is the number of rows that there must be.

    Raises InputError for another shape, numbers that are not real, and the first row that is not finite.
    """
    device = values.device if isinstance(values, wp.array) else None
    array = np.asarray(values.numpy() if device is not None else values)
    if array.dtype.kind not in "fiub" or array.ndim not in (1, 2):
        raise InputError(
            f"a {array.dtype} array of shape {array.shape} has no rows of real numbers",
            where=name,
            fix="give shape (count, D) with D = 1, 2 or 3",
        )
    flat = array.ndim == 1
    rows = array.reshape(len(array), 1) if flat else array
    if not 1 <= rows.shape[1] <= 3:
        raise InputError(f"rows of {rows.shape[1]} numbers", where=name, fix="D is 1, 2 or 3")
    if count is not None and len(rows) != count:
        raise InputError(f"{len(rows)} rows where {count} are needed", where=name, fix=f"give {count} rows")
    data = np.zeros((len(rows), 3))
    data[:, : rows.shape[1]] = rows
    finite = np.isfinite(data)
    if not finite.all():
        row = int(np.argmin(finite.all(axis=1)))
        raise InputError(
            f"row {row} is {rows[row].tolist()}, not finite",
            where=name,
            fix="remove or repair NaN and infinity",
        )
    dtype = array.dtype if array.dtype in (np.float32, np.float64) else np.dtype(np.float64)
    if device is None:
        return Rows(data, rows.shape[1], flat, dtype)
    return Rows(data, rows.shape[1], flat, dtype, device, values.dtype if dtype == array.dtype else wp.float64)


def to_device(data: NDArray[np.float64], device: Any) -> wp.array[wp.vec3d]:
    """(count, 3) float64 rows as a Warp array of vec3d; a copy, also on CPU."""
    return wp.array(data, dtype=wp.vec3d, device=device, copy=True)


def as_numpy(values: Any) -> NDArray[Any]:
    """A NumPy view of what the caller gave; a Warp array on a GPU is copied."""
    return np.asarray(values.numpy() if isinstance(values, wp.array) else values)


def vertex_mask(vertices: Any, vertex_count: int, where: str = "fixed") -> NDArray[np.bool_]:
    """Vertices by index or mask, None for none -> mask (V,). InputError for numbers out of range or a wrong length."""
    mask = np.zeros(vertex_count, dtype=bool)
    if vertices is not None:
        mask[vertex_numbers(vertices, vertex_count, where)] = True
    return mask


def vertex_numbers(vertices: Any, vertex_count: int, where: str) -> NDArray[np.int64]:
    """Vertices by index or mask -> ascending numbers. InputError for numbers out of range or a wrong length."""
    chosen = np.atleast_1d(as_numpy(vertices))
    if chosen.dtype == bool:
        if chosen.shape != (vertex_count,):
            raise InputError(
                f"a mask of shape {chosen.shape} for {vertex_count} vertices",
                where=where,
                fix=f"give ({vertex_count},)",
            )
        return np.flatnonzero(chosen)
    if chosen.size and (chosen.dtype.kind not in "iu" or chosen.ndim != 1):
        raise InputError(
            f"a {chosen.dtype} array of shape {chosen.shape} names no vertices",
            where=where,
            fix="give vertex numbers or a boolean mask",
        )
    wrong = (chosen < 0) | (chosen >= vertex_count)
    if wrong.any():
        raise InputError(
            f"vertex number {chosen[np.argmax(wrong)]} does not exist, there are {vertex_count} vertices",
            where=where,
            fix=f"use numbers from 0 to {vertex_count - 1}",
        )
    numbers: NDArray[np.int64] = np.unique(chosen.astype(np.int64))
    return numbers


def read_pairs(edges: Any, vertex_count: int, name: str) -> NDArray[np.int64]:
    """Checked vertex pairs (k, 2); None is none."""
    array = np.zeros((0, 2), dtype=np.int64) if edges is None else np.asarray(edges)
    if array.ndim != 2 or array.shape[1] != 2 or (array.size and array.dtype.kind not in "iu"):
        raise InputError(f"an array of shape {array.shape}", where=name, fix="give (k, 2) vertex numbers")
    wrong = ((array < 0) | (array >= vertex_count)).any(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"edge {row} is {array[row].tolist()}, the graph has {vertex_count} vertices",
            where=name,
            fix=f"use vertex numbers from 0 to {vertex_count - 1}",
        )
    return array.astype(np.int64)
