"""Handles: the vertices that the user sets, and the rotation, stretch and hold that they get."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import as_numpy, vertex_numbers
from oneform_warp.errors import InputError

__all__ = ["Handle", "check_dimension"]

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False, init=False)
class Handle:
    """Vertices that are turned by a rotation vector, stretched by a factor, held in place, or any of these."""

    vertices: Any
    rotation: NDArray[np.float64] | None
    """Rotation vector in radians, (3,); None where the rotation is free."""
    stretch: float | None
    held: bool
    name: str | None
    planar: bool
    """The rotation was given as a bare angle: it needs D = 2."""

    def __init__(
        self,
        vertices: Any,
        *,
        rotation: Any = (0.0, 0.0, 0.0),
        axis: Any = None,
        angle: float | None = None,
        stretch: float | None = 1.0,
        held: bool = False,
        name: str | None = None,
    ) -> None:
        """Any number of turns: 720 degrees are not 0.

        vertices: by number or by mask (V,). rotation: a rotation vector in radians, right-handed (D = 2: one angle);
        None leaves it free. axis: "x", "y", "z" or a vector, with angle in degrees (D = 2: angle alone).
        stretch: factor > 0; None leaves it free. held: positions stay exactly where they are.
        Raises InputError for matrices, quaternions and Rotation objects, which lose whole turns, and for a held
        handle that is rotated or stretched.
        """
        where = name or "handle"
        vector, planar = _rotation_vector(rotation, axis, angle, where)
        if stretch is not None and not (np.isfinite(stretch) and stretch > 0.0):
            raise InputError(f"stretch is {stretch}", where=where, fix="give a factor > 0, 1.0 for none")
        if held and ((vector is not None and vector.any()) or stretch not in (None, 1.0)):
            raise InputError(
                "a held handle stays where it is and cannot be rotated or stretched as well",
                where=where,
                fix="drop held=True, or drop the rotation and stretch",
            )
        for field, value in (
            ("vertices", vertices),
            ("rotation", vector),
            ("stretch", stretch),
            ("held", bool(held)),
            ("name", name),
            ("planar", planar),
        ):
            object.__setattr__(self, field, value)

    def members(self, vertex_count: int, number: int) -> NDArray[np.int64]:
        """The handle's vertices, ascending; InputError when there are none or they do not fit the mesh."""
        chosen = vertex_numbers(self.vertices, vertex_count, self.label(number))
        if not len(chosen):
            raise InputError(
                "no vertex is selected",
                where=self.label(number),
                fix="check the selection that makes this handle",
            )
        return chosen

    def alone(self) -> Handle:
        """The same handle with its own copy of the vertices, which nobody can change."""
        own = np.array(as_numpy(self.vertices))
        own.flags.writeable = False
        return self.on(own, self.name)

    def on(self, vertices: Any, name: str | None) -> Handle:
        """The same handle on other vertices, by another name."""
        twin = copy(self)
        object.__setattr__(twin, "vertices", vertices)
        object.__setattr__(twin, "name", name)
        return twin

    def holds_like(self, other: Handle) -> bool:
        """Whether both take hold of the same vertices in the same way; by what angle or factor does not matter."""
        return (
            self.held == other.held
            and (self.rotation is None) == (other.rotation is None)
            and (self.stretch is None) == (other.stretch is None)
            and _same(as_numpy(self.vertices), as_numpy(other.vertices))
        )

    def label(self, number: int) -> str:
        """The handle's name for messages, its number where it has none."""
        return f"handle {number}" if self.name is None else f"handle {self.name!r}"


def _same(a: NDArray[Any], b: NDArray[Any]) -> bool:
    """Whether two spellings of vertices are equal; a mask is no list of numbers."""
    return a.dtype.kind == b.dtype.kind and np.array_equal(a, b)


def _rotation_vector(
    rotation: Any, axis: Any, angle: float | None, where: str
) -> tuple[NDArray[np.float64] | None, bool]:
    """The rotation vector (3,), and whether it was a bare angle."""
    if axis is not None or angle is not None:
        if rotation is None or np.any(np.asarray(rotation) != 0.0):
            raise InputError("both a rotation and an axis or angle are given", where=where, fix="give one of the two")
        if angle is None or not np.isfinite(angle):
            raise InputError(f"the angle is {angle}", where=where, fix="give the angle in degrees, as angle=90")
        direction = (0.0, 0.0, 1.0) if axis is None else _axis(axis, where)
        return np.radians(angle) * np.asarray(direction), axis is None
    if rotation is None:
        return None, False
    if hasattr(rotation, "as_rotvec"):
        raise InputError(
            "a Rotation object has lost its whole turns",
            where=where,
            fix="pass rotation=R.as_rotvec(), or axis and angle for more than 180 degrees",
        )
    vector = np.asarray(rotation, dtype=np.float64)
    if vector.shape in ((3, 3), (4, 4), (4,)):
        raise InputError(
            f"an array of shape {vector.shape} is a matrix or quaternion, which lose whole turns",
            where=where,
            fix="pass a rotation vector in radians: scipy's Rotation.from_matrix(M).as_rotvec() makes one",
        )
    if vector.shape not in ((), (1,), (3,)) or not np.isfinite(vector).all():
        raise InputError(
            f"rotation is {rotation!r}",
            where=where,
            fix="give three finite radians (D = 2: one angle in radians)",
        )
    return (vector, False) if vector.shape == (3,) else (np.array([0.0, 0.0, float(vector.reshape(()))]), True)


def _axis(axis: Any, where: str) -> NDArray[np.float64]:
    if isinstance(axis, str):
        if axis.lower().lstrip("+-") not in AXES:
            raise InputError(f"there is no axis {axis!r}", where=where, fix="use 'x', 'y', 'z' or three numbers")
        sign = -1.0 if axis.startswith("-") else 1.0
        return sign * np.asarray(AXES[axis.lower().lstrip("+-")])
    vector = np.asarray(axis, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise InputError(f"the axis is {axis!r}", where=where, fix="use 'x', 'y', 'z' or three numbers, not all 0")
    return vector / length


def check_dimension(handle: Handle, number: int, dimension: int) -> None:
    """InputError for a rotation that dimension D does not have."""
    turn = handle.rotation
    if turn is None or not turn.any():
        return
    if dimension == 3 and handle.planar:
        raise InputError("an angle alone turns nothing in D = 3", where=handle.label(number), fix="give an axis too")
    if dimension == 2 and turn[:2].any():
        raise InputError(
            "in D = 2 there is only one axis",
            where=handle.label(number),
            fix="give an angle alone, or axis='z'",
        )
    if dimension == 1:
        raise InputError("a line has no rotations", where=handle.label(number), fix="use stretch")
