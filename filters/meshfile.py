"""Read a mesh from a file and write the same mesh with other coordinates."""

import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from oneform_warp.errors import FileError, InputError
from oneform_warp.filters.backends import Backend, Loaded, load, save
from oneform_warp.filters.formats import OffRecords, Polygons, Records, StlRecords, scan
from oneform_warp.filters.formats.companions import copy_companions, find_companions
from oneform_warp.filters.formats.losses import lost
from oneform_warp.filters.formats.motion import Motion, Normals
from oneform_warp.filters.formats.records import packed_triangles
from oneform_warp.filters.placing import failures, put, same_folder

__all__ = ["READABLE", "SCENES", "WRITABLE", "MeshFile", "read_mesh"]

Faces = NDArray[np.int32] | Polygons

SCENES = {".glb", ".gltf"}
WRITABLE = {".obj", ".off", ".ply", ".stl", ".xyz", ".dae", ".3ds", ".wrl", ".x3d"}
READABLE = WRITABLE | SCENES
TEXTURED = {".obj", ".ply", ".dae", ".wrl", ".x3d"}


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh as its file has it.

    `positions` (V, 3) float64, in the file's unit and frame, those of glTF in world space; V and the order are those of
    MeshLab's importer. `faces` (F, 3) int32 where all are triangles (also without any), else vertex indices and offsets
    (F + 1,), both int32. `colors` (V, 4) in 0..1, `normals` (V, 3) and `quality` (V,) are None where absent. `groups`
    has the vertices of each OBJ group and object, and of each glTF node.
    """

    path: Path
    positions: NDArray[np.float64]
    faces: Faces
    colors: NDArray[np.float64] | None
    normals: NDArray[np.float64] | None
    quality: NDArray[np.float64] | None
    groups: Mapping[str, NDArray[np.int32]]
    backend: str
    _loaded: Loaded = field(repr=False)
    _records: Records | None = field(repr=False)

    @cached_property
    def vertex_of(self) -> NDArray[np.int64]:
        """The vertex of each vertex record of the file, (R,): STL has three records a face, others one a vertex."""
        if not isinstance(self._records, StlRecords):
            return np.arange(len(self.positions))
        vertices = self.polygons[0].astype(np.int64)
        if not np.array_equal(self.positions[vertices], self._records.positions()):
            raise FileError("its triangles were read in another order", where=str(self.path), fix="report it")
        return vertices

    @property
    def records(self) -> Records | None:
        """The file as it stands; None for formats and dialects that only a library knows."""
        return self._records

    @property
    def triangles(self) -> NDArray[np.int32]:
        """The faces cut into triangles (F, 3) by the library that read them."""
        return self._loaded.triangles

    @property
    def polygons(self) -> Polygons:
        """The faces as vertex indices and offsets."""
        return _packed(self.faces)

    def keeps(self, path: str | os.PathLike[str]) -> bool:
        """Whether a file at this path would be this one with other numbers, everything else in it kept."""
        return self._records is not None and Path(path).suffix.lower() == self.path.suffix.lower()

    def lost(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """What this file has and one at another path cannot have, in words; nothing in the format that was read."""
        if self._records is None or self.keeps(path):
            return ()
        with failures(self.path, "read"):
            return lost(self._records.contents(), Path(path).suffix.lower())

    def check_target(self, path: str | os.PathLike[str]) -> None:
        """Raise FileError where this mesh cannot be written to a path: its extension or its folder."""
        target = Path(path).absolute()
        if target.suffix.lower() not in WRITABLE and not self.keeps(target):
            raise _unsupported(target, WRITABLE)
        if not target.parent.is_dir():
            raise FileError("the folder does not exist", where=str(target), fix="make the folder first")

    def write(
        self,
        path: str | os.PathLike[str],
        positions: ArrayLike,
        *,
        normals: Normals = "rotate",
        omega: ArrayLike | None = None,
    ) -> tuple[str, ...]:
        """Write this mesh with other coordinates (V, 3); the extension decides the format. -> warnings.

        In the format that was read (OBJ, OFF, PLY, STL, glTF) only the numbers of vertices that move change in the
        file, and those of normals that turn: by omega (V, 3), rotation vectors in radians, or without it as the
        surface turns; "recompute" makes all anew from the surface, "keep" leaves them. Other formats keep what they
        can hold. Materials and textures are copied into another folder. The file is complete or not there.
        Raises InputError for omega and normals, FileError for coordinates that do not fit or are not finite, an
        unknown extension, a missing folder, and a failure to write.
        """
        target = Path(path).absolute()
        points = _checked(positions, self.path)
        if points.shape != self.positions.shape:
            raise FileError(f"{len(self.positions)} vertices, but positions {points.shape}", where=str(self.path))
        if normals not in get_args(Normals):
            raise InputError(
                f"{normals!r} is no way to treat normals", where="normals", fix="use rotate, recompute, keep"
            )
        turns = None if omega is None else _checked_omega(omega, points.shape)
        self.check_target(target)
        with (
            failures(target, "written"),
            tempfile.TemporaryDirectory(dir=target.parent, prefix=".") as name,
        ):
            folder = Path(name)
            companions, warnings = self._make(folder, target, points, turns, normals)
            warnings += copy_companions(companions, self.path.parent, target.parent)
            warnings += put(folder, target)
        return tuple(warnings)

    def _make(
        self,
        folder: Path,
        target: Path,
        points: NDArray[np.float64],
        omega: NDArray[np.float64] | None,
        normals: Normals,
    ) -> tuple[list[Path], list[str]]:
        """Write the mesh into a folder, under the target's name; -> files that belong to it, and warnings."""
        elsewhere = not same_folder(target.parent, self.path.parent)
        names = self._records.companions() if self._records is not None else ()
        if self._records is None or not self.keeps(target):
            save(self.path, self._loaded, folder / target.name, points, self._records)
            wanted = elsewhere and target.suffix.lower() in TEXTURED
            files, warnings = find_companions(self.path.parent, names) if wanted else ([], [])
            return [file for file in files if file.suffix.lower() not in (".mtl", ".bin")], warnings
        rows: Any = self.vertex_of if isinstance(self._records, StlRecords) else slice(None)
        turns = None if omega is None else omega[rows]
        motion = Motion(self.positions[rows], points[rows], self.polygons, turns, normals)
        taken = frozenset() if elsewhere else frozenset(names)
        made = self._records.files(motion, target.name, taken)
        for name, data in made.items():
            (folder / name).write_bytes(data)
        files, warnings = find_companions(self.path.parent, names) if elsewhere else ([], [])
        return [file for file in files if file.name not in made], warnings


