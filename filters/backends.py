"""The libraries that read mesh files of all kinds and write those that are not kept as they stand."""

import os
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import FileError
from oneform_warp.filters.formats import GltfRecords, ObjRecords, OffRecords, PlyRecords, Records, StlRecords
from oneform_warp.filters.formats.motion import Floats, corner_normals
from oneform_warp.filters.formats.records import packed_triangles

__all__ = ["Backend", "Loaded", "load", "save"]

Backend = Literal["auto", "pymeshlab", "trimesh"]
TRIANGLES = 4


@dataclass(frozen=True, eq=False)
class Loaded:
    """What a library made of a file: positions (V, 3), triangles (F, 3), and per vertex what there is.

    `polygons` gives the faces as lists, in MeshLab's way, where the library knows more than triangles.
    """

    backend: str
    positions: Floats
    triangles: NDArray[np.int32]
    colors: Floats | None = None
    normals: Floats | None = None
    quality: Floats | None = None
    polygons: Any = field(default=None, repr=False)
    handle: Any = field(default=None, repr=False)


def load(path: Path, backend: Backend, records: Records | None, mesh_set: Any = None, *, later: bool = False) -> Loaded:
    """Read by the wanted library, or by the first one that can; glTF is read as it stands.

    later: so is what MeshLab would read no otherwise, and it does so when the mesh set needs it.
    """
    if isinstance(records, GltfRecords):
        return _load_scene(records, mesh_set)
    plain = records.plain() if later and isinstance(records, PlyRecords) else None
    if plain is not None:
        mesh_set.load_later(path, *plain)
        return Loaded("ply", *plain)
    loaded = _load(path, backend, records, mesh_set)
    if isinstance(records, StlRecords) and len(loaded.triangles) != records.faces:
        return _load_soup(records, mesh_set)
    return loaded


def _load(path: Path, backend: Backend, records: Records | None, mesh_set: Any) -> Loaded:
    if backend == "trimesh":
        return _load_trimesh(path, records)
    try:
        import pymeshlab
    except ImportError:
        if backend == "pymeshlab":
            raise FileError("pymeshlab is not installed", where=str(path), fix="use backend='auto'") from None
        return _load_trimesh(path, records)
    try:
        return _load_pymeshlab(path, records, mesh_set)
    except pymeshlab.PyMeshLabException as error:
        # A build without OpenGL lacks PLY and others; anything else is the file's own fault.
        if backend == "auto" and "nknown" in str(error):
            return _load_trimesh(path, records)
        raise


def _load_scene(records: GltfRecords, mesh_set: Any) -> Loaded:
    positions, triangles, normals = records.positions(), records.triangles, records.normals()
    if normals is None and len(triangles):
        normals = corner_normals(positions, records.polygons(), triangles.ravel().astype(np.int64), len(positions))
    colors = records.colors()
    if mesh_set is not None:
        mesh_set.add_mesh(_mesh(positions, triangles, colors, None))
    return Loaded("gltf", positions, triangles, colors, normals)


def _load_soup(records: StlRecords, mesh_set: Any) -> Loaded:
    """The triangles themselves, equal corners as one vertex: MeshLab loses some of a text with several solids."""
    positions, vertex_of = np.unique(records.positions(), axis=0, return_inverse=True)
    triangles = vertex_of.reshape(-1, 3).astype(np.int32)
    normals = corner_normals(positions, packed_triangles(triangles), vertex_of.ravel(), len(positions))
    if mesh_set is not None:
        mesh_set.delete_current_mesh()
        mesh_set.add_mesh(_mesh(positions, triangles, None, None))
    return Loaded("stl", positions, triangles, normals=normals)


def _load_pymeshlab(path: Path, records: Records | None, mesh_set: Any) -> Loaded:
    import pymeshlab

    meshes = pymeshlab.MeshSet() if mesh_set is None else mesh_set
    before = meshes.mesh_number()
    _load_into(meshes, path, records)
    if meshes.mesh_number() != before + 1:
        raise ValueError(f"it has {meshes.mesh_number() - before} meshes, not one")
    mesh = meshes.current_mesh()
    return Loaded(
        "pymeshlab",
        positions=np.ascontiguousarray(mesh.vertex_matrix(), dtype=np.float64),
        triangles=np.ascontiguousarray(mesh.face_matrix(), dtype=np.int32).reshape(-1, 3),
        colors=np.asarray(mesh.vertex_color_matrix()) if mesh.has_vertex_color() else None,
        normals=np.asarray(mesh.vertex_normal_matrix()) if mesh.face_number() else None,
        quality=np.asarray(mesh.vertex_scalar_array()) if mesh.has_vertex_scalar() else None,
        polygons=mesh.polygonal_face_list,
        handle=meshes if mesh_set is None else None,
    )


