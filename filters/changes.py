"""Whether a chain has only moved vertices: everything else of a mesh, before and after."""

from __future__ import annotations

from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import NDArray

__all__ = ["Looks", "looks_of"]


class Looks:
    """Faces, colours, qualities and UVs of a mesh; not its positions, normals and selection."""

    def __init__(self, number: int, arrays: dict[str, NDArray[Any]], textures: tuple[str, ...]) -> None:
        self.number, self.arrays, self.textures = number, arrays, textures

    def same_as(self, other: Looks) -> bool:
        """Whether everything is equal, on the same mesh."""
        return (
            (self.number, self.textures) == (other.number, other.textures)
            and self.arrays.keys() == other.arrays.keys()
            and all(np.array_equal(array, other.arrays[name], equal_nan=True) for name, array in self.arrays.items())
        )


def looks_of(meshes: pymeshlab.MeshSet) -> Looks:
    """The looks of the current mesh."""
    mesh = meshes.current_mesh()
    arrays: dict[str, Any] = {"vertices": np.array(mesh.vertex_number())}
    if mesh.face_number():
        arrays["faces"] = mesh.face_matrix()
        if mesh.has_face_color():
            arrays["face colours"] = mesh.face_color_array()
        if mesh.has_face_scalar():
            arrays["face quality"] = mesh.face_scalar_array()
        if mesh.has_wedge_tex_coord():
            arrays["wedge UVs"] = mesh.wedge_tex_coord_matrix()
    if mesh.has_vertex_color():
        arrays["vertex colours"] = mesh.vertex_color_array()
    if mesh.has_vertex_scalar():
        arrays["vertex quality"] = mesh.vertex_scalar_array()
    if mesh.has_vertex_tex_coord():
        arrays["vertex UVs"] = mesh.vertex_tex_coord_matrix()
    copied = {name: np.array(array) for name, array in arrays.items()}
    return Looks(meshes.current_mesh_id(), copied, tuple(mesh.textures()))
