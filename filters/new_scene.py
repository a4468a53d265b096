"""A glTF scene of a mesh from another format, with UVs, normals, colours, materials and textures as trimesh reads them.

Importers split vertices at UV seams and do not say which vertex each came from. So trimesh reads a copy of the file in
which each vertex stands where its own number says, and the numbers are read off the coordinates.
"""

import io
import tempfile
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.filters.formats import GltfRecords, ObjRecords, PlyRecords
from oneform_warp.filters.formats.motion import Motion
from oneform_warp.filters.meshfile import MeshFile

__all__ = ["scene_of"]

Numbers = NDArray[np.int64]
FAILURES = (ValueError, KeyError, IndexError, TypeError, AttributeError, AssertionError, NotImplementedError, OSError)

FLOATS = {"POSITION": 12, "NORMAL": 12}
"""Attributes that `GltfRecords` wants each node to have for itself, and the bytes of one."""

ROUGHNESS = 0.8
CLAY = {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": ROUGHNESS}, "doubleSided": True}
"""For primitives without a material: glTF's own default is metal, which most viewers show black."""

DIGIT = 1 << 12
"""Numbers of vertices are written in two digits of this base, which 32-bit coordinates hold exactly."""


def scene_of(mesh: MeshFile, name: str) -> tuple[GltfRecords, Numbers]:
    """The scene, whose file will be called `name`, and the mesh's vertex of each of its vertices (W,)."""
    scene = _by_trimesh(mesh)
    if scene is None or not _complete(mesh, scene):
        scene = _plain(mesh)
    vertices: dict[str, Numbers] = {}
    for node in scene.graph.nodes_geometry:
        geometry = scene.geometry[scene.graph[node][1]]
        vertices[node] = _numbers(geometry)
        _place(geometry, mesh.positions[vertices[node]])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(scene.export(file_type="glb", tree_postprocessor=_finish))
        records = GltfRecords.load(path)
    return records, np.concatenate([vertices[part.name] for part in records.parts])


def _by_trimesh(mesh: MeshFile) -> Any:
    """The scene that trimesh makes of the file, vertices standing where their numbers say; None where it cannot."""
    import trimesh
    from trimesh.resolvers import FilePathResolver

    if not isinstance(mesh.records, ObjRecords | PlyRecords):
        return None
    coded = Motion(mesh.positions, _coded(len(mesh.positions)), mesh.polygons, normals="keep")
    data, kind = io.BytesIO(mesh.records.moved(coded)), mesh.path.suffix.lower()[1:]
    resolver = FilePathResolver(str(mesh.path))
    with warnings.catch_warnings(), suppress(*FAILURES):  # of unusual files; the plain mesh is always there
        warnings.simplefilter("ignore")
        return trimesh.load_scene(data, file_type=kind, resolver=resolver, process=False)
    return None


def _complete(mesh: MeshFile, scene: Any) -> bool:
    """Whether all the mesh's triangles are there, on vertices that it has."""
    import trimesh

    parts = [part for part in scene.geometry.values() if isinstance(part, trimesh.Trimesh)]
    if len(parts) != len(scene.geometry) or sum(len(part.faces) for part in parts) != len(mesh.triangles):
        return False
    return all(np.array_equal(_coded(len(mesh.positions))[_numbers(part)], part.vertices) for part in parts)


def _plain(mesh: MeshFile) -> Any:
    """The triangles, with the colours of vertices."""
    import trimesh

    colors = None if mesh.colors is None else np.rint(255 * np.clip(mesh.colors, 0, 1)).astype(np.uint8)
    points = _coded(len(mesh.positions))
    return trimesh.Scene(trimesh.Trimesh(points, mesh.triangles, vertex_colors=colors, process=False))


def _coded(count: int) -> NDArray[np.float64]:
    """For each number below count the point (count, 3) that stands for it."""
    numbers = np.arange(count)
    return np.stack([numbers % DIGIT, numbers // DIGIT, np.zeros(count)], axis=1)


def _numbers(geometry: Any) -> Numbers:
    """The numbers (n,) that the vertices of a geometry stand for; 0 where a point stands for none."""
    points = np.asarray(geometry.vertices)
    numbers = (points[:, 0] + DIGIT * points[:, 1]).astype(np.int64)
    return np.where((numbers >= 0) & (numbers < DIGIT**2), numbers, 0)


def _place(geometry: Any, points: NDArray[np.float64]) -> None:
    """Puts the vertices where they belong; normals stay if the file had them, those of the coded points go."""
    stored = geometry.vertex_normals if "vertex_normals" in geometry._cache else None
    geometry.vertices = points
    if stored is not None:
        geometry.vertex_normals = stored
    if hasattr(geometry.visual, "material"):
        geometry.visual.material = _material(geometry.visual.material)


def _material(given: Any) -> Any:
    """A material as glTF has it: plain where the file has none, for which trimesh takes a grey picture."""
    from trimesh.visual.material import PBRMaterial, SimpleMaterial, empty_material

    if not isinstance(given, SimpleMaterial):
        return given
    picture, none = given.image, empty_material()
    if picture is not None and picture.size == none.image.size and picture.tobytes() == none.image.tobytes():
        return PBRMaterial(metallicFactor=0.0, roughnessFactor=ROUGHNESS, doubleSided=True)
    made = given.to_pbr()
    made.metallicFactor, made.doubleSided = 0.0, True
    if picture is not None and np.array_equal(given.diffuse, none.diffuse):
        made.baseColorFactor = None  # nobody chose the grey that would darken the picture
    return made


def _finish(tree: Any) -> None:
    """Gives each primitive a material, and vertices of its own: trimesh writes equal ones once, as of instances."""
    seen: set[int] = set()
    for primitive in (each for mesh in tree.get("meshes", ()) for each in mesh["primitives"]):
        for attribute in [name for name in FLOATS if name in primitive["attributes"]]:
            accessor = primitive["attributes"][attribute]
            if accessor in seen:
                entry = dict(tree["accessors"][accessor])
                tree["bufferViews"][entry["bufferView"]]["byteStride"] = FLOATS[attribute]
                tree["accessors"].append(entry)
                primitive["attributes"][attribute] = len(tree["accessors"]) - 1
            seen.add(accessor)
        if "material" not in primitive:
            materials = tree.setdefault("materials", [])
            if CLAY not in materials:
                materials.append(CLAY)
            primitive["material"] = materials.index(CLAY)
