"""The mirrored handle beside a handle, as a filter's parameter asks for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from oneform_warp.filters.handle_set import PlacedHandle
from oneform_warp.filters.parameters import Choice
from oneform_warp.symmetry import Plane, mirror, mirror_vertices

__all__ = ["MIRROR", "NOWHERE", "mirrored"]

NOWHERE = "none"

MIRROR = Choice("mirror", NOWHERE, "Whether the mirror image across this axis, through the middle of the box, gets the "
                "mirrored handle, 'NAME mirrored'.", (NOWHERE, "x", "y", "z"))  # fmt: skip


def mirrored(handle: PlacedHandle, rest: NDArray[np.float64], axis: str) -> PlacedHandle:
    """The handle on the other side of the plane; rest: (V, 3). Painted weights are those of the partners."""
    twin = PlacedHandle.of(mirror(handle.hard(), rest, axis), len(rest))
    if not handle.painted:
        return twin
    own = np.flatnonzero(handle.mask)
    vertices, partner = mirror_vertices(rest, own, Plane.of(rest, axis))
    weights = np.zeros(len(rest))
    weights[vertices] = handle.weights[own[partner]]
    return replace(twin, weights=weights)
