"""Presets: the handles of common deformations, along an axis or along the shape itself.

    y = deform(x, faces, presets.bend(x, 90))

Each returns a list of `Handle`, to use as it is, to change, or to join with others. `axis` is "x", "-y", three numbers,
or None for the principal axis, the direction in which the vertices spread the most; its low end stays where it is.
Parts of a mesh that are not connected move each by the handles that it has.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows, vertex_mask
from oneform_warp.errors import InputError
from oneform_warp.handle_values import direction
from oneform_warp.handles import Handle
from oneform_warp.joints import beyond_joint
from oneform_warp.principal import Span, across

__all__ = ["PRESETS", "bend", "pose", "stretch", "swell", "taper", "twist"]


def bend(x: Any, angle: float = 90.0, *, axis: Any = None, about: Any = None, ends: float = 0.1) -> list[Handle]:
    """Bends along the axis: the low end is held, the high end is turned about a direction across.

    x: (V, D), D = 2 or 3; angle: degrees, any number of turns; about: as axis, None for the direction across in which
    the shape is widest (D = 2: out of the plane); ends: the parts of the length that stay stiff, below 0.5.
    """
    span = _span(x, axis)
    low, high = span.ends(ends)
    return [_held(low), Handle(high, rotation=np.radians(angle) * _turning(span, x, about), name="turned end")]


def twist(x: Any, angle: float = 180.0, *, axis: Any = None, ends: float = 0.1) -> list[Handle]:
    """Twists along the axis: the low end is held, the high end is turned about the axis itself.

    x: (V, 3); angle: degrees, any number of turns; ends: the parts of the length that stay stiff, below 0.5.
    """
    span = _span(x, axis, dimensions=(3,))
    low, high = span.ends(ends)
    return [_held(low), Handle(high, rotation=np.radians(angle) * span.axis, name="turned end")]


def taper(x: Any, factor: float = 0.5, *, axis: Any = None, ends: float = 0.1) -> list[Handle]:
    """Makes the shape thinner (factor < 1) or thicker towards the high end, across the axis; its length stays.

    x: (V, D), D = 2 or 3; factor > 0: the thickness at the high end; ends: as in `bend`.
    """
    span = _span(x, axis)
    low, high = span.ends(ends)
    factors = _factor(factor), _factor(factor), 1.0
    return [_held(low), Handle(high, stretch=factors, frame=span.frame(), name="tapered end")]


def stretch(
    x: Any, factor: float = 1.5, *, axis: Any = None, keep_volume: bool = False, ends: float = 0.1
) -> list[Handle]:
    """Makes the shape longer (factor > 1) or shorter along the axis, evenly; its low end stays where it is.

    x: (V, D), D = 2 or 3; factor > 0: the new length over the old one; keep_volume: by 1 / sqrt(factor) across; ends:
    as in `bend`, here the part that is put in its place.
    """
    span = _span(x, axis)
    low, high = span.ends(ends)
    thickness = _factor(factor) ** -0.5 if keep_volume else 1.0
    same: dict[str, Any] = {"stretch": (thickness, thickness, _factor(factor)), "frame": span.frame()}
    return [
        Handle(low, pivot=_foot(span, low), name="stretched foot", **same),
        Handle(high, name="stretched end", **same),
    ]


def swell(x: Any, factor: float = 1.5, *, axis: Any = None, at: float = 0.5, ends: float = 0.1) -> list[Handle]:
    """Makes the shape thicker (factor > 1) or thinner around one place, across the axis; both ends are held.

    x: (V, D), D = 2 or 3; factor > 0: the thickness there; at: where, from 0 at the low end to 1 at the high one; ends:
    as in `bend`, and the part of the length that swells as a whole.
    """
    span = _span(x, axis)
    low, high = span.ends(ends)
    if not 0.0 < at < 1.0:
        raise InputError(f"at is {at}", where="at", fix="give a place between 0 and 1")
    away = np.abs(span.at - at)
    free = ~(low | high)
    if not free.any():
        raise InputError("no vertex is left between the ends", where="ends", fix="give a smaller part")
    middle = free & (away <= max(ends / 2.0, float(away[free].min())))
    factors = _factor(factor), _factor(factor), 1.0
    swollen = Handle(middle, stretch=factors, frame=span.frame(), name="swollen middle")
    return [_held(low), swollen, _held(high, "other held end")]


def pose(
    x: Any,
    angle: float = 90.0,
    *,
    axis: Any = None,
    at: float = 0.5,
    about: Any = None,
    room: float = 0.2,
    joint: Any = None,
    faces: Any = None,
    beyond: int | None = None,
) -> list[Handle]:
    """Turns everything beyond a joint about it, as a limb; the rest is held, and the joint's vertices are free.

    x: (V, D), D = 2 or 3; angle: degrees; about: as in `bend`. The joint is a plane across the axis, `at` from 0 to 1,
    where a part `room` of the length is free, and the high side turns; or the vertices `joint` (numbers or a mask),
    which cut the `faces` in two, and the side with the vertex `beyond` turns, None for the smaller one.
    """
    if joint is None:
        return _posed_by_plane(x, angle, _span(x, axis), at, about, room)
    rows = read_rows(x, None, "x")
    chosen = vertex_mask(joint, len(rows.data), "joint")
    side, rest = beyond_joint(rows.data, faces, chosen, beyond)
    pivot = rows.data[chosen].mean(axis=0)
    limb = rows.data[side].mean(axis=0) - pivot
    span = Span.of(rows.data[side | chosen], limb if axis is None and limb.any() else axis)
    return [_held(rest), _limb(side, angle, _turning(span, x, about), pivot)]


PRESETS = {each.__name__: each for each in (bend, twist, taper, stretch, swell, pose)}


def _posed_by_plane(x: Any, angle: float, span: Span, at: float, about: Any, room: float) -> list[Handle]:
    if not (0.0 < at < 1.0 and 0.0 <= room < 1.0):
        raise InputError(f"at is {at} and room {room}", where="joint", fix="give parts of the length between 0 and 1")
    low, high = span.at <= at - room / 2.0, span.at > at + room / 2.0
    for side, word in ((low, "before"), (high, "beyond")):
        if not side.any():
            raise InputError(f"no vertex lies {word} the joint", where="at", fix="move it, or give it less room")
    near = ~(low | high)
    # The vertices around the joint; where there are none, those nearest to it on both sides.
    around = near if near.any() else _nearest(span, at)
    pivot = span.x[around].mean(axis=0)
    return [_held(low), _limb(high, angle, _turning(span, x, about), pivot)]


def _nearest(span: Span, at: float) -> NDArray[np.bool_]:
    below, above = span.at[span.at <= at].max(), span.at[span.at > at].min()
    return np.asarray((span.at == below) | (span.at == above))


def _limb(vertices: NDArray[np.bool_], angle: float, about: NDArray[np.float64], pivot: NDArray[np.float64]) -> Handle:
    return Handle(vertices, rotation=np.radians(angle) * about, pivot=pivot, name="turned limb")


def _foot(span: Span, low: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The middle of the low end, where the shape begins."""
    middle = span.x[low].mean(axis=0)
    return np.asarray(middle - (span.axis @ middle - (span.x @ span.axis).min()) * span.axis)


def _held(vertices: NDArray[np.bool_], name: str = "held end") -> Handle:
    return Handle(vertices, held=True, name=name)


def _span(x: Any, axis: Any, dimensions: tuple[int, ...] = (2, 3)) -> Span:
    rows = read_rows(x, None, "x")
    if rows.dimension not in dimensions or not len(rows.data):
        words = " or ".join(map(str, dimensions))
        raise InputError(f"{len(rows.data)} vertices in D = {rows.dimension}", where="x", fix=f"give (V, {words})")
    return Span.of(rows.data, axis)


def _turning(span: Span, x: Any, about: Any) -> NDArray[np.float64]:
    """The direction that a bend turns about."""
    flat = np.shape(x)[-1] == 2
    if about is not None:
        return direction(about, "about")
    return np.array([0.0, 0.0, 1.0]) if flat else across(span.x, span.axis)


def _factor(factor: float) -> float:
    if not (np.isfinite(factor) and factor > 0.0):
        raise InputError(f"factor is {factor}", where="factor", fix="give a number > 0")
    return float(factor)
