"""The command line: what it writes, what it says, and its exit codes; errors are in test_cli_errors.py."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import oneform_warp as ow
from oneform_warp.cli import doctor, main
from oneform_warp.cli.settings import CHOICES
from oneform_warp.filters import read_mesh

ROOT = Path(ow.__file__).parents[1]
TWIST = ["--hold", "z < 0.2", "--handle", "z > 0.8", "axis=z,angle=90"]


def run(*arguments):
    return CliRunner().invoke(main, [str(each) for each in arguments])


def shell(*arguments, code="from oneform_warp.cli import main; main()"):
    """The command line in a process of its own."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)


def write_obj(path, x, faces, end=None):
    """An OBJ file whose faces from `end` on are the group head."""
    lines = ["v " + " ".join(map(repr, map(float, point))) for point in x]
    rows = ["f " + " ".join(str(vertex + 1) for vertex in face) for face in faces]
    lines += rows if end is None else ["g body", *rows[:end], "g head", *rows[end:]]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return path


@pytest.fixture
def bar(tmp_path):
    """A bar of 74 vertices: its file, positions and faces."""
    x, faces = ow.shapes.bar(segments=8, sides=2)
    return write_obj(tmp_path / "bar.obj", x, faces, end=len(faces) - 8), x, faces


def test_deform_writes_what_the_library_computes(bar, tmp_path):
    path, x, faces = bar
    result = run("deform", path, "-o", tmp_path / "out.obj", *TWIST, "--quiet")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")
    z = x[:, 2]
    expected = ow.deform(x, faces, [ow.Handle(z < 0.2, held=True), ow.Handle(z > 0.8, axis="z", angle=90)])
    written = read_mesh(tmp_path / "out.obj")
    assert np.abs(expected - x).max() > 0.1
    np.testing.assert_allclose(written.positions, expected, atol=1e-6)
    assert np.array_equal(written.faces, faces)


def test_report_is_short_and_complete(bar, tmp_path):
    path, *_ = bar
    out = tmp_path / "out.ply"
    result = run("deform", path, "-o", out, *TWIST)
    assert result.exit_code == 0
    for text in (
        "74 vertices",
        "216 edges",
        "1 component",
        "converged",
        "residual",
        "energy",
        "seconds",
        f"wrote {out}",
    ):
        assert text in result.stdout, text
    assert len(result.stdout.splitlines()) <= 6


def test_output_may_be_the_input(bar):
    path, x, _ = bar
    assert run("deform", path, "-o", path, *TWIST).exit_code == 0
    assert np.abs(read_mesh(path).positions - x).max() > 0.1
    assert [each.name for each in path.parent.iterdir()] == ["bar.obj"]


def test_dry_run_names_the_handles_and_writes_nothing(bar, tmp_path):
    path, *_ = bar
    result = run("deform", path, "-o", tmp_path / "out.obj", *TWIST, "--dry-run")
    assert result.exit_code == 0
    first, second = result.stdout.splitlines()
    assert first.startswith("z < 0.2: 17 vertices (x -0.1 to 0.1")
    assert "held in place" in first
    assert "rotated by 90 degrees about (0 0 1)" in second
    assert [each.name for each in tmp_path.iterdir()] == ["bar.obj"]
    assert run("deform", path, *TWIST, "--dry-run").exit_code == 0


@pytest.mark.parametrize(
    ("selection", "count"),
    [
        ("box:-1,-1,0,1,1,0.05", 9),
        ("file:numbers.txt", 4),
        ("group:head", 9),
        ("z > 0.5 ? x > 0 : vi == 0", 13),
    ],
)
def test_selections(bar, tmp_path, monkeypatch, selection, count):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "numbers.txt").write_text("0, 1\n7 8\n")
    result = run("deform", "bar.obj", "--dry-run", "--handle", selection, "name=it,stretch=2,rotation=free")
    assert result.stdout.startswith(f"it: {count} vertices"), result.output
    assert "rotation free, stretched by 2" in result.stdout


@pytest.mark.parametrize(
    ("spec", "text"),
    [
        ("axis=0:0:2,angle=720", "rotated by 720 degrees about (0 0 1)"),
        ("axis=0 -1 0, angle=-90", "rotated by 90 degrees about (0 1 0)"),
        ("r=0:0:3.141592653589793", "rotated by 180 degrees"),
        ("held", "held in place"),
        ("held=false,stretch=free", "not rotated, stretch free"),
    ],
)
def test_specs(bar, spec, text):
    assert text in run("deform", bar[0], "--dry-run", "--handle", "z > 0.8", spec).stdout


