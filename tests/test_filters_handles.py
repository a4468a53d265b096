"""Handles on a mesh: where they come from, how long they live, and what deforming again does."""

from __future__ import annotations

import numpy as np
import pymeshlab
import pytest

import oneform_warp as ow
from mesh_sets import bar, positions
from oneform_warp.errors import InputError, OneFormWarning
from oneform_warp.filters import MeshSet
from oneform_warp.filters.handle_set import StaleHandles

ROW = 4  # vertices in each ring of the bar


def posed() -> MeshSet:
    meshes = bar()
    meshes.set_oneform_handle(condselect="z < 0.1", held=True, name="foot")
    meshes.set_oneform_handle(condselect="z > 0.9", angle=90.0, name="head")
    return meshes


def expected(x: np.ndarray, faces: np.ndarray, **head: object) -> np.ndarray:
    z = x[:, 2]
    return ow.deform(x, faces, [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, **head)])


def refused(meshes: MeshSet, name: str, /, **values: object) -> InputError:
    with pytest.raises(pymeshlab.PyMeshLabException) as caught:
        meshes.apply_filter(name, **values)
    assert isinstance(caught.value.__cause__, InputError)
    return caught.value.__cause__


def test_a_deformation_is_that_of_the_library_to_the_last_bit() -> None:
    meshes = posed()
    x, faces = positions(meshes), meshes.current_mesh().face_matrix()
    meshes.apply_coord_oneform_deformation()
    assert np.array_equal(positions(meshes), expected(x, faces, axis="z", angle=90.0))


# ------------------------------------------------------------------ where the vertices come from


def sources(meshes: MeshSet) -> dict[str, dict[str, object]]:
    """The top of the bar, z > 0.9, in each way that can mean it."""
    mesh = meshes.current_mesh()
    top = positions(meshes)[:, 2] > 0.9
    meshes.compute_selection_by_condition_per_vertex(condselect="z > 0.9")
    mesh.add_vertex_custom_scalar_attribute(top.astype(float), "top")
    meshes.set_vertex_scalar_array(top.astype(float))
    meshes.compute_color_by_function_per_vertex(x="(z > 0.9) ? 255 : 0", y="0", z="0")
    meshes.name_parts({"head": np.flatnonzero(top).astype(np.int32)})
    return {
        "selection": {},
        "selected vertices": {"source": "selected vertices"},
        "condition": {"condselect": "z > 0.9"},
        "color": {"source": "color", "color": (255, 0, 0)},
        "group": {"group": "head"},
        "quality": {"source": "quality"},
        "attribute": {"attribute": "top"},
    }


@pytest.mark.parametrize("source", ["selection", "selected vertices", "condition", "color", "group", "quality", "attribute"])  # fmt: skip
def test_every_source_finds_the_same_vertices(source: str) -> None:
    meshes = bar()
    meshes.set_oneform_handle(**sources(meshes)[source], name=source)
    mask = meshes.placed_handles().handles[source].mask
    assert np.array_equal(mask, positions(meshes)[:, 2] > 0.9)


