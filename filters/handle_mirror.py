"""The mirrored handle beside a handle, as a filter's parameter asks for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.filters.handle_set import PlacedHandle
from oneform_warp.filters.parameters import Choice, Length, Number, Parameter, Vector
from oneform_warp.symmetry import Plane, mirror, mirror_vertices

__all__ = ["MIRRORING", "mirrored"]

NOWHERE, CUSTOM = "none", "custom axis"
CENTER, ORIGIN = "Bounding box center", "Origin"

MIRRORING: tuple[Parameter, ...] = (
    Choice("mirror", NOWHERE, "Whether the mirror image across this axis gets the mirrored handle, 'NAME mirrored'.",
           (NOWHERE, "x", "y", "z", CUSTOM)),
    Vector("mirroraxis", (0.0, 0.0, 0.0), "For mirror='custom axis': the normal of the plane."),
    Choice("mirrorrelativeto", CENTER, "Where mirroroffset is measured from.", (CENTER, ORIGIN)),
    Number("mirroroffset", 0.0, "How far along the axis the plane is from there."),
    Length("mirrortolerance", "1%", "How far a vertex may be from the image of its partner.", above=True),
)  # fmt: skip


def mirrored(handle: PlacedHandle, rest: NDArray[np.float64], values: Mapping[str, Any]) -> PlacedHandle | None:
    """The handle on the other side of the plane, if there is to be one; rest: (V, 3). Painted weights are mirrored."""
    if values["mirror"] == NOWHERE:
        return None
    axis = values["mirroraxis"] if values["mirror"] == CUSTOM else values["mirror"]
    if not any(axis):
        raise InputError("the axis is zero", where="mirroraxis", fix="give three numbers, not all 0")
    at = values["mirroroffset"] + (Plane.of(rest, axis).offset if values["mirrorrelativeto"] == CENTER else 0.0)
    tolerance = values["mirrortolerance"]
    twin = PlacedHandle.of(mirror(handle.hard(), rest, axis, at=at, tolerance=tolerance), len(rest))
    if not handle.painted:
        return twin
    own = np.flatnonzero(handle.mask)
    vertices, partner = mirror_vertices(rest, own, Plane.of(rest, axis, at), tolerance)
    weights = np.zeros(len(rest))
    weights[vertices] = handle.weights[own[partner]]
    return replace(twin, weights=weights)
