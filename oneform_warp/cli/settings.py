"""What the user asks of the deformation as a whole: options and the top level of a recipe, by the same names."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from oneform_warp.cli.specs import unknown_name
from oneform_warp.errors import InputError

__all__ = ["CHOICES", "Settings", "checked_setting", "settings_from", "weld_length"]

# The words of the core, repeated so that the help need not load Warp; a test compares them.
CHOICES = {
    "weights": ("cotangent", "uniform", "inverse_length"),
    "solver": ("auto", "cg", "cholmod", "cudss", "jacobi", "multigrid", "superlu"),
    "dtype": ("float32", "float64"),
    "start": ("auto", "rest", "previous", "min_depth", "maximal", "minimal", "rings", "zero"),
    "falloff": ("harmonic", "biharmonic", "geodesic"),
    "profile": ("smooth", "sphere", "root", "inverse_square", "sharp", "linear", "constant", "random"),
    "cells": ("spokes_and_rims", "spokes"),
    "backend": ("auto", "pymeshlab", "trimesh"),
}


LENGTHS = ("length", "radius", "struts")
"""Settings that are numbers above 0."""


@dataclass(frozen=True)
class Settings:
    """How to deform; None stands for the core's own default."""

    weights: str = "cotangent"
    weld: str | float = "exact"
    solver: str = "auto"
    tol: float | None = None
    max_iterations: int | None = None
    dtype: str | None = None
    start: str = "auto"
    sweeps: int | None = None
    length: float | None = None
    falloff: str = "harmonic"
    radius: float | None = None
    profile: str = "smooth"
    struts: float | None = None
    refine: int = 0
    refine_tol: float = 0.0
    cells: str = "spokes_and_rims"
    smooth_rotations: float = 0.0
    device: str | None = None
    backend: str = "auto"

    @property
    def solver_options(self) -> dict[str, Any]:
        """The fields of the solver that are given."""
        given = {"tol": self.tol, "max_iterations": self.max_iterations, "dtype": self.dtype}
        return {name: value for name, value in given.items() if value is not None}


def weld_length(weld: str | float, where: str = "weld") -> float | None:
    """What `Graph.from_faces` calls weld, from "exact", "off" or a length."""
    if weld in ("exact", "off"):
        return 0.0 if weld == "exact" else None
    try:
        length = math.nan if isinstance(weld, bool) else float(weld)
    except (TypeError, ValueError):
        length = math.nan
    if not (math.isfinite(length) and length >= 0.0):
        raise InputError(f"{weld!r} is not a length", where=where, fix="give a length >= 0, 'exact' or 'off'")
    return length


def checked_setting(key: str, value: Any, where: str) -> Any:
    """The value of a key of Settings from a recipe; InputError where it has the wrong kind."""
    if key in CHOICES:
        if value not in CHOICES[key]:
            raise unknown_name(key, str(value), CHOICES[key], where)
    elif key == "weld":
        weld_length(value, where)
    elif key == "device":
        if not isinstance(value, str):
            raise InputError(f"{value!r} is not a device", where=where, fix="give a text, as 'cpu' or 'cuda:0'")
    else:
        whole = key in ("max_iterations", "refine", "sweeps")
        number = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or value < 0 or (key in LENGTHS and value == 0):
            fix = (
                "give a whole number >= 0" if whole else "give a number > 0" if key in LENGTHS else "give a number >= 0"
            )
            raise InputError(f"{value!r} does not fit", where=where, fix=fix)
    return value


def settings_from(recipe: Mapping[str, Any], options: Mapping[str, Any]) -> Settings:
    """A recipe's settings, replaced by the options that are given (not None)."""
    return Settings(**{**recipe, **{key: value for key, value in options.items() if value is not None}})
