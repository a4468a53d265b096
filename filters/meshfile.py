"""Read a mesh from a file and write the same mesh with other coordinates."""

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from oneform_warp.errors import FileError
from oneform_warp.filters.records import ObjRecords, OffRecords, Polygons, Records, scan

__all__ = ["MeshFile", "read_mesh"]

Backend = Literal["auto", "pymeshlab", "trimesh"]
Faces = NDArray[np.int32] | Polygons

SCENES = {".glb", ".gltf"}
READABLE = {".obj", ".off", ".ply", ".stl", ".xyz", ".dae", ".3ds", ".wrl", ".x3d"} | SCENES
WRITABLE = {".obj", ".off", ".ply", ".stl", ".xyz", ".dae", ".3ds", ".wrl", ".x3d"}


@dataclass(frozen=True)
class MeshFile:
    """A mesh as its file has it.

    `positions` (V, 3) float64, in the file's unit and frame. `faces` (F, 3) int32 where all are triangles
    (also without any), else vertex indices and offsets (F + 1,), both int32. `colors` (V, 4) in 0..1,
    `normals` (V, 3) and `quality` (V,) are None where absent. `groups` has the vertices of each OBJ group
    and object.
    """

    path: Path
    positions: NDArray[np.float64]
    faces: Faces
    colors: NDArray[np.float64] | None
    normals: NDArray[np.float64] | None
    quality: NDArray[np.float64] | None
    groups: Mapping[str, NDArray[np.int32]]
    backend: str
    _handle: Any = field(repr=False)
    _records: Records | None = field(repr=False)

    def write(self, path: str | os.PathLike[str], positions: ArrayLike) -> None:
        """Write this mesh with other coordinates (V, 3); the extension decides the format.

        In the format that was read (OBJ, OFF, PLY), only the numbers of the vertices and normals change in
        the file. Other formats keep what they can hold. The file is complete or not there. Raises FileError
        for coordinates that do not fit or are not finite, an unknown extension, a missing folder, and a
        failure to write.
        """
        target = Path(path).absolute()
        points = _checked(positions, self.path)
        if points.shape != self.positions.shape:
            raise FileError(f"{len(self.positions)} vertices, but positions {points.shape}", where=str(self.path))
        same = target.suffix.lower() == self.path.suffix.lower()
        if target.suffix.lower() not in WRITABLE and not (same and self.backend == "trimesh"):
            raise _unsupported(target, WRITABLE)
        if not target.parent.is_dir():
            raise FileError("the folder does not exist", where=str(target), fix="make the folder first")
        with (
            _failures(target, "written"),
            tempfile.TemporaryDirectory(dir=target.parent, prefix=".") as folder,
        ):
            part = Path(folder) / target.name
            if same and self._records is not None:
                part.write_bytes(self._records.moved(points, _packed(self.faces)))
            else:
                (_save_pymeshlab if self.backend == "pymeshlab" else _save_trimesh)(self, part, points)
            # Materials and textures first: the mesh refers to them.
            for made in sorted(Path(folder).iterdir(), key=lambda made: made.name == target.name):
                os.replace(made, target.parent / made.name)


def read_mesh(path: str | os.PathLike[str], *, backend: Backend = "auto") -> MeshFile:
    """Read a mesh or a point cloud.

    "auto" takes pymeshlab, but trimesh for GLB and glTF and where pymeshlab cannot be used. Raises FileError,
    with the path and what to do, for a file that is missing, not readable, empty or not understood, for
    several meshes in one file, and for coordinates that are not finite.
    """
    source = Path(path).absolute()
    if source.suffix.lower() not in READABLE:
        raise _unsupported(source, READABLE)
    if not source.is_file() or not source.stat().st_size:
        state = "is empty" if source.is_file() else "does not exist"
        raise FileError(f"the file {state}", where=str(source), fix="check the path")
    with _failures(source, "read"):
        records = scan(source)
        if isinstance(records, OffRecords) and records.faces:
            _check_indices(records.polygons()[0], records.vertices, source)  # MeshLab would crash
        mesh = _load(source, backend, records)
    if records is not None and records.vertices != len(mesh.positions):
        with _failures(source, "read"):
            positions = records.positions()
        _checked(positions, source)  # MeshLab leaves out vertices with NaN and says nothing
        raise FileError(
            f"{records.vertices} vertices in the file, but {len(mesh.positions)} were read", where=str(source)
        )
    _checked(mesh.positions, source)
    _check_indices(_packed(mesh.faces)[0], len(mesh.positions), source)
    return mesh


def _load(path: Path, backend: Backend, records: Records | None) -> MeshFile:
    """Read by the wanted backend, or by the first one that can."""
    if backend == "trimesh" or (backend == "auto" and path.suffix.lower() in SCENES):
        return _load_trimesh(path, records)
    try:
        import pymeshlab
    except ImportError:
        if backend == "pymeshlab":
            raise FileError("pymeshlab is not installed", where=str(path), fix="use backend='auto'") from None
        return _load_trimesh(path, records)
    try:
        return _load_pymeshlab(path, records)
    except pymeshlab.PyMeshLabException as error:
        # A build without OpenGL lacks PLY and others; anything else is the file's own fault.
        if backend == "auto" and "nknown" in str(error):
            return _load_trimesh(path, records)
        raise


