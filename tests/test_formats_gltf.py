"""glTF and GLB: accessors are written in place, in the node's own space, and all else stays."""

import numpy as np
import pytest

from gltf_scenes import CUBE, SIDES, Scene, read_json
from oneform_warp.errors import FileError
from oneform_warp.filters import read_mesh
from oneform_warp.filters.formats import scan

TURN = [0.5, 0.5, 0.5, 0.5]  # by 120 degrees about (1, 1, 1): x -> y -> z -> x


def two_nodes():
    scene = Scene()
    scene.node(CUBE, name="left", translation=[-3, 0, 0])
    scene.node(CUBE * 2, name="right", rotation=TURN, scale=[2, 2, 2], translation=[5, 1, 0])
    return scene


def put(folder, name, data):
    (folder / name).write_bytes(data)
    return folder / name


def test_nodes_stand_in_world_space_one_after_the_other(tmp_path):
    mesh = read_mesh(put(tmp_path, "a.glb", two_nodes().glb()))
    np.testing.assert_array_equal(mesh.positions[:8], CUBE + [-3, 0, 0])
    np.testing.assert_allclose(mesh.positions[8:], 4 * CUBE[:, [2, 0, 1]] + [5, 1, 0], atol=1e-12)
    assert mesh.faces.shape == (16, 3)
    assert {name: part.tolist() for name, part in mesh.groups.items()} == {
        "left": list(range(8)),
        "right": list(range(8, 16)),
    }
    np.testing.assert_allclose(mesh.normals[8:], CUBE[:, [2, 0, 1]] / np.sqrt(3), atol=1e-6)


def test_meshlab_has_the_vertices_in_the_same_order(tmp_path):
    pymeshlab = pytest.importorskip("pymeshlab", reason="pymeshlab is not installed")
    scene = two_nodes()
    scene.json["scenes"][0]["nodes"] = [1]
    scene.json["nodes"][1]["children"] = [0]
    path = put(tmp_path, "a.glb", scene.glb())
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(path), load_in_a_single_layer=True)
    mesh = read_mesh(path)
    np.testing.assert_allclose(mesh.positions, meshes.current_mesh().vertex_matrix(), atol=1e-12)
    np.testing.assert_array_equal(mesh.faces, meshes.current_mesh().face_matrix())


@pytest.mark.parametrize("kind", ["glb", "embedded", "external"])
def test_what_moves_is_written_and_the_rest_stays(tmp_path, kind):
    scene = two_nodes()
    (tmp_path / "cube data.bin").write_bytes(scene.data)
    data = scene.glb() if kind == "glb" else scene.gltf("cube%20data.bin" if kind == "external" else None)
    source = put(tmp_path, "a.glb" if kind == "glb" else "a.gltf", data)
    mesh = read_mesh(source)
    out = tmp_path / "out"
    out.mkdir()
    target = out / source.name

    mesh.write(target, mesh.positions)
    assert target.read_bytes() == source.read_bytes()
    if kind == "external":
        assert (out / "cube data.bin").read_bytes() == scene.data

    moved = mesh.positions.copy()
    moved[8:] += [0, 0, 1.5]
    mesh.write(target, moved)
    again = read_mesh(target)
    np.testing.assert_allclose(again.positions, moved, atol=1e-6)
    np.testing.assert_array_equal(again.positions[:8], mesh.positions[:8])
    before, after = read_json(data), read_json(target.read_bytes())
    positions = before["meshes"][1]["primitives"][0]["attributes"]["POSITION"]
    local = CUBE * 2 + np.float32([0, 0.75, 0])  # the node turns y into z, and doubles
    np.testing.assert_allclose(after["accessors"][positions]["max"], local.max(axis=0), atol=1e-6)
    for entry in (before, after):
        del entry["accessors"][positions]["max"], entry["accessors"][positions]["min"]
        del entry["buffers"]
    assert after == before
    if kind == "glb":
        assert target.read_bytes().endswith(b"XTRAkept")
    if kind == "external":
        assert sorted(path.name for path in out.iterdir()) == ["a.bin", "a.gltf", "cube data.bin"]


def test_a_scene_written_over_itself_keeps_its_old_buffer(tmp_path):
    scene = two_nodes()
    put(tmp_path, "a.bin", scene.data)
    source = put(tmp_path, "a.gltf", scene.gltf("a.bin"))
    for step in range(3):
        mesh = read_mesh(source)
        mesh.write(source, mesh.positions + 1)
        np.testing.assert_allclose(read_mesh(source).positions, mesh.positions + 1, atol=1e-5)
        assert read_json(source.read_bytes())["buffers"][0]["uri"] == ("a-1.bin", "a.bin")[step % 2]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a-1.bin", "a.bin", "a.gltf"]


