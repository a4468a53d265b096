"""A mesh on its way through the steps of a chain, and a file."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError, OneFormWarning
from oneform_warp.filters.formats.motion import Normals
from oneform_warp.filters.measures import MEASURES
from oneform_warp.filters.meshfile import MeshFile, read_mesh
from oneform_warp.filters.meshset import MeshSet
from oneform_warp.filters.native import NATIVE_ERRORS
from oneform_warp.filters.registry import own_filters
from oneform_warp.filters.saving import save_by_meshlab
from oneform_warp.filters.sequence import place
from oneform_warp.filters.step import Step

__all__ = ["ChainReport", "FilePassage", "Passage", "named"]


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
    measures: Mapping[str, float] = field(default_factory=dict)
    """What the last get_oneform_measures found."""


class Passage:
    """The current mesh of a MeshSet, and how many of the steps it has behind it."""

    def __init__(self, steps: Sequence[Step], meshes: MeshSet) -> None:
        self.meshes, self.steps, self.done = meshes, tuple(steps), 0
        self._before = meshes.looks()
        self._results = dict[str, Any]()
        self._notes = list[str]()
        self._seconds = dict[str, float]()

    def run(self, end: int | None = None) -> None:
        """Applies the steps before number `end`, from 0, or all; InputError names the one that failed."""
        while self.done < (len(self.steps) if end is None else end):
            step, number, begin = self.steps[self.done], self.done + 1, time.perf_counter()
            with named(place(number, step)), _collected(self._notes):
                result = self.meshes.apply_step(step)
            if step.filter in own_filters():
                known = ChainReport.__annotations__
                self._results |= {name: value for name, value in result.items() if name in known}
                if step.filter == MEASURES.name:
                    self._results["measures"] = {name: float(value) for name, value in result.items()}
            self._seconds[f"{number} {step.filter}"] = time.perf_counter() - begin
            self.done = number

    def report(self) -> ChainReport:
        """How it went so far."""
        return ChainReport(
            energy=self._results.get("energy"),
            residual=self._results.get("residual"),
            iterations=self._results.get("iterations"),
            converged=self._results.get("converged", True),
            warnings=tuple(self._notes),
            seconds=dict(self._seconds),
            lost=(),
            moved_only=self.meshes.mesh_number() > 0 and self.meshes.looks_like(self._before),
            measures=self._results.get("measures", {}),
        )


class FilePassage(Passage):
    """A file that is loaded, goes through the steps, and is written."""

    def __init__(self, steps: Sequence[Step], source: Path, target: Path) -> None:
        begin = time.perf_counter()
        self.target, meshes = target.absolute(), MeshSet(deferred=True)
        own = all(step.filter in own_filters() for step in steps)  # then MeshLab may have nothing to do
        self.file = read_mesh(source, mesh_set=meshes, later=own)
        self.file.check_target(self.target)
        if self.file.backend == "gltf":
            meshes.name_parts(self.file.groups)
        super().__init__(steps, meshes)
        self._loading = time.perf_counter() - begin

    def save(self, normals: Normals) -> ChainReport:
        """Writes the mesh: the input with other positions where only these changed, or as MeshLab does."""
        begin, report, meshes, file = time.perf_counter(), self.report(), self.meshes, self.file
        lost: tuple[str, ...] = ()
        if report.moved_only and file.keeps(self.target):
            positions = meshes.vertex_matrix()
            notes = file.write(self.target, positions, normals=normals, omega=_turned(meshes, file, positions))
        else:
            lost, notes = save_by_meshlab(meshes, file.path, self.target)
        seconds = {"load": self._loading, **report.seconds, "save": time.perf_counter() - begin}
        return replace(report, seconds=seconds, lost=lost, warnings=(*report.warnings, *notes))


def _turned(meshes: MeshSet, file: MeshFile, positions: NDArray[np.float64]) -> Any:
    """The rotation vectors (V, 3) by which a deformation turned the file's surface; None where more moved it."""
    placed = meshes.handle_sets.get(meshes.current_mesh_id())
    if placed is None or placed.result is None or not np.array_equal(placed.rest, file.positions):
        return None
    return placed.result.solution.omega if np.array_equal(placed.result.positions, positions) else None


@contextmanager
def named(where: str) -> Iterator[None]:
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
