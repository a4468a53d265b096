"""Presets as the command line and recipes spell them: checked before anything is loaded."""

from __future__ import annotations

from inspect import signature
from pathlib import Path

import numpy as np
import pytest

import oneform_warp as ow
from oneform_warp import presets
from oneform_warp.cli.preset_spec import VALUES, parse_preset, preset_from
from oneform_warp.filters import MeshFile, read_mesh


@pytest.fixture
def mesh(tmp_path: Path) -> MeshFile:
    import trimesh

    x, faces = ow.shapes.bar(segments=20, sides=4)
    trimesh.Trimesh(x, faces, process=False).export(tmp_path / "bar.ply")
    return read_mesh(tmp_path / "bar.ply")


SPELLED = [
    ("bend", "bend", {}),
    ("twist, angle=720, axis=-z", "twist", {"angle": 720.0, "axis": "-z"}),
    ("bend,axis=principal,about=0:1:1", "bend", {"about": (0.0, 1.0, 1.0)}),
    ("stretch,keep_volume,factor=2", "stretch", {"factor": 2.0, "keep_volume": True}),
    ("swell,at=0.3,ends=0.2", "swell", {"at": 0.3, "ends": 0.2}),
    ("pose,at=0.6,room=0.3", "pose", {"at": 0.6, "room": 0.3}),
]


@pytest.mark.parametrize(("text", "name", "options"), SPELLED, ids=[text for text, *_ in SPELLED])
def test_a_text_means_the_call(mesh: MeshFile, text: str, name: str, options: dict) -> None:
    made = parse_preset(text, "--preset").handles(mesh)
    expected = presets.PRESETS[name](mesh.positions, **options)
    for one, other in zip(made, expected, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
        np.testing.assert_array_equal(one.rotation, other.rotation)
        np.testing.assert_array_equal(one.stretch, other.stretch)


def test_a_joint_is_a_selection(mesh: MeshFile) -> None:
    made = parse_preset("pose,joint=z > 0.64 && z < 0.76,angle=30", "--preset").handles(mesh)
    np.testing.assert_array_equal(made[1].vertices, mesh.positions[:, 2] > 0.76)
    with pytest.raises(ow.InputError, match=r"the joint of pose.*no vertex is selected"):
        parse_preset("pose,joint=z > 7", "--preset").handles(mesh)


def test_a_table_means_the_same_as_a_text(mesh: MeshFile) -> None:
    table = preset_from("twist", {"angle": 90, "axis": [0, 0, 2]}, "recipe")
    assert table.options == parse_preset("twist,angle=90,axis=0:0:2", "--preset").options


def test_every_argument_can_be_spelled() -> None:
    for make in presets.PRESETS.values():
        assert set(signature(make).parameters) - {"x", "faces"} <= set(VALUES)


WRONG = [
    ("bned", "--preset: there is no preset 'bned'; did you mean 'bend'"),
    ("bend,agnle=3", "there is no key 'agnle'; did you mean 'angle'"),
    ("swell,about=x", "there is no key 'about'"),
    ("bend,angle", "angle has no value"),
    ("bend,angle=x", "angle: 'x' is not a number"),
    ("bend,angle=3,angle=4", "angle is given twice"),
    ("bend,,angle=4", "an empty part"),
    ("pose,beyond=1.5", "'1.5' is no vertex"),
    ("pose,joint=", "is no selection"),
]


@pytest.mark.parametrize(("text", "message"), WRONG, ids=[text for text, _ in WRONG])
def test_what_does_not_fit_is_named(text: str, message: str) -> None:
    with pytest.raises(ow.InputError) as error:
        parse_preset(text, "--preset")
    assert message in str(error.value)
