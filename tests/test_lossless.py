"""Twenty properties of each real file, read by other libraries or off the text, before and after a deformation."""

from __future__ import annotations

import hashlib
import io
import os
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gltf_scenes import read_json
from oneform_warp import Deformer, Fields
from oneform_warp.filters import MeshFile, read_mesh

MESHES = Path(os.environ.get("ONEFORM_MESHES", Path(__file__).parents[2] / "shared" / "meshes"))
SUFFIXES = {".obj", ".off", ".ply", ".stl", ".glb"}
FILES = sorted(
    path for folder in ("attributes", "polygons") for path in (MESHES / folder).glob("*") if path.suffix in SUFFIXES
)

pymeshlab = pytest.importorskip("pymeshlab", reason="pymeshlab is not installed")
trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")


class Look:
    """A file as MeshLab, trimesh and a plain reading of its bytes see it."""

    def __init__(self, path: Path) -> None:
        self.path, self.data = path, path.read_bytes()
        self.meshes = pymeshlab.MeshSet()
        self.meshes.load_new_mesh(str(path))
        self.mesh = self.meshes.current_mesh()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # trimesh on UVs that are not numbers
            known = path.suffix != ".off"  # its polygons and comments are too much for trimesh
            self.scene = trimesh.load_scene(path, process=False, maintain_order=True) if known else trimesh.Scene()
        self.text = self.data.decode("latin-1") if path.suffix in (".obj", ".off") else ""
        self.header = self.data.partition(b"end_header")[0] if path.suffix == ".ply" else b""
        self.json = read_json(self.data) if path.suffix == ".glb" else {}

    def given(self, has: str, read: str) -> Any:
        """What MeshLab has per vertex, face or corner."""
        return digest(getattr(self.mesh, read)()) if getattr(self.mesh, has)() else None

    def lines(self, *kinds: str) -> list[str]:
        """The lines of an OBJ that begin with these words."""
        return [line for line in self.text.splitlines() if line.split()[:1] and line.split()[0] in kinds]

    def visuals(self) -> list[Any]:
        return [mesh.visual for mesh in self.scene.geometry.values() if hasattr(mesh, "visual")]


SIZES = {"char": 1, "uchar": 1, "short": 2, "ushort": 2, "int": 4, "uint": 4, "float": 4, "double": 8}
MOVED = {("vertex", name) for name in ("x", "y", "z", "nx", "ny", "nz")}


def digest(array: Any) -> tuple[tuple[int, ...], str]:
    array = np.ascontiguousarray(array)
    return array.shape, hashlib.sha256(array.tobytes()).hexdigest()


def ply_values(look: Look) -> dict[tuple[str, str], list[Any]]:
    """All numbers of a PLY file but coordinates and normals, those of a text as they are spelled."""
    if not look.header:
        return {}
    order = "big" if b"binary_big" in look.header else "little"
    body = look.data[len(look.header) :].partition(b"\n")[2]
    words, stream = iter(body.split()), io.BytesIO(body)

    def number(kind: str) -> Any:
        return next(words) if b"format ascii" in look.header else stream.read(SIZES[kind])

    def count(kind: str) -> int:
        value = number(kind)
        return int(value) if b"format ascii" in look.header else int.from_bytes(value, order)

    found: dict[tuple[str, str], list[Any]] = {}
    for part in look.header.decode("latin-1").split("\nelement ")[1:]:
        (element, length), *lines = (line.split() for line in part.splitlines() if not line.startswith("comment"))
        for _ in range(int(length)):
            for _, *kind, name in lines:
                value = [number(kind[2]) for _ in range(count(kind[1]))] if kind[0] == "list" else number(kind[0])
                found.setdefault((element, name), []).append(value)
    return {key: values for key, values in found.items() if key not in MOVED}


def scene_without_bounds(look: Look) -> Any:
    accessors = [{k: v for k, v in each.items() if k not in ("min", "max")} for each in look.json.get("accessors", ())]
    return {**look.json, "accessors": accessors}


def companions(look: Look) -> dict[str, bytes]:
    names = re.findall(r"(?m)^(?:mtllib|comment TextureFile)\s+(.+?)\s*$", look.text or look.header.decode("latin-1"))
    files = {name: look.path.parent / name for name in names}
    for path in list(files.values()):
        if path.suffix == ".mtl" and path.is_file():
            textures = re.findall(r"(?m)^map_\w+\s+(.+?)\s*$", path.read_text())
            files |= {name: path.parent / name for name in textures}
    return {name: path.read_bytes() for name, path in files.items() if path.is_file()}