def test_normals_and_tangents_turn_with_the_field_in_world_space(tmp_path):
    scene = Scene()
    primitive = scene.node(CUBE, name="a", rotation=TURN, scale=[1, 2, 3])
    tangents = np.tile(np.float32([1, 0, 0, -1]), (8, 1))
    primitive["attributes"]["TANGENT"] = scene.accessor(tangents)
    mesh = read_mesh(put(tmp_path, "a.glb", scene.glb()))
    omega = np.zeros((8, 3))
    omega[4:] = [0, 0, np.pi / 2]
    mesh.write(tmp_path / "b.glb", mesh.positions, omega=omega)
    again = read_mesh(tmp_path / "b.glb")
    np.testing.assert_array_equal(again.normals[:4], mesh.normals[:4])
    np.testing.assert_allclose(again.normals[4:], mesh.normals[4:] @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-6)
    assert again.positions.tobytes() == mesh.positions.tobytes()
    records = scan(tmp_path / "b.glb")
    stored = records.read(primitive["attributes"]["TANGENT"])
    # The node turns its x into the world's y, which turns into -x, which is the node's -z.
    np.testing.assert_allclose(stored, [[1, 0, 0, -1]] * 4 + [[0, 0, -1, -1]] * 4, atol=1e-6)


@pytest.mark.parametrize(("mode", "faces"), [(5, 6), (6, 6), (0, 0), (1, 0), (4, 2)])
def test_all_kinds_of_primitives_are_read(tmp_path, mode, faces):
    scene = Scene()
    scene.node(CUBE, None, name="a")["mode"] = mode
    mesh = read_mesh(put(tmp_path, "a.glb", scene.glb()))
    assert mesh.faces.shape == (faces, 3)
    mesh.write(tmp_path / "b.glb", mesh.positions * 2)
    np.testing.assert_array_equal(read_mesh(tmp_path / "b.glb").positions, mesh.positions * 2)


def refuse_draco(scene):
    scene.json["extensionsUsed"] = ["KHR_draco_mesh_compression"]


def refuse_quantised(scene):
    scene.json["accessors"][0]["componentType"] = 5122


def refuse_sparse(scene):
    scene.json["accessors"][0]["sparse"] = {"count": 1}


def refuse_skin(scene):
    scene.json["nodes"][0]["skin"] = 0


def refuse_instance(scene):
    scene.json["nodes"][1]["mesh"] = 0


def refuse_morph(scene):
    scene.json["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 0}]


def refuse_outside(scene):
    scene.json["bufferViews"][0]["byteOffset"] = 10**6


def refuse_index(scene):
    scene.json["accessors"][3]["count"] = 1
    scene.json["bufferViews"][3]["byteOffset"] = scene.json["bufferViews"][0]["byteOffset"] + 2


def refuse_cycle(scene):
    scene.json["nodes"][0]["children"] = [0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (refuse_draco, "compressed by Draco"),
        (refuse_quantised, "'left' is quantised"),
        (refuse_sparse, "'left' has a sparse accessor"),
        (refuse_skin, "'left' is skinned"),
        (refuse_instance, "'right' is an instance"),
        (refuse_morph, "has morph targets"),
        (refuse_outside, "lies outside its buffer"),
        (refuse_index, "a face uses vertex"),
        (refuse_cycle, "two parents"),
    ],
)
def test_a_scene_that_cannot_be_deformed_is_named(tmp_path, change, message):
    scene = two_nodes()
    change(scene)
    with pytest.raises(FileError, match=f"a.glb.*{message}"):
        read_mesh(put(tmp_path, "a.glb", scene.glb()))


@pytest.mark.parametrize("uri", ["../secret.bin", "/etc/hostname", "https://a.b/c.bin", "link.bin", "none.bin"])
def test_buffers_come_from_the_folder_of_the_scene_only(tmp_path, uri):
    inner = tmp_path / "inner"
    inner.mkdir()
    put(tmp_path, "secret.bin", two_nodes().data)
    (inner / "link.bin").symlink_to(tmp_path / "secret.bin")
    with pytest.raises(FileError, match=r"is not in its folder|cannot be read"):
        read_mesh(put(inner, "a.gltf", two_nodes().gltf(uri)))


@pytest.mark.parametrize("cut", [3, 14, 40, 500, -30])
def test_a_file_that_is_cut_off_is_named(tmp_path, cut):
    with pytest.raises(FileError, match=r"a\.glb"):
        read_mesh(put(tmp_path, "a.glb", two_nodes().glb()[:cut]))


def test_shared_vertices_must_stay_together(tmp_path):
    scene = Scene()
    primitive = scene.node(CUBE, name="a")
    other = {**primitive, "indices": scene.accessor(SIDES[::-1].copy())}
    scene.json["meshes"][0]["primitives"].append(other)
    mesh = read_mesh(put(tmp_path, "a.glb", scene.glb()))
    assert len(mesh.positions) == 16
    mesh.write(tmp_path / "b.glb", mesh.positions + 1)
    np.testing.assert_array_equal(read_mesh(tmp_path / "b.glb").positions, mesh.positions + 1)
    parted = mesh.positions.copy()
    parted[8:] += 1
    with pytest.raises(FileError, match="come apart"):
        mesh.write(tmp_path / "c.glb", parted)
    assert not (tmp_path / "c.glb").exists()


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl"])
def test_a_scene_becomes_another_format(tmp_path, suffix):
    pytest.importorskip("pymeshlab", reason="pymeshlab is not installed")
    mesh = read_mesh(put(tmp_path, "a.glb", two_nodes().glb()))
    mesh.write(tmp_path / f"b{suffix}", mesh.positions * 2)
    again = read_mesh(tmp_path / f"b{suffix}")
    if suffix != ".stl":
        np.testing.assert_array_equal(again.positions, mesh.positions * 2)
    assert again.faces.shape == mesh.faces.shape
    assert "nodes" in mesh.lost(tmp_path / f"b{suffix}")
