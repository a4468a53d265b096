"""What is asked for, part of the way: handles from one keyframe to the next, fields and constraints from rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import as_numpy
from oneform_warp.constraints import Constraint
from oneform_warp.fields import Fields
from oneform_warp.handles import CENTROID, Handle
from oneform_warp.places import fitted, targets_of
from oneform_warp.rest import Rest

__all__ = ["at_rest", "between", "constraint_at", "fields_at"]

Floats = NDArray[np.float64]


def at_rest(handle: Handle, rest: Rest) -> Handle:
    """The same handle, which leaves everything where it is."""
    placed: dict[str, Any] = {}
    if handle.to is not None:
        placed = {"to": _as_given(handle, rest.rows.data[_members(handle, rest)], rest)}
    elif handle.moves:
        placed = {"move": np.zeros(3), "pivot": handle.pivot}
    stretch = handle.stretch if handle.stretch is None or handle.held else np.ones_like(handle.stretch)
    rotation = None if handle.rotation is None else np.zeros(3)
    return _like(handle, rotation, stretch, handle.frame, placed)


def between(a: Handle, b: Handle, s: float, rest: Rest) -> Handle:
    """The handle at a share 0 <= s < 1 of the way from a to b, which take hold of the same vertices in the same way.

    Rotation vectors and log stretches go straight, so whole turns count. Targets turn and stretch along with them about
    their centroid, which goes straight; so do pivots and moves. At s = 0 it is a itself.
    """
    if s == 0.0 or a.held:
        return a
    a, b = fitted([a, b], rest)
    rotation = None if a.rotation is None else _mix(a.rotation, b.rotation, s)
    stretch, frame = _stretch_between(a, b, s)
    placed: dict[str, Any] = {}
    if a.to is not None or b.to is not None:
        shape = _Shape.of(a, rest).towards(_Shape.of(b, rest), s)
        placed = {"to": _as_given(a, shape.points(a, rest), rest)}
    elif a.moves:
        placed = {"move": _mix(_move(a), _move(b), s), "pivot": _pivot_between(a, b, s, rest)}
    return _like(a, rotation, stretch, frame, placed)


def fields_at(fields: Fields, t: float) -> Fields:
    """t omega and sigma^t, or S^t; at t = 1 the fields themselves."""
    if t == 1.0:
        return fields
    omega, sigma = (None if each is None else as_numpy(each) for each in (fields.omega, fields.sigma))
    turns = None if omega is None else t * omega
    if fields.stretch is None:
        return Fields(turns, None if sigma is None else sigma**t)
    factors, axes = np.linalg.eigh(as_numpy(fields.stretch))
    return Fields(turns, stretch=(axes * factors[:, None, :] ** t) @ axes.transpose(0, 2, 1))


def constraint_at(constraint: Constraint, t: float, rest: Rest) -> Constraint:
    """C x = C x_rest + t (d - C x_rest); at t = 1 the constraint itself."""
    if t == 1.0:
        return constraint
    x = rest.rows.data
    if constraint.along is None:
        terms = constraint.value * x[constraint.vertex, constraint.axis]
        now = np.bincount(constraint.row, terms, len(constraint.d))
    else:
        a, b = constraint.along
        now = np.full(len(constraint.d), np.linalg.norm(x[b] - x[a]))
    return replace(constraint, d=_mix(now, constraint.d, t))


def _mix(a: Any, b: Any, s: float) -> Any:
    return (1.0 - s) * a + s * b


def _like(handle: Handle, rotation: Any, stretch: Any, frame: Any, placed: dict[str, Any]) -> Handle:
    """A handle that takes hold in the same way, with other values."""
    return Handle(
        handle.vertices,
        rotation=rotation,
        stretch=stretch,
        frame=frame,
        held=handle.held,
        name=handle.name,
        weight=handle.weight,
        snap=handle.snap,
        **placed,
    )


def _log_stretch(handle: Handle) -> Floats:
    """log S, (3, 3); zero where the stretch is free."""
    factors = np.broadcast_to(1.0 if handle.stretch is None else handle.stretch, 3)
    frame = np.eye(3) if handle.frame is None else handle.frame
    return np.asarray((frame * np.log(factors)) @ frame.T)


def _exponential(log_stretch: Floats) -> tuple[Floats, Floats]:
    """The factors (3,) of a symmetric log stretch (3, 3), and their directions as columns."""
    logs, frame = np.linalg.eigh(log_stretch)
    return np.exp(logs), frame


def _stretch_between(a: Handle, b: Handle, s: float) -> tuple[Any, Floats | None]:
    if a.stretch is None:
        return None, None
    if np.ndim(a.stretch) == np.ndim(b.stretch) == 0:
        return float(np.exp(_mix(np.log(a.stretch), np.log(b.stretch), s))), None
    return _exponential(_mix(_log_stretch(a), _log_stretch(b), s))


def _members(handle: Handle, rest: Rest) -> NDArray[np.int64]:
    return handle.members(len(rest.rows.data), 0)


def _as_given(handle: Handle, rows: Floats, rest: Rest) -> Floats:
    """Rows (k, 3) in the order of `members` -> (k, D) in the order in which the handle lists its vertices."""
    listed = np.atleast_1d(as_numpy(handle.vertices))
    given = rows.copy()
    if listed.dtype != bool:
        given[np.argsort(listed)] = rows
    return given[:, : rest.dimension]


def _move(handle: Handle) -> Floats:
    return np.zeros(3) if handle.move is None else np.asarray(handle.move)


def _pivot_between(a: Handle, b: Handle, s: float, rest: Rest) -> Any:
    if not any(isinstance(handle.pivot, np.ndarray) for handle in (a, b)):
        return CENTROID
    start, end = (h.pivot if isinstance(h.pivot, np.ndarray) else _centroid(h, rest) for h in (a, b))
    return _mix(start, end, s)


def _centroid(handle: Handle, rest: Rest) -> Floats:
    return np.asarray(rest.rows.data[_members(handle, rest)].mean(axis=0))


@dataclass(frozen=True, eq=False)
class _Shape:
    """Targets y = centre + R(omega) S (x - mean x + bulge), which any targets are with some bulge."""

    omega: Floats
    log_stretch: Floats
    centre: Floats
    bulge: Floats
    """What is left once centre, rotation and stretch are undone, (k, 3)."""

    @classmethod
    def of(cls, handle: Handle, rest: Rest) -> _Shape:
        omega = np.zeros(3) if handle.rotation is None else handle.rotation
        shape = cls(omega, _log_stretch(handle), np.zeros(3), np.zeros(3))
        y = targets_of(handle, 0, rest)
        centre, x = y.mean(axis=0), shape._centred(handle, rest)
        return cls(omega, shape.log_stretch, centre, np.linalg.solve(shape._matrix(), (y - centre).T).T - x)

    def towards(self, other: _Shape, s: float) -> _Shape:
        return _Shape(
            _mix(self.omega, other.omega, s),
            _mix(self.log_stretch, other.log_stretch, s),
            _mix(self.centre, other.centre, s),
            _mix(self.bulge, other.bulge, s),
        )

    def points(self, handle: Handle, rest: Rest) -> Floats:
        return np.asarray(self.centre + (self._centred(handle, rest) + self.bulge) @ self._matrix().T)

    def _centred(self, handle: Handle, rest: Rest) -> Floats:
        return np.asarray(rest.rows.data[_members(handle, rest)] - _centroid(handle, rest))

    def _matrix(self) -> Floats:
        from scipy.spatial.transform import Rotation

        factors, frame = _exponential(self.log_stretch)
        return np.asarray(Rotation.from_rotvec(self.omega).as_matrix() @ (frame * factors) @ frame.T)
