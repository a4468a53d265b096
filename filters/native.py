"""MeshLab's own filters: which there are, which abort the process, and whether parameters fit them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
import pymeshlab

from oneform_warp.errors import InputError
from oneform_warp.filters.filter import nearest
from oneform_warp.filters.parameters import Length

__all__ = [
    "ABORTING",
    "NATIVE_ERRORS",
    "as_pymeshlab",
    "forget_failure",
    "native_filters",
    "native_plain",
    "native_values",
    "plain_values",
    "same_folder",
]

ABORTING = frozenset({
    "compute_color_and_texture_from_active_rasters_projection",
    "compute_color_from_active_rasters_projection",
    "compute_color_from_current_raster_projection",
    "compute_scalar_ambient_occlusion_gpu",
    "compute_scalar_by_shape_diameter_function_per_vertex_gpu",
    "compute_scalar_by_volumetric_obscurance_gpu",
    "compute_scalar_from_raster_coverage_per_face",
    "compute_scalar_from_raster_coverage_per_vertex",
    "compute_texcoord_parametrization_and_texture_from_registered_rasters",
    "compute_texcoord_parametrization_from_registered_rasters",
    "create_mesh_by_grammar",
    "get_depth_complexity",
    "raster_alignment_mutual_information",
    "raster_global_refinement_mutual_information",
    "save_snapshot",
})  # fmt: skip
"""Filters that ask for an OpenGL context, and abort the whole process where there is none."""

CAMERA = "shot"

NATIVE_ERRORS = (
    pymeshlab.PyMeshLabException,
    pymeshlab.InvalidEnumException,
    pymeshlab.InvalidPercentageException,
    pymeshlab.MissingComponentException,
    pymeshlab.MissingCompactnessException,
    RuntimeError,  # pybind11's own, for values of a wrong type
)
"""What a native filter raises."""


@cache
def native_filters() -> frozenset[str]:
    """The names of pymeshlab's filters."""
    return frozenset(pymeshlab.filter_list())


def forget_failure() -> None:
    """Undoes what a failed filter leaves in pymeshlab: a pointer to the log of its MeshSet, which outlives the MeshSet.

    Without this the next mesh that is loaded or saved may crash the process.
    """
    _cube().set_selection_none()


def native_plain(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a native filter as plain data; InputError for names, types and ranges that pymeshlab refuses.

    pymeshlab clamps numbers out of range and says nothing; here they are errors.
    """
    defaults = _defaults(name)
    plain = {key: _plain(value) for key, value in given.items()}
    for key in plain:
        if key not in defaults:
            raise InputError(f"{name} has no parameter {key!r}", where=key, fix=nearest(key, defaults))
        if key == CAMERA:
            raise InputError("pymeshlab takes no camera, and ends the process", where=key, fix="leave it out")
    for key, value in native_values(name, plain).items():
        try:
            used = _cube().filter_parameter_values(name, **{key: value})[key]
        except NATIVE_ERRORS[:2] as error:
            raise InputError(f"{key} is {plain[key]!r}: {_line(error)}", where=key) from None
        except (RuntimeError, TypeError, ValueError):
            kind = type(defaults[key]).__name__
            raise InputError(f"{key} is {plain[key]!r}", where=key, fix=f"give a value of type {kind}") from None
        if _clamped(value, used):
            raise InputError(f"{key} is {value:g}, out of range", where=key, fix=f"the nearest value is {used:g}")
    return plain


def plain_values(used: Mapping[str, Any]) -> dict[str, Any]:
    """What pymeshlab says it uses as plain data, cameras left out."""
    return {key: _plain(value) for key, value in used.items() if key != CAMERA}


def native_values(name: str, plain: Mapping[str, Any]) -> dict[str, Any]:
    """Plain data -> what pymeshlab takes; InputError for values that have no such form."""
    defaults = _defaults(name)
    return {key: _native(name, key, value, defaults[key]) for key, value in plain.items()}


@cache
def _cube() -> pymeshlab.MeshSet:
    """A mesh with everything that a filter may ask for before it says its parameters."""
    meshes = pymeshlab.MeshSet()
    meshes.create_cube()
    meshes.compute_scalar_by_function_per_face(q="0")
    meshes.compute_scalar_by_function_per_vertex(q="0")
    return meshes


@cache
def _defaults(name: str) -> dict[str, Any]:
    return dict(_cube().filter_parameter_values(name))


@cache
def _is_length(name: str, key: str) -> bool:
    """Whether a number stands for a PercentageValue; pymeshlab does not say it."""
    try:
        _cube().filter_parameter_values(name, **{key: pymeshlab.PureValue(1.0)})
    except (pymeshlab.PyMeshLabException, RuntimeError):
        return False
    return True


def _plain(value: Any) -> Any:
    """pymeshlab's and NumPy's kinds of values as plain data."""
    if type(value).__name__ in ("PercentageValue", "PureValue"):
        return Length("length", 0.0, "").plain(value)
    if isinstance(value, pymeshlab.Color):
        return (value.red(), value.green(), value.blue(), value.alpha())
    if isinstance(value, np.ndarray | list | tuple):
        return tuple(_plain(each) for each in value)
    return value.item() if isinstance(value, np.generic) else value


def _native(name: str, key: str, value: Any, default: Any) -> Any:
    if isinstance(default, np.ndarray):
        return _array(key, value, default.shape)
    if isinstance(default, pymeshlab.Color):
        if not isinstance(value, tuple) or len(value) not in (3, 4):
            raise InputError(f"{key} is {value!r}", where=key, fix="give red, green, blue (and alpha), 0..255")
        return pymeshlab.Color(*value)
    if isinstance(default, float) and not isinstance(value, bool) and _is_length(name, key):
        length = Length(key, 0.0, "").plain(value)
        if isinstance(length, str):
            return _percentage(key, float(length.removesuffix("%")))
        return pymeshlab.PureValue(length)
    return value


def _percentage(key: str, percent: float) -> Any:
    if percent > 100.0:
        raise InputError(f"{key} is {percent:g}%", where=key, fix="give at most 100%, or a number in the mesh's unit")
    return pymeshlab.PercentageValue(percent)


def _array(key: str, value: Any, shape: tuple[int, ...]) -> Any:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape != shape or not np.isfinite(array).all():
        size = " x ".join(map(str, shape))
        raise InputError(f"{key} is {value!r}", where=key, fix=f"give {size} finite numbers")
    return array


def _clamped(value: Any, used: Any) -> bool:
    """Whether pymeshlab took another number; its own are float32."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not isinstance(used, int | float):
        return False
    return not abs(used - value) <= 1e-6 * max(1.0, abs(value))


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


@contextmanager
def as_pymeshlab(message: str) -> Iterator[None]:
    """InputError as the exception that users of pymeshlab catch, with its words and our cause."""
    try:
        yield
    except InputError as error:
        raise pymeshlab.PyMeshLabException(f"{message}\nDetails: {error}") from error


@contextmanager
def same_folder() -> Iterator[None]:
    """Back to the folder that pymeshlab leaves when a file cannot be loaded."""
    folder = os.getcwd()
    try:
        yield
    finally:
        os.chdir(folder)
