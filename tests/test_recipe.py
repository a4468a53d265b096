"""Recipes: checked whole, with the key and the nearest name in every error; there and back without a loss."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

pytest.importorskip("msgspec")
pytest.importorskip("pymeshlab")

from click.testing import CliRunner

import oneform_warp as ow
from oneform_warp.cli import main
from oneform_warp.errors import InputError
from oneform_warp.filters import Chain, MeshSet, Step
from oneform_warp.filters.recipe import Recipe, checked_recipe, read_recipe, recipe_text

RECIPES = sorted((Path(__file__).resolve().parents[1] / "recipes").glob("*.toml"))

TWIST = """
[[steps]]
filter = "set_oneform_handle"
condselect = "z < zmin + 0.1*(zmax-zmin)"
held = true

[[steps]]
filter = "set_oneform_handle"
condselect = "z > zmin + 0.9*(zmax-zmin)"
angle = 90

[[steps]]
filter = "apply_coord_oneform_deformation"
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("twist.toml").write_text(TWIST)
    return tmp_path


def recipe(*arguments: str):
    return CliRunner().invoke(main, ["recipe", *arguments])


SMOOTH = '[[steps]]\nfilter = "apply_coord_laplacian_smoothing"\n'
BAD = [
    ("", "object missing required field", "steps"),
    ("steps = []", "there are no steps", "add [[steps]]"),
    ("steps = 3", "expected list, got whole number", "write [[steps]] above each step"),
    ('steps = ["a"]', "expected table, got text", "steps[0]"),
    ("[[steps]]\nangle = 3", "step 1: there is no filter", "add a line as filter"),
    ("[[steps]]\nfilter = 3", "step 1: there is no filter", "add a line as filter"),
    ('[[steps]]\nfilter = "set_onefrom_handle"', "step 1, set_onefrom_handle", "did you mean 'set_oneform_handle'"),
    ('[[steps]]\nfilter = "save_snapshot"', "step 1, save_snapshot", "it needs OpenGL"),
    (SMOOTH + "stepsmothnum = 2", "step 1, apply_coord_laplacian_smoothing", "did you mean 'stepsmoothnum'"),
    (SMOOTH + 'stepsmoothnum = "many"', "stepsmoothnum is 'many'", "give a value of type int"),
    (TWIST.replace("angle", "angel"), "step 2, set_oneform_handle", "did you mean 'angle'"),
    (TWIST.replace("90", '"90"'), "angle is '90'", "give a number"),
    (TWIST + "solver = 'cgg'", "solver is 'cgg'", "give one of 'auto'"),
    (TWIST + "tolerance = 2", "tolerance is 2", "<= 1"),
    (TWIST + "welddistance = '-5%'", "welddistance is '-5%'", 'or a percentage as "5%"'),
    (SMOOTH + "[outptu]", "there is no key 'outptu'", "did you mean 'output'? known: steps, title"),
    (SMOOTH + "[output]\nnmae = 'x'", "output: there is no key 'nmae'", "did you mean 'name'"),
    (SMOOTH + "[output]\nname = 3", "output.name: expected text, got whole number", ""),
    (SMOOTH + "[output]\nname = '../{name}.ply'", "output.name: '../{name}.ply' leads out", "leave out '..'"),
    (SMOOTH + "[output]\nname = '{name}.exe'", "names no format that can be written", ".ply"),
    (SMOOTH + "[input]\nextensions = ['ply']", "input.extensions: 'ply' has no dot", "write '.ply'"),
    ('[[steps]]\nfilter = "set_oneform_handle"', "step 1, set_oneform_handle: nothing is selected", "or give condselect"),
    ('[[steps]]\nfilter = "apply_coord_oneform_deformation"', "there is no handle", "add a step set_oneform_handle"),
    (
        TWIST.rpartition("[[steps]]")[0] + "[[steps]]\nfilter = 'meshing_surface_subdivision_loop'\n[[steps]]"
        "\nfilter = 'apply_coord_oneform_deformation'",
        "leaves other vertices than those that the handles were set on",
        "set the handles after it",
    ),
    ("steps = [", "this is not TOML", "toml.io"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "what", "fix"), BAD)
