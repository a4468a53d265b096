"""Filter scripts: native and own steps mixed, saved, loaded and replayed to the last bit."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mesh_sets import bar, positions
from oneform_warp.filters import Chain, MeshSet, Step
from oneform_warp.filters.mlx import YOUNGER, Applied, read_script, write_script
from oneform_warp.filters.native import native_filters
from oneform_warp.filters.registry import own_filters


def shown(path: Path) -> list[str]:
    return [element.get("name", "") for element in ET.parse(path).getroot()]


def test_native_and_own_steps_stand_in_order(tmp_path: Path) -> None:
    meshes = bar()
    meshes.compute_selection_by_condition_per_vertex(condselect="z < 0.1")
    meshes.set_oneform_handle(held=True)
    meshes.set_oneform_handle(condselect="z > 0.9", angle=30.0)
    meshes.apply_coord_oneform_deformation()
    meshes.compute_scalar_oneform_field()
    meshes.apply_coord_laplacian_smoothing(stepsmoothnum=1)
    meshes.save_filter_script(tmp_path / "a.mlx")
    assert shown(tmp_path / "a.mlx") == [
        "Conditional Vertex Selection", "set_oneform_handle", "set_oneform_handle", "apply_coord_oneform_deformation",
        "compute_scalar_oneform_field", "Laplacian Smooth",
    ]  # fmt: skip
    assert [step.filter for step in read_back(tmp_path / "a.mlx")] == [step.filter for step in meshes.steps]


def read_back(path: Path) -> list[Step]:
    return [applied.step for applied in read_script(path)]


def test_a_script_that_was_loaded_is_saved_as_it_was(tmp_path: Path) -> None:
    meshes = bar()
    meshes.apply_coord_taubin_smoothing(lambda_=0.123456789)
    meshes.set_oneform_handle(condselect="z > 0.9", angle=30.0)
    meshes.save_filter_script(tmp_path / "a.mlx")
    again = MeshSet()
    again.load_filter_script(tmp_path / "a.mlx")
    again.save_filter_script(tmp_path / "b.mlx")
    assert (tmp_path / "a.mlx").read_bytes() == (tmp_path / "b.mlx").read_bytes()


@given(percent=st.floats(0.5, 30.0), shift=st.floats(-1e3, 1e3))
def test_numbers_are_replayed_to_the_last_bit(percent: float, shift: float, tmp_path_factory: pytest.TempPathFactory) -> None:  # fmt: skip
    script = tmp_path_factory.mktemp("script") / "a.mlx"
    meshes, again = bar(), bar()
    meshes.compute_matrix_from_translation(traslmethod="XYZ translation", axisx=shift)
    meshes.meshing_merge_close_vertices(threshold=pymeshlab.PercentageValue(percent))
    meshes.save_filter_script(script)
    again.load_filter_script(script)
    again.apply_filter_script()
    assert np.array_equal(positions(meshes), positions(again))


@given(
    values=st.fixed_dictionaries(
        {
            "angle": st.floats(-1e6, 1e6),
            "rotaxis": st.sampled_from(["X axis", "custom axis"]),
            "customaxis": st.tuples(*[st.floats(-10, 10)] * 3),
            "color": st.tuples(*[st.integers(0, 255)] * 4),
            "name": st.text(st.characters(min_codepoint=32, exclude_categories=["Cs", "Cc"])),
            "held": st.booleans(),
        }
    )
)
def test_every_kind_of_own_value_comes_back(tmp_path_factory: pytest.TempPathFactory, values: dict[str, object]) -> None:  # fmt: skip
    own = own_filters()["set_oneform_handle"]
    plain = own.plain(values)
    script = tmp_path_factory.mktemp("script") / "a.mlx"
    write_script(script, [Applied(Step(own.name, plain))])
    (step,) = read_back(script)
    assert {name: step.parameters[name] for name in plain} == plain


def test_filters_that_filters_apply_are_no_steps() -> None:
    meshes = bar()
    meshes.set_oneform_handle(condselect="z > 0.9", angle=30.0)
    meshes.apply_coord_oneform_deformation()
    assert [step.filter for step in meshes.steps] == ["set_oneform_handle", "apply_coord_oneform_deformation"]


def test_a_filter_that_failed_is_no_step() -> None:
    meshes = bar()
    for name, values in (("set_oneform_handle", {}), ("apply_coord_laplacian_smoothing", {"nonsense": 1})):
        with pytest.raises(pymeshlab.PyMeshLabException):
            meshes.apply_filter(name, **values)
    assert meshes.steps == ()


def test_clearing_and_printing(capsys: pytest.CaptureFixture[str]) -> None:
    meshes = bar()
    meshes.set_oneform_handle(condselect="z > 0.9", angle=30.0)
    meshes.print_filter_script()
    assert "0: set_oneform_handle\n\tcondselect = 'z > 0.9'\n\tangle = 30.0" in capsys.readouterr().out
    meshes.clear_filter_script()
    meshes.apply_coord_laplacian_smoothing()
    assert [step.filter for step in meshes.steps] == ["apply_coord_laplacian_smoothing"]


def test_a_script_of_meshlab_becomes_a_chain(tmp_path: Path) -> None:
    plain = pymeshlab.MeshSet()
    plain.create_cube()
    plain.meshing_isotropic_explicit_remeshing(iterations=1, targetlen=pymeshlab.PercentageValue(10))
    plain.compute_matrix_from_rotation(rotaxis="Z axis", angle=20)
    plain.set_color_per_vertex(color1=pymeshlab.Color(1, 2, 3))
    plain.save_filter_script(str(tmp_path / "meshlab.mlx"))
    chain = Chain.from_script(tmp_path / "meshlab.mlx")
    assert [step.filter for step in chain.steps] == [
        "create_cube", "meshing_isotropic_explicit_remeshing", "compute_matrix_from_rotation", "set_color_per_vertex",
    ]  # fmt: skip
    assert chain.steps[2].parameters["rotaxis"] == 2
    assert chain.steps[3].parameters["color1"] == (1, 2, 3, 255)
    assert chain.steps[1].parameters["targetlen"] == pytest.approx(0.1 * np.sqrt(3), rel=1e-5)


def test_names_of_young_filters_are_pymeshlabs() -> None:
    assert set(YOUNGER.values()) <= native_filters()


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "not XML"),
        ("<html/>", "is not a filter script"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><FilterScript/>', "not a filter script"),
        ('<FilterScript><filter name="set_oneform_handel"/></FilterScript>', "did you mean 'set_oneform_handle'"),
        ('<FilterScript><filter name="set_oneform_handle"><Param type="RichFloat" name="stretch" value="-1"/></filter></FilterScript>', "filter 1"),
        ('<FilterScript><filter name="set_oneform_handle"><Param type="RichFloat" name="angle" value="x"/></filter></FilterScript>', "could not convert"),
        ('<FilterScript><filter name="Laplacian Smooth"><Param type="RichThing" name="a" value="x"/></filter></FilterScript>', "unknown type 'RichThing'"),
    ],
)  # fmt: skip
def test_scripts_that_cannot_be_used_say_why(text: str, word: str, tmp_path: Path) -> None:
    (tmp_path / "bad.mlx").write_text(text)
    meshes = bar()
    meshes.apply_coord_laplacian_smoothing()
    with pytest.raises(pymeshlab.PyMeshLabException) as caught:
        meshes.load_filter_script(tmp_path / "bad.mlx")
    assert word in str(caught.value)
    assert "bad.mlx" in str(caught.value)
    assert len(meshes.steps) == 1


def test_a_missing_script_and_a_missing_folder_are_errors(tmp_path: Path) -> None:
    with pytest.raises(pymeshlab.PyMeshLabException, match="cannot be read"):
        MeshSet().load_filter_script(tmp_path / "missing.mlx")
    with pytest.raises(pymeshlab.PyMeshLabException, match="cannot be written"):
        bar().save_filter_script(tmp_path / "none" / "a.mlx")
