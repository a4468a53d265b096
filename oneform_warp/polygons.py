"""Polygons as (indices, offsets): what a mesh's faces become inside, n-gons kept as they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError

__all__ = ["Faces", "Polygons", "as_polygons", "out_of_range"]

Faces = Any
"""(F, k) integer array, a list of polygons, or the pair (indices, offsets)."""


class Polygons(NamedTuple):
    """Face f is indices[offsets[f]:offsets[f + 1]], int64 vertex numbers, in order around the face."""

    indices: NDArray[np.int64]
    offsets: NDArray[np.int64]


def as_polygons(faces: Faces, vertex_count: int) -> Polygons:
    """Faces in any of the three spellings -> checked Polygons.

    Raises InputError for indices out of range, offsets that do not fit, or numbers that are not integers.
    """
    if isinstance(faces, tuple) and len(faces) == 2 and np.ndim(faces[0]) == 1 and np.ndim(faces[1]) == 1:
        polygons = Polygons(_integers(faces[0]), _integers(faces[1]))
        _check_offsets(polygons)
    elif isinstance(faces, np.ndarray) and faces.ndim == 2:
        count, corners = faces.shape
        polygons = Polygons(_integers(faces).ravel(), np.arange(count + 1, dtype=np.int64) * corners)
    else:
        polygons = _from_list(faces)
    _check_range(polygons, vertex_count)
    return polygons


def _integers(values: Any) -> NDArray[np.int64]:
    array = np.asarray(values)
    if array.size and not np.issubdtype(array.dtype, np.integer):
        raise InputError(
            f"faces hold {array.dtype} numbers, not vertex numbers",
            where="faces",
            fix="give integers, as in np.array([[0, 1, 2]])",
        )
    return array.astype(np.int64)


def _from_list(faces: Any) -> Polygons:
    if isinstance(faces, str | bytes) or not isinstance(faces, Sequence | np.ndarray):
        raise InputError(
            f"faces cannot be a {type(faces).__name__}",
            where="faces",
            fix="give an (F, k) array, a list of polygons, or (indices, offsets)",
        )
    lists = [_integers(polygon) for polygon in faces]
    for number, polygon in enumerate(lists):
        if polygon.ndim != 1:
            raise InputError("a polygon is a flat list of vertex numbers", where=f"face {number}", fix="flatten it")
    offsets = np.zeros(len(lists) + 1, dtype=np.int64)
    np.cumsum([len(polygon) for polygon in lists], out=offsets[1:])
    indices = np.concatenate(lists) if lists else np.zeros(0, dtype=np.int64)
    return Polygons(indices, offsets)


def _check_offsets(polygons: Polygons) -> None:
    indices, offsets = polygons
    rising = len(offsets) > 0 and offsets[0] == 0 and offsets[-1] == len(indices) and np.all(np.diff(offsets) >= 0)
    if not rising:
        raise InputError(
            "the offsets of the pair (indices, offsets) do not fit its indices",
            where="faces",
            fix=f"let offsets rise from 0 to len(indices) = {len(indices)}, one more entry than faces",
        )


def _check_range(polygons: Polygons, vertex_count: int) -> None:
    indices, offsets = polygons
    wrong = (indices < 0) | (indices >= vertex_count)
    if wrong.any():
        corner = int(np.argmax(wrong))
        face = int(np.searchsorted(offsets, corner, side="right")) - 1
        raise out_of_range(int(indices[corner]), face, vertex_count)


def out_of_range(vertex: int, face: int, vertex_count: int) -> InputError:
    """The error for a face with a vertex that the mesh does not have."""
    return InputError(
        f"vertex number {vertex} does not exist, the mesh has {vertex_count} vertices",
        where=f"face {face}",
        fix=f"use numbers from 0 to {vertex_count - 1}",
    )
