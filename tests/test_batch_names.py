"""Inputs and the names of outputs: each input once, no two outputs the same, none outside of the output folder."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

pytest.importorskip("msgspec")
pytest.importorskip("pymeshlab")

from oneform_warp.errors import InputError
from oneform_warp.filters.batch.inputs import find_sources
from oneform_warp.filters.batch.plan import plan_outputs
from oneform_warp.filters.batch.shards import Shard
from oneform_warp.filters.names import Source, checked_pattern, output_name

SOURCE = Source(Path("/data/scans/left/hand.ply"), "left")


@pytest.mark.parametrize(
    ("pattern", "name"),
    [
        ("{folder}/{name}{ext}", "left/hand.ply"),
        ("{name}_posed.obj", "hand_posed.obj"),
        ("{parent}-{name}{ext}", "left-hand.ply"),
        ("by format/{ext}/{name}{ext}", "by format/.ply/hand.ply"),
        ("{{{name}}}.stl", "{hand}.stl"),
    ],
)
def test_patterns(pattern, name):
    assert output_name(checked_pattern(pattern, "name"), SOURCE) == name


def test_a_file_without_a_folder_gets_none():
    assert output_name("{folder}/{name}{ext}", Source(Path("/data/hand.ply"))) == "hand.ply"


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("{nmae}.ply", "there is no field {nmae}"),
        ("{name.__class__}.ply", "there is no field {name.__class__}"),
        ("{name[0]}.ply", "there is no field"),
        ("{name!r}.ply", "there is no field"),
        ("{name:>9}.ply", "there is no field"),
        ("{}.ply", "there is no field"),
        ("{name.ply", "expected '}'"),
        ("/tmp/{name}.ply", "leads out of"),
        ("../{name}.ply", "leads out of"),
        ("a/../../{name}.ply", "leads out of"),
        ("{name}\0.ply", "leads out of"),
        ("{name}", "no format that can be written"),
        ("{name}.zip", "no format that can be written"),
        ("", "no format that can be written"),
    ],
)
def test_patterns_that_cannot_be_used(pattern, message):
    with pytest.raises(InputError, match="name: ") as caught:
        checked_pattern(pattern, "name")
    assert message in str(caught.value)


FILE_NAMES = st.text(st.characters(exclude_characters="/\0"), min_size=1, max_size=300).filter(
    lambda n: n not in (".", "..")
)
PATTERNS = st.sampled_from(
    ["{folder}/{name}{ext}", "{name}/x{ext}", "{name}.ply", "{parent}{ext}/{name}.ply", "{ext}/{name}{ext}"]
)


@given(FILE_NAMES, FILE_NAMES, PATTERNS)
@example("...ply", "a", "{name}/x{ext}")
@example("..", "..a", "{name}{ext}")
@example(".oneform-warp", "a", "{name}/x{ext}")
def test_every_name_stays_below_the_output_folder_or_is_refused(name, folder, pattern):
    try:
        output = output_name(pattern, Source(Path("/in", folder, name), folder))
    except InputError:
        return
    out = Path("/out")
    inner = Path(os.path.normpath(out / output))
    assert inner.is_relative_to(out)
    assert inner != out
    assert str(inner) == f"/out/{output}"  # already in its simplest form
    assert not output.startswith(".oneform-warp")
    assert all(len(os.fsencode(part)) <= 255 for part in output.split("/"))


@pytest.fixture
def tree(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in (
        "b.ply",
        "a.OBJ",
        "notes.txt",
        "model.zip",
        ".hidden.ply",
        "sub/a.obj",
        "sub/deep/c.stl",
        ".git/x.ply",
        "[1].ply",
    ):
        Path(name).parent.mkdir(exist_ok=True, parents=True)
        Path(name).write_text("")
    return tmp_path


def found(*inputs, **options):
    return [(source.path.name, source.folder) for source in find_sources(inputs, **options)]


def test_a_folder_is_searched_in_order_and_hidden_files_are_left_out(tree):
    assert found(".") == [("[1].ply", ""), ("a.OBJ", ""), ("b.ply", ""), ("a.obj", "sub"), ("c.stl", "sub/deep")]
    assert found("sub") == [("a.obj", ""), ("c.stl", "deep")]
    assert found(".", out=tree / "sub") == [("[1].ply", ""), ("a.OBJ", ""), ("b.ply", "")]
    assert found(".", extensions=(".STL",)) == [("c.stl", "sub/deep")]


def test_globs_keep_the_folders_that_they_searched(tree):
    assert found("*.ply") == [("[1].ply", ""), ("b.ply", "")]
    assert found("**/*.obj") == [("a.obj", "sub")]
    assert found("sub/**/*.stl") == [("c.stl", "deep")]
    assert found("[1].ply") == [("[1].ply", "")]  # it exists, so it is no glob


def test_an_input_that_is_given_twice_is_done_once(tree):
    assert found("b.ply", "./b.ply", str(tree / "b.ply"), "*.ply") == [("b.ply", ""), ("[1].ply", "")]


def test_a_file_is_taken_whatever_its_extension(tree):
    assert found("notes.txt", "model.zip") == [("notes.txt", ""), ("model.zip", "")]


def test_lists_keep_their_folders_and_name_files_that_are_not_there(tree):
    Path("list").write_bytes(b"sub/a.obj\r\n\nb.ply\ngone.ply\n" + os.fsencode(tree) + b"/sub/deep/c.stl\n../up.ply\n")
    expected = [("a.obj", "sub"), ("b.ply", ""), ("gone.ply", ""), ("c.stl", ""), ("up.ply", "")]
    assert found(lists=["list"]) == expected
    Path("list").write_bytes(b"sub/a.obj\0new\nline.ply\0")
    assert found(lists=["list"]) == [("a.obj", "sub"), ("new\nline.ply", "")]


def test_what_is_not_there_is_named(tree):
    for inputs, lists in ((["gone"], []), ([], ["gone"])):
        with pytest.raises(InputError, match="gone: "):
            find_sources(inputs, lists)
    for pattern in ("*.off", "gone/*.ply"):
        with pytest.raises(InputError, match="there are no input files"):
            find_sources([pattern])


def test_two_inputs_never_write_one_output(tree):
    sources = find_sources(["."])
    with pytest.raises(
        InputError, match=r"x\.ply: .*\[1\]\.ply and .*a\.OBJ would both write it; tell the outputs apart"
    ):
        plan_outputs(sources, "x.ply", tree / "out")
    names = [task.output for task in plan_outputs(sources, "{folder}/{name}.ply", tree / "out")]
    assert len(set(names)) == len(sources)


@given(st.integers(1, 20), st.integers(0, 60))
def test_shards_share_out_everything_once(count, size):
    parts = [Shard(number, count).of(range(size)) for number in range(1, count + 1)]
    assert sorted(item for part in parts for item in part) == list(range(size))
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "1/0", "a/b", "1/2/3", "-1/2", "1 / 2"])
def test_shards_that_cannot_be(text):
    with pytest.raises(InputError, match="write I/N with I from 1 to N"):
        Shard.parsed(text)
