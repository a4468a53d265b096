"""The checks that every solver's options pass when it is made."""

from __future__ import annotations

from typing import Any

import numpy as np

from oneform_warp.errors import InputError

__all__ = ["check_limits"]


def check_limits(tol: float, max_iterations: Any) -> None:
    """InputError unless tol >= 0 is finite and max_iterations >= 0 is whole."""
    if not (np.isfinite(tol) and tol >= 0.0):
        raise InputError(f"tol is {tol}", where="solver", fix="give a number >= 0, as 1e-6")
    if not isinstance(max_iterations, int | np.integer) or max_iterations < 0:
        raise InputError(f"max_iterations is {max_iterations!r}", where="solver", fix="give a whole number >= 0")
