"""Mesh files: what is read is what the file has, and what is written is the same mesh elsewhere."""

import os
from pathlib import Path

import numpy as np
import pytest

from oneform_warp.errors import FileError, InputError
from oneform_warp.filters import read_mesh

MESHES = Path(os.environ.get("ONEFORM_MESHES", Path(__file__).parents[2] / "shared" / "meshes"))
SUFFIXES = {".obj", ".off", ".ply", ".stl", ".glb"}
REAL = sorted(path for path in MESHES.glob("*/*") if path.suffix.lower() in SUFFIXES)

MIXED_OBJ = """# two parts
mtllib parts.mtl
o house
g wall left
v 0 0 0 1 0 0
v 1 0 0 1 0 0
v 1 1 0 1 0 0
v 0 1 0 1 0 0
v 0.1 2 0 1 0 0
vt 0.5 0.5
vn 0 0 1
usemtl brick
f 1/1/1 2/1/1 3/1/1 4/1/1
g roof
f -3/1/1 -1/1/1 -2/1/1
"""
QUADS_OFF = "OFF\n# broken lines\n6 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n2 1 0\n4 0 1\n2 3 4\n1 4 5 2\n"
CLOUD_PLY = (
    "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    "0 0 0 255 0 0\n0.1 1 1 0 255 0\n"
)
NORMALS_PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n"
    "property float nx\nproperty float ny\nproperty float nz\nproperty float heat\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n"
    "0 0 0 0 0 1 5\n1 0 0 0 0 1 6\n0 1 0 0 0 1 7\n3 0 1 2\n"
)


