"""Constraints as people type them: a kind and its options, as in a recipe or on a command line."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from typing import Any

from oneform_warp import constraints
from oneform_warp.constraints import Constraint
from oneform_warp.errors import InputError

__all__ = ["CONSTRAINTS", "constraint_of_kind"]

CONSTRAINTS: dict[str, Callable[..., Constraint]] = {
    builder.__name__: builder
    for builder in (
        constraints.position,
        constraints.centroid,
        constraints.relative_position,
        constraints.edge_direction,
        constraints.edge_angle,
        constraints.edge_length,
        constraints.face_normal,
        constraints.planar,
        constraints.linear,
    )
}
"""Every builder by its name."""


def constraint_of_kind(kind: str, options: Mapping[str, Any]) -> Constraint:
    """CONSTRAINTS[kind](**options); InputError for a kind or option that there is none of, and for one that is missing.

    kind: of CONSTRAINTS. options: its arguments by name, as vertices, to, weight, name.
    """
    where = f"constraint {options['name']!r}" if options.get("name") else "constraint"
    if kind not in CONSTRAINTS:
        raise InputError(
            f"there is no kind {kind!r}{_near(kind, CONSTRAINTS)}", where=where, fix=f"use {', '.join(CONSTRAINTS)}"
        )
    known = inspect.signature(CONSTRAINTS[kind]).parameters
    for option in options:
        if option not in known:
            raise InputError(
                f"{kind} has no option {option!r}{_near(option, known)}", where=where, fix=f"use {', '.join(known)}"
            )
    for option, parameter in known.items():
        if parameter.default is inspect.Parameter.empty and option not in options:
            raise InputError(f"{kind} needs {option}", where=where, fix=f"add {option}")
    return CONSTRAINTS[kind](**options)


def _near(word: str, known: Mapping[str, Any]) -> str:
    near = get_close_matches(word, known, n=1)
    return f", did you mean {near[0]!r}?" if near else ""
