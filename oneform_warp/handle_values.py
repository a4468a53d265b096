"""What people write for the rotation, stretch and place of a handle -> checked arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError

__all__ = ["AXES", "direction", "frame_axes", "point", "pull_weights", "rotation_vector", "stretch_factors"]

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def stretch_factors(stretch: Any, where: str) -> Any:
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


def frame_axes(frame: Any, factors: Any, where: str) -> NDArray[np.float64] | None:
    """Orthonormal columns (3, 3) from themselves or from a rotation vector (3,); None for x, y, z."""
    if frame is None:
        return None
    axes = np.asarray(frame, dtype=np.float64)
    if axes.shape == (3,) and np.isfinite(axes).all():
        from scipy.spatial.transform import Rotation

        axes = Rotation.from_rotvec(axes).as_matrix()
    if not isinstance(factors, np.ndarray):
        raise InputError("a frame needs three factors", where=where, fix="give stretch=(s1, s2, s3)")
    if axes.shape != (3, 3) or not np.abs(axes.T @ axes - np.eye(3)).max() <= FRAME_ERROR:
        raise InputError(
            "the columns of the frame are not orthonormal", where=where, fix="give a rotation matrix (3, 3) or vector"
        )
    return axes


def point(value: Any, word: str, where: str) -> NDArray[np.float64]:
    """A point or translation as (3,), the columns past D zero."""
    try:
        point = np.atleast_1d(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError):
        raise InputError(f"{word} is {value!r}", where=where, fix="give finite numbers, as many as x has") from None
    if point.ndim != 1 or not 1 <= len(point) <= 3 or not np.isfinite(point).all():
        raise InputError(f"{word} is {value!r}", where=where, fix="give finite numbers, as many as x has")
    return np.concatenate([point, np.zeros(3 - len(point))])


def pull_weights(weight: Any, where: str) -> NDArray[np.float64]:
    """One weight (), or one for each vertex (k,)."""
    weights = np.asarray(weight, dtype=np.float64)
    if weights.ndim > 1 or not (np.isfinite(weights).all() and (weights > 0.0).all()):
        raise InputError(f"weight is {weight!r}", where=where, fix="give a number > 0, or one for each vertex")
    return weights


def rotation_vector(
    rotation: Any, axis: Any, angle: float | None, where: str
) -> tuple[NDArray[np.float64] | None, bool]:
    """The rotation vector (3,), and whether it was a bare angle."""
    if axis is not None or angle is not None:
        if rotation is None or np.any(np.asarray(rotation) != 0.0):
            raise InputError("both a rotation and an axis or angle are given", where=where, fix="give one of the two")
        if angle is None or not np.isfinite(angle):
            raise InputError(f"the angle is {angle}", where=where, fix="give the angle in degrees, as angle=90")
        about = np.asarray(AXES["z"]) if axis is None else direction(axis, where)
        return np.radians(angle) * about, axis is None
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


def direction(axis: Any, where: str) -> NDArray[np.float64]:
    """An axis by name, as "x" or "-y", or three numbers -> a vector of length 1, (3,)."""
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