def put(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def packed(faces):
    return faces if isinstance(faces, tuple) else (faces.ravel(), np.arange(0, faces.size + 1, 3))


def same_faces(left, right):
    return all(map(np.array_equal, packed(left), packed(right)))


@pytest.fixture(params=["pymeshlab", "trimesh"])
def backend(request):
    pytest.importorskip(request.param, reason=f"{request.param} is not installed")
    return request.param


def test_obj_keeps_polygons_groups_and_all_other_lines(tmp_path, backend):
    mesh = read_mesh(put(tmp_path, "a.obj", MIXED_OBJ), backend=backend)
    indices, offsets = mesh.faces
    assert indices.tolist() == [0, 1, 2, 3, 2, 4, 3]
    assert offsets.tolist() == [0, 4, 7]
    groups = {name: members.tolist() for name, members in mesh.groups.items()}
    assert groups == {"wall": [0, 1, 2, 3], "left": [0, 1, 2, 3], "house": [0, 1, 2, 3, 4], "roof": [2, 3, 4]}
    moved = mesh.positions[:, [2, 0, 1]] + np.pi
    mesh.write(tmp_path / "b.obj", moved)
    again = read_mesh(tmp_path / "b.obj", backend=backend)
    np.testing.assert_array_equal(again.positions, moved)
    before, after = MIXED_OBJ.splitlines(), (tmp_path / "b.obj").read_text().splitlines()
    assert [line for line in after if line[0] != "v"] == [line for line in before if line[0] != "v"]
    assert after[4].endswith(" 1 0 0")
    assert "vn 1.0 0.0 0.0" in after


def test_off_records_may_run_over_lines(tmp_path):
    mesh = read_mesh(put(tmp_path, "a.off", QUADS_OFF))
    assert mesh.faces[0].tolist() == [0, 1, 2, 3, 1, 4, 5, 2]
    assert mesh.faces[1].tolist() == [0, 4, 8]
    mesh.write(tmp_path / "b.off", mesh.positions * 2)
    np.testing.assert_array_equal(read_mesh(tmp_path / "b.off").positions, mesh.positions * 2)


def test_ply_keeps_values_and_gets_new_normals(tmp_path, backend):
    mesh = read_mesh(put(tmp_path, "a.ply", NORMALS_PLY), backend=backend)
    mesh.write(tmp_path / "b.ply", mesh.positions[:, [2, 0, 1]])
    rows = (tmp_path / "b.ply").read_text().split("end_header\n")[1].splitlines()
    assert [float(row.split()[3]) for row in rows[:3]] == [1, 1, 1]
    assert [row.split()[6] for row in rows[:3]] == ["5", "6", "7"]
    assert rows[3] == "3 0 1 2"


def test_point_cloud_with_colours(tmp_path, backend):
    mesh = read_mesh(put(tmp_path, "a.ply", CLOUD_PLY), backend=backend)
    assert mesh.faces.shape == (0, 3)
    np.testing.assert_allclose(mesh.colors[:, :3], [[1, 0, 0], [0, 1, 0]])
    mesh.write(tmp_path / "b.ply", mesh.positions + 1)
    np.testing.assert_array_equal(read_mesh(tmp_path / "b.ply").positions, [[1, 1, 1], np.float32([1.1, 2, 2])])


@pytest.mark.parametrize("suffix", [".ply", ".off", ".obj"])
def test_another_format_has_the_positions_bit_for_bit(tmp_path, suffix):
    pytest.importorskip("pymeshlab", reason="pymeshlab is not installed")
    mesh = read_mesh(put(tmp_path, "a.ply", NORMALS_PLY) if suffix != ".ply" else put(tmp_path, "a.obj", MIXED_OBJ))
    moved = np.round(mesh.positions + [[1e3, 0.1, 0.7]], 3)
    mesh.write(tmp_path / f"b{suffix}", moved)
    np.testing.assert_array_equal(read_mesh(tmp_path / f"b{suffix}").positions, moved)
    np.testing.assert_array_equal(mesh.positions, read_mesh(mesh.path).positions)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.abc", "x", "unknown extension '.abc'.*use .3ds"),
        ("a.obj", "", "is empty"),
        ("a.ply", b"\x93\x01\xff" * 900, "cannot be read"),
        ("a.stl", b"\x93\x01\xff" * 900, "cannot be read"),
        ("a.off", b"\x93\x01\xff" * 900, "cannot be read"),
        ("a.obj", "v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n", r"vertex 1 \(from 0\) is not finite"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 inf\n0 1 0\n3 0 1 2\n", r"vertex 1 \(from 0\) is not finite"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "a face uses vertex 7"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "a face uses vertex 8"),
    ],
)
def test_a_file_that_cannot_be_used_is_named(tmp_path, name, content, message):
    folder = os.getcwd()
    with pytest.raises(FileError, match=f"(?s){name}.*{message}"):
        read_mesh(put(tmp_path, name, content))
    assert os.getcwd() == folder


def test_a_failed_write_leaves_the_old_file(tmp_path):
    mesh = read_mesh(put(tmp_path, "a.obj", MIXED_OBJ))
    old = put(tmp_path, "b.obj", "old")
    for positions, message in [(mesh.positions * np.nan, "not finite"), (mesh.positions[:2], "5 vertices")]:
        with pytest.raises(FileError, match=message):
            mesh.write(old, positions)
    with pytest.raises(FileError, match="the folder does not exist"):
        mesh.write(tmp_path / "none" / "b.obj", mesh.positions)
    with pytest.raises(FileError, match="unknown extension"):
        mesh.write(tmp_path / "b.abc", mesh.positions)
    with pytest.raises(FileError, match="does not exist"):
        read_mesh(tmp_path / "none.obj")
    assert old.read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.obj", "b.obj"]


@pytest.mark.skipif(not REAL, reason="no meshes: set ONEFORM_MESHES to their folder")
@pytest.mark.parametrize("path", REAL, ids=lambda path: path.name)
def test_real_files_are_written_back_the_same(path, tmp_path):
    mesh = read_mesh(path)
    moved = mesh.positions * 2  # exact in float32, so that importers of STL merge the same corners
    target = tmp_path / f"b{path.suffix}"
    mesh.write(target, moved)
    again = read_mesh(target)
    np.testing.assert_array_equal(again.positions, moved)
    assert same_faces(again.faces, mesh.faces)