PROPERTIES: dict[str, Callable[[Look], Any]] = {
    "vertices": lambda look: look.mesh.vertex_number(),
    "faces": lambda look: digest(look.mesh.face_matrix()) if look.mesh.face_number() else None,
    "polygons": lambda look: [list(face) for face in look.mesh.polygonal_face_list()],
    "vertex colours": lambda look: look.given("has_vertex_color", "vertex_color_matrix"),
    "face colours": lambda look: look.given("has_face_color", "face_color_matrix"),
    "encoding": lambda look: look.header or look.json.get("asset") or look.data[:2],
    "line ends": lambda look: "crlf" if "\r\n" in (look.text or str(look.header)) else "lf",
    "UVs of corners": lambda look: look.given("has_wedge_tex_coord", "wedge_tex_coord_matrix"),
    "UVs of vertices": lambda look: look.given("has_vertex_tex_coord", "vertex_tex_coord_matrix"),
    "textures": lambda look: {name: (i.width(), i.height()) for name, i in look.mesh.textures().items()},
    "trimesh's UVs": lambda look: [digest(v.uv) for v in look.visuals() if getattr(v, "uv", None) is not None],
    "trimesh's materials": lambda look: [str(getattr(getattr(v, "material", None), "name", "")) for v in look.visuals()],
    "names": lambda look: (sorted(look.scene.geometry), sorted(look.scene.graph.nodes_geometry)),
    "node transforms": lambda look: [digest(look.scene.graph[n][0]) for n in sorted(look.scene.graph.nodes_geometry)],
    "custom properties and elements": ply_values,
    "groups, materials, smoothing": lambda look: look.lines("g", "o", "s", "usemtl", "mtllib"),
    "comments": lambda look: [*re.findall(r"#[^\n]*", look.text), *re.findall(rb"comment[^\n]*", look.header)],
    "other lines": lambda look: [line for line in look.text.splitlines() if line.split()[:1] not in (["v"], ["vn"], ["f"])]
    if look.path.suffix == ".obj" else len(look.text.splitlines()),
    "scene": scene_without_bounds,
    "materials and textures beside it": companions,
}  # fmt: skip


def identity(mesh: MeshFile) -> tuple[np.ndarray, np.ndarray]:
    """Positions and omega of a deformation by fields that turn and stretch nothing; a cloud simply stays."""
    count = len(mesh.positions)
    fields = Fields(omega=np.zeros((count, 3)), sigma=np.ones(count))
    faces = mesh.faces[0] if isinstance(mesh.faces, tuple) else mesh.faces
    if not len(faces):
        return mesh.positions, fields.omega
    return Deformer(mesh.positions, mesh.faces, device="cpu").solve(fields=fields).x, fields.omega


def bent(mesh: MeshFile) -> tuple[np.ndarray, np.ndarray]:
    """Every vertex somewhere else, exactly representable in 32 bits, and turned by its own angle."""
    points = (mesh.positions[:, [2, 0, 1]] * 2).astype(np.float32).astype(np.float64)
    return points, np.sin(mesh.positions)


def test_there_are_twenty_properties() -> None:
    assert len(PROPERTIES) == 20


@pytest.mark.skipif(not FILES, reason="no meshes: set ONEFORM_MESHES to their folder")
@pytest.mark.parametrize("deformation", [identity, bent])
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_a_deformed_file_keeps_what_it_had(
    path: Path, deformation: Callable[[MeshFile], tuple[np.ndarray, np.ndarray]], tmp_path: Path
) -> None:
    mesh = read_mesh(path)
    positions, omega = deformation(mesh)
    target = tmp_path / path.name
    assert mesh.write(target, positions, omega=omega) == ()
    again = read_mesh(target)
    if path.suffix == ".glb" and deformation is bent:  # nodes round in their own space, to 32 bits
        np.testing.assert_allclose(again.positions, positions, atol=1e-6 * np.ptp(positions))
    else:
        np.testing.assert_array_equal(again.positions, positions)
    before, after = Look(path), Look(target)
    different = [name for name, read in PROPERTIES.items() if not same(read(before), read(after))]
    assert different == []
    if deformation is identity:
        assert positions.tobytes() == mesh.positions.tobytes()
        assert target.read_bytes() == path.read_bytes()


def same(left: Any, right: Any) -> bool:
    return bool(left == right)


@pytest.mark.skipif(not FILES, reason="no meshes: set ONEFORM_MESHES to their folder")
def test_every_property_is_somewhere() -> None:
    """A property that no file has would compare nothing with nothing."""
    looks = [Look(path) for path in FILES]
    empty = [name for name, read in PROPERTIES.items() if not any(read(look) for look in looks)]
    assert empty == []
