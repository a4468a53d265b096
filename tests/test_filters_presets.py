"""Presets as filters: the same positions as from Python, and a place in chains and scripts."""

from __future__ import annotations

import numpy as np
import pymeshlab
import pytest

import oneform_warp as ow
from mesh_sets import bar, positions
from oneform_warp import presets
from oneform_warp.filters import MeshSet
from oneform_warp.filters.presets import PRESET_FILTERS

FILTERS = {each.name.removeprefix("apply_coord_oneform_"): each for each in PRESET_FILTERS}

CASES = [
    ("bend", {"angle": 40.0, "rotaxis": "X axis"}, {"angle": 40.0, "about": "x"}),
    ("bend", {}, {}),
    ("twist", {"angle": 200.0, "axis": "Z axis", "ends": 0.2}, {"angle": 200.0, "axis": "z", "ends": 0.2}),
    ("twist", {"axis": "custom axis", "customaxis": (0, 0, -2)}, {"axis": (0, 0, -2)}),
    ("taper", {"factor": 0.7}, {"factor": 0.7}),
    ("stretch", {"factor": 1.2, "keepvolume": True}, {"factor": 1.2, "keep_volume": True}),
    ("swell", {"factor": 1.3, "at": 0.4}, {"factor": 1.3, "at": 0.4}),
    ("pose", {"angle": 30.0, "at": 0.6, "room": 0.3}, {"angle": 30.0, "at": 0.6, "room": 0.3}),
]


def by_python(name: str, options: dict) -> np.ndarray:
    meshes = bar()
    x, faces = positions(meshes), meshes.current_mesh().face_matrix()
    return ow.Deformer(x, faces).solve(presets.PRESETS[name](x, **options)).x


@pytest.mark.parametrize(("name", "given", "options"), CASES, ids=[f"{c[0]}-{n}" for n, c in enumerate(CASES)])
def test_a_filter_gives_the_bits_of_the_function(name: str, given: dict, options: dict) -> None:
    meshes = bar()
    result = meshes.apply_filter(f"apply_coord_oneform_{name}", **given)
    assert result["converged"]
    np.testing.assert_array_equal(positions(meshes), by_python(name, options))


def test_every_preset_has_a_filter_with_its_parameters() -> None:
    assert set(FILTERS) == set(presets.PRESETS)
    for each in FILTERS.values():
        names = {parameter.name for parameter in each.parameters}
        assert {"axis", "customaxis", "solver", "refine"} <= names
        assert len(names) == len(each.parameters)


def test_selected_vertices_are_a_joint() -> None:
    meshes = bar()
    x = positions(meshes)
    meshes.compute_selection_by_condition_per_vertex(condselect="z > 0.45 && z < 0.55")
    meshes.apply_filter("apply_coord_oneform_pose", angle=50.0, rotaxis="X axis", joint="selection")
    y = positions(meshes)
    moved = np.abs(y - x).max(axis=1) > 1.0e-9
    assert not moved[x[:, 2] < 0.4].any()
    np.testing.assert_array_equal(moved[x[:, 2] > 0.6], x[x[:, 2] > 0.6, 2] > 0.6)


def test_presets_add_up_and_the_last_can_be_taken_back() -> None:
    meshes = bar()
    meshes.apply_filter("apply_coord_oneform_twist", angle=90.0)
    twisted = positions(meshes)
    meshes.apply_filter("apply_coord_oneform_bend", angle=60.0, axis="Z axis", rotaxis="X axis")
    expected = ow.Deformer(twisted, meshes.current_mesh().face_matrix()).solve(
        presets.bend(twisted, 60.0, axis="z", about="x")
    )
    np.testing.assert_array_equal(positions(meshes), expected.x)
    meshes.apply_filter("reset_oneform_deformation")
    np.testing.assert_array_equal(positions(meshes), twisted)


def test_a_preset_that_fails_leaves_mesh_and_handles_alone() -> None:
    meshes = bar()
    meshes.apply_filter("set_oneform_handle", condselect="z > 0.9", angle=10.0, name="mine")
    before = positions(meshes)
    with pytest.raises(pymeshlab.PyMeshLabException, match="the axis is zero"):
        meshes.apply_filter("apply_coord_oneform_bend", axis="custom axis")
    assert list(meshes.placed_handles().handles) == ["mine"]
    np.testing.assert_array_equal(positions(meshes), before)


def test_a_script_repeats_a_preset(tmp_path: object) -> None:
    meshes = bar()
    meshes.apply_filter("apply_coord_oneform_twist", angle=123.4)
    script = f"{tmp_path}/twist.mlx"
    meshes.save_filter_script(script)
    again = bar(MeshSet())
    again.load_filter_script(script)
    again.apply_filter_script()
    np.testing.assert_array_equal(positions(again), positions(meshes))