def _load_into(meshes: Any, path: Path, records: Records | None) -> None:
    """Load a file by MeshLab, in a form that it does not crash, hang or stumble over."""
    if isinstance(records, ObjRecords):
        _check_libraries(path, records)
    if isinstance(records, OffRecords) and records.unusual:
        with tempfile.TemporaryDirectory() as folder:
            flowed = Path(folder) / path.name
            flowed.write_bytes(records.flowed())
            meshes.load_new_mesh(str(flowed))
    else:
        meshes.load_new_mesh(
            str(path), **({"load_in_a_single_layer": True} if isinstance(records, GltfRecords) else {})
        )


def _check_libraries(path: Path, records: ObjRecords) -> None:
    """MeshLab never comes back from a material library that is a folder."""
    for name in {word for line in records.companions() for word in (line, *line.split())}:
        if "\0" not in name and os.path.isdir(path.parent / name):
            raise FileError(
                f"its material library {name!r} is a folder", where=str(path), fix="correct the mtllib line"
            )


def _load_trimesh(path: Path, records: Records | None) -> Loaded:
    import trimesh

    scene = trimesh.load_scene(path, process=False, maintain_order=True)
    read = sum(len(mesh.vertices) for mesh in scene.geometry.values())
    if isinstance(records, ObjRecords) and records.vertices != read:
        # trimesh splits by material and leaves out loose vertices: take the records themselves.
        mesh = trimesh.Trimesh(records.positions(), process=False)
        scene = trimesh.Scene(mesh)
    if len(scene.geometry) != 1:
        raise ValueError(f"it has {len(scene.geometry)} meshes, not one")
    mesh = next(iter(scene.geometry.values()))
    triangles = np.asarray(getattr(mesh, "faces", np.zeros((0, 3))), dtype=np.int32)
    colors = mesh.visual.vertex_colors if getattr(mesh.visual, "kind", "") == "vertex" else None
    return Loaded(
        "trimesh",
        positions=np.array(mesh.vertices, dtype=np.float64),
        triangles=triangles,
        colors=np.asarray(colors) / 255 if colors is not None else None,
        normals=np.array(mesh.vertex_normals) if len(triangles) else None,
        handle=scene,
    )


def save(source: Path, loaded: Loaded, target: Path, points: Floats, records: Records | None) -> None:
    """Write a mesh that was loaded, moved onto points (V, 3), in the format of the target's extension."""
    if loaded.backend == "trimesh":
        geometry = next(iter(loaded.handle.copy().geometry.values()))
        geometry.vertices = points
        geometry.export(str(target))
        return
    import pymeshlab

    meshes, embedded = _meshes(source, loaded, records) if len(loaded.triangles) else (None, False)
    if meshes is None:
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(_mesh(points, loaded.triangles, loaded.colors, loaded.quality))
    else:
        _move(meshes, points)
    meshes.save_current_mesh(str(target), save_textures=embedded)


def _meshes(source: Path, loaded: Loaded, records: Records | None) -> tuple[Any, bool]:
    """A MeshSet with the mesh that was loaded, or None, and whether it has images that are no files."""
    import pymeshlab

    if loaded.handle is not None:
        return loaded.handle, False
    # MeshLab's importer crashes on points, lines and strips.
    if isinstance(records, GltfRecords) and any(part.mode != TRIANGLES for part in records.parts):
        return None, False
    meshes = pymeshlab.MeshSet()
    _load_into(meshes, source, records)
    mesh = meshes.current_mesh()
    if meshes.mesh_number() != 1 or mesh.vertex_number() != len(loaded.positions) or loaded.backend == "stl":
        return None, False
    images = [image for image in mesh.textures().values() if image.width() > 0]
    return meshes, bool(images) and isinstance(records, GltfRecords)


def _mesh(positions: Floats, triangles: NDArray[np.int32], colors: Floats | None, quality: Floats | None) -> Any:
    import pymeshlab

    given = {"face_matrix": triangles if len(triangles) else None, "v_color_matrix": colors, "v_scalar_array": quality}
    return pymeshlab.Mesh(positions, **{name: each for name, each in given.items() if each is not None})


def _move(meshes: Any, points: Floats) -> None:
    """Put the current mesh of a MeshSet onto points (V, 3), every bit."""
    import pymeshlab

    current = meshes.current_mesh_id()
    meshes.add_mesh(pymeshlab.Mesh(points))
    target = meshes.current_mesh_id()
    meshes.set_current_mesh(current)
    for _ in range(2):  # the first pass leaves rounding errors of the difference, the second one none
        meshes.compute_coord_linear_morphing(targetmesh=target, percentmorph=100)
    meshes.set_current_mesh(target)
    meshes.delete_current_mesh()
    meshes.set_current_mesh(current)
