"""compute_scalar_oneform_field: the fields of the last deformation as quality per vertex, to look at."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.filters.filter import Filter
from oneform_warp.filters.handle_set import HandleSet, Result
from oneform_warp.filters.parameters import Choice
from oneform_warp.forms import codifferential, differential, edge_energy
from oneform_warp.graph import Graph

if TYPE_CHECKING:
    from oneform_warp.filters.meshset import MeshSet

__all__ = ["SCALAR_FIELD"]

Floats = NDArray[np.float64]


def _rotation(placed: HandleSet, result: Result) -> Floats:
    return np.asarray(np.linalg.norm(result.solution.omega, axis=1))


def _stretch(placed: HandleSet, result: Result) -> Floats:
    return np.asarray(result.solution.sigma, dtype=np.float64)


def _residual(placed: HandleSet, result: Result) -> Floats:
    graph, solution = result.deformer.graph, result.solution
    difference = np.asarray(solution.v) - np.asarray(differential(graph, result.positions))
    held = np.zeros(graph.vertex_count, dtype=bool)
    for handle in placed.handles.values():
        held |= handle.mask & handle.held
    return np.asarray(np.where(held, 0.0, np.linalg.norm(codifferential(graph, difference), axis=1)))


def _energy_density(placed: HandleSet, result: Result) -> Floats:
    graph = result.deformer.graph
    energies = edge_energy(graph, result.positions, result.solution.v)
    halves = [np.bincount(graph.node_of[graph.edges[:, end]], energies, graph.node_count) / 2 for end in (0, 1)]
    areas = _node_areas(graph, placed)
    density = np.divide(halves[0] + halves[1], areas, out=np.zeros(graph.node_count), where=areas > 0)
    return np.asarray(density[graph.node_of])


def _node_areas(graph: Graph, placed: HandleSet) -> Floats:
    """A third of the area of the faces around each node, in the rest pose."""
    corners = placed.rest[placed.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 6.0
    return np.asarray(
        np.bincount(graph.node_of[placed.faces].ravel(), np.repeat(areas, 3), graph.node_count), np.float64
    )


FIELDS: dict[str, Callable[[HandleSet, Result], Floats]] = {
    "rotation": _rotation,
    "stretch": _stretch,
    "residual": _residual,
    "energy density": _energy_density,
}


def _show(meshes: MeshSet, *, field: str) -> dict[str, Any]:
    placed = meshes.placed_handles()
    if placed.result is None:
        raise InputError("the mesh is not deformed", where="field", fix="apply_coord_oneform_deformation comes first")
    values = FIELDS[field](placed, placed.result)
    meshes.set_vertex_scalar_array(values)
    return {"min": float(values.min()), "max": float(values.max())}


SCALAR_FIELD = Filter(
    "compute_scalar_oneform_field",
    "Writes a field of the last deformation as quality per vertex: |omega| in radians, sigma, the residual of the "
    "equations, or the energy per area.",
    (Choice("field", "rotation", "What is written.", tuple(FIELDS)),),
    _show,
)
