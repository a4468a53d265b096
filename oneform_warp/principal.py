"""Directions that a shape has of itself: along it, and across."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.handle_values import direction

__all__ = ["PRINCIPAL", "Span", "across", "principal"]

Floats = NDArray[np.float64]

PRINCIPAL = "principal"
"""In place of an axis: the direction in which the vertices spread the most."""

EVEN = 0.02
"""Spreads that differ by less than this part count as equal, and leave the choice to x, y, z in this order."""

ROUNDING = 1.0e-9
"""Parts of a length within this are equal: rings of a mesh that is straight up to rounding stay whole."""

FEWEST = 0.02
"""An end has at least this part of the vertices: from a single one a rotation hardly spreads."""


@dataclass(frozen=True, eq=False)
class Span:
    """The vertices along a direction, from 0 at the lowest to 1 at the highest."""

    axis: Floats
    """Of length 1, (3,)."""
    at: Floats
    """(V,)."""
    x: Floats
    """Rest positions, (V, 3)."""

    @classmethod
    def of(cls, x: Floats, axis: Any) -> Span:
        """x: (V, 3); axis: "x", "-y", three numbers, "principal" or None for it. InputError where x has no extent."""
        along = principal(x) if axis is None or _is_principal(axis) else direction(axis, "axis")
        height = x @ along
        low, extent = float(height.min()), float(np.ptp(height))
        if not extent > 1.0e-12 * float(np.abs(x).max()):
            what = "the mesh has no extent along the axis" if np.ptp(x, axis=0).any() else "the mesh has no extent"
            raise InputError(what, where="axis", fix="choose another axis")
        return cls(along, (height - low) / extent, x)

    def ends(self, part: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Masks of the lowest and the highest part, each with at least one vertex in fifty."""
        if not 0.0 < part < 0.5:
            raise InputError(f"ends is {part}", where="ends", fix="give a part of the length between 0 and 0.5")
        count = max(int(FEWEST * len(self.at)), 1) - 1
        first = np.partition(self.at, count)[count]
        last = 1.0 - np.partition(1.0 - self.at, count)[count]
        low = self.at <= max(part, min(first, 0.5)) + ROUNDING
        return low, (self.at >= min(1.0 - part, last) - ROUNDING) & ~low

    def frame(self) -> Floats:
        """Columns (3, 3), right-handed: two directions across, and the axis."""
        first = across(self.x, self.axis)
        return np.stack([first, np.cross(self.axis, first), self.axis], axis=1)


def principal(x: Floats) -> Floats:
    """The direction in which vertices (V, 3) spread the most, its largest component positive, (3,)."""
    return _widest(x, np.eye(3))


def across(x: Floats, axis: Floats) -> Floats:
    """The direction at right angles to an axis (3,) in which vertices (V, 3) spread the most, of length 1."""
    return _widest(x, np.linalg.svd(axis[None])[2][1:].T)


def _widest(x: Floats, plane: Floats) -> Floats:
    """The direction within the span of orthonormal columns in which the vertices spread the most."""
    inside = (x - x.mean(axis=0)) @ plane
    spread, directions = np.linalg.eigh(inside.T @ inside)
    alike = spread >= (1.0 - EVEN) * spread[-1]
    space = plane @ directions[:, alike]
    # Of a disc or a ball every direction is as good: the projection of x, else of y, else of z, is found again.
    shadows = space @ space.T
    first = shadows[int(np.argmax(np.diag(shadows) >= np.diag(shadows).max() - EVEN))]
    widest = first / np.linalg.norm(first)
    widest[np.abs(widest) < ROUNDING] = 0.0
    return np.asarray(widest * np.sign(widest[int(np.argmax(np.abs(widest) > np.abs(widest).max() - EVEN))]))


def _is_principal(axis: Any) -> bool:
    return isinstance(axis, str) and axis == PRINCIPAL
