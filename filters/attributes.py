"""What pymeshlab leaves out of a file: properties that it does not know, and the names of a mesh's parts."""

from __future__ import annotations

import re
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from oneform_warp.errors import FileError, OneFormWarning
from oneform_warp.filters.formats import OffRecords, PlyRecords, scan

__all__ = ["SCENES", "Parts", "add_attributes", "loadable", "named_parts"]

SCENES = (".glb", ".gltf")

Parts = Mapping[str, NDArray[np.int32]]
"""Vertex numbers by the name of a group, an object or a material."""

# What pymeshlab reads of a PLY vertex.
KNOWN = {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha", "quality", "scalar", "radius", "flags",
         "confidence", "s", "t", "u", "v", "texture_u", "texture_v", "texnum", "diffuse_red", "diffuse_green",
         "diffuse_blue", "diffuse_alpha"}  # fmt: skip

OBJ_RECORD = re.compile(rb"^[ \t]*(v|f|g|o|usemtl)[ \t]+((?:[^\r\n\\]|\\\r?\n)+)", re.M)


@contextmanager
def loadable(path: Path) -> Iterator[Path]:
    """The file itself, or for OFF dialects that pymeshlab does not read, the same mesh in one that it does.

    Raises FileError for a file that would crash pymeshlab, or that it would load as something else.
    """
    records = scan(path) if path.suffix.lower() in (".off", *SCENES) and path.is_file() else None
    if not isinstance(records, OffRecords) or not records.faces:
        yield path
        return
    try:
        indices = records.polygons()[0]
    except (ValueError, IndexError, StopIteration, RuntimeError):
        raise FileError("the faces cannot be read", where=str(path), fix="check that it is an OFF file") from None
    wrong = indices[(indices < 0) | (indices >= records.vertices)]
    if len(wrong):
        what = f"a face uses vertex {wrong[0]} (from 0) of {records.vertices}"
        raise FileError(what, where=str(path), fix="repair the faces")
    if not records.unusual:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        flowed = Path(folder) / path.name
        flowed.write_bytes(records.flowed())
        yield flowed


def add_attributes(mesh: pymeshlab.Mesh, path: Path) -> None:
    """Adds what pymeshlab did not read of a file's vertices to its mesh, as custom attributes.

    Three properties a_x, a_y, a_z are also one point attribute a. Warns where the file has other vertices.
    """
    found = _file_attributes(mesh, path)
    for name, values in found.items():
        if len(values) != mesh.vertex_number():
            what = f"{path.name}: the properties of {len(values)} vertices are left out, {mesh.vertex_number()} loaded"
            warnings.warn(what, OneFormWarning, stacklevel=3)
            return
        if values.ndim == 1:
            mesh.add_vertex_custom_scalar_attribute(values, name)
        else:
            mesh.add_vertex_custom_point_attribute(values, name)


def _file_attributes(mesh: pymeshlab.Mesh, path: Path) -> dict[str, NDArray[np.float64]]:
    if path.suffix.lower() in SCENES:
        return _scene_attributes(path, mesh.label(), mesh.vertex_number())
    return _ply_attributes(path) if path.suffix.lower() == ".ply" else {}


def _ply_attributes(path: Path) -> dict[str, NDArray[np.float64]]:
    """The scalar properties of a PLY file's vertices that pymeshlab does not know; triples also as points."""
    unknown = [name for name in _ply_properties(path) if name not in KNOWN]
    if not unknown:
        return {}
    try:
        found = PlyRecords.read(path.read_bytes()).scalars()
        scalars = {name: found[name] for name in unknown}
    except (ValueError, KeyError, IndexError):
        warnings.warn(f"{path.name}: its own properties cannot be read", OneFormWarning, stacklevel=4)
        return {}
    points = {name[:-2]: [f"{name[:-2]}_{axis}" for axis in "xyz"] for name in scalars if name.endswith("_x")}
    whole = {name: axes for name, axes in points.items() if all(axis in scalars for axis in axes)}
    return scalars | {name: np.stack([scalars[a] for a in axes], axis=1) for name, axes in whole.items()}


def _ply_properties(path: Path) -> list[str]:
    """The names of the vertices' properties in the header of a PLY file, lists left out."""
    with path.open("rb") as file:
        lines = [
            line.split() for line in takewhile(lambda line: line.strip() != b"end_header", iter(file.readline, b""))
        ]
    element, names = b"", []
    for words in lines:
        if words[:1] == [b"element"] and len(words) > 1:
            element = words[1]
        elif words[:1] == [b"property"] and element == b"vertex" and words[1] != b"list":
            names.append(words[-1].decode("latin-1"))
    return names


def _scene_attributes(path: Path, label: str, vertices: int) -> dict[str, NDArray[np.float64]]:
    """The custom attributes, whose names begin with an underscore, of the mesh of this name and number of vertices."""
    import trimesh

    scene = trimesh.load_scene(path, process=False, maintain_order=True)
    for name, mesh in scene.geometry.items():
        known = label in (name, mesh.metadata.get("name")) or len(scene.geometry) == 1
        if known and len(mesh.vertices) == vertices:
            found = getattr(mesh, "vertex_attributes", {})
            arrays = {key.removeprefix("_"): np.asarray(value, dtype=np.float64) for key, value in found.items()}
            flat = {key: each[:, 0] if each.shape == (vertices, 1) else each for key, each in arrays.items()}
            return {key: each for key, each in flat.items() if each.shape in ((vertices,), (vertices, 3))}
    return {}


def named_parts(path: Path) -> tuple[int, Parts]:
    """How many vertices an OBJ file has, and those of each group, object and material; no names for other formats."""
    if path.suffix.lower() != ".obj" or not path.is_file():
        return 0, {}
    count, members = 0, dict[str, list[int]]()
    current: dict[bytes, list[str]] = {}
    for kind, text in _obj_records(path.read_bytes()):
        if kind == b"v":
            count += 1
        elif kind == b"f":
            corners = list(_corners(text, count))
            for name in {name for names in current.values() for name in names}:
                members.setdefault(name, []).extend(corners)
        else:
            name = text.decode("utf-8", "replace").strip()
            current[kind] = name.split() if kind == b"g" else [name]
    return count, {name: np.unique(np.asarray(numbers, dtype=np.int32)) for name, numbers in members.items()}


def _obj_records(data: bytes) -> Iterator[tuple[Any, bytes]]:
    for match in OBJ_RECORD.finditer(data):
        yield match[1], match[2].replace(b"\\", b" ").split(b"#")[0]


def _corners(text: bytes, vertices: int) -> Iterator[int]:
    """Vertex numbers from 0 of a face record; negative ones count back from the last vertex so far."""
    for corner in text.split():
        index = int(corner.split(b"/")[0])
        yield index - 1 if index > 0 else vertices + index
