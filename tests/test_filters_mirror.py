"""The parameter `mirror` of set_oneform_handle: a second handle, on the other side."""

from __future__ import annotations

import numpy as np
import pymeshlab
import pytest

import oneform_warp as ow
from oneform_warp.filters import MeshSet
from oneform_warp.symmetry import mirror


def sheet(quality: np.ndarray | None = None) -> MeshSet:
    x, faces = ow.shapes.grid(12, 6)
    meshes = MeshSet()
    values = {} if quality is None else {"v_scalar_array": quality}
    meshes.add_mesh(pymeshlab.Mesh(x, np.asarray(faces, dtype=np.int32), **values), "sheet")
    return meshes


def test_the_mirrored_handle_is_that_of_the_function() -> None:
    meshes = sheet()
    result = meshes.apply_filter(
        "set_oneform_handle", condselect="x < 0.2", name="left", rotation=[0.1, 0.2, 0.3], move=[0, 0, 0.5], mirror="x"
    )
    assert result["name"] == "left"
    x = meshes.current_mesh().vertex_matrix()
    twin = mirror(ow.Handle(x[:, 0] < 0.2, rotation=[0.1, 0.2, 0.3], move=[0.0, 0.0, 0.5]), x)
    made = meshes.placed_handles().handles["left mirrored"]
    np.testing.assert_array_equal(np.flatnonzero(made.mask), twin.vertices)
    np.testing.assert_array_equal(made.rotation, twin.rotation)
    np.testing.assert_array_equal(made.place["move"], twin.move[:3])


@pytest.mark.parametrize(
    ("values", "at"),
    [
        ({"mirror": "x", "mirrorrelativeto": "Origin", "mirroroffset": 0.25}, 0.25),
        ({"mirror": "x", "mirroroffset": -0.25}, 0.25),
        ({"mirror": "custom axis", "mirroraxis": [-2, 0, 0], "mirroroffset": 0.25}, 0.25),
    ],
)
def test_the_plane_is_anywhere(values: dict, at: float) -> None:
    meshes = sheet()
    meshes.apply_filter("set_oneform_handle", condselect="x < 0.1", name="left", angle=30.0, **values)
    x = meshes.current_mesh().vertex_matrix()
    twin = mirror(ow.Handle(x[:, 0] < 0.1, angle=30.0), x, "x", at=at)
    made = np.flatnonzero(meshes.placed_handles().handles["left mirrored"].mask)
    np.testing.assert_array_equal(made, twin.vertices)
    assert x[made, 0].min() > 0.4


def test_a_partner_may_be_as_far_as_is_said() -> None:
    meshes = sheet()
    values = {"condselect": "x < 0.1", "angle": 10.0, "mirror": "x", "mirroroffset": 0.02}
    with pytest.raises(pymeshlab.PyMeshLabException, match="mirror"):
        meshes.apply_filter("set_oneform_handle", **values)
    meshes.apply_filter("set_oneform_handle", **values, mirrortolerance="5%")
    assert len(meshes.placed_handles().handles) == 2


def test_painted_weights_are_those_of_the_partners() -> None:
    x = ow.shapes.grid(12, 6)[0]
    paint = np.where(x[:, 0] < 0.4, 1.0 - x[:, 0], 0.0) * (0.5 + x[:, 1] / 2.0)
    meshes = sheet(paint)
    meshes.apply_filter("set_oneform_handle", source="quality", angle=30.0, name="left", mirror="x")
    made = meshes.placed_handles().handles["left mirrored"]
    across = 1.0 - x[:, 0]
    expected = np.where(across < 0.4 - 1.0e-9, 1.0 - across, 0.0) * (0.5 + x[:, 1] / 2.0)
    np.testing.assert_allclose(made.weights, expected, atol=1.0e-12)
    np.testing.assert_allclose(made.rotation, [0.0, 0.0, -np.pi / 6.0], atol=1.0e-12)


def test_what_has_no_other_side_makes_no_handle_at_all() -> None:
    meshes = sheet()
    with pytest.raises(pymeshlab.PyMeshLabException, match="its own mirror image"):
        meshes.apply_filter("set_oneform_handle", condselect="x > 0.4 && x < 0.6", angle=10.0, mirror="x")
    assert not meshes.placed_handles().handles
