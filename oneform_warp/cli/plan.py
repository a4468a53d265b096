"""A mesh, its handles and a deformer: everything that is checked before the first kernel runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from oneform_warp.cli.mesh_facts import box_text
from oneform_warp.cli.selections import select_vertices
from oneform_warp.cli.settings import Settings, weld_length
from oneform_warp.cli.specs import HandleSpec
from oneform_warp.deformation import Deformation
from oneform_warp.deformer import Deformer
from oneform_warp.errors import FileError
from oneform_warp.fields import Smoothing
from oneform_warp.filters import MeshFile
from oneform_warp.filters.meshfile import WRITABLE
from oneform_warp.graph import Graph
from oneform_warp.handles import Handle
from oneform_warp.solvers import Progress, solver_named

__all__ = ["Plan", "handle_text", "make_plan"]


@dataclass(frozen=True, eq=False)
class Plan:
    """What is going to be deformed, and how."""

    mesh: MeshFile
    specs: Sequence[HandleSpec]
    handles: Sequence[Handle]
    deformer: Deformer
    settings: Settings

    def solve(self, progress: Progress) -> Deformation:
        """The deformation."""
        settings = self.settings
        return self.deformer.solve(
            self.handles, sweeps=settings.sweeps, length=settings.length, start=settings.start, progress=progress
        )

    def vertices(self, *, held: bool) -> NDArray[np.bool_]:
        """The vertices (V,) of the handles that hold, or of the others."""
        masks = [handle.vertices for handle in self.handles if handle.held == held]
        return np.logical_or.reduce([np.zeros(len(self.mesh.positions), dtype=bool), *masks])

    def lines(self) -> list[str]:
        """One line for each handle: its name, vertices, box, and what it does."""
        lines = []
        for spec, handle in zip(self.specs, self.handles, strict=True):
            points = self.mesh.positions[handle.vertices]
            lines.append(f"{spec.name}: {len(points):,} vertices ({box_text(points)}), {handle_text(handle)}")
        return lines


def make_plan(mesh: MeshFile, specs: Sequence[HandleSpec], settings: Settings, out: Path | None) -> Plan:
    """Checked selections, handles and options; InputError names the one that cannot be used. Warp is initialised."""
    _check_faces(mesh)
    if out is not None:
        _check_format(mesh, out)
    Smoothing(settings.sweeps, settings.length)
    handles = [Handle(select_vertices(spec, mesh), **{**spec.options, "name": spec.name}) for spec in specs]
    graph = Graph.from_faces(
        mesh.positions,
        mesh.faces,
        weights=settings.weights,
        weld=weld_length(settings.weld),
        device=settings.device,
    )
    deformer = Deformer(mesh.positions, graph, solver=solver_named(settings.solver, graph, settings.solver_options))
    deformer.check(handles)
    return Plan(mesh, specs, handles, deformer, settings)


def handle_text(handle: Handle) -> str:
    """What a handle does, in words."""
    if handle.held:
        return "held in place"
    turn = handle.rotation
    if turn is None:
        words = ["rotation free"]
    elif not turn.any():
        words = ["not rotated"]
    else:
        size = float(np.linalg.norm(turn))
        axis = " ".join(f"{each + 0.0:.4g}" for each in turn / size)  # + 0.0 makes 0 of -0
        words = [f"rotated by {np.degrees(size):.6g} degrees about ({axis})"]
    if handle.stretch is None:
        words.append("stretch free")
    elif handle.stretch != 1.0:
        words.append(f"stretched by {handle.stretch:.6g}")
    return ", ".join(words)


def _check_faces(mesh: MeshFile) -> None:
    faces = mesh.faces[0] if isinstance(mesh.faces, tuple) else mesh.faces
    if not len(faces):
        raise FileError(
            "there are only points, and a deformation needs edges",
            where=str(mesh.path),
            fix="give a mesh with faces, or in Python join the points by Graph.from_points",
        )


def _check_format(mesh: MeshFile, out: Path) -> None:
    suffix = out.suffix.lower()
    if suffix not in WRITABLE and not mesh.keeps(out):
        raise FileError(
            f"{suffix or 'no extension'} cannot be written", where=str(out), fix=f"use {', '.join(sorted(WRITABLE))}"
        )