def _load_pymeshlab(path: Path, records: Records | None) -> MeshFile:
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    if isinstance(records, OffRecords) and records.unusual:
        with tempfile.TemporaryDirectory() as folder:
            flowed = Path(folder) / path.name
            flowed.write_bytes(records.flowed())
            meshes.load_new_mesh(str(flowed))
    else:
        meshes.load_new_mesh(str(path))
    if meshes.mesh_number() != 1:
        raise ValueError(f"it has {meshes.mesh_number()} meshes, not one")
    mesh = meshes.current_mesh()
    faces = _faces(mesh.face_matrix(), mesh.polygonal_face_list, records)
    return MeshFile(
        path=path,
        positions=np.ascontiguousarray(mesh.vertex_matrix(), dtype=np.float64),
        faces=faces,
        colors=np.asarray(mesh.vertex_color_matrix()) if mesh.has_vertex_color() else None,
        normals=np.asarray(mesh.vertex_normal_matrix()) if mesh.face_number() else None,
        quality=np.asarray(mesh.vertex_scalar_array()) if mesh.has_vertex_scalar() else None,
        groups=records.groups() if records else {},
        backend="pymeshlab",
        _handle=meshes,
        _records=records,
    )


def _load_trimesh(path: Path, records: Records | None) -> MeshFile:
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
    return MeshFile(
        path=path,
        positions=np.array(mesh.vertices, dtype=np.float64),
        faces=_faces(triangles, None, records),
        colors=np.asarray(colors) / 255 if colors is not None else None,
        normals=np.array(mesh.vertex_normals) if len(triangles) else None,
        quality=None,
        groups=records.groups() if records else {},
        backend="trimesh",
        _handle=scene,
        _records=records,
    )


def _faces(triangles: NDArray[Any], polygonal: Any, records: Records | None) -> Faces:
    """The faces as in the file, from an importer's triangles.

    As many triangles as face records: all are triangles. This saves MeshLab's list of polygons, which takes a
    second for a million faces.
    """
    triangles = np.ascontiguousarray(triangles, dtype=np.int32).reshape(-1, 3)
    if not len(triangles) and not (records and records.faces):
        return triangles
    if records is not None and records.faces != len(triangles):
        polygons = records.polygons()
        if polygons is not None:
            return polygons
    elif records is not None or polygonal is None:
        return triangles
    if polygonal is None:
        return triangles
    faces = polygonal()
    if records is not None and len(faces) != records.faces:
        raise ValueError(f"{records.faces} faces in the file, but MeshLab makes {len(faces)} of them")
    sizes = [len(face) for face in faces]
    if set(sizes) == {3}:
        return triangles
    return np.concatenate(faces).astype(np.int32), np.cumsum([0, *sizes], dtype=np.int32)


def _save_pymeshlab(mesh: MeshFile, path: Path, points: NDArray[np.float64]) -> None:
    """Write by MeshLab: its mesh, moved onto the new positions."""
    import pymeshlab

    meshes = mesh._handle
    if not meshes.current_mesh().face_number():
        given = {"v_color_matrix": mesh.colors, "v_scalar_array": mesh.quality}
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(points, **{name: a for name, a in given.items() if a is not None}))
        meshes.save_current_mesh(str(path))
        return
    current = meshes.current_mesh_id()
    meshes.add_mesh(pymeshlab.Mesh(points))
    target = meshes.current_mesh_id()
    meshes.set_current_mesh(current)
    for _ in range(2):  # the first pass leaves rounding errors of the difference, the second one none
        meshes.compute_coord_linear_morphing(targetmesh=target, percentmorph=100)
    meshes.set_current_mesh(target)
    meshes.delete_current_mesh()
    meshes.set_current_mesh(current)
    images = [image for image in meshes.current_mesh().textures().values() if image.width() > 0]
    meshes.save_current_mesh(str(path), save_textures=bool(images))


def _save_trimesh(mesh: MeshFile, path: Path, points: NDArray[np.float64]) -> None:
    """Write by trimesh; a scene keeps its transforms and materials, polygons become triangles."""
    scene = mesh._handle.copy()
    geometry = next(iter(scene.geometry.values()))
    geometry.vertices = points
    (scene if path.suffix.lower() in SCENES else geometry).export(str(path))


def _packed(faces: Faces) -> Polygons:
    """Faces as indices and offsets."""
    if isinstance(faces, tuple):
        return faces
    return faces.ravel(), np.arange(0, faces.size + 1, 3, dtype=np.int32)


def _checked(positions: ArrayLike, path: Path) -> NDArray[np.float64]:
    """Positions (V, 3) that are finite; raises FileError with the first vertex that is not."""
    points = np.ascontiguousarray(positions, dtype=np.float64)
    if not len(points):
        raise FileError("there are no vertices", where=str(path), fix="check that it is a mesh file")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=-1))
    if len(bad):
        values = points[bad[0]].tolist()
        what = f"vertex {bad[0]} (from 0) is not finite: {values}"
        raise FileError(what, where=str(path), fix=f"repair it and {len(bad) - 1} more")
    return points


def _check_indices(indices: NDArray[np.int32], vertices: int, path: Path) -> None:
    """Raise FileError where a face uses a vertex that is not there."""
    bad = indices[(indices < 0) | (indices >= vertices)]
    if len(bad):
        what = f"a face uses vertex {bad[0]} (from 0) of {vertices}"
        raise FileError(what, where=str(path), fix="repair the faces")


def _unsupported(path: Path, known: set[str]) -> FileError:
    return FileError(f"unknown extension '{path.suffix}'", where=str(path), fix=f"use {', '.join(sorted(known))}")


@contextmanager
def _failures(path: Path, verb: str) -> Iterator[None]:
    """Turn what a backend raises into FileError, and go back to the folder that MeshLab leaves."""
    folder = os.getcwd()
    try:
        yield
    except FileError:
        raise
    except Exception as error:  # importers raise anything on broken files
        reason = " ".join(str(error).split()) or type(error).__name__
        fix = "check that it is a mesh of this format" if verb == "read" else "choose another format or folder"
        raise FileError(f"cannot be {verb}: {reason}", where=str(path), fix=fix) from error
    finally:
        os.chdir(folder)