def test_a_mesh_set_gets_the_mesh_without_reading_it_twice(tmp_path):
    pymeshlab = pytest.importorskip("pymeshlab", reason="pymeshlab is not installed")
    meshes = pymeshlab.MeshSet()
    meshes.create_cube()
    for name, content in [("a.obj", MIXED_OBJ), ("a.off", QUADS_OFF), ("a.ply", NORMALS_PLY)]:
        mesh = read_mesh(put(tmp_path, name, content), mesh_set=meshes)
        np.testing.assert_array_equal(meshes.current_mesh().vertex_matrix(), mesh.positions)
        mesh.write(tmp_path / "b.ply", mesh.positions + 1)  # by another way than the caller's mesh set
        np.testing.assert_array_equal(meshes.current_mesh().vertex_matrix(), mesh.positions)
    assert meshes.mesh_number() == 4


@pytest.mark.parametrize(("name", "content"), [("a.obj", MIXED_OBJ), ("a.ply", NORMALS_PLY), ("a.off", QUADS_OFF)])
@pytest.mark.parametrize("suffix", ["same", ".ply", ".obj"])
def test_a_second_run_gives_the_same_bytes(tmp_path, name, content, suffix):
    target = tmp_path / f"b{name[1:] if suffix == 'same' else suffix}"
    written = []
    for _ in range(2):
        mesh = read_mesh(put(tmp_path, name, content))
        mesh.write(target, np.sin(mesh.positions), omega=np.cos(mesh.positions))
        written.append(target.read_bytes())
    assert written[0] == written[1]


def test_omega_and_normals_are_checked_before_anything_is_written(tmp_path):
    mesh = read_mesh(put(tmp_path, "a.ply", NORMALS_PLY))
    for options, message in [
        ({"omega": np.zeros((2, 3))}, "omega"),
        ({"omega": np.full((3, 3), np.nan)}, "omega"),
        ({"normals": "turn"}, "use rotate, recompute, keep"),
    ]:
        with pytest.raises(InputError, match=message):
            mesh.write(tmp_path / "b.ply", mesh.positions, **options)
    assert not (tmp_path / "b.ply").exists()


@pytest.mark.parametrize("name", ["-o.obj", "a b\n.obj", "ü" * 120 + ".obj", "..obj", "$(x);'\".obj"])
def test_any_name_of_a_file_will_do(tmp_path, name):
    mesh = read_mesh(put(tmp_path, name, MIXED_OBJ))
    out = tmp_path / "out"
    out.mkdir()
    mesh.write(out / name, mesh.positions)
    assert (out / name).read_bytes() == MIXED_OBJ.encode()
    assert [path.name for path in out.iterdir()] == [name]


def test_what_another_format_loses_is_said(tmp_path):
    mesh = read_mesh(put(tmp_path, "a.obj", MIXED_OBJ))
    assert mesh.lost("b.obj") == ()
    assert set(mesh.lost("b.ply")) == {
        "corner normals",
        "groups",
        "objects",
        "materials",
        "names of materials",
        "polygons",
        "comments",
    }
    assert set(mesh.lost("c.stl")) - set(mesh.lost("b.ply")) == {"UVs", "colours"}
    mesh = read_mesh(put(tmp_path, "a.ply", NORMALS_PLY))
    assert mesh.lost("b.obj") == ("property heat",)


def test_a_link_is_replaced_and_what_it_leads_to_stays(tmp_path):
    mesh = read_mesh(put(tmp_path, "a.obj", MIXED_OBJ))
    outside = put(tmp_path, "outside.obj", "precious")
    (tmp_path / "b.obj").symlink_to(outside)
    mesh.write(tmp_path / "b.obj", mesh.positions)
    assert outside.read_text() == "precious"
    assert (tmp_path / "b.obj").read_text() == MIXED_OBJ
