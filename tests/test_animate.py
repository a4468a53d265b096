"""`oneform-warp animate`: what it writes, what it says, and how it ends."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import oneform_warp as ow
from gltf_player import Player
from oneform_warp.cli import main
from oneform_warp.filters import read_mesh

TWIST = ["--hold", "z < 0.2", "--handle", "z > 0.8", "axis=z,angle=180"]
SINGLE = 1e-6  # positions of the unit bar, stored and added in 32 bits

SCRIPT = """\
frames = 9
fps = 8
weights = "uniform"

[[handles]]
select = "z < 0.2"
held = true

[[keyframes]]
t = 0.5
[[keyframes.handles]]
select = "z > 0.8"
name = "top"
axis = "z"
angle = 180

[[keyframes]]
t = 1
[[keyframes.handles]]
name = "top"
axis = "x"
angle = 90
"""


def run(*arguments):
    return CliRunner().invoke(main, [str(each) for each in arguments])


@pytest.fixture
def bar(tmp_path):
    """A bar of 74 vertices: its file and positions."""
    x, faces = ow.shapes.bar(segments=8, sides=2)
    lines = ["v " + " ".join(map(repr, map(float, point))) for point in x]
    lines += ["f " + " ".join(str(vertex + 1) for vertex in face) for face in faces]
    path = tmp_path / "bar.obj"
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path, x


def test_numbered_frames_begin_at_rest_and_end_with_the_one_off_result(bar, tmp_path):
    path, _ = bar
    result = run("animate", path, "-o", tmp_path / "t_{frame}.obj", *TWIST, "--frames", 4, "-q")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")
    assert run("deform", path, "-o", tmp_path / "once.obj", *TWIST).exit_code == 0
    files = sorted(tmp_path.glob("t_*.obj"))
    assert [file.name for file in files] == [f"t_{i:04}.obj" for i in range(4)]
    assert files[0].read_bytes() == path.read_bytes()
    assert files[-1].read_bytes() == (tmp_path / "once.obj").read_bytes()
    assert files[1].read_bytes() not in (files[0].read_bytes(), files[2].read_bytes())


def test_a_scene_moves_as_the_library_says(bar, tmp_path):
    path, x = bar
    result = run("animate", path, "-o", tmp_path / "t.glb", *TWIST, "--frames", 5, "--fps", 2)
    assert result.exit_code == 0, result.output
    for text in ("bar.obj: 74 vertices", "5 frames at 2 per second, 5 converged", "wrote", "t.glb"):
        assert text in result.stdout
    player, mesh = Player(tmp_path / "t.glb"), read_mesh(path)
    rest = player.shown(0.0)
    rows = np.abs(rest[:, None] - x[None]).max(axis=2).argmin(axis=1)
    z = x[:, 2]
    for number in range(5):
        handles = [ow.Handle(z < 0.2, held=True), ow.Handle(z > 0.8, axis="z", angle=180 * number / 4)]
        expected = ow.deform(x, mesh.faces, handles)
        np.testing.assert_allclose(player.shown(number / 2), expected[rows], atol=SINGLE)


def test_a_recipe_has_keyframes_and_its_selections_are_said_once(bar, tmp_path):
    path, x = bar
    (tmp_path / "turn.toml").write_text(SCRIPT, encoding="utf-8")
    out = tmp_path / "t_{frame}.ply"
    result = run("animate", path, "-o", out, "--recipe", tmp_path / "turn.toml", "--report", tmp_path / "r.json")
    assert result.exit_code == 0, result.output
    z, faces = x[:, 2], read_mesh(path).faces
    held = ow.Handle(z < 0.2, held=True)
    for number, what in ((4, {"axis": "z", "angle": 180}), (8, {"axis": "x", "angle": 90})):
        # The keys of a handle that is not held in the recipe's own words.
        expected = ow.deform(x, faces, [held, ow.Handle(z > 0.8, **what)], weights="uniform")
        np.testing.assert_allclose(read_mesh(tmp_path / f"t_{number:04}.ply").positions, expected, atol=SINGLE)
    report = json.loads((tmp_path / "r.json").read_text())
    assert [frame["t"] for frame in report["frames"]] == [i / 8 for i in range(9)]
    assert [key["t"] for key in report["keyframes"]] == [0.5, 1.0]
    assert report["converged"] is True
    assert (report["fps"], report["settings"]["weights"]) == (8, "uniform")
    assert len(list(tmp_path.glob("t_*.ply"))) == 9
    fewer = run("animate", path, "-o", out, "--recipe", tmp_path / "turn.toml", "--frames", 3, "--weights", "cotangent")
    assert "3 frames at 8 per second" in fewer.stdout


def test_a_film_alone_is_enough(bar, tmp_path, monkeypatch):
    image = pytest.importorskip("PIL.Image")
    monkeypatch.setattr("oneform_warp.movie.by_polyscope", lambda *_: None)
    path, _ = bar
    result = run("animate", path, "--preview", tmp_path / "t.gif", *TWIST, "--frames", 4, "--fps", 10)
    assert result.exit_code == 0, result.output
    film = image.open(tmp_path / "t.gif")
    assert (film.n_frames, film.info["duration"]) == (4, 100)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["bar.obj", "t.gif"]


def test_a_dry_run_says_what_each_key_does_and_writes_nothing(bar, tmp_path):
    path, _ = bar
    (tmp_path / "turn.toml").write_text(SCRIPT, encoding="utf-8")
    result = run("animate", path, "--recipe", tmp_path / "turn.toml", "--dry-run")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert [line.split(":")[0] for line in lines] == ["t = 0.5, top", "t = 1, z < 0.2", "t = 1, top"]
    assert "held in place" in lines[1]
    assert "rotated by 90 degrees" in lines[2]
    assert len(list(tmp_path.iterdir())) == 2


def test_frames_that_do_not_converge_end_with_3(bar, tmp_path):
    path, _ = bar
    options = ["--solver", "cg", "--max-iterations", 0, "--frames", 3, "--report", tmp_path / "r.json"]
    result = run("animate", path, "-o", tmp_path / "t.glb", *TWIST, *options)
    assert result.exit_code == 3
    assert "warning: frame 2 (t = 1): " in result.stderr
    report = json.loads((tmp_path / "r.json").read_text())
    assert [frame["converged"] for frame in report["frames"]] == [True, False, False]
    assert (tmp_path / "t.glb").is_file()


@pytest.mark.parametrize(
    ("script", "text"),
    [
        (SCRIPT.replace("t = 1\n", "t = 1.5\n"), "keyframes[1]: t is 1.5"),
        (SCRIPT.replace("t = 1\n", "t = 0.5\n"), "two keyframes at t = 0.5"),
        (SCRIPT.replace("t = 1\n", ""), "keyframes[1]: t: None is not a number"),
        (SCRIPT.replace("t = 1\n", "tt = 1\n"), "no key 'tt'"),
        (
            SCRIPT.replace('name = "top"\naxis = "x"', 'name = "tip"\naxis = "x"'),
            "keyframes[1].handles[0]: there is no s",
        ),
        (SCRIPT.replace("angle = 90", "angle = 90\nheld = true"), "cannot be rotated"),
        (SCRIPT.replace('axis = "x"\nangle = 90', 'rotation = "free"'), "takes hold in another way"),
        (SCRIPT.replace("frames = 9", "frames = 1"), "frames is 1"),
        (SCRIPT.replace("fps = 8", "fps = 0"), "fps is 0"),
        ("keyframes = 3", "keyframes are not tables"),
    ],
)
def test_scripts_that_cannot_be_played_name_the_place(bar, tmp_path, script, text):
    path, _ = bar
    (tmp_path / "turn.toml").write_text(script, encoding="utf-8")
    result = run("animate", path, "-o", tmp_path / "t.glb", "--recipe", tmp_path / "turn.toml")
    assert result.exit_code == 1
    assert text in result.stderr
    assert not (tmp_path / "t.glb").exists()


def test_deform_points_to_animate_for_keyframes(bar, tmp_path):
    path, _ = bar
    (tmp_path / "turn.toml").write_text(SCRIPT, encoding="utf-8")
    result = run("deform", path, "-o", tmp_path / "t.obj", "--recipe", tmp_path / "turn.toml")
    assert result.exit_code == 1
    assert "oneform-warp animate" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["-o", "t.glb"], 2, "There is no handle"),
        (TWIST, 2, "Missing option"),
        ([*TWIST, "-o", "t.obj"], 1, "write numbered meshes, as t_{frame}.obj"),
        ([*TWIST, "-o", "t.glb", "--preview", "t.png"], 1, "a film is a .gif or .mp4 file"),
        ([*TWIST, "-o", "t.glb", "--report", "t.glb"], 1, "two files are to be written here"),
        ([*TWIST, "-o", "t.glb", "--frames", "1"], 2, "--frames"),
        ([*TWIST, "-o", "none/t_{frame}.obj"], 1, "the folder does not exist"),
        (["--hold", "z < -5", "-o", "t.glb"], 1, "no vertex is selected"),
    ],
)
def test_what_cannot_be_done_is_said_before_anything_is_solved(bar, tmp_path, monkeypatch, arguments, code, text):
    monkeypatch.chdir(tmp_path)
    result = run("animate", bar[0], *arguments)
    assert result.exit_code == code
    assert text in result.stderr
    assert len(list(tmp_path.iterdir())) == 1
