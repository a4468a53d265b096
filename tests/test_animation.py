"""Frames on the disk: a player written from the specification shows what was given, and the scene keeps all it had."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import oneform_warp as ow
from gltf_player import Player
from gltf_scenes import CUBE, Scene, read_json
from oneform_warp.errors import FileError, InputError
from oneform_warp.filters import read_mesh
from oneform_warp.filters.animation import write_animation, write_frames
from oneform_warp.filters.formats.motion import turned_by

SINGLE = 4e-7  # of numbers up to 3, stored and added in 32 bits
TIMES = np.array([0.0, 0.5, 1.25])

QUADS = """\
mtllib box.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 2 0 0.5
v 2 1 0.5
v 9 9 9
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
vn -0.447214 0 0.894427
usemtl red
f 1/1/1 2/2/1 3/3/1 4/4/1
usemtl blue
f 2/1/2 5/2/2 6/3/2 3/4/2
"""
MATERIALS = "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\nmap_Kd dots.png\n"


def frames_of(mesh, rows=slice(None)):
    """Three frames, the first at rest, and the rotation vectors of their vertices."""
    frames = []
    for t in (0.0, 0.5, 1.0):
        omega = np.zeros_like(mesh.positions)
        omega[rows] = [0.0, 0.0, 2.0 * t]
        moved = mesh.positions.copy()
        moved[rows] = turned_by(omega[rows], mesh.positions[rows] * (1 + t)) + [0, 0, t]
        frames.append((moved, omega))
    return frames


def put(folder, name, data):
    (folder / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    return folder / name


def rows_at(points, positions):
    """For each point the only row of positions that is there."""
    near = np.abs(points[:, None] - positions[None]).max(axis=2) < 1e-6
    assert (near.sum(axis=1) == 1).all()
    return near.argmax(axis=1)


def check_player(path, mesh, frames, rows):
    player = Player(path)
    for seconds, (positions, _) in zip(TIMES, frames, strict=True):
        np.testing.assert_allclose(player.shown(seconds), positions[rows], atol=SINGLE * 10)
    half = (frames[0][0] + frames[1][0]) / 2
    np.testing.assert_allclose(player.shown(0.25), half[rows], atol=SINGLE * 10)
    return player


@pytest.fixture
def scene():
    made = Scene()
    made.node(CUBE, name="left", translation=[-3, 0, 0])
    made.node(CUBE, name="right", translation=[3, 0, 0])
    made.json["animations"] = []
    return made


@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_a_scene_keeps_what_it_has_and_moves(tmp_path, scene, kind):
    del scene.json["animations"]
    data = scene.glb() if kind == "glb" else scene.gltf("numbers.bin")
    put(tmp_path, "numbers.bin", scene.data)
    mesh = read_mesh(put(tmp_path, f"a.{kind}", data))
    frames = frames_of(mesh, slice(8, 16))
    (tmp_path / "out").mkdir()
    target = tmp_path / "out" / f"b.{kind}"
    assert write_animation(mesh, target, frames, TIMES) == ()
    player = check_player(target, mesh, frames, np.arange(16))
    before, after = read_json(data), copy.deepcopy(player.scene)
    assert player.buffers[0][: len(scene.data)] == scene.data
    # Without what was added it is the scene that was read.
    for number in (0, 1):
        for primitive in after["meshes"][number]["primitives"]:
            assert ("targets" in primitive) == (number == 1)
            primitive.pop("targets", None)
        after["meshes"][number].pop("weights", None)
        after["meshes"][number].pop("extras", None)
    del after["animations"], after["buffers"], before["buffers"]
    for name in ("accessors", "bufferViews"):
        after[name] = after[name][: len(before[name])]
    assert after == before
    if kind == "glb":
        assert target.read_bytes().endswith(data[-12:])  # a chunk of others


def test_normals_and_tangents_turn_with_the_frames(tmp_path, scene):
    primitive = scene.node(CUBE, name="third")
    primitive["attributes"]["TANGENT"] = scene.accessor(np.tile(np.float32([1, 0, 0, 1]), (8, 1)))
    for each in scene.json["meshes"][:2]:
        each["primitives"][0]["attributes"]["TANGENT"] = scene.accessor(np.tile(np.float32([0, 1, 0, 1]), (8, 1)))
    mesh = read_mesh(put(tmp_path, "a.glb", scene.glb()))
    frames = frames_of(mesh)
    write_animation(mesh, tmp_path / "b.glb", frames, TIMES)
    player = Player(tmp_path / "b.glb")
    rest = Player(tmp_path / "a.glb")
    for attribute in ("NORMAL", "TANGENT"):
        stored = rest.shown(0.0, attribute)
        for seconds, (_, omega) in zip(TIMES, frames, strict=True):
            np.testing.assert_allclose(player.shown(seconds, attribute), turned_by(omega, stored), atol=SINGLE)
    write_animation(mesh, tmp_path / "c.glb", frames, TIMES, normals="keep")
    targets = Player(tmp_path / "c.glb").scene["meshes"][0]["primitives"][0]["targets"]
    assert all(target.keys() == {"POSITION"} for target in targets)


def test_animations_that_are_there_stay(tmp_path, scene):
    clock = scene.accessor(np.float32([0, 1]).reshape(-1, 1), min=[0], max=[1])
    path = scene.accessor(np.float32([[-3, 0, 0], [-3, 1, 0]]))
    own = {
        "samplers": [{"input": clock, "output": path}],
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
    }
    scene.json["animations"] = [own]
    mesh = read_mesh(put(tmp_path, "a.glb", scene.glb()))
    write_animation(mesh, tmp_path / "a.glb", frames_of(mesh), TIMES)
    animations = Player(tmp_path / "a.glb").scene["animations"]
    assert animations[0] == own
    assert len(animations) == 2


def test_a_scene_in_which_nothing_moves_stays_byte_for_byte(tmp_path, scene):
    mesh = read_mesh(put(tmp_path, "a.glb", scene.glb()))
    write_animation(mesh, tmp_path / "b.glb", [(mesh.positions, None)] * 3, TIMES)
    assert (tmp_path / "b.glb").read_bytes() == (tmp_path / "a.glb").read_bytes()


def test_primitives_of_one_node_have_as_many_targets(tmp_path, scene):
    # Two primitives with vertices of their own, of which only the second moves, and in the last frame only.
    first, second = (mesh["primitives"][0] for mesh in scene.json["meshes"])
    scene.json["meshes"][0]["primitives"].append(copy.deepcopy(second))
    scene.json["meshes"].pop()
    scene.json["nodes"].pop()
    scene.json["scenes"][0]["nodes"] = [0]
    mesh = read_mesh(put(tmp_path, "a.glb", scene.glb()))
    assert first["attributes"] != second["attributes"]
    frames = [(mesh.positions, None), (mesh.positions, None), frames_of(mesh, slice(8, 16))[2]]
    write_animation(mesh, tmp_path / "b.glb", frames, TIMES)
    player = check_player(tmp_path / "b.glb", mesh, frames, np.arange(16))
    primitives = player.scene["meshes"][0]["primitives"]
    assert [len(each["targets"]) for each in primitives] == [1, 1]
    # What does not move needs no bytes.
    assert "bufferView" not in player.scene["accessors"][primitives[0]["targets"][0]["POSITION"]]


def test_an_obj_becomes_a_scene_with_seams_normals_and_materials(tmp_path):
    image = pytest.importorskip("PIL.Image")
    image.new("RGB", (4, 4), (10, 200, 30)).save(tmp_path / "dots.png")
    put(tmp_path, "box.mtl", MATERIALS)
    mesh = read_mesh(put(tmp_path, "box.obj", QUADS))
    frames = frames_of(mesh)
    (tmp_path / "out").mkdir()
    assert write_animation(mesh, tmp_path / "out" / "box.glb", frames, TIMES) == ()
    assert [each.name for each in (tmp_path / "out").iterdir()] == ["box.glb"]
    path = tmp_path / "out" / "box.glb"
    rest = Player(path).shown(0.0)
    rows = rows_at(rest, mesh.positions)
    player = check_player(path, mesh, frames, rows)
    assert set(rows) == {0, 1, 2, 3, 4, 5}  # what no face uses is not there
    assert len(rows) == 8  # two vertices have two normals and two materials
    stored = player.shown(0.0, "NORMAL")
    turned = turned_by(frames[2][1][rows], stored)
    np.testing.assert_allclose(player.shown(TIMES[2], "NORMAL"), turned, atol=SINGLE)
    begin = 0
    for mesh_entry in player.scene["meshes"]:
        for each in mesh_entry["primitives"]:
            material = player.scene["materials"][each["material"]]["pbrMetallicRoughness"]
            uvs = player.numbers(each["attributes"]["TEXCOORD_0"])
            part = slice(begin, begin + len(uvs))
            blue = "baseColorTexture" in material
            assert set(rows[part]) == ({1, 2, 4, 5} if blue else {0, 1, 2, 3})
            normal = [-0.447214, 0, 0.894427] if blue else [0, 0, 1]
            np.testing.assert_allclose(stored[part], [normal] * 4, atol=1e-6)
            corners = {0: (0, 0), 1: (1, 0), 2: (1, 1), 3: (0, 1)}
            if blue:
                corners = {1: (0, 0), 4: (1, 0), 5: (1, 1), 2: (0, 1)}
            expected = np.array([corners[row] for row in rows[part]])
            np.testing.assert_allclose(uvs, expected * [1, -1] + [0, 1], atol=1e-6)  # glTF counts v downwards
            assert material["metallicFactor"] == 0.0
            begin = part.stop
    assert len(player.scene["images"]) == 1


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".off", ".stl"])
def test_every_format_becomes_a_scene(tmp_path, suffix):
    trimesh = pytest.importorskip("trimesh")
    x, faces = ow.shapes.bar(segments=3, sides=1)
    trimesh.Trimesh(x, faces, process=False).export(tmp_path / f"bar{suffix}")
    mesh = read_mesh(tmp_path / f"bar{suffix}")
    frames = frames_of(mesh)
    path = tmp_path / "bar.glb"
    write_animation(mesh, path, frames, TIMES)
    rows = rows_at(Player(path).shown(0.0), mesh.positions)
    player = check_player(path, mesh, frames, rows)
    primitive = player.scene["meshes"][0]["primitives"][0]
    written = rows[player.numbers(primitive["indices"])[:, 0].astype(int).reshape(-1, 3)]
    np.testing.assert_array_equal(written, mesh.triangles)
    again = trimesh.load(path, process=False, force="mesh")  # a reader of others, which knows no morph targets
    np.testing.assert_allclose(again.vertices, mesh.positions[rows], atol=SINGLE)
    assert np.array_equal(rows[again.faces], mesh.triangles)


def test_colours_of_vertices_come_along(tmp_path):
    ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    ply += "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n"
    ply += "property list uchar int vertex_indices\nend_header\n0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 255\n3 0 1 2\n"
    mesh = read_mesh(put(tmp_path, "a.ply", ply))
    write_animation(mesh, tmp_path / "a.glb", frames_of(mesh), TIMES)
    player = Player(tmp_path / "a.glb")
    primitive = player.scene["meshes"][0]["primitives"][0]
    np.testing.assert_array_equal(player.numbers(primitive["attributes"]["COLOR_0"])[:, :3], 255 * np.eye(3))


def test_another_reader_takes_the_scene(tmp_path, scene):
    pygltflib = pytest.importorskip("pygltflib", reason="pygltflib is not installed")
    mesh = read_mesh(put(tmp_path, "a.glb", scene.glb()))
    write_animation(mesh, tmp_path / "b.glb", frames_of(mesh), TIMES)
    read = pygltflib.GLTF2().load(str(tmp_path / "b.glb"))
    assert [channel.target.path for channel in read.animations[0].channels] == ["weights", "weights"]
    assert len(read.meshes[0].primitives[0].targets) == len(read.meshes[0].weights) == 2


def test_the_meshes_of_the_world_become_scenes(tmp_path, meshes):
    done = 0
    for path in sorted((meshes / "attributes").iterdir()):
        if path.suffix not in (".obj", ".ply", ".off"):
            continue
        mesh = read_mesh(path)
        if not len(mesh.triangles) or len(mesh.positions) > 1000:
            continue
        frames = frames_of(mesh)
        write_animation(mesh, tmp_path / "a.glb", frames, TIMES)
        player = Player(tmp_path / "a.glb")
        # Each vertex of the scene is one of the mesh's, in all frames.
        rest, end = player.shown(0.0), player.shown(TIMES[2])
        both = np.hstack([mesh.positions, frames[2][0]])
        size = np.abs(both).max()
        apart = np.array([np.abs(both - each).max(axis=1).min() for each in np.hstack([rest, end])])
        assert apart.max() < 1e-6 * size, path.name
        done += 1
    assert done > 8


def test_numbered_frames_are_files_like_any_other(tmp_path):
    mesh = read_mesh(put(tmp_path, "box.obj", QUADS.replace("mtllib box.mtl\n", "")))
    frames = frames_of(mesh)
    assert write_frames(mesh, tmp_path / "box_{frame}.obj", frames) == ()
    assert sorted(each.name for each in tmp_path.glob("box_*")) == [f"box_000{i}.obj" for i in range(3)]
    assert (tmp_path / "box_0000.obj").read_bytes() == (tmp_path / "box.obj").read_bytes()
    mesh.write(tmp_path / "alone.obj", frames[2][0], omega=frames[2][1])
    assert (tmp_path / "box_0002.obj").read_bytes() == (tmp_path / "alone.obj").read_bytes()


@pytest.mark.parametrize(
    ("source", "target", "text"),
    [
        ("a.glb", "b.gltf", "end the name in .glb"),
        ("a.glb", "b.obj", "write numbered meshes, as b_{frame}.obj"),
        ("a.obj", "b.gltf", "end the name in .glb"),
        ("a.obj", "b", "end the name in .glb"),
        ("a.obj", "b_{frame}.xml", "unknown extension"),
        ("a.obj", "none/b.glb", "make the folder first"),
        ("a.obj", "none/b_{frame}.obj", "make the folder first"),
    ],
)
def test_targets_that_cannot_be_written_are_errors(tmp_path, scene, source, target, text):
    mesh = read_mesh(
        put(tmp_path, source, scene.glb() if source.endswith("glb") else "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    )
    write = write_frames if "{frame}" in target else lambda *given: write_animation(*given, TIMES)
    with pytest.raises(FileError, match=text):
        write(mesh, tmp_path / target, frames_of(mesh))
    assert [each.name for each in tmp_path.iterdir()] == [source]


def test_frames_that_do_not_fit_leave_no_file(tmp_path, scene):
    mesh = read_mesh(put(tmp_path, "a.glb", scene.glb()))
    frames, target = frames_of(mesh), tmp_path / "b.glb"
    nan, huge = mesh.positions * np.nan, mesh.positions * 1e39
    for given, times, error in (
        (frames, TIMES[:2], InputError),
        (frames[:2], TIMES, InputError),
        (frames, TIMES[::-1], InputError),
        (frames, [0.0, 1.0, 1.0 + 1e-12], InputError),
        ([*frames[:2], (nan, None)], TIMES, InputError),
        ([*frames[:2], (mesh.positions[:4], None)], TIMES, InputError),
        ([*frames[:2], (huge, None)], TIMES, FileError),
    ):
        with pytest.raises(error):
            write_animation(mesh, target, given, times)
    with pytest.raises(InputError, match="no way to treat normals"):
        write_animation(mesh, target, frames, TIMES, normals="bend")  # type: ignore[arg-type]
    assert [each.name for each in tmp_path.iterdir()] == ["a.glb"]