def test_selected_faces_mean_their_vertices() -> None:
    meshes = bar()
    meshes.compute_selection_by_condition_per_face(condselect="z0 > 0.9 && z1 > 0.9 && z2 > 0.9")
    faces = meshes.current_mesh().face_matrix()[np.array(meshes.current_mesh().face_selection_array())]
    meshes.set_oneform_handle(name="top")
    assert np.array_equal(np.flatnonzero(meshes.placed_handles().handles["top"].mask), np.unique(faces))


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({}, "no vertex is selected"),
        ({"condselect": "z > 99"}, "no vertex is selected"),
        ({"condselect": "z >"}, "unexpected end"),
        ({"source": "quality"}, "paint weights above 0"),
        ({"source": "color"}, "check color"),
        ({"attribute": "paint"}, "no scalar attribute 'paint'"),
        ({"group": "head"}, "named parts"),
        ({"condselect": "z > 0.9", "attribute": "paint"}, "condition and attribute are given"),
        ({"condselect": "z > 0.9", "source": "quality"}, "condition and quality are given"),
        ({"condselect": "z > 0.9", "held": True, "angle": 3}, "cannot be rotated"),
        ({"condselect": "z > 0.9", "held": True, "stretch": 2}, "cannot be rotated or stretched"),
        ({"condselect": "z > 0.9", "angle": 3, "rotation": [1, 0, 0]}, "angle and rotation are given"),
        ({"condselect": "z > 0.9", "angle": 3, "freerotation": True}, "angle and freerotation are given"),
        ({"condselect": "z > 0.9", "angle": 3, "rotaxis": "custom axis"}, "the axis is zero"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_handle_says_why(values: dict[str, object], word: str) -> None:
    meshes = bar()
    assert word in str(refused(meshes, "set_oneform_handle", **values))
    assert not meshes.placed_handles().handles


@pytest.mark.parametrize(
    ("values", "rotation"),
    [
        ({"angle": 720, "rotaxis": "X axis"}, [4 * np.pi, 0, 0]),
        ({"angle": -45, "rotaxis": 1}, [0, -np.pi / 4, 0]),
        ({"angle": 90, "rotaxis": "custom axis", "customaxis": [3, 0, 4]}, [0.3 * np.pi, 0, 0.4 * np.pi]),
        ({"rotation": [0.1, 0.2, 0.3]}, [0.1, 0.2, 0.3]),
    ],
)
def test_axes_are_spelled_as_pymeshlabs_rotation_filter_spells_them(values: dict[str, object], rotation: list[float]) -> None:  # fmt: skip
    meshes = bar()
    meshes.set_oneform_handle(condselect="z > 0.9", name="top", **values)
    assert np.allclose(meshes.placed_handles().handles["top"].rotation, rotation, rtol=1e-15)


def test_the_rotation_turns_as_pymeshlabs_rotation_filter_does() -> None:
    turned, rotated = bar(), bar()
    turned.set_oneform_handle(condselect="z > -1", angle=50.0, rotaxis="custom axis", customaxis=[1.0, 2.0, -1.0])
    turned.apply_coord_oneform_deformation()
    rotated.compute_matrix_from_rotation(rotaxis="custom axis", customaxis=[1.0, 2.0, -1.0], angle=50.0)
    inward = [each - each.mean(axis=0) for each in (positions(turned), positions(rotated))]
    assert np.allclose(inward[0], inward[1], atol=1e-6)


# ------------------------------------------------------------------ painted weights


def test_painted_weights_are_the_falloff() -> None:
    meshes = bar()
    z = positions(meshes)[:, 2]
    meshes.compute_scalar_by_function_per_vertex(q="z")
    meshes.set_oneform_handle(condselect="z < 0.01", held=True)
    meshes.set_oneform_handle(source="quality", angle=90.0)
    meshes.apply_coord_oneform_deformation()
    omega = meshes.placed_handles().result.solution.omega
    assert np.allclose(omega, z[:, None] * [0.0, 0.0, np.pi / 2], atol=1e-12)


def test_weights_outside_0_to_1_are_refused_or_normalized() -> None:
    meshes = bar()
    meshes.compute_scalar_by_function_per_vertex(q="7*z-1")
    assert "run from -1 to 6" in str(refused(meshes, "set_oneform_handle", source="quality", angle=90.0))
    meshes.set_oneform_handle(source="quality", angle=90.0, normalize=True, name="paint")
    assert np.allclose(meshes.placed_handles().handles["paint"].weights, positions(meshes)[:, 2])


# ------------------------------------------------------------------ how long they live


@pytest.mark.parametrize(
    "between",
    [
        lambda meshes: meshes.compute_color_by_function_per_vertex(x="z"),
        lambda meshes: meshes.meshing_invert_face_orientation(),
        lambda meshes: meshes.compute_selection_by_condition_per_vertex(condselect="z > 0.5"),
    ],
)
def test_handles_survive_native_filters_that_keep_the_vertices(between: object) -> None:
    plain, with_filter = posed(), posed()
    between(with_filter)
    for meshes in (plain, with_filter):
        meshes.apply_coord_oneform_deformation()
    assert np.allclose(positions(plain), positions(with_filter), atol=1e-7)


def test_a_filter_that_moves_before_the_deformation_makes_the_rest_pose() -> None:
    meshes = posed()
    meshes.compute_matrix_from_scaling_or_normalization(axisx=2.0, axisy=2.0, axisz=2.0)
    x, faces = positions(meshes), meshes.current_mesh().face_matrix()
    meshes.apply_coord_oneform_deformation()
    z = x[:, 2] / 2
    handles = [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, axis="z", angle=90.0)]
    assert np.array_equal(positions(meshes), ow.deform(x, faces, handles))


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("meshing_surface_subdivision_midpoint", {"iterations": 1}),
        ("meshing_decimation_quadric_edge_collapse", {"targetfacenum": 20}),
        ("meshing_isotropic_explicit_remeshing", {"iterations": 1}),
    ],
)
def test_after_a_filter_that_changed_the_vertices_they_are_a_named_error(name: str, values: dict[str, object]) -> None:
    meshes = posed()
    meshes.apply_filter(name, **values)
    for own in ("apply_coord_oneform_deformation", "print_oneform_handles", "set_oneform_handle"):
        cause = refused(meshes, own, **({"condselect": "z > 0"} if own.startswith("set") else {}))
        assert isinstance(cause, StaleHandles)
        assert f"{name} changed the vertices" in str(cause)
    meshes.clear_oneform_handles()
    meshes.set_oneform_handle(condselect="z > 0.5", angle=10.0)
    meshes.apply_coord_oneform_deformation()


