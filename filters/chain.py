"""A chain: steps checked whole before anything runs, for a MeshSet, a trimesh, plain arrays, or files."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError, OneFormWarning
from oneform_warp.filters.changes import looks_of
from oneform_warp.filters.filter import nearest
from oneform_warp.filters.for_trimesh import as_given, mesh_from
from oneform_warp.filters.formats.motion import Normals
from oneform_warp.filters.listing import filter_list
from oneform_warp.filters.meshfile import MeshFile, read_mesh
from oneform_warp.filters.meshset import MeshSet
from oneform_warp.filters.mlx import read_script
from oneform_warp.filters.native import ABORTING, NATIVE_ERRORS, native_filters, native_plain
from oneform_warp.filters.registry import own_filters
from oneform_warp.filters.saving import save_by_meshlab
from oneform_warp.filters.sequence import check_order, place
from oneform_warp.filters.step import Step

__all__ = ["Chain", "ChainReport", "Step"]


@dataclass(frozen=True)
class ChainReport:
    """How a run went. Energy, residual and iterations are of the last deformation, None where there was none."""

    energy: float | None
    """Squared units of x."""
    residual: float | None
    """The largest residual over the one to reach: at most 1 where it converged."""
    iterations: int | None
    converged: bool
    warnings: tuple[str, ...]
    seconds: Mapping[str, float]
    """Wall time of load, each step, and save."""
    lost: tuple[str, ...]
    """What the written format loses, in words."""
    moved_only: bool
    """Whether the chain changed nothing but positions, so that the output is the input with others."""


@dataclass(frozen=True)
class Chain:
    """Steps, native and ours, in order; their parameters are plain data.

    Raises InputError, naming the step, for a filter that is not known, parameters that do not fit it, and filters that
    abort the process where there is no OpenGL.
    """

    steps: tuple[Step, ...]

    def __init__(self, steps: Iterable[Step]) -> None:
        checked = tuple(_checked(step, number) for number, step in enumerate(steps, 1))
        object.__setattr__(self, "steps", checked)

    @classmethod
    def from_script(cls, path: str | os.PathLike[str]) -> Chain:
        """The chain of an .mlx file, MeshLab's or ours."""
        return cls([applied.step for applied in read_script(path)])

    def check_order(self) -> None:
        """InputError where the steps cannot work on a mesh fresh from a file, whatever mesh it is."""
        check_order(self.steps)

    def run(self, meshes: MeshSet) -> ChainReport:
        """Applies the steps to the current mesh; InputError names the step that failed."""
        before, results, notes = looks_of(meshes), dict[str, Any](), list[str]()
        seconds = dict[str, float]()
        for number, step in enumerate(self.steps, 1):
            begin = time.perf_counter()
            with _named(place(number, step)), _collected(notes):
                result = meshes.apply_step(step)
            if step.filter in own_filters():
                results |= {name: value for name, value in result.items() if name in ChainReport.__annotations__}
            seconds[f"{number} {step.filter}"] = time.perf_counter() - begin
        return ChainReport(
            energy=results.get("energy"),
            residual=results.get("residual"),
            iterations=results.get("iterations"),
            converged=results.get("converged", True),
            warnings=tuple(notes),
            seconds=seconds,
            lost=(),
            moved_only=meshes.mesh_number() > 0 and looks_of(meshes).same_as(before),
        )

    def apply(self, mesh: Any) -> Any:
        """The chain on a MeshSet (in place), a trimesh.Trimesh or (vertices, faces), -> the same kind.

        Where only vertices moved, a trimesh keeps its visuals and faces their shape and dtype. Warns what a run notes.
        """
        meshes = mesh if isinstance(mesh, MeshSet) else MeshSet()
        if meshes is not mesh:
            meshes.add_mesh(mesh_from(mesh))
        report = self.run(meshes)
        for text in report.warnings:
            warnings.warn(text, OneFormWarning, stacklevel=2)
        return mesh if meshes is mesh else as_given(mesh, meshes.current_mesh(), moved_only=report.moved_only)

    def process(
        self, source: str | os.PathLike[str], target: str | os.PathLike[str], *, normals: Normals = "rotate"
    ) -> ChainReport:
        """Loads a mesh, runs the steps and writes it, whole or not at all.

        Where only vertices moved and the format stays, the output is the input file with other positions, and stored
        normals turned with the surface; otherwise MeshLab writes it, and the report says what is lost. Raises
        InputError or FileError.
        """
        self.check_order()
        begin = time.perf_counter()
        target, meshes = Path(target).absolute(), MeshSet()
        file = read_mesh(source, mesh_set=meshes)
        file.check_target(target)
        if file.backend == "gltf":
            meshes.name_parts(file.groups)
        loaded = time.perf_counter()
        report = self.run(meshes)
        ran = time.perf_counter()
        lost: tuple[str, ...] = ()
        if report.moved_only and file.keeps(target):
            positions = meshes.current_mesh().vertex_matrix()
            notes = file.write(target, positions, normals=normals, omega=_turned(meshes, file, positions))
        else:
            lost, notes = save_by_meshlab(meshes, file.path, target)
        seconds = {"load": loaded - begin, **report.seconds, "save": time.perf_counter() - ran}
        return replace(report, seconds=seconds, lost=lost, warnings=(*report.warnings, *notes))


def _turned(meshes: MeshSet, file: MeshFile, positions: NDArray[np.float64]) -> Any:
    """The rotation vectors (V, 3) by which a deformation turned the file's surface; None where more moved it."""
    placed = meshes.handle_sets.get(meshes.current_mesh_id())
    if placed is None or placed.result is None or not np.array_equal(placed.rest, file.positions):
        return None
    return placed.result.solution.omega if np.array_equal(placed.result.positions, positions) else None


def _checked(step: Step, number: int) -> Step:
    """The step with plain parameters."""
    with _named(place(number, step)):
        if step.filter in ABORTING:
            raise InputError("it needs OpenGL, and without it ends the whole process", fix="leave it out")
        if step.filter in own_filters():
            return Step(step.filter, own_filters()[step.filter].plain(step.parameters))
        if step.filter not in native_filters():
            known = dict.fromkeys(filter_list())
            raise InputError("there is no such filter", fix=nearest(step.filter, known).split(" known:")[0])
        return Step(step.filter, native_plain(step.filter, step.parameters))


@contextmanager
def _named(where: str) -> Iterator[None]:
    """Errors of a step as InputError with the step's name; the kind of our own ones stays."""
    try:
        yield
    except InputError as error:
        raise _at(error, where) from error
    except NATIVE_ERRORS as error:
        if isinstance(error.__cause__, InputError):
            raise _at(error.__cause__, where) from error
        raise InputError(" ".join(str(error).split()), where=where, fix="check the step and the mesh") from error


def _at(error: InputError, where: str) -> InputError:
    return type(error)(error.what, where=": ".join(filter(None, (where, error.where))), fix=error.fix)


@contextmanager
def _collected(notes: list[str]) -> Iterator[None]:
    """Warnings of this package's kind become notes; others are warned as ever."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for each in caught:
        if issubclass(each.category, OneFormWarning):
            notes.append(str(each.message))
        else:
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
