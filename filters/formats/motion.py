"""Vertices that move, and what becomes of the normals stored with them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["Floats", "Motion", "Normals", "Polygons", "corner_normals", "turned_by"]

Floats = NDArray[np.float64]
Polygons = tuple[NDArray[np.int32], NDArray[np.int32]]
Normals = Literal["rotate", "recompute", "keep"]


@dataclass(frozen=True, eq=False)
class Motion:
    """A mesh before and after: positions (R, 3) of the file's vertex records and the polygons on them.

    normals: "rotate" turns stored normals by R(omega), omega (R, 3) rotation vectors in radians; without omega by the
    least rotation that takes the normal of the surface before to that after. "recompute" takes the surface's own.
    """

    before: Floats
    after: Floats
    polygons: Polygons
    omega: Floats | None = None
    normals: Normals = "rotate"

    @cached_property
    def rows(self) -> NDArray[np.int64]:
        """The records that are elsewhere afterwards."""
        moved = self.before != self.after
        return np.flatnonzero(moved[:, 0] | moved[:, 1] | moved[:, 2])

    def turned(self, stored: Floats, vertices: NDArray[np.int64], corners: NDArray[np.int64]) -> Floats:
        """Normals (n, 3), stored at vertices (n,), after the motion; bit for bit where nothing turns.

        corners (c,): for each corner of the polygons the row of its normal, n where it has none.
        """
        if self.normals == "keep":
            return stored
        if self.normals == "rotate" and self.omega is not None:
            return turned_by(self.omega[vertices], stored)
        after = corner_normals(self.after, self.polygons, corners, len(stored) + 1)[:-1]
        if self.normals == "recompute":
            return np.where(after.any(axis=1, keepdims=True), after, stored)
        before = corner_normals(self.before, self.polygons, corners, len(stored) + 1)[:-1]
        return _carried(before, after, stored)

    def turned_at_vertices(self, stored: Floats) -> Floats:
        """Normals (R, 3), one for each vertex record, after the motion."""
        return self.turned(stored, np.arange(len(stored)), self.polygons[0].astype(np.int64))

    def turned_facets(self, stored: Floats) -> Floats:
        """Normals (F, 3) of a soup, three records a triangle, which knows its own normal better than omega does."""
        if self.normals == "keep":
            return stored
        after = _triangle_normals(self.after)
        if self.normals == "recompute":
            return after
        return _carried(_triangle_normals(self.before), after, stored)


def corner_normals(points: Floats, polygons: Polygons, ids: NDArray[np.int64], count: int) -> Floats:
    """Sum the area vectors of the faces at all corners with one id: (count, 3), unit length or zero."""
    indices, offsets = polygons
    if not len(indices):
        return np.zeros((count, 3))
    following = np.arange(1, len(indices) + 1)
    following[offsets[1:] - 1] = offsets[:-1]
    # Relative to a corner of the face: far from the origin the areas would drown in rounding.
    size = np.diff(offsets)
    origin = np.repeat(points[indices[offsets[:-1]]], size, axis=0)
    edges = np.cross(points[indices] - origin, points[indices[following]] - origin)
    areas = np.repeat(np.add.reduceat(edges, offsets[:-1]), size, axis=0)
    normals = np.stack([np.bincount(ids, areas[:, axis], count) for axis in range(3)], axis=1)
    lengths: Floats = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(lengths > 0, lengths, 1))


def _triangle_normals(points: Floats) -> Floats:
    """The normals (F, 3) of a soup of triangles (3 F, 3), unit length or zero."""
    a, b, c = points[0::3], points[1::3], points[2::3]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(lengths > 0, lengths, 1))


def turned_by(omega: Floats, vectors: Floats) -> Floats:
    """R(omega) on vectors (n, 3), by rotation vectors (n, 3) in radians; bit for bit where omega is zero."""
    angle = np.linalg.norm(omega, axis=1, keepdims=True)
    safe = np.where(angle > 1e-8, angle, 1.0)
    first = np.where(angle > 1e-8, np.sin(angle) / safe, 1.0)
    half = np.where(angle > 1e-8, np.sin(angle / 2) / (safe / 2), 1.0)
    across = np.cross(omega, vectors)
    turned = vectors + first * across + half**2 / 2 * np.cross(omega, across)
    return np.where(angle > 0.0, turned, vectors)


def _carried(before: Floats, after: Floats, vectors: Floats) -> Floats:
    """The least rotations that take `before` to `after` (unit or zero) on vectors; bit for bit where these agree."""
    axis = np.cross(before, after)
    cosine = np.sum(before * after, axis=1, keepdims=True)
    opposite = cosine < -1.0 + 1e-12
    along = np.sum(axis * vectors, axis=1, keepdims=True)
    turned = cosine * vectors + np.cross(axis, vectors) + axis * along / np.where(opposite, 1.0, 1.0 + cosine)
    flipped = vectors - 2.0 * np.sum(before * vectors, axis=1, keepdims=True) * before
    known = before.any(axis=1) & after.any(axis=1) & (before != after).any(axis=1)
    return np.where(known[:, None], np.where(opposite, flipped, turned), vectors)
