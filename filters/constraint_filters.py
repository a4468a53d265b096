"""set_oneform_constraint and clear_oneform_constraints: linear constraints on the vertices of a mesh."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp import constraints
from oneform_warp.constraints import Constraint
from oneform_warp.errors import InputError
from oneform_warp.filters.filter import Filter, nearest
from oneform_warp.filters.handle_weights import handle_weights
from oneform_warp.filters.parameters import Choice, Number, Text, Vector, Whole

if TYPE_CHECKING:
    from oneform_warp.filters.meshset import MeshSet

__all__ = ["CLEAR_CONSTRAINTS", "SET_CONSTRAINT"]

Build = Callable[["MeshSet", dict[str, Any], dict[str, Any]], Constraint]
"""From the mesh set, the values and the words that all builders know."""


def _chosen(meshes: MeshSet, values: dict[str, Any]) -> NDArray[np.int64]:
    """The vertices of the condition, or the selected ones."""
    source = {"source": "selection", "attribute": "", "group": "", "condselect": values["condselect"]}
    return np.flatnonzero(handle_weights(meshes, source | {"held": True, "normalize": False}))


def _ends(values: dict[str, Any], *names: str) -> list[int]:
    """The vertices that are named one by one."""
    for name in names:
        if values[name] < 0:
            raise InputError(f"{values['kind']} needs {name}", where=name, fix="give the number of a vertex")
    return [int(values[name]) for name in names]


def _centroid(meshes: MeshSet, values: dict[str, Any], words: dict[str, Any]) -> Constraint:
    return constraints.centroid(_chosen(meshes, values), values["to"], **words)


def _position(meshes: MeshSet, values: dict[str, Any], words: dict[str, Any]) -> Constraint:
    chosen = _chosen(meshes, values)
    return constraints.position(chosen, np.tile(values["to"], (len(chosen), 1)), **words)


def _planar(meshes: MeshSet, values: dict[str, Any], words: dict[str, Any]) -> Constraint:
    plane = {"normal": values["direction"]} if any(values["direction"]) else {"x": meshes.placed_handles().rest}
    return constraints.planar(_chosen(meshes, values), **plane, **words)


def _face_normal(meshes: MeshSet, values: dict[str, Any], words: dict[str, Any]) -> Constraint:
    faces = meshes.placed_handles().faces
    if not 0 <= values["face"] < len(faces):
        fix = f"give a number from 0 to {len(faces) - 1}"
        raise InputError(f"there is no face {values['face']}", where="face", fix=fix)
    return constraints.face_normal(faces[values["face"]], values["direction"], **words)


def _relative_position(meshes: MeshSet, values: dict[str, Any], words: dict[str, Any]) -> Constraint:
    a, b = _ends(values, "vertexa", "vertexb")
    return constraints.relative_position(a, b, values["to"], **words)


def _edge_direction(meshes: MeshSet, values: dict[str, Any], words: dict[str, Any]) -> Constraint:
    a, b = _ends(values, "vertexa", "vertexb")
    return constraints.edge_direction(a, b, values["direction"], **words)


def _edge_length(meshes: MeshSet, values: dict[str, Any], words: dict[str, Any]) -> Constraint:
    direction = values["direction"] if any(values["direction"]) else None
    a, b = _ends(values, "vertexa", "vertexb")
    return constraints.edge_length(a, b, values["size"], direction=direction, **words)


def _edge_angle(meshes: MeshSet, values: dict[str, Any], words: dict[str, Any]) -> Constraint:
    i, j, k = _ends(values, "vertexa", "vertexb", "vertexc")
    return constraints.edge_angle(i, j, k, rotation=values["rotation"], ratio=values["ratio"], **words)


KINDS: dict[str, Build] = {
    "position": _position,
    "centroid": _centroid,
    "planar": _planar,
    "face normal": _face_normal,
    "relative position": _relative_position,
    "edge direction": _edge_direction,
    "edge length": _edge_length,
    "edge angle": _edge_angle,
}


def _set_constraint(meshes: MeshSet, **values: Any) -> dict[str, Any]:
    placed = meshes.placed_handles()
    words = {"weight": values["softweight"] or None, "name": values["name"] or None}
    made = KINDS[values["kind"]](meshes, values, words)
    placed.constraints[made.name] = made
    return {"name": made.name, "rows": len(made.d)}


SET_CONSTRAINT = Filter(
    "set_oneform_constraint",
    "Asks something linear of the deformed vertices: where they or their centroid are, that they lie in a plane, or "
    "how an edge runs. Lengths and places are in the unit of the mesh.",
    (
        Choice("kind", "centroid", "What is asked.", tuple(KINDS)),
        Text("condselect", "", "MeshLab's condition on vertices; empty for the selected ones. For position, centroid "
             "and planar."),
        Vector("to", (0.0, 0.0, 0.0), "The position, the centroid, or the place of vertexb relative to vertexa."),
        Vector("direction", (0.0, 0.0, 0.0), "Of an edge, or a normal; zero for the plane that fits the rest pose, and "
               "for an edge's own direction."),
        Whole("face", -1, "For kind='face normal': the number of a triangle.", -1),
        Whole("vertexa", -1, "The first vertex of an edge; of an angle an end.", -1),
        Whole("vertexb", -1, "The other vertex of an edge; of an angle its corner.", -1),
        Whole("vertexc", -1, "Of an angle the other end.", -1),
        Vector("rotation", (0.0, 0.0, 0.0), "For kind='edge angle': the rotation vector from a to c around b."),
        Number("ratio", 1.0, "For kind='edge angle': the length of the second edge over that of the first.", 0.0,
               above=True),
        Number("size", 0.0, "For kind='edge length': the length.", 0.0),
        Number("softweight", 0.0, "How strongly it pulls, in the unit of mu; 0 has it met exactly.", 0.0),
        Text("name", "", "The constraint's name; one of the same name is replaced."),
    ),
    _set_constraint,
)  # fmt: skip


def _clear_constraints(meshes: MeshSet, *, name: str) -> None:
    placed = meshes.handle_sets.get(meshes.current_mesh_id())
    known: dict[str, Constraint] = {} if placed is None else placed.constraints
    if not name:
        known.clear()
    elif name not in known:
        raise InputError(f"there is no constraint {name!r}", where="name", fix=nearest(name, known))
    else:
        del known[name]


CLEAR_CONSTRAINTS = Filter(
    "clear_oneform_constraints",
    "Forgets the constraints of the current mesh; the handles stay.",
    (Text("name", "", "Only the constraint of this name."),),
    _clear_constraints,
)
