"""trimesh meshes and plain arrays as pymeshlab's meshes, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pymeshlab

from oneform_warp.errors import InputError

__all__ = ["as_given", "mesh_from", "mesh_from_arrays"]


def mesh_from(mesh: Any) -> pymeshlab.Mesh:
    """A pymeshlab.Mesh of a trimesh.Trimesh (with its vertex colours), or of (vertices (V, 3), faces).

    faces: (F, 3) or (F, 4) whole numbers, or a list of polygons. Raises InputError for other things.
    """
    if isinstance(mesh, tuple) and len(mesh) == 2:
        return mesh_from_arrays(*mesh)
    if not hasattr(mesh, "vertices") or not hasattr(mesh, "faces"):
        kind = type(mesh).__name__
        raise InputError(f"a chain is not for {kind}", fix="give a MeshSet, a trimesh.Trimesh or (vertices, faces)")
    colors = mesh.visual.vertex_colors if getattr(mesh.visual, "kind", None) == "vertex" else None
    return mesh_from_arrays(mesh.vertices, mesh.faces, None if colors is None else np.asarray(colors) / 255.0)


def as_given(given: Any, mesh: pymeshlab.Mesh, *, moved_only: bool) -> Any:
    """A pymeshlab.Mesh as the kind of thing that was given; what did not change stays the given thing's own."""
    vertices, faces = np.array(mesh.vertex_matrix()), np.array(mesh.face_matrix(), dtype=np.int64)
    if isinstance(given, tuple):
        kind = getattr(given[0], "dtype", vertices.dtype)
        kind = kind if np.issubdtype(kind, np.floating) else vertices.dtype
        return vertices.astype(kind), (given[1] if moved_only else faces)
    if moved_only:
        moved = given.copy()
        moved.vertices = vertices
        return moved
    import trimesh

    colors = np.rint(np.asarray(mesh.vertex_color_matrix()) * 255).astype(np.uint8) if mesh.has_vertex_color() else None
    return trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)


def mesh_from_arrays(vertices: Any, faces: Any, colors: Any = None) -> pymeshlab.Mesh:
    """A pymeshlab.Mesh of vertices (V, 3), faces as for `mesh_from`, and colours (V, 4) in 0..1."""
    attributes = {} if colors is None else {"v_color_matrix": np.ascontiguousarray(colors, dtype=np.float64)}
    try:
        points = np.ascontiguousarray(vertices, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.zeros(0)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
        raise InputError(f"vertices {points.shape}", where="vertices", fix="give finite numbers (V, 3)")
    polygons = [np.asarray(face) for face in faces]
    flat = np.concatenate(polygons) if polygons else np.zeros(0, dtype=np.int64)
    if not all(face.ndim == 1 and len(face) > 2 for face in polygons) or flat.dtype.kind not in "iu":
        raise InputError("faces are not lists of three or more vertex numbers", where="faces", fix="give (F, 3)")
    if len(flat) and (flat.min() < 0 or flat.max() >= len(points)):
        what = f"a face uses vertex {flat.min() if flat.min() < 0 else flat.max()} of {len(points)}"
        raise InputError(what, where="faces", fix="numbers run from 0")
    if not polygons:
        return pymeshlab.Mesh(points, **attributes)
    if {len(face) for face in polygons} == {3}:
        triangles = np.ascontiguousarray(np.reshape(flat, (-1, 3)), dtype=np.int32)
        return pymeshlab.Mesh(points, triangles, **attributes)
    return pymeshlab.Mesh(points, face_list_of_indices=[face.tolist() for face in polygons], **attributes)
