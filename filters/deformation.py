"""apply_coord_oneform_deformation, apply_coord_oneform_integration and reset_oneform_deformation."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from oneform_warp.arap import CELLS, RIMS, Arap
from oneform_warp.errors import InputError, NotConverged, OneFormWarning
from oneform_warp.falloff import Biharmonic, Falloff, Geodesic, Smoothing
from oneform_warp.fields import Fields
from oneform_warp.filters.filter import Filter
from oneform_warp.filters.handle_set import SOLVERS, HandleSet, Settings
from oneform_warp.filters.parameters import Choice, Flag, Length, Number, Parameter, Text, Whole
from oneform_warp.profiles import PROFILES
from oneform_warp.starts import STARTS
from oneform_warp.weights import KINDS

if TYPE_CHECKING:
    from oneform_warp.filters.meshset import MeshSet

__all__ = ["DEFORMATION", "INTEGRATION", "REFINING", "RESET", "SOLVING", "moved", "settings_of"]

SOLVING: tuple[Parameter, ...] = (
    Choice("weights", "cotangent", "Edge weights mu.", KINDS),
    Flag("weld", True, "Whether vertices at one position, or within welddistance, move as one."),
    Length("welddistance", "0%", "How near counts as one position; 0 means exactly equal."),
    Number("struts", 0.0, "Strength of edges through the inside of closed parts, which keep the volume: 1 is a start, "
           "0 for none.", 0.0),
    Number("t", 1.0, "How much of the way from the rest pose, 0..1: rotations, logs of stretches and moves are scaled.",
           0.0, 1.0),
    Choice("start", "auto", "Where the solver starts; 'auto' chooses by the solver and the 1-form.", tuple(STARTS)),
    Choice("solver", "auto", "What solves; 'auto' chooses by the size of the mesh.", SOLVERS),
    Number("tolerance", 0.0, "Relative residual to reach; 0 is the solver's own.", 0.0, 1.0),
    Whole("maxiterations", 0, "Iterations at most; 0 is the solver's own.", 0),
    Choice("precision", "auto", "Numbers of the inner iterations.", ("auto", "float32", "float64")),
    Text("device", "", "Warp's name of a device, as 'cpu' or 'cuda:0'; empty for the current one."),
)  # fmt: skip

REFINING: tuple[Parameter, ...] = (
    Whole("refine", 0, "Steps of ARAP refinement at most; targets that the rotations do not lead to want 5 to 20.", 0),
    Number(
        "refinetolerance", 0.0, "Refining ends when a step lowers the energy by less than this part of it.", 0.0, 1.0
    ),
    Choice("cells", RIMS, "What turns as one in the ARAP energy.", tuple(CELLS)),
    Number(
        "smoothrotations", 0.0, "How much rotations of neighbours pay for differing, 0.01 to 0.1; 0 for nothing.", 0.0
    ),
)

SMOOTHING: tuple[Parameter, ...] = (
    Choice("smoothing", "harmonic", "How far handles reach: to the harmonic limit, for a number of sweeps, or over a "
           "screening length, so that they leave the handles without a bend, or by the distance along the surface.",
           ("harmonic", "sweeps", "length", "biharmonic", "geodesic")),
    Whole("sweeps", 10, "For smoothing='sweeps'.", 0),
    Length("length", "10%", "For smoothing='length'.", above=True),
    Length("radius", "20%", "For smoothing='geodesic': where a handle's reach ends.", above=True),
    Choice("profile", "smooth", "For smoothing='geodesic': the curve on the way there, by Blender's names.", PROFILES),
)  # fmt: skip


def _falloff(values: Mapping[str, Any]) -> Falloff:
    kinds: dict[str, Callable[[], Falloff]] = {
        "harmonic": Smoothing,
        "sweeps": lambda: Smoothing(sweeps=values["sweeps"]),
        "length": lambda: Smoothing(length=values["length"]),
        "biharmonic": Biharmonic,
        "geodesic": lambda: Geodesic(values["radius"], values["profile"]),
    }
    return kinds[values.get("smoothing", "harmonic")]()


def settings_of(values: Mapping[str, Any]) -> Settings:
    """The values of SOLVING and REFINING, and of SMOOTHING where a filter has it."""
    return Settings(
        weights=values["weights"],
        weld=values["welddistance"] if values["weld"] else None,
        falloff=_falloff(values),
        struts=values["struts"] or None,
        start=values["start"],
        t=values["t"],
        refine=Arap(values["refine"], values["refinetolerance"], values["cells"], values["smoothrotations"]),
        solver=values["solver"],
        tol=values["tolerance"] or None,
        max_iterations=values["maxiterations"] or None,
        dtype=None if values["precision"] == "auto" else values["precision"],
        device=values["device"] or None,
    )


def _deform(meshes: MeshSet, **values: Any) -> dict[str, Any]:
    placed = meshes.placed_handles()
    if not placed.handles and not placed.constraints:
        raise InputError("the mesh has no handles", where="handles", fix="apply set_oneform_handle first")
    return moved(meshes, placed, settings_of(values), None)


def _integrate(meshes: MeshSet, *, rotation: str, stretch: str, **values: Any) -> dict[str, Any]:
    if not rotation and not stretch:
        raise InputError("there is no field", where="rotation", fix="name an attribute for rotation, stretch or both")
    placed = meshes.placed_handles()
    turned = [handle.name for handle in placed.handles.values() if not handle.held and not handle.place]
    if turned:
        fix = "clear it, or set it with held=True or a place; the fields say the rest"
        raise InputError("fields are given, so handles can only hold or place", where=f"handle {turned[0]!r}", fix=fix)
    count = len(placed.rest)
    omega = meshes.vertex_attribute(rotation, columns=3) if rotation else np.zeros((count, 3))
    sigma = meshes.vertex_attribute(stretch, columns=1) if stretch else np.ones(count)
    return moved(meshes, placed, settings_of(values), Fields(omega, sigma))


def moved(meshes: MeshSet, placed: HandleSet, settings: Settings, fields: Fields | None) -> dict[str, Any]:
    """Deforms, moves the mesh, and says how it went."""
    result = placed.deform(settings, fields)
    meshes.set_vertex_matrix(result.positions)
    solution = result.solution
    for text in solution.warnings:
        warnings.warn(text, OneFormWarning, stacklevel=2)
    if not solution.converged:
        warnings.warn(str(solution.status), NotConverged, stacklevel=2)
    return {
        "energy": solution.energy,
        "residual": solution.history[-1][1] if solution.history else 0.0,
        "iterations": solution.iterations,
        "converged": solution.converged,
        "status": solution.status.word,
    }


def _reset(meshes: MeshSet) -> None:
    placed = meshes.handle_sets.get(meshes.current_mesh_id())
    if placed is None or placed.result is None:
        raise InputError("the mesh is not deformed", where="rest pose", fix="there is nothing to restore")
    meshes.placed_handles()  # for the check that they are still those of this mesh
    meshes.set_vertex_matrix(placed.rest)
    placed.result = None


DEFORMATION = Filter(
    "apply_coord_oneform_deformation",
    "Deforms the current mesh by its handles: their rotations and stretches spread over the mesh and are integrated. "
    "Each time it starts from the rest pose that the handles were set on.",
    (*SMOOTHING, *REFINING, *SOLVING),
    _deform,
)

INTEGRATION = Filter(
    "apply_coord_oneform_integration",
    "Integrates rotations and stretches that stand at each vertex in custom attributes; handles can only hold.",
    (
        Text("rotation", "", "Name of a point attribute with rotation vectors in radians."),
        Text("stretch", "", "Name of a scalar attribute with factors above 0."),
        *REFINING,
        *SOLVING,
    ),
    _integrate,
)

RESET = Filter(
    "reset_oneform_deformation",
    "Puts the vertices of the current mesh back to the rest pose; the handles stay.",
    (),
    _reset,
)
