"""Symmetry: the handle that does on the other side of a plane what a handle does on this one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import as_numpy, read_rows
from oneform_warp.errors import InputError
from oneform_warp.handle_values import direction
from oneform_warp.handles import FIT, Handle

__all__ = ["mirror", "mirror_vertices"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

TOLERANCE = 0.01
"""How far a vertex may be from the mirror image of its partner, as a part of the bounding box's diagonal."""


def mirror(
    handle: Handle, x: Any, axis: Any = "x", *, at: float | None = None, tolerance: float | None = None
) -> Handle:
    """The mirrored handle: vertices, rotation -M omega, stretch M S M and places M p, with M = I - 2 n n^T.

    x: rest positions (V, D) of the mesh. axis: the normal n of the plane, "x", "y", "z" or three numbers. at: where the
    plane cuts the axis, None for the middle of the bounding box. tolerance: how far a vertex may be from the image of
    its partner, None for 1 % of the box's diagonal. Vertices that both sides share stay with the handle given.
    Raises InputError where the mesh has no vertices there, or where the handle is its own mirror image.
    """
    rows = read_rows(x, None, "x")
    plane = Plane.of(rows.data, axis, at, rows.dimension)
    own = handle.members(len(rows.data), 0)
    vertices, partner = mirror_vertices(rows.data, own, plane, tolerance, handle.label(0))
    return Handle(
        vertices,
        rotation=FIT if handle.fitted else plane.turn(handle),
        stretch=handle.stretch,
        frame=plane.frame(handle),
        held=handle.held,
        name=None if handle.name is None else f"{handle.name} mirrored",
        to=None if handle.to is None else plane.points(_of_partners(handle, len(rows.data), handle.to, partner, "to")),
        move=None if handle.move is None else plane.direction(handle.move),
        pivot=handle.pivot if handle.pivot is None or isinstance(handle.pivot, str) else plane.points(handle.pivot),
        weight=handle.weight
        if handle.weight is None or not np.ndim(handle.weight)
        else _of_partners(handle, len(rows.data), handle.weight, partner, "weight"),
        snap=handle.snap,
    )


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane normal . x = offset, and the mirror images of what a handle has."""

    normal: Floats
    """Of length 1, (3,)."""
    offset: float
    dimension: int = 3

    @classmethod
    def of(cls, x: Floats, axis: Any, at: float | None = None, dimension: int = 3) -> Plane:
        """Across an axis, at a place on it or in the middle of the bounding box of x (V, 3)."""
        normal = direction(axis, "axis")
        height = x @ normal
        return cls(normal, float(height.min() + height.max()) / 2.0 if at is None else float(at), dimension)

    @property
    def image(self) -> Floats:
        """M = I - 2 n n^T."""
        return np.asarray(np.eye(3) - 2.0 * np.outer(self.normal, self.normal))

    def points(self, values: Any) -> Floats:
        """Of points (..., D)."""
        values = np.asarray(values, dtype=np.float64)
        padded = np.zeros((*values.shape[:-1], 3))
        padded[..., : values.shape[-1]] = values
        images = padded - 2.0 * (padded @ self.normal - self.offset)[..., None] * self.normal
        return np.asarray(images[..., : self.dimension])

    def direction(self, values: Floats) -> Floats:
        """Of a translation (3,)."""
        return np.asarray((self.image @ values)[: self.dimension])

    def turn(self, handle: Handle) -> Any:
        """Of a rotation vector: it turns about the image of its axis, the other way round."""
        if handle.rotation is None:
            return None
        vector = -self.image @ handle.rotation
        return float(vector[2]) if handle.planar else vector

    def frame(self, handle: Handle) -> Floats | None:
        """Of the directions of three factors; a single factor needs none."""
        if not isinstance(handle.stretch, np.ndarray):
            return None
        return np.asarray(self.image if handle.frame is None else self.image @ handle.frame)


def mirror_vertices(
    x: Floats, own: Integers, plane: Plane, tolerance: float | None = None, where: str = "mirror"
) -> tuple[Integers, Integers]:
    """The vertices whose mirror images lie on `own`, ascending, without `own`, and the number in `own` of each partner.

    x: (V, 3), own: ascending. A vertex belongs to its nearest image, so that sides with other numbers
    of vertices work, too. InputError where none is there.
    """
    from scipy.spatial import cKDTree

    limit = TOLERANCE * float(np.linalg.norm(np.ptp(x, axis=0))) if tolerance is None else float(tolerance)
    images = Plane(plane.normal, plane.offset).points(x)
    away, nearest = cKDTree(x).query(images)
    place = np.full(len(x), -1, dtype=np.int64)
    place[own] = np.arange(len(own))
    hit = (place[nearest] >= 0) & (away <= limit)
    if not hit.any():
        gap = float(cKDTree(images[own]).query(x)[0].min())
        raise InputError(
            f"no vertex lies within {limit:.4g} of the handle's mirror image, the nearest is {gap:.4g} away",
            where=where,
            fix="check the axis, give the plane's place as at, or a larger tolerance",
        )
    vertices = np.flatnonzero(hit & (place < 0))
    if not len(vertices):
        raise InputError(
            "the handle is its own mirror image", where=where, fix="mirror handles that lie on one side of the plane"
        )
    return vertices, place[nearest[vertices]]


def _of_partners(handle: Handle, count: int, values: Any, partner: Integers, word: str) -> NDArray[Any]:
    """Values, one for each vertex of the handle, of the partners of the mirrored vertices."""
    return handle.rows(count, 0, as_numpy(values), word)[partner]
