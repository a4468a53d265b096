"""One kernel text, two precisions: the inner iterations run in float32, or by choice in float64 throughout."""

from __future__ import annotations

import types
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from oneform_warp.errors import InputError

__all__ = ["FLOAT32", "FLOAT64", "Precision", "in_both_precisions", "precision_named"]


@dataclass(frozen=True)
class Precision:
    """What the names Scalar and Vector stand for in a kernel of the inner iterations."""

    name: str
    scalar: type
    vector: type
    floor: float
    """The relative residual below which the recursion no longer follows the true one: restart there."""


FLOAT32 = Precision("float32", wp.float32, wp.vec3, 2.0e-7)
FLOAT64 = Precision("float64", wp.float64, wp.vec3d, 1.0e-12)


def precision_named(dtype: Any) -> Precision:
    """float32 or float64 by name, NumPy or Warp type -> Precision; InputError for any other."""
    for precision in (FLOAT32, FLOAT64):
        if dtype in (precision.name, precision.scalar, getattr(np, precision.name)):
            return precision
    raise InputError(f"iterations cannot run in {dtype!r}", where="dtype", fix="use 'float32' or 'float64'")


def in_both_precisions(function: Callable[..., None]) -> Callable[[Precision], wp.Kernel]:
    """A kernel text that uses the names Scalar and Vector -> the kernel of each precision.

    Each precision has a Warp module of its own, so that float64 is compiled only by those who ask for it.
    """

    def kernel(precision: Precision) -> wp.Kernel:
        names = {**function.__globals__, "Scalar": precision.scalar, "Vector": precision.vector}
        text = types.FunctionType(function.__code__, names, function.__name__)
        text.__annotations__ = function.__annotations__
        text.__module__ = function.__module__
        module = wp.get_module(f"{function.__module__}.{precision.name}")
        return wp.kernel(text, enable_backward=False, module=module)

    kernels = {precision: kernel(precision) for precision in (FLOAT32, FLOAT64)}
    return kernels.__getitem__
