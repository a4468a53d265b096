"""Handles: the vertices that the user sets, and the rotation, stretch and place that they get."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import as_numpy, vertex_numbers
from oneform_warp.errors import InputError

__all__ = ["CENTROID", "FIT", "Handle", "check_dimension"]

CENTROID = "centroid"
"""In place of a pivot: the mean of the handle's vertices."""

FIT = "fit"
"""In place of a rotation: the one that fits the targets best."""

SNAP_WEIGHT = 1.0
"""What snapped vertices are pulled with where no weight is given: as strongly as by their edges together."""

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False, init=False)
class Handle:
    """Vertices that are turned by a rotation vector, stretched, put somewhere or held in place, or any of these."""

    vertices: Any
    rotation: NDArray[np.float64] | None
    """Rotation vector in radians, (3,); None where the rotation is free."""
    stretch: Any
    """A factor, three of them (3,) along the columns of `frame`, or None where the stretch is free."""
    frame: NDArray[np.float64] | None
    """Directions of three factors as columns, (3, 3); None for x, y, z."""
    held: bool
    name: str | None
    planar: bool
    """The rotation was given as a bare angle: it needs D = 2."""
    fitted: bool
    """The rotation is the one that fits `to` best."""
    to: Any
    """Target positions, (k, D), in the order of `vertices`; None for none."""
    move: Any
    """A translation (D,), or None."""
    pivot: Any
    """The point (D,) that the handle turns about as a whole, "centroid", or None."""
    weight: Any
    """How strongly targets pull, a number or (k,); None where positions are hard."""
    snap: bool

    def __init__(
        self,
        vertices: Any,
        *,
        rotation: Any = (0.0, 0.0, 0.0),
        axis: Any = None,
        angle: float | None = None,
        stretch: Any = 1.0,
        frame: Any = None,
        held: bool = False,
        name: str | None = None,
        to: Any = None,
        move: Any = None,
        pivot: Any = None,
        weight: Any = None,
        snap: bool = False,
    ) -> None:
        """Any number of turns: 720 degrees are not 0.

        vertices: by number or by mask (V,). rotation: a rotation vector in radians, right-handed (D = 2: one angle);
        None leaves it free; "fit" takes the one that fits `to` best, below 180 degrees. axis: "x", "y", "z" or a
        vector, with angle in degrees (D = 2: angle alone). stretch: factor > 0, or three factors along the columns of
        `frame` (default x, y, z) in the rest pose; None leaves it free. held: positions stay exactly where they are.

        Positions are left to the solve unless something places them: `to`, rows (k, D), one for each of the vertices in
        their order (of a mask: ascending); or the rigid motion pivot + R S (x - pivot) + move, by `move` (D,), by
        `pivot` (D,) or "centroid", or both. weight: None puts vertices exactly there; a number > 0, or one for each
        vertex, pulls each by so many times the sum of mu at its edges. snap: pull while solving, then put it there.
        Raises InputError for matrices, quaternions and Rotation objects, which lose whole turns, and for requests that
        contradict each other.
        """
        where = name or "handle"
        fitted = isinstance(rotation, str) and rotation == FIT
        vector, planar = (np.zeros(3), False) if fitted else _rotation_vector(rotation, axis, angle, where)
        factors = _stretch(stretch, where)
        placed = {"to": to, "move": move, "pivot": pivot}
        given = [word for word, value in placed.items() if value is not None]
        _check_place(given, where, held=held, fitted=fitted, weight=weight, snap=snap)
        turned = vector is not None and vector.any()
        if held and (turned or (factors is not None and np.any(np.asarray(factors) != 1.0))):
            raise InputError(
                "a held handle stays where it is and cannot be rotated or stretched as well",
                where=where,
                fix="drop held=True, or drop the rotation and stretch",
            )
        for field, value in (
            ("vertices", vertices),
            ("rotation", vector),
            ("stretch", factors),
            ("frame", _frame(frame, factors, where)),
            ("held", bool(held)),
            ("name", name),
            ("planar", planar),
            ("fitted", fitted),
            ("to", None if to is None else as_numpy(to)),
            ("move", None if move is None else _point(move, "move", where)),
            (
                "pivot",
                pivot
                if pivot is None or (isinstance(pivot, str) and pivot == CENTROID)
                else _point(pivot, "pivot", where),
            ),
            ("weight", None if weight is None else _weight(weight, where)),
            ("snap", bool(snap)),
        ):
            object.__setattr__(self, field, value)

    @property
    def placed(self) -> bool:
        """Whether the positions of the vertices are given."""
        return self.held or any(value is not None for value in (self.to, self.move, self.pivot))

    @property
    def moves(self) -> bool:
        """Whether they are given and not those of the rest pose."""
        return self.placed and not self.held

    @property
    def soft(self) -> bool:
        """Whether they are pulled to their positions instead of put there."""
        return self.placed and (self.weight is not None or self.snap)

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

    def rows(self, vertex_count: int, number: int, values: Any, word: str) -> NDArray[Any]:
        """Values, one for each of `vertices` in their order, in the order of `members`."""
        count = len(self.members(vertex_count, number))
        chosen = np.atleast_1d(as_numpy(self.vertices))
        if len(values) != count:
            raise InputError(
                f"{word} has {len(values)} rows for {count} vertices", where=self.label(number), fix="give one for each"
            )
        if chosen.dtype == bool:
            return values
        if len(chosen) != count:
            raise InputError(
                f"vertices repeat, and {word} has a row for each", where=self.label(number), fix="drop them"
            )
        return values[np.argsort(chosen)]

    def pull(self, vertex_count: int, number: int) -> NDArray[np.float64]:
        """The weights of a soft handle in the order of `members`, (k,), or one for all, ()."""
        if self.weight is None:
            return np.asarray(SNAP_WEIGHT)
        weight: NDArray[np.float64] = self.weight
        return weight if weight.ndim == 0 else self.rows(vertex_count, number, weight, "weight")

    def alone(self) -> Handle:
        """The same handle with its own copy of the vertices, which nobody can change."""
        own = np.array(as_numpy(self.vertices))
        own.flags.writeable = False
        return self.on(own, self.name)

    def turned(self, rotation: NDArray[np.float64]) -> Handle:
        """The same handle with this rotation vector (3,)."""
        twin = copy(self)
        object.__setattr__(twin, "rotation", rotation)
        object.__setattr__(twin, "fitted", False)
        return twin

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
            and self.placed == other.placed
            and self.snap == other.snap
            and _same(np.asarray(self.weight, dtype=float), np.asarray(other.weight, dtype=float))
            and (self.rotation is None) == (other.rotation is None)
            and (self.stretch is None) == (other.stretch is None)
            and _same(as_numpy(self.vertices), as_numpy(other.vertices))
        )

    def label(self, number: int) -> str:
        """The handle's name for messages, its number where it has none."""
        return f"handle {number}" if self.name is None else f"handle {self.name!r}"


