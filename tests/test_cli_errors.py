"""Errors of the command line: each says what, where and how to mend it, and leaves every file as it was."""

from pathlib import Path

import pytest
from click.testing import CliRunner

import oneform_warp as ow
from oneform_warp.cli import main


def run(*arguments):
    return CliRunner().invoke(main, arguments)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with a bar of 74 vertices whose upper end is a group, and files with faults."""
    monkeypatch.chdir(tmp_path)
    x, faces = ow.shapes.bar(segments=8, sides=2)
    rows = ["f {} {} {}".format(*face) for face in faces + 1]
    vertices = ["v {} {} {}".format(*point) for point in x]
    files = {
        "bar.obj": "\n".join([*vertices, *rows[:-8], "g head", *rows[-8:]]),
        "out.obj": "precious",
        "nan.obj": "v 0 0 0\nv nan 0 0\nv 1 1 0\nf 1 2 3\n",
        "points.obj": "v 0 0 0\nv 1 0 0\nv 1 1 0\n",
        "words.txt": "0 one 2",
        "large.txt": "0 74",
        "key.toml": 'wieghts = "uniform"',
        "handle.toml": '[[handles]]\nselct = "z > 0"',
        "value.toml": 'tol = "1e-6"',
        "kind.toml": 'weights = "cotan"',
    }
    for name, text in files.items():
        Path(name).write_text(text)
    return tmp_path


# What follows `deform bar.obj -o out.obj`, and what the message has.
ERRORS = [
    ("--hold z<1 -o out.docx", "out.docx: .docx cannot be written; use .3ds"),
    ("--hold z<1 -o no/out.obj", "no/out.obj: the folder does not exist; make the folder"),
    ("--hold z<1 -o .", "this is a folder; add a file name"),
    ("--hold z<1 -o /proc/out.obj", "/proc/out.obj: the folder cannot be written to"),
    ("--hold z<1 --preview a.jpg", "a.jpg: a picture is a .png file"),
    ("--hold z<1 --report ./out.obj", "two files are to be written here"),
    ("--hold z<1 --device cuda:99", "there is no device 'cuda:99'; use one of: cpu"),
    ("--dry-run --hold z<1 --sweeps 3 --length 1", "sweeps and length are both given"),
    ("--hold z<-5", "handle 'z<-5': no vertex is selected; the mesh has x -0.1 to"),
    ("--hold zz<1", "unknown variable 'zz' at column 1; did you mean 'z'"),
    ("--hold grp:head", "no kind of selection 'grp'; did you mean 'group'"),
    ("--hold group:hed", "there is no group 'hed'; did you mean 'head'"),
    ("--hold box:1,2,3", "a box is six numbers"),
    ("--hold box:1,0,0,0,1,1", "a box is six numbers, the smaller ones first"),
    ("--hold file:words.txt", "words.txt: 'one' is not a vertex number"),
    ("--hold file:large.txt", "large.txt: vertex number 74 does not exist"),
    ("--hold file:gone.txt", "gone.txt: cannot be read: No such file"),
    ("--handle z>0 angel=9", "--handle 'z>0': there is no key 'angel'; did you mean 'angle'"),
    ("--handle z>0 axis=z,angle=nan", "angle: 'nan' is not a number"),
    ("--handle z>0 axis=w,angle=9", "axis: 'w' is not three numbers; use x, y, z"),
    ("--handle z>0 angle=9", "axis and angle belong together"),
    ("--handle z>0 angle", "angle has no value; write angle=..."),
    ("--handle z>0 stretch=2,stretch=3", "stretch is given twice"),
    ("--handle z>0 stretch=0", "stretch: the stretch is 0; give a factor > 0"),
    ("--handle z>0 held,axis=z,angle=9", "z>0: a held handle stays where it is"),
    ("--hold z<.6 --handle z>.4 axis=z,angle=9", "handle 'z<.6' and handle 'z>.4' give different rotations"),
    ("--dry-run --handle z<.6 stretch=2 --handle z>.4 stretch=3", "give different stretches"),
    ("--recipe key.toml", "key.toml: there is no key 'wieghts'; did you mean 'weights'"),
    ("--recipe handle.toml", "handle.toml: handles[0]: there is no key 'selct'; did you mean 'select'"),
    ("--recipe value.toml", "value.toml: tol: '1e-6' does not fit; give a number >= 0"),
    ("--recipe kind.toml", "no weights 'cotan'; did you mean 'cotangent'"),
    ("--recipe words.txt", "words.txt: this is not TOML"),
    ("--recipe gone.toml", "gone.toml: cannot be read"),
]
OTHER_ERRORS = [
    ("deform gone.obj -o out.obj --hold z<1", "gone.obj: the file does not exist; check the path"),
    ("deform nan.obj -o out.obj --hold z<1", "nan.obj: vertex 1 (from 0) is not finite"),
    ("deform points.obj -o out.obj --hold z<1", "only points, and a deformation needs edges; give a mesh"),
    ("info gone.obj", "gone.obj: the file does not exist"),
    ("demo bar.obj", "bar.obj: the folder cannot be made: File exists"),
]
ERRORS = [("deform bar.obj -o out.obj " + command, message) for command, message in ERRORS] + OTHER_ERRORS


@pytest.mark.parametrize(("command", "message"), ERRORS)
def test_errors_name_what_where_and_how_and_touch_nothing(folder, command, message):
    if "/proc" in command and not Path("/proc").is_dir():
        pytest.skip("there is no folder that nobody can write to")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    result = run(*command.split())
    assert result.exit_code == 1, result.output
    assert message in result.stderr
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["deform", "bar.obj", "--hold", "z<1"], "Missing option '-o'"),
        (["deform", "bar.obj", "-o", "out.obj"], "There is no handle"),
        (["deform", "bar.obj", "-o", "out.obj", "--weights", "cotan"], "'cotan' is not one of 'cotangent'"),
        (["deform", "bar.obj", "-o", "out.obj", "--weld", "near"], "'near' is not a length; give a length >= 0"),
        (["deform", "bar.obj", "-o", "out.obj", "--length", "0"], "0.0 is not in the range"),
        (["deforme"], "No such command 'deforme'"),
    ],
)
def test_wrong_usage_exits_with_2(arguments, message):
    result = run(*arguments)
    assert result.exit_code == 2
    assert message in result.stderr
