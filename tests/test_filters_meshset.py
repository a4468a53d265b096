"""MeshSet: pymeshlab's face with our filters beside MeshLab's."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mesh_sets import bar, positions
from oneform_warp.errors import InputError, OneFormWarning
from oneform_warp.filters import Filter, MeshSet, filter_list, print_filter_parameter_list, registry
from oneform_warp.filters.parameters import Length, Number

FINITE = st.floats(-1e30, 1e30, allow_subnormal=False)


# ------------------------------------------------------------------ at home for users of pymeshlab


def test_the_script_of_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bar().save_current_mesh(str(tmp_path / "scan.ply"))
    monkeypatch.chdir(tmp_path)
    ms = MeshSet()
    ms.load_new_mesh("scan.ply")
    ms.compute_selection_by_condition_per_vertex(condselect="z < zmin + 0.1*(zmax-zmin)")
    ms.apply_filter("set_oneform_handle", held=True)
    ms.compute_selection_by_condition_per_vertex(condselect="z > zmin + 0.9*(zmax-zmin)")
    ms.apply_filter("set_oneform_handle", angle=90)  # degrees about rotaxis="Z axis", any number of turns
    ms.apply_filter("apply_coord_oneform_deformation")
    ms.apply_coord_laplacian_smoothing(stepsmoothnum=1)
    ms.save_current_mesh("posed.ply")
    written = MeshSet()
    written.load_new_mesh("posed.ply")
    assert positions(written).shape == positions(ms).shape


def test_apply_filter_and_method_style_are_one() -> None:
    by_name, by_method = bar(), bar()
    by_name.apply_filter("set_oneform_handle", condselect="z < 0.1", held=True)
    by_name.apply_filter("set_oneform_handle", condselect="z > 0.9", angle=90.0)
    by_name.apply_filter("apply_coord_oneform_deformation")
    by_method.set_oneform_handle(condselect="z < 0.1", held=True)
    by_method.set_oneform_handle(condselect="z > 0.9", angle=90.0)
    result = by_method.apply_coord_oneform_deformation()
    assert np.array_equal(positions(by_name), positions(by_method))
    assert result["converged"]
    assert result["iterations"] > 0


def test_lists_and_help_know_both_kinds(capsys: pytest.CaptureFixture[str]) -> None:
    names = filter_list()
    assert {"apply_coord_laplacian_smoothing", "set_oneform_handle"} <= set(names)
    assert "apply_coord_oneform_deformation" in dir(MeshSet())
    print_filter_parameter_list("set_oneform_handle")
    printed = capsys.readouterr().out
    assert "rotaxis : str = 'Z axis'" in printed
    assert "angle : float = 0" in printed
    assert "any number of turns" in MeshSet().set_oneform_handle.__doc__


def test_parameter_values_are_defaults_and_what_is_given() -> None:
    meshes = bar()
    values = meshes.filter_parameter_values("set_oneform_handle", angle=3)
    assert (values["angle"], values["rotaxis"], values["held"]) == (3.0, "Z axis", False)
    assert meshes.filter_parameter_values("apply_coord_laplacian_smoothing")["stepsmoothnum"] == 3


def test_percentages_are_of_the_bounding_box_diagonal() -> None:
    meshes = bar()
    diagonal = np.linalg.norm(np.ptp(positions(meshes), axis=0))
    for given_length in (pymeshlab.PercentageValue(10), "10%"):
        values = meshes.filter_parameter_values("apply_coord_oneform_deformation", length=given_length)
        assert values["length"] == pytest.approx(0.1 * diagonal, rel=1e-12)
    for given_length in (pymeshlab.PureValue(0.25), 0.25):
        values = meshes.filter_parameter_values("apply_coord_oneform_deformation", length=given_length)
        assert values["length"] == 0.25


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("set_oneform_handle", {"angel": 3}, ["Parameter angel not found for filter set_oneform_handle", "did you mean 'angle'"]),
        ("set_oneform_handle", {"angle": "x"}, ["Failed to apply filter: set_oneform_handle", "Details: angle"]),
        ("set_oneform_handle", {"angle": float("nan")}, ["angle is nan"]),
        ("set_oneform_handle", {"stretch": 0.0}, ["stretch is 0.0", "> 0"]),
        ("set_oneform_handle", {"colortolerance": 256}, ["colortolerance is 256", "<= 255"]),
        ("set_oneform_handle", {"rotaxis": "Q axis"}, ["rotaxis is 'Q axis'", "'custom axis'"]),
        ("set_oneform_handle", {"held": 1}, ["held is 1", "true or false"]),
        ("set_oneform_handle", {"customaxis": [1, 2]}, ["customaxis is [1, 2]", "three finite numbers"]),
        ("apply_coord_oneform_deformation", {"tolerance": 2.0}, ["tolerance is 2.0"]),
        ("apply_coord_oneform_deformation", {"maxiterations": -1}, ["maxiterations is -1", ">= 0"]),
        ("apply_coord_oneform_deformation", {"sweeps": 2.5}, ["sweeps is 2.5", "whole"]),
        ("apply_coord_oneform_deformation", {"length": "0%"}, ["length is '0%'", "> 0"]),
        ("apply_coord_oneform_deformation", {}, ["the mesh has no handles", "set_oneform_handle"]),
        ("nonsense", {}, ["Failed to apply filter: nonsense", "Filter does not exists"]),
    ],
)  # fmt: skip
def test_errors_have_pymeshlabs_wording_and_our_cause(name: str, values: dict[str, object], words: list[str]) -> None:
    meshes = bar()
    before = positions(meshes)
    with pytest.raises(pymeshlab.PyMeshLabException) as caught:
        meshes.apply_filter(name, **values)
    for word in words:
        assert word in str(caught.value)
    assert name == "nonsense" or isinstance(caught.value.__cause__, InputError)
    assert np.array_equal(positions(meshes), before)


def test_without_a_mesh_it_says_so_as_pymeshlab_does() -> None:
    for name in ("apply_coord_oneform_deformation", "apply_coord_laplacian_smoothing"):
        with pytest.raises(pymeshlab.PyMeshLabException, match="requires at least one mesh"):
            MeshSet().apply_filter(name)


def test_an_unknown_attribute_is_no_method() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        MeshSet().nonsense()


def test_a_mesh_id_that_is_not_there_is_an_error_and_no_crash() -> None:
    with pytest.raises(pymeshlab.PyMeshLabException, match="Mesh ID 77 not found"):
        bar().set_current_mesh(77)


def test_a_failed_load_leaves_the_folder(tmp_path: Path) -> None:
    (tmp_path / "bad.ply").write_text("ply\nformat nonsense\n")
    folder = os.getcwd()
    with pytest.raises(pymeshlab.PyMeshLabException, match="Unable to open file"):
        MeshSet().load_new_mesh(tmp_path / "bad.ply")
    assert os.getcwd() == folder


def test_a_filter_that_failed_leaves_no_crash_behind() -> None:
    """pymeshlab keeps a pointer to the log of the MeshSet whose filter failed; in another process, as it may crash."""
    code = """if True:
        import numpy as np, pymeshlab, sys, warp
        from oneform_warp.filters import MeshSet
        x = np.random.default_rng(0).random((5000, 3))
        faces = np.arange(4998, dtype=np.int32).reshape(-1, 3)
        for _ in range(5):
            meshes = MeshSet()
            meshes.add_mesh(pymeshlab.Mesh(x, faces))
            try:
                meshes.compute_selection_by_condition_per_vertex(condselect="nonsense")
            except pymeshlab.PyMeshLabException:
                pass
        del meshes
        meshes = MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(x, faces))
        meshes.save_current_mesh(sys.argv[1])
    """
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "MALLOC_PERTURB_": "165"}
        command = [sys.executable, "-c", code, f"{folder}/out.ply"]
        assert subprocess.run(command, env=environment, timeout=300, check=False).returncode == 0


def test_an_off_file_that_would_crash_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")
    with pytest.raises(pymeshlab.PyMeshLabException, match="a face uses vertex 7"):
        MeshSet().load_new_mesh(tmp_path / "bad.off")


# ------------------------------------------------------------------ coordinates and quality in place


@given(st.integers(3, 12).flatmap(lambda n: st.tuples(*[arrays(np.float64, (n, 3), elements=FINITE)] * 2)))
def test_coordinates_are_written_to_the_last_bit(pair: tuple[np.ndarray, np.ndarray]) -> None:
    before, after = pair
    meshes = MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(before, np.array([[0, 1, 2]], dtype=np.int32)))
    meshes.set_vertex_matrix(after)
    assert np.array_equal(positions(meshes), after)
    assert meshes.mesh_number() == 1


def test_writing_coordinates_keeps_every_attribute() -> None:
    meshes = bar()
    meshes.compute_scalar_by_function_per_vertex(q="z")
    meshes.compute_color_by_function_per_vertex(x="255*z", y="0", z="7")
    meshes.compute_selection_by_condition_per_vertex(condselect="z > 0.5")
    mesh = meshes.current_mesh()
    mesh.add_vertex_custom_scalar_attribute(np.arange(mesh.vertex_number(), dtype=float), "paint")
    quality, colors = np.array(mesh.vertex_scalar_array()), np.array(mesh.vertex_color_array())
    chosen = np.array(mesh.vertex_selection_array())
    meshes.set_vertex_matrix(positions(meshes) * [1.0, 2.0, 3.0])
    assert np.array_equal(mesh.vertex_scalar_array(), quality)
    assert np.array_equal(mesh.vertex_color_array(), colors)
    assert np.array_equal(mesh.vertex_selection_array(), chosen)
    assert np.array_equal(mesh.vertex_custom_scalar_attribute_array("paint"), np.arange(mesh.vertex_number()))


def test_quality_is_written_to_the_last_bit_and_nothing_moves() -> None:
    meshes = bar()
    before = positions(meshes)
    meshes.set_vertex_matrix(before * 2.0)
    meshes.set_vertex_matrix(before)
    normals = np.array(meshes.current_mesh().vertex_normal_matrix())
    values = np.random.default_rng(0).normal(size=len(before))
    meshes.set_vertex_scalar_array(values)
    assert np.array_equal(meshes.current_mesh().vertex_scalar_array(), values)
    assert np.array_equal(positions(meshes), before)
    assert np.array_equal(meshes.current_mesh().vertex_normal_matrix(), normals)


def test_wrong_coordinates_change_nothing() -> None:
    meshes = bar()
    before = positions(meshes)
    for wrong in (before[:-1], np.full_like(before, np.nan)):
        with pytest.raises(InputError):
            meshes.set_vertex_matrix(wrong)
    assert np.array_equal(positions(meshes), before)


# ------------------------------------------------------------------ filters of other packages


def lift(meshes: MeshSet, *, height: float, share: float) -> dict[str, float]:
    meshes.set_vertex_matrix(positions(meshes) + [0.0, 0.0, height * share])
    return {"lifted": height * share}


LIFT = Filter("apply_coord_lift", "Lifts the mesh.", (Length("height", "10%", "How far."), Number("share", 1.0, "Of it.")), lift)  # fmt: skip


@pytest.fixture
def offered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Entry points of another distribution: a filter, a list of filters, one that fails and one that is none."""
    names = ["LIFT", "LISTED", "missing", "NOT_ONE", "TAKEN"]
    entries = [EntryPoint(name.lower(), f"{__name__}:{name}", registry.GROUP) for name in names]
    monkeypatch.setitem(sys.modules, __name__, sys.modules[__name__])
    monkeypatch.setattr(registry, "entry_points", lambda *, group: entries if group == registry.GROUP else [])
    registry.own_filters.cache_clear()
    yield
    registry.own_filters.cache_clear()


LISTED = [Filter("get_nothing", "Nothing.", (), lambda meshes: None)]
NOT_ONE = ["no filter"]
TAKEN = Filter("apply_coord_laplacian_smoothing", "MeshLab's own name.", (), lambda meshes: None)


@pytest.mark.usefixtures("offered")
def test_third_party_filters_register_through_the_entry_point_group() -> None:
    with pytest.warns(OneFormWarning) as warned:
        assert {"apply_coord_lift", "get_nothing"} <= set(filter_list())
    assert [word for word in ("missing", "NOT_ONE", "TAKEN") if any(word in str(w.message) for w in warned)] == [
        "missing", "NOT_ONE", "TAKEN",
    ]  # fmt: skip
    meshes = bar()
    before = positions(meshes)
    diagonal = meshes.current_mesh().bounding_box().diagonal()
    result = meshes.apply_coord_lift(share=0.5)
    assert result["lifted"] == pytest.approx(0.05 * diagonal)
    assert np.array_equal(positions(meshes), before + [0.0, 0.0, result["lifted"]])
    meshes.apply_coord_laplacian_smoothing(stepsmoothnum=1)  # MeshLab's stays MeshLab's
