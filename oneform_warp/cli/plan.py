"""A mesh, its handles and a deformer: everything that is checked before the first kernel runs."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arap import Arap
from oneform_warp.cli.constraint_spec import constraints_from
from oneform_warp.cli.mesh_facts import box_text
from oneform_warp.cli.preset_spec import PresetSpec, presets_from
from oneform_warp.cli.recipe import Asked
from oneform_warp.cli.selections import select_vertices
from oneform_warp.cli.settings import Settings, weld_length
from oneform_warp.cli.specs import HandleSpec
from oneform_warp.constraints import Constraint
from oneform_warp.deformation import Deformation
from oneform_warp.deformer import Deformer
from oneform_warp.errors import FileError, InputError
from oneform_warp.falloff import Biharmonic, Falloff, Geodesic, Smoothing
from oneform_warp.filters import MeshFile, read_mesh
from oneform_warp.filters.meshfile import WRITABLE
from oneform_warp.graph import Graph
from oneform_warp.handles import Handle
from oneform_warp.sequences import Keyframes
from oneform_warp.solvers import Progress, solver_named
from oneform_warp.struts import extra_edges
from oneform_warp.symmetry import mirror

__all__ = ["Plan", "check_faces", "falloff_of", "make_deformer", "make_handles", "make_plan", "solve_options"]


@dataclass(frozen=True, eq=False)
class Plan:
    """What is going to be deformed, and how."""

    mesh: MeshFile
    specs: Sequence[HandleSpec]
    handles: Sequence[Handle]
    deformer: Deformer
    settings: Settings
    constraints: Sequence[Constraint] = ()
    t: float = 1.0
    """How much of the way from the rest pose."""

    def solve(self, progress: Progress) -> Deformation:
        """The deformation."""
        keyframes = Keyframes(self.deformer, self.handles)
        return keyframes.solve(self.t, constraints=self.constraints, **solve_options(self.settings), progress=progress)

    def vertices(self, *, held: bool) -> NDArray[np.bool_]:
        """The vertices (V,) of the handles that hold, or of the others."""
        return touched([handle for handle in self.handles if handle.held == held], len(self.mesh.positions))

    def lines(self) -> list[str]:
        """One line for each handle: its name, vertices, box, and what it does."""
        lines = []
        for spec, handle in zip(self.specs, self.handles, strict=True):
            points = self.mesh.positions[handle.vertices]
            lines.append(f"{spec.name}: {len(points):,} vertices ({box_text(points)}), {handle.describe()}")
        return lines


def touched(handles: Iterable[Handle], vertex_count: int) -> NDArray[np.bool_]:
    """The vertices (V,) that have a part in any of these handles."""
    mask = np.zeros(vertex_count, dtype=bool)
    for number, handle in enumerate(handles):
        mask[handle.members(vertex_count, number)] = True
    return mask


def make_plan(
    mesh: MeshFile,
    specs: Sequence[HandleSpec],
    settings: Settings,
    out: Path | None,
    *,
    asked: Asked | None = None,
    t: float = 1.0,
) -> Plan:
    """Checked selections, handles and options; InputError names the one that cannot be used. Warp is initialised."""
    check_faces(mesh)
    if out is not None:
        _check_format(mesh, out)
    falloff_of(settings)
    wanted = Asked() if asked is None else asked
    chosen, handles = make_handles(mesh, specs, presets_from(wanted))
    constraints = [each.on(mesh) for each in constraints_from(wanted)]
    deformer = make_deformer(mesh, settings)
    deformer.check(handles)
    return Plan(mesh, chosen, handles, deformer, settings, constraints, t)


def make_handles(
    mesh: MeshFile, specs: Sequence[HandleSpec], presets: Sequence[PresetSpec] = ()
) -> tuple[list[HandleSpec], list[Handle]]:
    """The handles of presets, specifications and their mirror images, and where each came from.

    InputError for selections that mean no vertex.
    """
    chosen, handles = [], []
    for preset in presets:
        made = preset.handles(mesh)
        handles += made
        chosen += [HandleSpec(f"{preset.preset} ({handle.name})") for handle in made]
    for spec in specs:
        vertices = select_vertices(spec, mesh)
        options = {**spec.options, "name": spec.name}
        across = options.pop("mirror", None)
        plane = {word: options.pop(f"mirror_{word}", None) for word in ("at", "tolerance")}
        if "to" in options:
            options["to"] = _targets(mesh, spec)[vertices]
        handles.append(Handle(vertices, **options))
        chosen.append(spec)
        if across is not None:
            handles.append(mirror(handles[-1], mesh.positions, across, **plane))
            chosen.append(HandleSpec(spec.select, {"name": handles[-1].name}, spec.folder))
    return chosen, handles


def _targets(mesh: MeshFile, spec: HandleSpec) -> NDArray[np.float64]:
    """The positions (V, 3) in the file that a handle's `to` names."""
    path = spec.folder / Path(spec.options["to"]).expanduser()
    there = read_mesh(path)
    if len(there.positions) != len(mesh.positions):
        what = f"{len(there.positions)} vertices, the mesh has {len(mesh.positions)}"
        raise FileError(what, where=str(path), fix="give the same mesh with other positions")
    return np.asarray(there.positions, dtype=np.float64)


def make_deformer(mesh: MeshFile, settings: Settings) -> Deformer:
    """The mesh at rest, with the graph, weights and solver that the settings ask for."""
    where: dict[str, Any] = {"weld": weld_length(settings.weld), "device": settings.device}
    inner = extra_edges(mesh.positions, mesh.faces, settings.struts, **where)
    graph = Graph.from_faces(mesh.positions, mesh.faces, weights=settings.weights, **where, **inner)
    return Deformer(mesh.positions, graph, solver=solver_named(settings.solver, graph, settings.solver_options))


def solve_options(settings: Settings) -> dict[str, Any]:
    """The options of `Deformer.solve`."""
    arap = Arap(settings.refine, settings.refine_tol, settings.cells, settings.smooth_rotations)
    return {"falloff": falloff_of(settings), "start": settings.start, "refine": arap}


def falloff_of(settings: Settings) -> Falloff:
    """How handles spread; InputError where settings contradict each other."""
    reach = Smoothing(settings.sweeps, settings.length)
    if settings.falloff != "harmonic" and reach != Smoothing():
        given = "sweeps" if settings.length is None else "length"
        raise InputError(f"falloff and {given} are both given", where="falloff", fix="give one of them")
    if settings.falloff == "geodesic":
        if settings.radius is None:
            raise InputError("a geodesic falloff ends somewhere", where="radius", fix="give a length > 0")
        return Geodesic(settings.radius, settings.profile)
    if settings.radius is not None:
        raise InputError("a radius is for a geodesic falloff", where="radius", fix="add falloff=geodesic, or drop it")
    return Biharmonic() if settings.falloff == "biharmonic" else reach


def check_faces(mesh: MeshFile) -> None:
    """FileError for a file of points."""
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