def read_mesh(
    path: str | os.PathLike[str], *, backend: Backend = "auto", mesh_set: Any = None, later: bool = False
) -> MeshFile:
    """Read a mesh or a point cloud.

    "auto" takes pymeshlab, and trimesh where pymeshlab cannot be used; glTF is read as it stands, all nodes in world
    space as one mesh. mesh_set: a pymeshlab.MeshSet that gets the mesh too, as its current one, without reading it
    twice. later: where MeshLab would read just what the file has, the set gets that by `load_later`, and there are no
    colours, normals and quality. Raises FileError, with the path and what to do, for a file that is missing, not
    readable, empty or not understood, for several meshes in one file, for scenes that cannot be deformed (skinned,
    instanced, compressed, quantised), and for coordinates that are not finite.
    """
    source = Path(path).absolute()
    if source.suffix.lower() not in READABLE:
        raise _unsupported(source, READABLE)
    if not source.is_file() or not source.stat().st_size:
        state = "is empty" if source.is_file() else "does not exist"
        raise FileError(f"the file {state}", where=str(source), fix="check the path")
    with failures(source, "read"):
        records = scan(source)
        if isinstance(records, OffRecords) and records.faces:
            _check_indices(records.polygons()[0], records.vertices, source)  # MeshLab would crash
        loaded = load(source, backend, records, mesh_set, later=later)
        if records is not None:
            _check_count(records, loaded, source)
        faces = _faces(loaded, records)
        groups = records.groups() if records is not None else {}
    _checked(loaded.positions, source)
    _check_indices(_packed(faces)[0], len(loaded.positions), source)
    return MeshFile(
        path=source,
        positions=loaded.positions,
        faces=faces,
        colors=loaded.colors,
        normals=loaded.normals,
        quality=loaded.quality,
        groups=groups,
        backend=loaded.backend,
        _loaded=loaded,
        _records=records,
    )