def _same(a: NDArray[Any], b: NDArray[Any]) -> bool:
    """Whether two spellings of vertices are equal; a mask is no list of numbers."""
    return a.dtype.kind == b.dtype.kind and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")


def _check_place(given: list[str], where: str, *, held: bool, fitted: bool, weight: Any, snap: bool) -> None:
    """InputError for words about places that contradict each other."""
    if held and given:
        raise InputError(f"held and {given[0]} are both given", where=where, fix="give one of them")
    if "to" in given and len(given) > 1:
        raise InputError(
            f"to and {given[1]} are both given", where=where, fix="give target positions, or a motion by move and pivot"
        )
    if fitted and "to" not in given:
        raise InputError("a rotation cannot be fitted without targets", where=where, fix="give target positions as to")
    if not held and not given and (weight is not None or snap):
        raise InputError(
            "a weight pulls to a place, and none is given", where=where, fix="give to, move, pivot or held=True"
        )


def _stretch(stretch: Any, where: str) -> Any:
    """A factor, three factors (3,), or None."""
    if stretch is None:
        return None
    factors = np.asarray(stretch, dtype=np.float64)
    if factors.shape not in ((), (3,)) or not (np.isfinite(factors).all() and (factors > 0.0).all()):
        raise InputError(
            f"stretch is {stretch}", where=where, fix="give a factor > 0, 1.0 for none, or three along x, y, z"
        )
    return float(factors) if factors.shape == () else factors


FRAME_ERROR = 1.0e-6
"""By how much the columns of a frame may miss being orthonormal: what is typed with six digits passes."""


def _frame(frame: Any, factors: Any, where: str) -> NDArray[np.float64] | None:
    if frame is None:
        return None
    axes = np.asarray(frame, dtype=np.float64)
    if not isinstance(factors, np.ndarray):
        raise InputError("a frame needs three factors", where=where, fix="give stretch=(s1, s2, s3)")
    if axes.shape != (3, 3) or not np.abs(axes.T @ axes - np.eye(3)).max() <= FRAME_ERROR:
        raise InputError(
            "the columns of the frame are not orthonormal", where=where, fix="give a rotation matrix (3, 3)"
        )
    return axes


def _point(value: Any, word: str, where: str) -> NDArray[np.float64]:
    """A point or translation as (3,), the columns past D zero."""
    try:
        point = np.atleast_1d(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError):
        raise InputError(f"{word} is {value!r}", where=where, fix="give D finite numbers") from None
    if point.ndim != 1 or not 1 <= len(point) <= 3 or not np.isfinite(point).all():
        raise InputError(f"{word} is {value!r}", where=where, fix="give D finite numbers")
    return np.concatenate([point, np.zeros(3 - len(point))])


def _weight(weight: Any, where: str) -> NDArray[np.float64]:
    """One weight (), or one for each vertex (k,)."""
    weights = np.asarray(weight, dtype=np.float64)
    if weights.ndim > 1 or not (np.isfinite(weights).all() and (weights > 0.0).all()):
        raise InputError(f"weight is {weight!r}", where=where, fix="give a number > 0, or one for each vertex")
    return weights


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