RECIPE = """
weights = "uniform"
tol = 1e-4
max_iterations = 500
[[handles]]
name = "foot"
select = "file:foot.txt"
held = true
[[handles]]
select = "z > 0.8"
axis = [0, 0, 1]
angle = 90
"""


def test_recipe_gives_handles_and_settings_and_options_win(bar, tmp_path):
    folder = tmp_path / "recipes"
    folder.mkdir()
    recipe = folder / "twist.toml"
    recipe.write_text(RECIPE)
    (folder / "foot.txt").write_text("0 1 2 3 4 5 6 7")
    arguments = ["--handle", "group:head", "axis=z,angle=90", "--tol", "1e-5", "--report", tmp_path / "report.json"]
    result = run("deform", bar[0], "-o", tmp_path / "out.obj", "--recipe", recipe, *arguments)
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / "report.json").read_text())
    assert [handle["name"] for handle in report["handles"]] == ["foot", "z > 0.8", "group:head"]
    assert [handle["held"] for handle in report["handles"]] == [True, False, False]
    settings = report["settings"]
    assert (settings["weights"], settings["tol"], settings["max_iterations"]) == ("uniform", 1e-5, 500)
    assert report["converged"]
    assert report["status"] == "converged"
    assert (report["vertices"], report["edges"], report["components"]) == (74, 216, 1)
    assert report["residual_over_goal"] <= 1 < report["energy"] * 1e6
    assert {"read", "fields", "solve", "write"} <= set(report["seconds"])
    assert 0.5 < report["measures"]["volume"] < 1.5
    assert report["measures"]["edge_rms"] > 0.0


def test_a_preview_is_a_picture(bar, tmp_path):
    picture = tmp_path / "picture.png"
    result = run("deform", bar[0], "-o", tmp_path / "out.obj", *TWIST, "--preview", picture)
    assert result.exit_code == 0, result.output
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_not_converged_writes_and_exits_with_3(bar, tmp_path):
    out = tmp_path / "out.obj"
    result = run("deform", bar[0], "-o", out, *TWIST, "--max-iterations", 3)
    assert result.exit_code == 3
    assert "warning: max_iterations" in result.stderr
    assert len(read_mesh(out).positions) == 74


@pytest.mark.parametrize("solver", ["cg", "jacobi"])
def test_a_named_solver_is_used_with_the_options_given(bar, tmp_path, solver):
    report, options = tmp_path / "report.json", ["--solver", solver, "--dtype", "float64", "--tol", "1e-9"]
    assert run("deform", bar[0], "-o", tmp_path / "out.obj", *TWIST, *options, "--report", report).exit_code == 0
    found = json.loads(report.read_text())
    assert found["solver"].lower() == solver
    assert found["residual"] < 1e-8  # the default tolerance leaves 1e-7


def test_interrupt_exits_with_130(bar, tmp_path, monkeypatch):
    from oneform_warp.cli.plan import Plan

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Plan, "solve", interrupted)
    result = run("deform", bar[0], "-o", tmp_path / "out.obj", *TWIST)
    assert (result.exit_code, result.stderr) == (130, "interrupted\n")
    assert not (tmp_path / "out.obj").exists()


@pytest.mark.parametrize("solver", ["cg", "multigrid", "superlu"])
def test_named_solvers_agree(solver, bar, tmp_path):
    path, x, faces = bar
    out = tmp_path / "out.obj"
    result = run("deform", path, "-o", out, *TWIST, "--solver", solver, "--tol", "1e-8")
    assert result.exit_code == 0, result.stderr
    handles = [ow.Handle(x[:, 2] < 0.2, held=True), ow.Handle(x[:, 2] > 0.8, axis="z", angle=90)]
    expected = ow.Deformer(x, faces).solve(handles).x
    assert np.abs(read_mesh(out).positions - expected).max() < 1e-5


def test_a_direct_solver_has_no_precision_to_choose(bar, tmp_path):
    result = run("deform", bar[0], "-o", tmp_path / "out.obj", *TWIST, "--solver", "superlu", "--dtype", "float32")
    assert result.exit_code == 1
    assert "solver: SuperLU has no dtype; leave dtype out, or take multigrid" in result.stderr