def _check_count(records: Records, loaded: Loaded, path: Path) -> None:
    """Raise FileError where the library read other vertices than the file has, for the first that is not finite."""
    if isinstance(records, StlRecords) or len(loaded.positions) == records.vertices:
        return
    _checked(records.positions(), path)  # MeshLab leaves out vertices with NaN and says nothing
    what = f"{records.vertices} vertices in the file, but {len(loaded.positions)} were read"
    raise FileError(what, where=str(path), fix="check the file")


def _faces(loaded: Loaded, records: Records | None) -> Faces:
    """The faces as in the file, from a library's triangles.

    As many triangles as face records: all are triangles. This saves MeshLab's list of polygons, which takes a
    second for a million faces.
    """
    triangles = loaded.triangles
    if not len(triangles) and not (records and records.faces):
        return triangles
    if records is not None and records.faces != len(triangles):
        polygons = records.polygons()
        if polygons is not None:
            return polygons
    elif records is not None or loaded.polygons is None:
        return triangles
    if loaded.polygons is None:
        return triangles
    faces = loaded.polygons()
    if records is not None and len(faces) != records.faces:
        raise ValueError(f"{records.faces} faces in the file, but MeshLab makes {len(faces)} of them")
    sizes = [len(face) for face in faces]
    if set(sizes) == {3}:
        return triangles
    return np.concatenate(faces).astype(np.int32), np.cumsum([0, *sizes], dtype=np.int32)


def _packed(faces: Faces) -> Polygons:
    """Faces as indices and offsets."""
    return faces if isinstance(faces, tuple) else packed_triangles(faces)


def _checked(positions: ArrayLike, path: Path) -> NDArray[np.float64]:
    """Positions (V, 3) that are finite; raises FileError with the first vertex that is not."""
    points = np.ascontiguousarray(positions, dtype=np.float64)
    if not len(points):
        raise FileError("there are no vertices", where=str(path), fix="check that it is a mesh file")
    finite = np.isfinite(points)
    if not finite.all():
        bad = np.flatnonzero(~finite.all(axis=-1))
        values = points[bad[0]].tolist()
        what = f"vertex {bad[0]} (from 0) is not finite: {values}"
        raise FileError(what, where=str(path), fix=f"repair it and {len(bad) - 1} more")
    return points


def _checked_omega(omega: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Rotation vectors (V, 3) that are finite."""
    vectors = np.asarray(omega, dtype=np.float64)
    if vectors.shape != shape or not np.isfinite(vectors).all():
        raise InputError(f"omega is {vectors.shape} for positions {shape}", where="omega", fix="give finite (V, 3)")
    return vectors


def _check_indices(indices: NDArray[np.int32], vertices: int, path: Path) -> None:
    """Raise FileError where a face uses a vertex that is not there."""
    bad = indices[(indices < 0) | (indices >= vertices)]
    if len(bad):
        what = f"a face uses vertex {bad[0]} (from 0) of {vertices}"
        raise FileError(what, where=str(path), fix="repair the faces")


def _unsupported(path: Path, known: set[str]) -> FileError:
    return FileError(f"unknown extension '{path.suffix}'", where=str(path), fix=f"use {', '.join(sorted(known))}")