def test_handles_belong_to_a_mesh() -> None:
    meshes = bar(posed())
    assert meshes.mesh_number() == 2
    assert "no handles" in str(refused(meshes, "apply_coord_oneform_deformation"))
    meshes.set_current_mesh(0)
    meshes.apply_coord_oneform_deformation()
    meshes.delete_current_mesh()
    bar(meshes)
    assert "no handles" in str(refused(meshes, "apply_coord_oneform_deformation"))
    meshes.clear()
    assert meshes.handle_sets == {}


def test_deforming_again_starts_from_the_rest_pose() -> None:
    meshes = posed()
    x, faces = positions(meshes), meshes.current_mesh().face_matrix()
    meshes.apply_coord_oneform_deformation()
    meshes.set_oneform_handle(condselect="vi >= 0 && z > 0.9", angle=30.0, name="head")
    meshes.apply_coord_oneform_deformation()
    assert np.array_equal(positions(meshes), expected(x, faces, axis="z", angle=30.0))
    meshes.apply_coord_laplacian_smoothing(stepsmoothnum=2)
    meshes.apply_coord_oneform_deformation()
    assert np.array_equal(positions(meshes), expected(x, faces, axis="z", angle=30.0))
    meshes.reset_oneform_deformation()
    assert np.array_equal(positions(meshes), x)
    assert "not deformed" in str(refused(meshes, "reset_oneform_deformation"))


def test_clearing_all_handles_keeps_the_pose() -> None:
    meshes = posed()
    meshes.apply_coord_oneform_deformation()
    pose = positions(meshes)
    meshes.clear_oneform_handles()
    assert np.array_equal(positions(meshes), pose)
    assert "no handles" in str(refused(meshes, "apply_coord_oneform_deformation"))


def test_clearing_one_handle_leaves_the_others() -> None:
    meshes = posed()
    assert "did you mean 'foot'" in str(refused(meshes, "clear_oneform_handles", name="food"))
    meshes.clear_oneform_handles(name="head")
    assert list(meshes.placed_handles().handles) == ["foot"]


