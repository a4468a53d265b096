"""Where a handle's vertices come from: selection, condition, quality, attribute, colour, or a part of the file."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.conditions import needs_positions_only, select, vertex_variables
from oneform_warp.errors import InputError
from oneform_warp.filters.filter import nearest

if TYPE_CHECKING:
    from oneform_warp.filters.meshset import MeshSet

__all__ = ["SOURCES", "handle_weights"]

Weights = NDArray[np.bool_] | NDArray[np.float64]


def handle_weights(meshes: MeshSet, values: dict[str, Any]) -> Weights:
    """A mask or painted weights of the current mesh, (V,); InputError where no vertex is meant."""
    weights = SOURCES[_source(values)](meshes, values)
    if weights.dtype != np.bool_:
        weights = _painted(weights.astype(np.float64), values)
    if not (weights > 0).any():
        raise InputError("no vertex is selected", where=_source(values), fix=EMPTY.get(_source(values), "look at it"))
    return weights


def _source(values: dict[str, Any]) -> str:
    """The wanted source; one that is named by its own parameter need not be named twice."""
    said = [name for name in ("condition", "attribute", "group") if values[SPELLED.get(name, name)]]
    if len(said) > 1 or (said and values["source"] not in ("selection", said[0])):
        both = " and ".join(said if len(said) > 1 else [said[0], values["source"]])
        raise InputError(f"both {both} are given", where="source", fix="give one of them")
    return said[0] if said else str(values["source"])


def _selection(meshes: MeshSet, values: dict[str, Any]) -> Weights:
    """The selected vertices; where there are none, the vertices of the selected faces."""
    vertices = _selected_vertices(meshes, values)
    return vertices if vertices.any() else _selected_faces(meshes, values)


def _selected_vertices(meshes: MeshSet, values: dict[str, Any]) -> NDArray[np.bool_]:
    return np.asarray(meshes.current_mesh().vertex_selection_array(), dtype=bool)


def _selected_faces(meshes: MeshSet, values: dict[str, Any]) -> NDArray[np.bool_]:
    mesh = meshes.current_mesh()
    mask = np.zeros(mesh.vertex_number(), dtype=bool)
    if mesh.face_number():
        mask[mesh.face_matrix()[np.asarray(mesh.face_selection_array(), dtype=bool)].ravel()] = True
    return mask


def _condition(meshes: MeshSet, values: dict[str, Any]) -> Weights:
    if needs_positions_only(values["condselect"]):
        return select(values["condselect"], vertex_variables(meshes.vertex_matrix()))
    mesh = meshes.current_mesh()
    variables = vertex_variables(
        mesh.vertex_matrix(),
        colors=mesh.vertex_color_matrix() if mesh.has_vertex_color() else None,
        normals=mesh.vertex_normal_matrix(),
        quality=mesh.vertex_scalar_array() if mesh.has_vertex_scalar() else None,
        selected=mesh.vertex_selection_array(),
    )
    return select(values["condselect"], variables)


def _quality(meshes: MeshSet, values: dict[str, Any]) -> Weights:
    mesh = meshes.current_mesh()
    if not mesh.has_vertex_scalar():
        raise InputError("the mesh has no quality per vertex", where="source", fix="paint one, or use a selection")
    return np.array(mesh.vertex_scalar_array(), dtype=np.float64)


def _attribute(meshes: MeshSet, values: dict[str, Any]) -> Weights:
    return meshes.vertex_attribute(values["attribute"], columns=1)


def _color(meshes: MeshSet, values: dict[str, Any]) -> Weights:
    mesh = meshes.current_mesh()
    if not mesh.has_vertex_color():
        raise InputError("the mesh has no colours per vertex", where="source", fix="use a selection or a condition")
    channels = np.rint(np.asarray(mesh.vertex_color_matrix()) * 255.0)[:, :3]
    distance = np.abs(channels - np.asarray(values["color"][:3])).max(axis=1)
    return np.asarray(distance <= values["colortolerance"])


def _group(meshes: MeshSet, values: dict[str, Any]) -> Weights:
    parts = meshes.named_parts()
    if not parts:
        fix = "use a condition, or load an OBJ with groups or materials"
        raise InputError("the mesh was not loaded from a file with named parts", where="group", fix=fix)
    if values["group"] not in parts:
        raise InputError(f"there is no group {values['group']!r}", where="group", fix=nearest(values["group"], parts))
    mask = np.zeros(meshes.current_mesh().vertex_number(), dtype=bool)
    mask[parts[values["group"]]] = True
    return mask


SOURCES: dict[str, Callable[[MeshSet, dict[str, Any]], Weights]] = {
    "selection": _selection,
    "selected vertices": _selected_vertices,
    "selected faces": _selected_faces,
    "condition": _condition,
    "quality": _quality,
    "attribute": _attribute,
    "color": _color,
    "group": _group,
}
SPELLED = {"condition": "condselect"}
EMPTY = {
    "selection": "select vertices or faces first, for example by compute_selection_by_condition_per_vertex",
    "selected vertices": "select vertices first, for example by compute_selection_by_condition_per_vertex",
    "selected faces": "select faces first, for example by compute_selection_by_condition_per_face",
    "condition": "check condselect against the mesh's bounding box",
    "quality": "paint weights above 0",
    "attribute": "give weights above 0",
    "color": "check color, or raise colortolerance",
}


def _painted(weights: NDArray[np.float64], values: dict[str, Any]) -> Weights:
    """Weights in 0..1, scaled into it if that is wanted; held vertices are those of at least 1/2."""
    if not np.isfinite(weights).all():
        raise InputError("painted weights are not finite", where=_source(values), fix="repair them")
    low, high = float(weights.min()), float(weights.max())
    if values["normalize"]:
        weights = (weights - low) / ((high - low) or 1.0)
    elif low < 0.0 or high > 1.0:
        what = f"painted weights run from {low:.4g} to {high:.4g}"
        raise InputError(what, where=_source(values), fix="give 0..1, or normalize=True")
    return weights >= 0.5 if values["held"] else weights
