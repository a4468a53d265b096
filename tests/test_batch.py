"""Batches: everything is done or has a reason, a resume does what is missing, and nothing else is touched."""

from __future__ import annotations

import errno
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("pebble")
pytest.importorskip("pymeshlab")

from click.testing import CliRunner

import oneform_warp as ow
from oneform_warp.cli import main
from oneform_warp.errors import FileError, InputError
from oneform_warp.filters import MeshSet, read_mesh
from oneform_warp.filters.batch import Entry, read_entries, run_batch
from oneform_warp.filters.batch.journal import Journal
from oneform_warp.filters.batch.pool import LocalPool
from oneform_warp.filters.recipe import Recipe, checked_recipe, recipe_text

SMOOTH = """
[[steps]]
filter = "apply_coord_laplacian_smoothing"
stepsmoothnum = 2
"""


def write_obj(path: Path, *, twist: float = 0.0, segments: int = 8) -> Path:
    x, faces = ow.shapes.bar(segments=segments, sides=2)
    rows = [f"v {a:.9g} {b + twist * c:.9g} {c:.9g}" for a, b, c in x]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*rows, *("f {} {} {}".format(*face) for face in faces + 1), ""]))
    return path


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder: a recipe, and four meshes in `scans`, two of them deeper."""
    monkeypatch.chdir(tmp_path)
    Path("smooth.toml").write_text(SMOOTH)
    for number, name in enumerate(("a.obj", "b.obj", "deep/a.obj", "deep/er/c.obj")):
        write_obj(Path("scans", name), twist=0.1 * number)
    return tmp_path


def outputs(out: str | Path = "out") -> dict[str, bytes]:
    """What lies in the output folder, but the journals."""
    out = Path(out)
    files = (path for path in out.rglob("*") if path.is_file() and path.suffix not in (".jsonl", ".html"))
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


def lines(out: str | Path = "out") -> list[dict]:
    return [json.loads(line) for path in sorted(Path(out).glob("journal*")) for line in path.read_text().splitlines()]


def hidden(out: str | Path = "out") -> list[str]:
    return [path.name for path in Path(out).rglob("*") if path.name.startswith(".")]


def batch(*arguments: str):
    return CliRunner().invoke(main, ["batch", *arguments])


# What is done, and what is done again.


def test_each_input_has_its_output_and_its_line(folder):
    before = outputs("scans")
    result = run_batch("smooth.toml", ["scans"], "out", jobs=2)
    assert (result.written, result.kept, result.failures, result.exit_code) == (4, 0, (), 0)
    assert set(outputs()) == {"a.obj", "b.obj", "deep/a.obj", "deep/er/c.obj"} == {line["output"] for line in lines()}
    assert outputs("scans") == before
    assert hidden() == []
    for line in lines():
        assert line["status"] == "written"
        assert line["input"] == str(folder / "scans" / line["output"])
        assert line["size"] == len(before[line["output"]])
        assert len(line["hash"]) == len(line["output_hash"]) == len(line["recipe"]) == 64


def test_a_second_run_does_nothing_and_one_by_force_does_all(folder):
    first = run_batch("smooth.toml", ["scans"], "out", jobs=1)
    made = outputs()
    again = run_batch("smooth.toml", ["scans"], "out", jobs=1)
    assert (again.written, again.kept) == (0, 4)
    assert len(lines()) == first.written == 4
    forced = run_batch("smooth.toml", ["scans"], "out", jobs=2, force=True)
    assert (forced.written, forced.kept) == (4, 0)
    assert outputs() == made


@pytest.mark.parametrize(
    ("change", "redone"),
    [
        (lambda: Path("out/a.obj").unlink(), {"a.obj"}),
        (lambda: Path("out/b.obj").write_bytes(b"broken"), {"b.obj"}),
        (lambda: write_obj(Path("scans/deep/a.obj"), twist=0.7), {"deep/a.obj"}),
        (lambda: os.utime("scans/a.obj", (1, 1)), set()),
        (lambda: Path("smooth.toml").write_text("# a remark\n" + SMOOTH), set()),
        (
            lambda: Path("smooth.toml").write_text(SMOOTH.replace("= 2", "= 3")),
            {"a.obj", "b.obj", "deep/a.obj", "deep/er/c.obj"},
        ),
        (lambda: write_obj(Path("scans/new.obj")), {"new.obj"}),
    ],
    ids=["output gone", "output changed", "input changed", "touched", "remark", "recipe changed", "new input"],
)
def test_a_resume_does_what_is_missing_or_changed(folder, change, redone):
    run_batch("smooth.toml", ["scans"], "out", jobs=1)
    count = len(lines())
    change()
    result = run_batch("smooth.toml", ["scans"], "out", jobs=1)
    assert {line["output"] for line in lines()[count:]} == redone
    assert result.written == len(redone)
    clean = run_batch("smooth.toml", ["scans"], "clean", jobs=1)
    assert clean.exit_code == 0
    assert outputs() == outputs("clean")


def test_what_fails_has_a_reason_and_is_tried_again(folder):
    Path("scans/broken.obj").write_text("v 0 0\nf 1 2 3\n")
    Path("scans/empty.ply").write_text("")
    Path("scans/lfs.stl").write_text("version https://git-lfs.github.com/spec/v1\n")
    result = run_batch("smooth.toml", ["scans"], "out", jobs=2)
    assert (result.written, len(result.failures), result.exit_code) == (4, 3, 1)
    assert all(entry.reason for entry in result.failures)
    assert {Path(entry.input).name for entry in result.failures} == {"broken.obj", "empty.ply", "lfs.stl"}
    write_obj(Path("scans/broken.obj"))
    again = run_batch("smooth.toml", ["scans"], "out", jobs=1)
    assert (again.written, again.kept, len(again.failures)) == (1, 4, 2)
    assert {entry.output: entry.status for entry in read_entries(Path("out"))}["broken.obj"] == "written"


def test_the_number_of_workers_does_not_change_a_byte(folder):
    run_batch("smooth.toml", ["scans"], "one", jobs=1)
    run_batch("smooth.toml", ["scans"], "three", jobs=3)
    assert outputs("one") == outputs("three")


def test_a_recipe_or_a_chain_from_python(folder):
    recipe = checked_recipe({"steps": [{"filter": "apply_coord_laplacian_smoothing", "stepsmoothnum": 2}]})
    run_batch("smooth.toml", ["scans"], "out", jobs=1)
    assert run_batch(recipe, ["scans"], "out", jobs=1).kept == 4
    assert run_batch(recipe.chain(), ["scans"], "out", jobs=1).kept == 4


MIXED = [
    ("compute_selection_by_condition_per_vertex", {"condselect": "z < zmin + 0.1*(zmax-zmin)"}),
    ("set_oneform_handle", {"held": True}),
    ("compute_selection_by_condition_per_vertex", {"condselect": "z > zmin + 0.9*(zmax-zmin)"}),
    ("set_oneform_handle", {"angle": 90}),
    ("apply_coord_oneform_deformation", {}),
    ("apply_coord_laplacian_smoothing", {"stepsmoothnum": 1}),
]


def test_a_batch_gives_the_bits_that_filters_by_hand_give(folder):
    meshes = MeshSet()
    meshes.load_new_mesh("scans/b.obj")
    for name, values in MIXED:
        meshes.apply_filter(name, **values)
    Path("mixed.toml").write_text(recipe_text(Recipe(tuple({"filter": name, **values} for name, values in MIXED))))
    result = run_batch("mixed.toml", ["scans"], "out", jobs=2)
    assert result.exit_code == 0, result.failures
    assert read_mesh("out/b.obj").positions.tobytes() == meshes.current_mesh().vertex_matrix().tobytes()
    entry = next(entry for entry in read_entries(Path("out")) if entry.output == "b.obj")
    assert entry.converged
    assert entry.energy > 0
    assert entry.residual <= 1
    assert entry.iterations > 0


# Nothing is lost.

KILLED = """
import sys
from oneform_warp.filters.batch import run_batch
if __name__ == "__main__":
    sys.exit(run_batch("smooth.toml", ["many"], "out", jobs=2).exit_code)
