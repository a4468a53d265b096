"""Where a handle puts its vertices, as filters spell it: moved, turned about a point, or onto target positions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.filters.parameters import Choice, Flag, Number, Parameter, Text, Vector, Whole

if TYPE_CHECKING:
    from oneform_warp.filters.meshset import MeshSet

__all__ = ["PLACE", "place_of"]

ORIGIN, BARYCENTER, CUSTOM, FREE = "origin", "barycenter", "custom point", "none"

PLACE: tuple[Parameter, ...] = (
    Vector("move", (0.0, 0.0, 0.0), "A translation, in the unit of the mesh: the vertices go there."),
    Choice("rotcenter", FREE, "The point that the handle as a whole turns and grows about, so that its place is given; "
           "'none' leaves its place to the solve, unless it moves.", (FREE, ORIGIN, BARYCENTER, CUSTOM)),
    Vector("customcenter", (0.0, 0.0, 0.0), "For rotcenter='custom point'."),
    Whole("targetmesh", -1, "The id of a mesh with the same vertices elsewhere: the handle's go there.", -1),
    Text("targetattribute", "", "Name of a point attribute with target positions, instead of a mesh."),
    Flag("fitrotation", False, "Whether the rotation is the one that fits the targets best."),
    Number("softweight", 0.0, "How strongly vertices are pulled to their place, times the weights at their edges; 0 "
           "puts them exactly there.", 0.0),
    Flag("snap", False, "Whether softly pulled vertices are put exactly there afterwards."),
)  # fmt: skip


def place_of(meshes: MeshSet, values: Mapping[str, Any], chosen: NDArray[np.bool_]) -> dict[str, Any]:
    """The keyword arguments of `Handle` that say where the chosen vertices (V,) go; empty where that is left open."""
    place: dict[str, Any] = {}
    if any(values["move"]):
        place["move"] = values["move"]
    if values["rotcenter"] != FREE:
        place["pivot"] = {BARYCENTER: "centroid", ORIGIN: (0.0, 0.0, 0.0), CUSTOM: values["customcenter"]}[
            values["rotcenter"]
        ]
    targets = _targets(meshes, values)
    if targets is not None:
        place["to"] = targets[chosen]
    if values["softweight"]:
        place["weight"] = values["softweight"]
    if values["snap"]:
        place["snap"] = True
    return place


def _targets(meshes: MeshSet, values: Mapping[str, Any]) -> NDArray[np.float64] | None:
    """Target positions of all vertices, (V, 3)."""
    number, name = values["targetmesh"], values["targetattribute"]
    if number >= 0 and name:
        raise InputError("targetmesh and targetattribute are given", where="targetmesh", fix="give one of them")
    if name:
        return meshes.vertex_attribute(name, columns=3)
    if number < 0:
        return None
    if not meshes.mesh_id_exists(number):
        raise InputError(f"there is no mesh {number}", where="targetmesh", fix="load it first, and give its id")
    positions: NDArray[np.float64] = np.array(meshes.mesh(number).vertex_matrix(), dtype=np.float64)
    count = meshes.current_mesh().vertex_number()
    if len(positions) != count:
        what = f"mesh {number} has {len(positions)} vertices, the current one {count}"
        raise InputError(what, where="targetmesh", fix="give a mesh with the same vertices")
    return positions