def test_errors_name_file_key_and_what_is_allowed(folder, text, what, fix):
    Path("bad.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        read_recipe("bad.toml")
    assert str(caught.value).startswith("bad.toml: ")
    assert what in str(caught.value)
    assert fix in str(caught.value)


@pytest.mark.parametrize("text", [text for text, _, _ in BAD if "steps" in text])
def test_a_bad_recipe_stops_a_batch_before_its_first_file(folder, text):
    Path("bad.toml").write_text(text)
    x, faces = ow.shapes.bar(segments=2, sides=2)
    Path("bar.obj").write_text(
        "\n".join([*("v {} {} {}".format(*p) for p in x), *("f {} {} {}".format(*f) for f in faces + 1)])
    )
    done = CliRunner().invoke(main, ["batch", "bad.toml", "bar.obj", "-o", "out"])
    assert done.exit_code == 2
    assert done.stderr.startswith("error: bad.toml: ")
    assert not Path("out").exists()


def test_a_recipe_that_is_not_text_is_named(folder):
    Path("bad.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="this is not TOML"):
        read_recipe("bad.toml")


def test_the_hash_is_that_of_what_the_steps_do():
    tables = tomllib.loads(TWIST)
    digest = checked_recipe(tables).digest
    assert checked_recipe({**tables, "title": "Twist", "output": {"name": "{name}.ply"}}).digest == digest
    turned = [dict(reversed(step.items())) for step in tables["steps"]]
    assert checked_recipe({"steps": turned}).digest == digest
    tables["steps"][1]["angle"] = 90.0
    assert checked_recipe(tables).digest == digest
    tables["steps"][1]["angle"] = 91
    assert checked_recipe(tables).digest != digest


def test_there_and_back_through_toml_and_through_a_chain():
    first = checked_recipe({**tomllib.loads(TWIST), "title": 'A "title"', "output": {"name": "{name}.ply"}})
    assert checked_recipe(tomllib.loads(recipe_text(first))) == first
    steps = [Step("apply_coord_oneform_deformation", {"smoothing": "length", "length": "5%"})]
    handle = Step("set_oneform_handle", {"condselect": "z > 0", "rotation": (0, 0, 7)})
    again = Recipe.of(Chain([handle, *steps]))
    assert checked_recipe(tomllib.loads(recipe_text(again))).digest == again.digest
    assert '"5%"' in recipe_text(again).replace("'", '"')


def test_nothing_in_a_recipe_is_evaluated(folder):
    Path("evil.toml").write_text(TWIST.replace("z < zmin + 0.1*(zmax-zmin)", "__import__('os').mkdir('made')"))
    x, faces = ow.shapes.bar(segments=2, sides=2)
    Path("bar.obj").write_text(
        "\n".join([*("v {} {} {}".format(*p) for p in x), *("f {} {} {}".format(*f) for f in faces + 1)])
    )
    result = CliRunner().invoke(main, ["batch", "evil.toml", "bar.obj", "-o", "out", "-j", "1"])
    assert result.exit_code in (1, 2)
    assert not list(folder.rglob("made"))


@pytest.mark.parametrize("path", RECIPES, ids=lambda path: path.stem)
def test_the_recipes_of_this_package_are_good(path):
    assert recipe("check", str(path)).exit_code == 0
    assert "filter" not in recipe("show", str(path)).output.splitlines()[0]
    assert read_recipe(path).description


def test_a_new_recipe_is_good_and_replaces_nothing(folder):
    assert recipe("new", "mine.toml").exit_code == 0
    assert "3 steps, all good" in recipe("check", "mine.toml").output
    again = recipe("new", "mine.toml")
    assert again.exit_code == 1
    assert "there is a file of this name" in again.stderr


def test_show_tells_every_step_and_the_names(folder):
    shown = recipe("show", "twist.toml").output
    assert '2. set_oneform_handle\n     condselect = "z > zmin + 0.9*(zmax-zmin)"\n     angle = 90' in shown
    assert "{folder}/{name}{ext}" in shown


def test_a_script_becomes_a_recipe_and_a_recipe_a_script(folder):
    x, faces = ow.shapes.bar(segments=8, sides=2)
    Path("bar.obj").write_text(
        "\n".join([*("v {} {} {}".format(*p) for p in x), *("f {} {} {}".format(*f) for f in faces + 1)])
    )
    Path("twist.toml").write_text(TWIST + '[[steps]]\nfilter = "apply_coord_laplacian_smoothing"\nstepsmoothnum = 1\n')
    assert recipe("to-mlx", "twist.toml", "bar.obj", "twist.mlx").output == "wrote twist.mlx\n"
    assert recipe("from-mlx", "twist.mlx", "again.toml").exit_code == 0
    positions = []
    for chain in (read_recipe("twist.toml").chain(), read_recipe("again.toml").chain(), Chain.from_script("twist.mlx")):
        meshes = MeshSet()
        meshes.load_new_mesh("bar.obj")
        chain.run(meshes)
        positions.append(meshes.current_mesh().vertex_matrix().tobytes())
    assert len(set(positions)) == 1


def test_the_schema_knows_every_key_and_filter():
    schema = json.loads(recipe("schema").output)
    tables = schema["$defs"]["Recipe"]["properties"]
    assert set(tables) == {"steps", "title", "description", "input", "output"}
    names = tables["steps"]["items"]["properties"]["filter"]["enum"]
    assert {"set_oneform_handle", "apply_coord_laplacian_smoothing"} <= set(names)
    assert "save_snapshot" not in names
    parts = {
        each["if"]["properties"]["filter"]["const"]: each["then"]["properties"]
        for each in tables["steps"]["items"]["allOf"]
    }
    assert parts["set_oneform_handle"]["angle"]["type"] == "number"
    assert "stepsmoothnum" in parts["apply_coord_laplacian_smoothing"]