"""


def start(folder: Path) -> subprocess.Popen[bytes]:
    (folder / "killed.py").write_text(KILLED)
    return subprocess.Popen([sys.executable, "killed.py"], cwd=folder)


def wait_for(condition, seconds=30.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)


def size_of(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def test_kills_at_any_moment_cost_nothing(folder):
    """The whole batch is killed, again and again; BATCH_KILLS asks for more of them than the usual few."""
    kills, count = int(os.environ.get("BATCH_KILLS", "6")), 100
    for number in range(count):
        write_obj(Path(f"many/{number:03}.obj"), twist=0.01 * number, segments=40)
    run_batch("smooth.toml", ["many"], "clean", jobs=2)
    journal, chance, landed = folder / "out/journal.jsonl", random.Random(0), 0
    for number in range(kills):
        size = size_of(journal)
        parent = start(folder)
        if number % 2:  # anywhere from one file to the next
            wait_for(lambda run=parent, size=size: run.poll() is not None or size_of(journal) > size)
            time.sleep(chance.uniform(0, 0.05))
        else:  # while it starts, and looks at what is there
            time.sleep(chance.uniform(0, 2.0))
        landed += parent.poll() is None
        parent.kill()
        parent.wait()
    assert landed >= kills // 2, landed
    result = run_batch("smooth.toml", ["many"], "out", jobs=2)
    assert result.exit_code == 0
    assert outputs() == outputs("clean")
    assert len(outputs()) == count
    assert hidden() == []
    written = [line["output"] for line in lines() if line["status"] == "written"]
    assert sorted(written) == sorted(outputs())  # each once


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_command_leaves_whole_files_and_no_others(folder, sent, code):
    for number in range(60):
        write_obj(Path(f"many/{number:03}.obj"), twist=0.01 * number, segments=60)
    command = [sys.executable, "-m", "oneform_warp.cli", "batch", "smooth.toml", "many", "-o", "out", "-j", "2"]
    # What a shell starts in the background has SIGINT ignored, and would hand that on.
    heeded = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    parent = subprocess.Popen(command, stdout=subprocess.DEVNULL, preexec_fn=heeded)
    wait_for(lambda: len(list(Path("out").glob("*.obj"))) > 2)
    parent.send_signal(sent)
    assert parent.wait(10) == code
    assert hidden() == []
    run_batch("smooth.toml", ["many"], "clean", jobs=2)
    assert all(outputs("clean")[name] == content for name, content in outputs().items())
    result = run_batch("smooth.toml", ["many"], "out", jobs=2)
    assert result.kept > 0
    assert outputs() == outputs("clean")


def test_half_a_line_in_the_journal_is_cut_off(folder):
    run_batch("smooth.toml", ["scans"], "out", jobs=1)
    journal = Path("out/journal.jsonl")
    content = journal.read_bytes()
    journal.write_bytes(content[:-40])
    assert run_batch("smooth.toml", ["scans"], "out", jobs=1).written == 1
    assert len(lines()) == 4
    journal.write_bytes(b"\0" * 100 + b"\n[1]\n{}\n" + content)
    assert run_batch("smooth.toml", ["scans"], "out", jobs=1).kept == 4


def test_what_a_killed_run_has_left_is_swept_away(folder):
    left = Path("out/.oneform-warp/0123/7-x")
    left.mkdir(parents=True)
    (left / "half.obj").write_text("v 0")
    run_batch("smooth.toml", ["scans"], "out", jobs=1)
    assert hidden() == []


def test_two_batches_do_not_share_a_folder(folder):
    fcntl = pytest.importorskip("fcntl")
    run_batch("smooth.toml", ["scans"], "out", jobs=1)
    with open("out/journal.jsonl", "a") as journal:
        fcntl.flock(journal, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="another batch is writing to this folder"):
            run_batch("smooth.toml", ["scans"], "out", jobs=1)


@pytest.fixture
def small_disk(folder):
    """A folder on a file system of 200 KB, where mounting is allowed."""
    place = folder / "disk"
    place.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(place)], check=False, capture_output=True
    )
    if done.returncode:
        pytest.skip("mounting a small disk is not allowed here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_full_disk_is_a_reason_and_the_rest_is_done_when_there_is_room(folder, small_disk):
    for number in range(40):
        write_obj(Path(f"many/{number:02}.obj"), segments=40)
    result = run_batch("smooth.toml", ["many"], small_disk / "out", jobs=2)
    assert result.written
    assert result.exit_code == 1
    assert result.written + len(result.failures) == 40
    assert all("No space left" in entry.reason for entry in result.failures), {e.reason for e in result.failures}
    subprocess.run(["mount", "-o", "remount,size=20m", str(small_disk)], check=True)
    again = run_batch("smooth.toml", ["many"], small_disk / "out", jobs=2)
    assert again.exit_code == 0
    assert again.kept + again.written == 40
    run_batch("smooth.toml", ["many"], "clean", jobs=2)
    assert outputs(small_disk / "out") == outputs("clean")
    assert hidden(small_disk / "out") == []


def test_lines_that_could_not_be_written_come_with_the_next_ones(tmp_path, monkeypatch):
    journal = Journal(tmp_path, "journal.jsonl")
    entries = [Entry(f"/in/{n}.ply", f"{n}.ply", "failed", "", reason="none") for n in range(3)]
    assert journal.write(entries[:1])
    whole = journal.path.read_bytes()
    write = os.write

    def half(file, data):
        write(file, data[:9])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", half)
    assert not journal.write(entries[1:2])
    assert journal.path.read_bytes() == whole
    monkeypatch.setattr(os, "ftruncate", lambda *_: half(journal._file, b""))
    assert not journal.write([])  # on a disk that can only be read by now, nothing helps, and nothing is raised
    monkeypatch.undo()
    journal.close()
    assert Journal(tmp_path, "journal.jsonl").write(entries[2:])
    assert [entry.output for entry in read_entries(tmp_path)] == ["0.ply", "2.ply"]


def test_a_folder_that_cannot_be_written_to_is_named_before_anything(folder):
    with pytest.raises(FileError, match="cannot be written to"):
        run_batch("smooth.toml", ["scans"], "/proc/out", jobs=1)
    Path("file").write_text("")
    with pytest.raises(FileError, match=r"file/out: the folder cannot be written to"):
        run_batch("smooth.toml", ["scans"], "file/out", jobs=1)


def test_a_folder_in_the_way_costs_only_its_own_files(folder):
    Path("out/a.obj").mkdir(parents=True)
    Path("out/deep").write_text("a file where a folder should be")
    result = run_batch("smooth.toml", ["scans"], "out", jobs=1)
    assert {entry.output for entry in result.failures} == {"a.obj", "deep/a.obj", "deep/er/c.obj"}
    assert result.written == 1


# Nothing outside of the output folder.


def test_an_output_never_replaces_an_input(folder):
    before = outputs("scans")
    for out, name in (("scans", None), (".", "scans/{folder}/{name}{ext}")):
        with pytest.raises(FileError, match="would replace an input"):
            run_batch("smooth.toml", ["scans"], out, name=name, jobs=1)
    os.symlink("scans", "link")
    with pytest.raises(FileError, match="would replace an input"):
        run_batch("smooth.toml", ["scans"], "link", jobs=1)
    with pytest.raises(FileError, match="would lie among the inputs, and the next run would take it for one"):
        run_batch("smooth.toml", ["scans"], "scans", name="{folder}/{name}_smooth{ext}", jobs=1)
    assert outputs("scans") == before


def test_outputs_may_lie_below_the_inputs_and_are_no_inputs_of_the_next_run(folder):
    for _ in range(2):
        result = run_batch("smooth.toml", [".", "./**/*.obj"], "scans/out", jobs=1)
        assert result.total == 4
    assert result.kept == 4
    beside = run_batch("smooth.toml", ["scans/a.obj"], "scans", name="{name}_smooth{ext}", jobs=1)
    assert beside.written == 1


def test_links_do_not_lead_out_of_the_output_folder(folder):
    Path("elsewhere").mkdir()
    Path("elsewhere/precious.obj").write_text("precious")
    Path("out").mkdir()
    os.symlink(folder / "elsewhere", "out/deep")
    os.symlink(folder / "elsewhere/precious.obj", "out/a.obj")
    result = run_batch("smooth.toml", ["scans"], "out", jobs=1)
    assert {entry.output for entry in result.failures} == {"deep/a.obj", "deep/er/c.obj"}
    assert all("a link leads out" in entry.reason for entry in result.failures)
    assert outputs("elsewhere") == {"precious.obj": b"precious"}
    assert not Path("out/a.obj").is_symlink()


NAMES = [
    "-rf.obj",
    "--force.obj",
    "new\nline.obj",
    "a b'\"$(touch x)`;.obj",
    "[bold]x[red].obj",
    "<script>alert(1)</script>.obj".replace("/", "\u2044"),
    "~.obj",
    "{name}.obj",
    "%s.obj",
    "\u202egnp.obj",
    "é\u0301.obj",
    "n" * 251 + ".obj",
    os.fsdecode(b"broken\xff.obj"),
    "...obj",
    "con.obj",
    "x\\y.obj",
]


def test_any_name_is_written_below_the_output_folder_or_has_a_reason(folder):
    made = []
    for name in NAMES:
        try:
            made.append(write_obj(Path("names") / name))
        except OSError:  # this file system cannot hold the name
            continue
    before = sorted(os.listdir(folder))
    result = run_batch("smooth.toml", ["names", "names/...obj"], "out", jobs=2)
    assert result.written + len(result.failures) == len(made)
    assert sorted(os.listdir(folder)) == sorted([*before, "out"])
    assert set(outputs()) == {line["output"] for line in lines() if line["status"] == "written"}
    assert result.written >= len(made) - 2, [(entry.input, entry.reason) for entry in result.failures]
    run = batch(
        "smooth.toml", "names", "names/...obj", "-o", "out", "--plain", "--force", "--report", "--pictures", "2"
    )
    assert run.exit_code == result.exit_code, run.output
    assert "\x1b" not in run.output
    page = Path("out/report.html").read_text()
    assert "<script>" not in page


# One machine's part.


def test_shards_together_are_the_whole(folder):
    run_batch("smooth.toml", ["scans"], "whole", jobs=1)
    done = [run_batch("smooth.toml", ["scans"], "out", jobs=1, shard=f"{number}/3") for number in (1, 2, 3)]
    assert sum(result.written for result in done) == 4
    assert all(result.kept == 0 for result in done)
    assert outputs() == outputs("whole")
    assert hidden() == []
    assert run_batch("smooth.toml", ["scans"], "out", jobs=1).kept == 4


# The command.


def test_the_command_says_what_it_did_and_exits_by_it(folder):
    done = batch("smooth.toml", "scans", "-o", "out", "-j", "1")
    assert done.exit_code == 0, done.output
    assert "4 written, 0 unchanged, 0 failed" in done.output
    assert "1/4 written" in done.output
    Path("scans/broken.obj").write_text("f 1 2 3")
    failed = batch("smooth.toml", "scans", "-o", "out", "-j", "1", "--quiet")
    assert failed.exit_code == 1
    assert failed.stdout == ""
    assert "0 written, 4 unchanged, 1 failed" in failed.stderr
    assert f"failed {folder}/scans/broken.obj: " in failed.stderr
    quiet = batch("smooth.toml", "scans/deep", "-o", "other", "-j", "1", "--quiet")
    assert (quiet.exit_code, quiet.output) == (0, "")


def test_a_dry_run_lists_what_it_would_write_and_writes_nothing(folder):
    shown = batch("smooth.toml", "scans", "-o", "out", "--dry-run")
    assert shown.exit_code == 0, shown.output
    assert f"{folder}/scans/deep/a.obj -> {folder}/out/deep/a.obj" in shown.output
    assert not Path("out").exists()
    run_batch("smooth.toml", ["scans/a.obj", "scans/b.obj"], "out", jobs=1)
    assert "scans/a.obj" not in batch("smooth.toml", "scans", "-o", "out", "--dry-run").output


def test_the_report_has_pictures_and_reasons_and_loads_nothing(folder):
    Path("scans/broken & <b>.obj").write_text("f 1 2 3")
    done = batch("smooth.toml", "scans", "-o", "out", "-j", "2", "--report", "--pictures", "3", "--quiet")
    assert done.exit_code == 1
    page = Path("out/report.html").read_text()
    assert page.count("data:image/png;base64,iVBOR") == 3
    assert "broken &amp; &lt;b&gt;.obj" in page
    assert "4 written, 1 failed" in page
    assert not re.search(r"""(src|href|url)\s*[=(]\s*["']?(?!["']?data:image/png)""", page)


def test_measures_of_the_recipe_are_columns_of_journal_and_report(folder):
    twist = """
[[steps]]
filter = "apply_coord_oneform_twist"
angle = 90

[[steps]]
filter = "get_oneform_measures"
selfintersections = false
"""
    Path("twist.toml").write_text(twist)
    assert batch("twist.toml", "scans", "-o", "out", "-j", "1", "--report", "--quiet").exit_code == 0
    for line in lines():
        assert 0.5 < line["measures"]["volume"] < 1.0
    assert "<th>volume</th>" in Path("out/report.html").read_text()


NOTHING_RUNS = [
    ("gone.toml scans -o out", "gone.toml: cannot be read"),
    ("bad.toml scans -o out", "bad.toml: step 1"),
    ("smooth.toml gone -o out", "gone: there is no such file or folder"),
    ("smooth.toml *.stl -o out", "there are no input files"),
    ("smooth.toml scans -o out --name {name}{ext}", "a.obj: "),
    ("smooth.toml scans -o out --name ../{name}{ext}", "leads out of the output folder"),
    ("smooth.toml scans -o out --name {nmae}.ply", "there is no field {nmae}"),
    ("smooth.toml scans -o out --name {name}.docx", "names no format that can be written"),
    ("smooth.toml scans -o out --shard 0/4", "'0/4' is no shard"),
    ("smooth.toml scans -o scans", "an output would replace an input"),
    ("smooth.toml scans -o smooth.toml", "smooth.toml: the folder cannot be written to"),
    ("smooth.toml scans -o out --cluster tcp://127.0.0.1:9", "no scheduler answers"),
]


@pytest.mark.parametrize(("command", "message"), NOTHING_RUNS)
def test_where_nothing_can_run_the_code_is_2_and_nothing_is_written(folder, command, message, monkeypatch):
    if "--cluster" in command:
        pytest.importorskip("distributed")
        monkeypatch.setattr("oneform_warp.filters.batch.cluster.CONNECTING", 1)
    Path("bad.toml").write_text('[[steps]]\nfilter = "apply_coord_laplacian_smooting"\n')
    before = outputs(".")
    result = batch(*command.split())
    assert result.exit_code == 2, result.output
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert outputs(".") == before


def test_no_worker_starts_where_there_is_nothing_to_do(folder, monkeypatch):
    run_batch("smooth.toml", ["scans"], "out", jobs=1)
    monkeypatch.setattr(LocalPool, "__enter__", lambda _: pytest.fail("a pool was started"))
    assert run_batch("smooth.toml", ["scans"], "out", jobs=1).kept == 4


def test_materials_and_textures_in_subfolders_come_along(folder):
    scan = write_obj(Path("scans/a.obj"))
    scan.write_text("mtllib paint/a.mtl\n" + scan.read_text())
    Path("scans/paint").mkdir()
    Path("scans/paint/a.mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    Path("scans/paint/skin.png").write_bytes(b"not really a picture")
    Path("turn.toml").write_text(
        '[[steps]]\nfilter = "set_oneform_handle"\ncondselect = "z > 0.5"\nangle = 20\n'
        '[[steps]]\nfilter = "apply_coord_oneform_deformation"\n'
    )
    result = batch("turn.toml", "scans/a.obj", "-o", "out")
    assert result.exit_code == 0, result.output
    assert outputs()["paint/a.mtl"] == Path("scans/paint/a.mtl").read_bytes()
    assert outputs()["a.obj"].startswith(b"mtllib paint/a.mtl\n")
    assert hidden() == []
