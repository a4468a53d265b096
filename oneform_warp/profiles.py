"""Profiles: how much is left at a part of the radius, by the names that Blender's proportional editing has."""

from __future__ import annotations

from difflib import get_close_matches

import warp as wp

from oneform_warp.errors import InputError

__all__ = ["PROFILES", "profile_at", "profile_number"]

PROFILES = ("smooth", "sphere", "root", "inverse_square", "sharp", "linear", "constant", "random")
"""With s = 1 - d / radius: 3 s^2 - 2 s^3, sqrt(2 s - s^2), sqrt(s), s (2 - s), s^2, s, 1, and s times a number in 0..1
that belongs to the vertex."""


def profile_number(name: str) -> int:
    """The place of a profile in PROFILES; InputError with the nearest name."""
    if name not in PROFILES:
        near = get_close_matches(str(name), PROFILES, n=1) or [PROFILES[0]]
        fix = f"did you mean {near[0]!r}? profiles: {', '.join(PROFILES)}"
        raise InputError(f"there is no profile {name!r}", where="falloff", fix=fix)
    return PROFILES.index(name)


@wp.func
def profile_at(number: int, s: wp.float64, vertex: int) -> wp.float64:
    """The weight at s = 1 - d / radius: 1 at the handle, where s = 1, and 0 from s = 0 on."""
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    weight = wp.float64(0.0)
    if s > wp.float64(0.0):
        if number == 0:
            weight = s * s * (wp.float64(3.0) - two * s)
        elif number == 1:
            weight = wp.sqrt(s * (two - s))
        elif number == 2:
            weight = wp.sqrt(s)
        elif number == 3:
            weight = s * (two - s)
        elif number == 4:
            weight = s * s
        elif number == 5:
            weight = s
        elif number == 6:
            weight = one
        else:
            # The handle itself keeps its weight.
            weight = wp.where(s < one, s * wp.float64(wp.randf(wp.rand_init(vertex))), one)
    return wp.min(weight, one)
