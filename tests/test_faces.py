"""Every option has the same meaning from Python, as a filter's parameters, on the command line and in a recipe."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab
import pytest
import tomli_w
from click.testing import CliRunner

import oneform_warp as ow
from oneform_warp.cli.commands import main
from oneform_warp.filters import MeshSet, read_mesh
from oneform_warp.symmetry import mirror

WRITTEN = 2e-6  # of the bar's length: what the text of the file keeps of a position

X, FACES = ow.shapes.bar(segments=16, sides=4)
FOOT, HEAD = X[:, 2] < 0.1, X[:, 2] > 0.9
THERE = X + np.array([0.0, 0.15, 0.02]) * HEAD[:, None]
MIDDLE = np.flatnonzero(np.abs(X[:, 2] - 0.5) < 0.05)
HOLD = ow.Handle(FOOT, held=True)


def of(**options: Any) -> list[ow.Handle]:
    return [HOLD, ow.Handle(HEAD, **options)]


@dataclass(frozen=True)
class Face:
    """One option, as each face spells it; the foot is held in all of them."""

    python: Callable[[], np.ndarray]
    handle: dict[str, Any] = field(default_factory=dict)
    spec: str = ""
    deformation: dict[str, Any] = field(default_factory=dict)
    options: Sequence[str] = ()
    recipe: dict[str, Any] = field(default_factory=dict)
    before: Sequence[tuple[str, dict[str, Any]]] = ()
    """Filters between the handle and the deformation."""


def turned(**options: Any) -> Callable[[], np.ndarray]:
    return lambda: ow.deform(X, FACES, of(axis="x", angle=50), **options)


TURN: dict[str, Any] = {"handle": {"angle": 50, "rotaxis": "X axis"}, "spec": "axis=x,angle=50"}

FACES_OF = {
    "move": Face(lambda: ow.deform(X, FACES, of(move=(0.02, 0, 0))), {"move": [0.02, 0, 0]}, "move=0.02:0:0"),
    "pivot": Face(
        lambda: ow.deform(X, FACES, of(axis="z", angle=40, pivot="centroid")),
        {"angle": 40, "rotcenter": "barycenter"},
        "axis=z,angle=40,pivot=centroid",
    ),
    "pivot point": Face(
        lambda: ow.deform(X, FACES, of(axis="z", angle=10, pivot=(0.1, 0, 1))),
        {"angle": 10, "rotcenter": "custom point", "customcenter": [0.1, 0, 1]},
        "axis=z,angle=10,pivot=0.1:0:1",
    ),
    "soft": Face(
        lambda: ow.deform(X, FACES, of(move=(0.02, 0, 0), weight=0.5)),
        {"move": [0.02, 0, 0], "softweight": 0.5},
        "move=0.02:0:0,weight=0.5",
    ),
    "snap": Face(
        lambda: ow.deform(X, FACES, of(move=(0.02, 0, 0), weight=0.5, snap=True)),
        {"move": [0.02, 0, 0], "softweight": 0.5, "snap": True},
        "move=0.02:0:0,weight=0.5,snap",
    ),
    "targets": Face(
        lambda: ow.deform(X, FACES, of(to=THERE[HEAD], rotation="fit"), refine=4),
        {"targetattribute": "there", "fitrotation": True},
        "to=there.obj,rotation=fit",
        {"refine": 4},
        ["--refine", "4"],
        {"refine": 4},
    ),
    "three factors": Face(
        lambda: ow.deform(X, FACES, of(stretch=(2, 1, 0.5), frame=(0, 0, 0.4))),
        {"stretchfactors": [2, 1, 0.5], "stretchframe": [0, 0, 0.4]},
        "stretch=2:1:0.5,frame=0:0:0.4",
    ),
    "refine": Face(
        turned(refine=ow.Arap(6, 1e-4, "spokes", 0.02)),
        **TURN,
        deformation={"refine": 6, "refinetolerance": 1e-4, "cells": "spokes", "smoothrotations": 0.02},
        options=["--refine", "6", "--refine-tol", "1e-4", "--cells", "spokes", "--smooth-rotations", "0.02"],
        recipe={"refine": 6, "refine_tol": 1e-4, "cells": "spokes", "smooth_rotations": 0.02},
    ),
    "struts": Face(
        turned(struts=0.7), **TURN, deformation={"struts": 0.7}, options=["--struts", "0.7"], recipe={"struts": 0.7}
    ),
    "biharmonic": Face(
        turned(falloff=ow.Biharmonic()),
        **TURN,
        deformation={"smoothing": "biharmonic"},
        options=["--falloff", "biharmonic"],
        recipe={"falloff": "biharmonic"},
    ),
    "geodesic": Face(
        turned(falloff=ow.Geodesic(0.6, "sharp")),
        **TURN,
        deformation={"smoothing": "geodesic", "radius": 0.6, "profile": "sharp"},
        options=["--falloff", "geodesic", "--radius", "0.6", "--profile", "sharp"],
        recipe={"falloff": "geodesic", "radius": 0.6, "profile": "sharp"},
    ),
    "t": Face(
        lambda: ow.Keyframes(ow.Deformer(X, FACES), of(axis="x", angle=50)).solve(0.4).x,
        **TURN,
        deformation={"t": 0.4},
        options=["--t", "0.4"],
    ),
    "centroid": Face(
        turned(constraints=[ow.constraints.centroid(MIDDLE, (0.05, 0, 0.5))]),
        **TURN,
        options=["--constraint", "centroid", "select=abs(z-0.5)<0.05,to=0.05:0:0.5"],
        recipe={"constraints": [{"kind": "centroid", "select": "abs(z-0.5)<0.05", "to": [0.05, 0, 0.5]}]},
        before=[
            ("set_oneform_constraint", {"kind": "centroid", "condselect": "abs(z-0.5)<0.05", "to": [0.05, 0, 0.5]})
        ],
    ),
    "soft length": Face(
        turned(constraints=[ow.constraints.edge_length(40, 80, 0.5, direction=(0, 0, 1), weight=2.0)]),
        **TURN,
        options=["--constraint", "edge_length", "a=40,b=80,length=0.5,direction=0:0:1,weight=2"],
        recipe={
            "constraints": [
                {"kind": "edge_length", "a": 40, "b": 80, "length": 0.5, "direction": [0, 0, 1], "weight": 2}
            ]
        },
        before=[
            (
                "set_oneform_constraint",
                {
                    "kind": "edge length",
                    "vertexa": 40,
                    "vertexb": 80,
                    "size": 0.5,
                    "direction": [0, 0, 1],
                    "softweight": 2,
                },
            )
        ],
    ),
}


def mesh_set() -> MeshSet:
    ms = MeshSet()
    ms.add_mesh(pymeshlab.Mesh(X, np.asarray(FACES)))
    ms.current_mesh().add_vertex_custom_point_attribute(THERE, "there")
    ms.apply_filter("set_oneform_handle", condselect="z < 0.1", held=True)
    return ms


@pytest.mark.parametrize("name", FACES_OF)
def test_a_filter_means_the_same_to_the_last_bit(name: str) -> None:
    face, ms = FACES_OF[name], mesh_set()
    ms.apply_filter("set_oneform_handle", condselect="z > 0.9", **face.handle)
    for filter_name, values in face.before:
        ms.apply_filter(filter_name, **values)
    ms.apply_filter("apply_coord_oneform_deformation", **face.deformation)
    assert np.array_equal(ms.current_mesh().vertex_matrix(), face.python())


def write_obj(path: Path, x: np.ndarray) -> None:
    lines = [f"v {p[0]!r} {p[1]!r} {p[2]!r}" for p in x.tolist()]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in np.asarray(FACES).tolist()]
    path.write_text("\n".join(lines) + "\n")


def run(folder: Path, *arguments: str) -> np.ndarray:
    write_obj(folder / "bar.obj", X)
    write_obj(folder / "there.obj", THERE)
    result = CliRunner().invoke(main, ["deform", str(folder / "bar.obj"), "-o", str(folder / "out.obj"), *arguments])
    assert result.exit_code == 0, result.output
    return np.asarray(read_mesh(folder / "out.obj").positions)


@pytest.mark.parametrize("name", FACES_OF)
def test_the_command_line_means_the_same(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    face = FACES_OF[name]
    y = run(tmp_path, "--hold", "z < 0.1", "--handle", "z > 0.9", face.spec, *face.options)
    assert np.abs(y - face.python()).max() < WRITTEN


@pytest.mark.parametrize("name", [name for name, face in FACES_OF.items() if face.recipe])
def test_a_recipe_means_the_same(name: str, tmp_path: Path) -> None:
    face = FACES_OF[name]
    handle = {"select": "z > 0.9"} | dict(part.partition("=")[::2] for part in face.spec.split(","))
    recipe = face.recipe | {"handles": [{"select": "z < 0.1", "held": True}, handle]}
    (tmp_path / "recipe.toml").write_text(tomli_w.dumps(recipe))
    assert np.abs(run(tmp_path, "--recipe", str(tmp_path / "recipe.toml")) - face.python()).max() < WRITTEN


def test_mirrored_handles_and_presets_on_the_command_line(tmp_path: Path) -> None:
    side = ow.Handle((X[:, 2] > 0.9) & (X[:, 0] > 0.05), axis="y", angle=30)
    expected = ow.deform(X, FACES, [HOLD, side, mirror(side, X, "x")])
    y = run(tmp_path, "--hold", "z < 0.1", "--handle", "z > 0.9 && x > 0.05", "axis=y,angle=30,mirror=x")
    assert np.abs(y - expected).max() < WRITTEN
    spec = "axis=y,angle=30,mirror=1:0:0,mirror_at=0,mirror_tolerance=0.001"
    y = run(tmp_path, "--hold", "z < 0.1", "--handle", "z > 0.9 && x > 0.05", spec)
    assert np.abs(y - expected).max() < WRITTEN
    expected = ow.deform(X, FACES, ow.presets.twist(X, 90, axis="z"))
    assert np.abs(run(tmp_path, "--preset", "twist,angle=90,axis=z") - expected).max() < WRITTEN
    recipe = {"presets": [{"preset": "twist", "angle": 90, "axis": "z"}]}
    (tmp_path / "recipe.toml").write_text(tomli_w.dumps(recipe))
    assert np.abs(run(tmp_path, "--recipe", str(tmp_path / "recipe.toml")) - expected).max() < WRITTEN


@pytest.mark.parametrize("command", ["deform", "animate"])
def test_mirrored_handles_are_drawn_and_reported(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("oneform_warp.preview.by_polyscope", lambda *_: None)
    monkeypatch.setattr("oneform_warp.movie.by_polyscope", lambda *_: None)
    write_obj(tmp_path / "bar.obj", X)
    side = (X[:, 2] > 0.9) & (X[:, 0] > 0.05)
    twin = mirror(ow.Handle(side), X, "x")
    files = {"deform": ["-o", "out.obj", "--preview", "a.png"], "animate": ["--preview", "a.gif", "--frames", "3"]}
    monkeypatch.chdir(tmp_path)
    handles = ["--hold", "z < 0.1", "--handle", "z > 0.9 && x > 0.05", "axis=y,angle=30,mirror=x"]
    result = CliRunner().invoke(main, [command, "bar.obj", *files[command], *handles, "--report", "r.json"])
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / "r.json").read_text())
    told = report["handles"] if command == "deform" else report["keyframes"][-1]["handles"]
    assert [each["vertices"] for each in told] == [FOOT.sum(), side.sum(), len(np.asarray(twin.vertices))]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--falloff", "geodesic"], "a geodesic falloff ends somewhere"),
        (["--radius", "0.3"], "a radius is for a geodesic falloff"),
        (["--falloff", "biharmonic", "--length", "0.3"], "falloff and length are both given"),
        (["--constraint", "middle", "to=0:0:1"], "there is no kind 'middle'"),
        (["--constraint", "centroid", "to=0:0:1"], "centroid needs a selection"),
        (["--constraint", "centroid", "select=z>0.9,to=0:0:1,too=1"], "there is no key 'too'; did you mean 'to'"),
        (["--constraint", "edge_length", "a=1,b=2"], "edge_length needs length"),
        (["--preset", "fold"], "there is no preset 'fold'"),
        (["--handle", "z > 0.9", "axis=z,angle=9,mirror_at=0.2"], "mirror_at is given without mirror"),
        (["--handle", "z > 0.9", "axis=z,angle=9,mirror=x,mirror_tolerance=0"], "the distance is 0"),
    ],
)
def test_what_cannot_be_is_named_and_nothing_is_written(arguments: list[str], message: str, tmp_path: Path) -> None:
    write_obj(tmp_path / "bar.obj", X)
    command = ["deform", str(tmp_path / "bar.obj"), "-o", str(tmp_path / "out.obj"), "--hold", "z < 0.1", *arguments]
    result = CliRunner().invoke(main, command)
    assert result.exit_code == 2 or result.exit_code == 1
    assert message in " ".join(result.output.split())
    assert not (tmp_path / "out.obj").exists()
