"""A chain: steps checked whole before anything runs, for a MeshSet, a trimesh, plain arrays, or files."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from oneform_warp.errors import InputError, OneFormWarning
from oneform_warp.filters.filter import nearest
from oneform_warp.filters.for_trimesh import as_given, mesh_from
from oneform_warp.filters.formats.motion import Normals
from oneform_warp.filters.listing import filter_list
from oneform_warp.filters.meshset import MeshSet
from oneform_warp.filters.mlx import read_script
from oneform_warp.filters.native import ABORTING, native_filters, native_plain
from oneform_warp.filters.passage import ChainReport, FilePassage, Passage, named
from oneform_warp.filters.registry import own_filters
from oneform_warp.filters.sequence import check_order, place
from oneform_warp.filters.step import Step

__all__ = ["Chain", "ChainReport", "Step"]


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
        passage = Passage(self.steps, meshes)
        with meshes.deferred():
            passage.run()
        return passage.report()

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
        passage = self.begin(source, target)
        passage.run()
        return passage.save(normals)

    def begin(self, source: str | os.PathLike[str], target: str | os.PathLike[str]) -> FilePassage:
        """The first part of `process`: the file is loaded, and no step applied yet."""
        self.check_order()
        return FilePassage(self.steps, Path(source), Path(target))


def _checked(step: Step, number: int) -> Step:
    """The step with plain parameters."""
    with named(place(number, step)):
        if step.filter in ABORTING:
            raise InputError("it needs OpenGL, and without it ends the whole process", fix="leave it out")
        if step.filter in own_filters():
            return Step(step.filter, own_filters()[step.filter].plain(step.parameters))
        if step.filter not in native_filters():
            known = dict.fromkeys(filter_list())
            raise InputError("there is no such filter", fix=nearest(step.filter, known).split(" known:")[0])
        return Step(step.filter, native_plain(step.filter, step.parameters))