def test_choices_are_those_of_the_core():
    from oneform_warp import solvers
    from oneform_warp.arap import CELLS
    from oneform_warp.starts import STARTS
    from oneform_warp.weights import KINDS

    assert CHOICES["solver"] == ("auto", *sorted(solvers.SOLVERS))
    assert CHOICES["start"] == tuple(STARTS)
    assert CHOICES["cells"] == tuple(CELLS)
    assert CHOICES["weights"] == KINDS


def test_info_counts(tmp_path):
    # Two squares that share an edge by position only, a third face on that edge, a sliver and a loose vertex.
    x = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (1, 0.5, 1), (9, 9, 9)]
    path = write_obj(tmp_path / "a.obj", x, [(0, 1, 2, 3), (4, 5, 6, 7), (1, 2, 8), (4, 1, 8)], end=3)
    lines = run("info", path).stdout.splitlines()
    facts = {line[:20].strip(): line[21:] for line in lines}
    assert facts["vertices"] == "10"
    assert facts["faces"] == "4 (2 triangles, 2 quads)"
    assert facts["box"] == "x 0 to 9, y 0 to 9, z 0 to 9"
    assert facts["duplicate positions"] == "2"
    assert facts["isolated vertices"] == "1"
    assert facts["edges"] == "9"
    assert facts["components"] == "2 (the largest has 7 vertices)"
    assert facts["boundary edges"] == "7"
    assert facts["non-manifold edges"] == "2"
    assert facts["zero-length edges"] == "1"
    assert facts["groups"] == "body (9 vertices), head (3 vertices)"
    assert facts["read by"] in ("pymeshlab", "trimesh")
    assert "duplicate positions  0" in run("info", path, "--weld", "off").stdout


def test_doctor_finds_this_machine_fit():
    result = run("doctor")
    assert result.exit_code == 0, result.output
    assert "kernels compile and run" in result.stdout
    assert result.stdout.rstrip().endswith("ready: meshes can be deformed here")


def test_doctor_names_missing_libraries_and_readers(monkeypatch):
    monkeypatch.setattr(doctor, "_loads", lambda name: name != "libOpenGL.so.0")
    monkeypatch.setattr(doctor, "filter_count", lambda: 120)
    monkeypatch.setattr(doctor.sys, "platform", "linux")
    result = run("doctor")
    assert result.exit_code == 0
    assert "sudo apt-get install --no-install-recommends libopengl0" in result.stdout
    assert "PyMeshLab has 120 of 281 filters; what it lacks, as PLY, goes through trimesh" in result.stdout
    monkeypatch.setattr(doctor, "PACKAGES", doctor.PACKAGES | {"scipy": "no-such-package"})
    result = run("doctor")
    assert result.exit_code == 1
    assert "problem: scipy is missing" in result.stdout


def test_demo_turns_the_bar_all_the_way(tmp_path):
    result = run("demo", tmp_path / "demo")
    assert result.exit_code == 0, result.output
    names = {path.name for path in (tmp_path / "demo").iterdir()}
    assert names == {"bar.obj", *(f"bar-{name}.obj" for name in ("90", "180", "360", "720", "bent")), "bar-gallery.png"}
    reached = [line.split("turned by ")[1].split() for line in result.stdout.splitlines() if "turned by" in line]
    turns = " ".join(words[2] + words[5] for words in reached)
    assert turns == "90z 180z 360z 720z 90x"
    assert all(0.9 < float(words[0]) / float(words[2]) < 1.01 for words in reached)
    assert "next: " in result.stdout


def test_version_in_one_line():
    text = run("--version").stdout
    words = text.split()
    assert text.count("\n") == 1
    assert words[:3] == ["oneform-warp", f"{ow.__version__},", "warp"]
    assert words[4:] == ["Python", sys.version.split()[0]]


def test_help_is_quick():
    heavy = ["warp", "pymeshlab", "trimesh", "numpy", "scipy", "lark"]
    code = (
        "import sys; from oneform_warp.cli import main; main(['deform', '--help'], standalone_mode=False);"
        f"print(sorted(set(sys.modules) & {set(heavy)}))"
    )
    done = shell(code=code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"


def test_as_a_program_it_says_nothing_but_the_report(bar, tmp_path):
    done = shell("deform", bar[0], "-o", tmp_path / "out.obj", *TWIST)
    assert (done.returncode, done.stderr) == (0, "")
    assert len(done.stdout.splitlines()) == 5
    done = shell("deform", bar[0], "-o", tmp_path / "out.obj", "--hold", "z < -1")
    assert done.returncode == 1
    assert done.stderr.startswith("error: handle 'z < -1': no vertex is selected; ")
    assert "Traceback" not in done.stderr