def test_printing_lists_names_counts_and_boxes(capsys: pytest.CaptureFixture[str]) -> None:
    meshes = posed()
    meshes.print_oneform_handles()
    foot, head = capsys.readouterr().out.splitlines()
    low = positions(meshes)[:, 2] < 0.1
    assert foot.startswith(f"foot: {low.sum()} vertices (x ")
    assert foot.endswith("held in place")
    assert "rotated by 90 degrees about (0 0 1)" in head


def test_a_transform_matrix_has_to_be_applied_first() -> None:
    meshes = bar()
    meshes.compute_matrix_from_rotation(angle=30, freeze=False)
    assert "apply_matrix_freeze" in str(refused(meshes, "set_oneform_handle", condselect="z > 0.9"))


# ------------------------------------------------------------------ fields, painted by hand and looked at


def test_fields_from_attributes_are_integrated() -> None:
    meshes = bar()
    x, faces = positions(meshes), meshes.current_mesh().face_matrix()
    omega = x[:, 2:] * [0.3, 0.0, 1.0]
    sigma = 1.0 + 0.2 * x[:, 2]
    meshes.current_mesh().add_vertex_custom_point_attribute(omega, "omega")
    meshes.current_mesh().add_vertex_custom_scalar_attribute(sigma, "sigma")
    meshes.set_oneform_handle(condselect="z < 0.1", held=True)
    meshes.apply_coord_oneform_integration(rotation="omega", stretch="sigma")
    held = ow.Handle(x[:, 2] < 0.1, held=True)
    assert np.array_equal(positions(meshes), ow.deform(x, faces, [held], fields=ow.Fields(omega, sigma)))


def test_integration_says_what_it_misses() -> None:
    meshes = posed()
    assert "there is no field" in str(refused(meshes, "apply_coord_oneform_integration"))
    assert "handles can only hold" in str(refused(meshes, "apply_coord_oneform_integration", rotation="omega"))
    meshes.clear_oneform_handles(name="head")
    assert "no point attribute 'omega'" in str(refused(meshes, "apply_coord_oneform_integration", rotation="omega"))


def test_fields_can_be_looked_at_as_quality() -> None:
    meshes = posed()
    assert "not deformed" in str(refused(meshes, "compute_scalar_oneform_field"))
    meshes.apply_coord_oneform_deformation()
    pose, solution = positions(meshes), meshes.placed_handles().result.solution
    mesh = meshes.current_mesh()
    meshes.compute_scalar_oneform_field()
    assert np.array_equal(mesh.vertex_scalar_array(), np.linalg.norm(solution.omega, axis=1))
    meshes.compute_scalar_oneform_field(field="stretch")
    assert np.array_equal(mesh.vertex_scalar_array(), solution.sigma)
    free = (positions(meshes) != 0).any(axis=1)
    meshes.compute_scalar_oneform_field(field="residual")
    assert free.any()
    assert np.max(mesh.vertex_scalar_array()) <= 1e-5
    result = meshes.compute_scalar_oneform_field(field="energy density")
    assert result["min"] >= 0.0
    assert np.array_equal(positions(meshes), pose)


def test_energy_densities_sum_to_the_energy() -> None:
    meshes = posed()
    energy = meshes.apply_coord_oneform_deformation()["energy"]
    placed = meshes.placed_handles()
    meshes.compute_scalar_oneform_field(field="energy density")
    corners = placed.rest[placed.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 6
    shares = np.bincount(placed.faces.ravel(), np.repeat(areas, 3), len(placed.rest))
    assert shares @ np.array(meshes.current_mesh().vertex_scalar_array()) == pytest.approx(energy, rel=1e-9)


def test_what_to_look_at_is_warned() -> None:
    meshes = posed()
    meshes.set_oneform_handle(condselect="z > 0.9", angle=3000.0, name="head")
    with pytest.warns(OneFormWarning) as warned:
        meshes.apply_coord_oneform_deformation()
    assert any("45 degrees" in str(each.message) for each in warned)
