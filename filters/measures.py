"""get_oneform_measures: what the last deformation did to the current mesh, as numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows
from oneform_warp.errors import InputError
from oneform_warp.filters.filter import Filter
from oneform_warp.filters.handle_set import HandleSet, Result
from oneform_warp.filters.parameters import Flag
from oneform_warp.measures import measures
from oneform_warp.places import targets_of
from oneform_warp.rest import Rest

if TYPE_CHECKING:
    from oneform_warp.filters.meshset import MeshSet

__all__ = ["MEASURES"]


def _measures(meshes: MeshSet, *, selfintersections: bool, normals: bool) -> dict[str, Any]:
    placed = meshes.placed_handles()
    if placed.result is None:
        fix = "apply_coord_oneform_deformation comes first"
        raise InputError("there is no deformation to measure", where="rest pose", fix=fix)
    mesh = meshes.current_mesh()
    return measures(
        placed.rest,
        mesh.vertex_matrix(),
        placed.faces,
        targets=_targets(placed, placed.result),
        omega=placed.result.solution.omega if normals else None,
        normals=mesh.vertex_normal_matrix() if normals else None,
        intersections=selfintersections,
    ).known()


def _targets(placed: HandleSet, result: Result) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
    """Vertices that handles put somewhere, and where; None for none."""
    rest = Rest(read_rows(placed.rest, None, "rest pose"), result.deformer.graph)
    # Of painted handles no position is given.
    handles = [each.hard() for each in placed.handles.values() if not each.painted]
    chosen = [(number, handle) for number, handle in enumerate(handles) if handle.placed]
    if not chosen:
        return None
    vertices = [handle.members(len(placed.rest), number) for number, handle in chosen]
    return np.concatenate(vertices), np.concatenate([targets_of(handle, number, rest) for number, handle in chosen])


MEASURES = Filter(
    "get_oneform_measures",
    "Compares the current mesh with the rest pose that its handles were set on: change of edges, angles, area and "
    "volume, ARAP and symmetric Dirichlet energy, self-intersections, distance of handles from their targets.",
    (
        Flag("selfintersections", True, "Whether pairs of triangles that run through each other are counted."),
        Flag("normals", False, "Whether stored normals are compared with those of the rest pose, turned by the field."),
    ),
    _measures,
)
