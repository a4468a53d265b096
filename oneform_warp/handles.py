"""Handles: the vertices that the user sets, and the rotation, stretch and place that they get."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import as_numpy, vertex_numbers
from oneform_warp.errors import InputError
from oneform_warp.handle_values import frame_axes, point, pull_weights, rotation_vector, stretch_factors

__all__ = ["CENTROID", "FIT", "Handle", "check_dimension"]

CENTROID = "centroid"
"""In place of a pivot: the mean of the handle's vertices."""

FIT = "fit"
"""In place of a rotation: the one that fits the targets best."""

SNAP_WEIGHT = 1.0
"""What snapped vertices are pulled with where no weight is given: as strongly as by their edges together."""


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
        `frame` (default x, y, z; or a rotation vector) in the rest pose; None leaves it free. held: positions stay
        exactly where they are.

        Positions are left to the solve unless something places them: `to`, rows (k, D), one for each of the vertices in
        their order (of a mask: ascending); or the rigid motion pivot + R S (x - pivot) + move, by `move` (D,), by
        `pivot` (D,) or "centroid", or both. weight: None puts vertices exactly there; a number > 0, or one for each
        vertex, pulls each by so many times the sum of mu at its edges. snap: pull while solving, then put it there.
        Raises InputError for matrices, quaternions and Rotation objects, which lose whole turns, and for requests that
        contradict each other.
        """
        where = name or "handle"
        fitted = isinstance(rotation, str) and rotation == FIT
        vector, planar = (np.zeros(3), False) if fitted else rotation_vector(rotation, axis, angle, where)
        factors = stretch_factors(stretch, where)
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
            ("frame", frame_axes(frame, factors, where)),
            ("held", bool(held)),
            ("name", name),
            ("planar", planar),
            ("fitted", fitted),
            ("to", None if to is None else as_numpy(to)),
            ("move", None if move is None else point(move, "move", where)),
            ("pivot", None if pivot is None else _pivot(pivot, where)),
            ("weight", None if weight is None else pull_weights(weight, where)),
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

    def onto(self, to: Any) -> Handle:
        """The same handle with these targets (k, D)."""
        twin = copy(self)
        object.__setattr__(twin, "to", to)
        return twin

    def within(self, centre: NDArray[np.float64], scale: float) -> Handle:
        """The same handle where positions x are given as (x - centre) / scale; centre (3,)."""
        twin = copy(self)
        if self.to is not None:
            rows = self.to.reshape(len(self.to), -1)
            object.__setattr__(twin, "to", (rows - centre[: rows.shape[1]]) / scale)
        if self.move is not None:
            object.__setattr__(twin, "move", self.move / scale)
        if isinstance(self.pivot, np.ndarray):
            object.__setattr__(twin, "pivot", (self.pivot - centre) / scale)
        return twin

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

    def describe(self) -> str:
        """What the handle does, in words."""
        if self.held:
            return "softly held in place" if self.soft else "held in place"
        words = [_turn_in_words(self.rotation)] if not self.fitted else ["rotation fitted"]
        factors = "free" if self.stretch is None else " ".join(f"{s:.6g}" for s in np.atleast_1d(self.stretch))
        if factors != "1":
            words.append("stretch free" if self.stretch is None else f"stretched by {factors}")
        words += [
            word
            for word, value in (("put on targets", self.to), ("turned about a point", self.pivot))
            if value is not None
        ]
        if self.move is not None:
            words.append(f"moved by ({' '.join(f'{m:.4g}' for m in self.move)})")
        words += ["softly"] if self.weight is not None else []
        return ", ".join(words + (["snapped"] if self.snap else []))

    def label(self, number: int) -> str:
        """The handle's name for messages, its number where it has none."""
        return f"handle {number}" if self.name is None else f"handle {self.name!r}"


def _turn_in_words(turn: NDArray[np.float64] | None) -> str:
    if turn is None:
        return "rotation free"
    size = float(np.linalg.norm(turn))
    axis = " ".join(f"{each + 0.0:.4g}" for each in turn / (size or 1.0))  # + 0.0 makes 0 of -0
    return f"rotated by {np.degrees(size):.6g} degrees about ({axis})" if size else "not rotated"


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


def _pivot(pivot: Any, where: str) -> Any:
    """A point (3,), or CENTROID."""
    if isinstance(pivot, str) and pivot == CENTROID:
        return pivot
    return point(pivot, "pivot", where)


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
