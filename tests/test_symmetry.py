"""Symmetry: a mirrored handle does on the other side what the handle does on this one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from oneform_warp.symmetry import Plane, mirror, mirror_vertices

EXACT = 1.0e-12
"""Rounding of float64 over a few operations, on shapes of size 1."""

SOLVED = 1.0e-5
"""Two solves to the default tolerance, the second on mirrored numbers."""

numbers = st.floats(-3.0, 3.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
normals = vectors.filter(lambda n: np.linalg.norm(n) > 0.1).map(lambda n: n / np.linalg.norm(n))


def reflected(x: np.ndarray, normal: np.ndarray, offset: float) -> np.ndarray:
    """Points on the other side, one at a time and from the definition."""
    return np.array([p - 2.0 * (p @ normal - offset) * normal for p in np.atleast_2d(x)])


def plane_with_sides() -> tuple[np.ndarray, np.ndarray]:
    """A sheet whose mesh is its own mirror image: quads, off the origin."""
    x, faces = ow.shapes.bumpy_plane(20, 20, quads=True)
    return x + [3.0, -1.0, 0.5], faces


# ---------------------------------------------------------------------- what is mirrored


@given(turn=vectors, normal=normals, offset=numbers, point=vectors)
def test_a_mirrored_rotation_is_the_mirror_image_of_the_motion(
    turn: np.ndarray, normal: np.ndarray, offset: float, point: np.ndarray
) -> None:
    plane = Plane(normal, offset, 3)
    handle = ow.Handle([0], rotation=turn)
    moved = Rotation.from_rotvec(turn).apply(point)
    image = np.eye(3) - 2.0 * np.outer(normal, normal)
    np.testing.assert_allclose(
        Rotation.from_rotvec(plane.turn(handle)).apply(image @ point), image @ moved, atol=1.0e-10
    )
    np.testing.assert_allclose(plane.points(point), reflected(point, normal, offset)[0], atol=1.0e-10)


@given(factors=st.tuples(*[st.floats(0.2, 5.0)] * 3), turn=vectors, normal=normals)
def test_a_mirrored_stretch_is_the_mirrored_tensor(factors: tuple, turn: np.ndarray, normal: np.ndarray) -> None:
    frame = Rotation.from_rotvec(turn).as_matrix()
    handle = ow.Handle([0], stretch=factors, frame=frame)
    there = Plane(normal, 0.0, 3).frame(handle)
    image = np.eye(3) - 2.0 * np.outer(normal, normal)
    tensor = frame @ np.diag(factors) @ frame.T
    np.testing.assert_allclose(there @ np.diag(factors) @ there.T, image @ tensor @ image, atol=1.0e-10)


def test_whole_turns_count_on_the_other_side_too() -> None:
    x, _ = plane_with_sides()
    twin = mirror(ow.Handle(x[:, 0] < 3.2, axis="z", angle=720.0), x)
    np.testing.assert_allclose(twin.rotation, [0.0, 0.0, -4.0 * np.pi], atol=EXACT)


def test_an_axis_along_the_normal_turns_the_same_way() -> None:
    x, _ = plane_with_sides()
    twin = mirror(ow.Handle(x[:, 0] < 3.2, axis="x", angle=30.0), x)
    np.testing.assert_allclose(twin.rotation, [np.pi / 6.0, 0.0, 0.0], atol=EXACT)


def test_everything_that_a_handle_has_is_mirrored() -> None:
    x, _ = plane_with_sides()
    low = np.flatnonzero(x[:, 0] < 3.11)[::-1]  # places are in the order of the vertices, whatever that is
    to, weight = x[low] + [0.1, 0.2, 0.3], 1.0 + np.arange(len(low))
    twin = mirror(ow.Handle(low, rotation=None, to=to, weight=weight, name="wing", snap=True), x)
    normal, offset = np.array([1.0, 0.0, 0.0]), 3.5
    partner = {tuple(np.round(p, 9)): k for k, p in enumerate(reflected(x[low], normal, offset))}
    order = [partner[tuple(np.round(x[v], 9))] for v in twin.vertices]
    np.testing.assert_allclose(twin.to, reflected(to, normal, offset)[order], atol=EXACT)
    np.testing.assert_array_equal(twin.weight, weight[order])
    assert (twin.name, twin.rotation, twin.snap, twin.held) == ("wing mirrored", None, True, False)
    moved = mirror(ow.Handle(low, move=[0.1, 0.2, 0.3], pivot=[3.0, 1.0, 2.0]), x)
    np.testing.assert_allclose(moved.move, [-0.1, 0.2, 0.3], atol=EXACT)
    np.testing.assert_allclose(moved.pivot, [4.0, 1.0, 2.0], atol=EXACT)
    assert mirror(ow.Handle(low, pivot="centroid", axis="y", angle=9.0), x).pivot == "centroid"
    assert mirror(ow.Handle(low, rotation="fit", to=to), x).fitted
    assert mirror(ow.Handle(low, held=True), x).held


def test_in_a_plane_the_angle_turns_round() -> None:
    x, _ = ow.shapes.grid(6, 6)
    twin = mirror(ow.Handle(x[:, 0] < 0.2, angle=40.0, move=[0.1, 0.2], pivot=[0.0, 0.5]), x[:, :2])
    assert twin.planar
    np.testing.assert_allclose(twin.rotation, [0.0, 0.0, -np.radians(40.0)], atol=EXACT)
    np.testing.assert_allclose(twin.move, [-0.1, 0.2, 0.0], atol=EXACT)
    np.testing.assert_allclose(twin.pivot, [1.0, 0.5, 0.0], atol=EXACT)


# ---------------------------------------------------------------------- which vertices


@pytest.mark.parametrize(("axis", "column"), [("x", 0), ("-x", 0), ("y", 1), ((0.0, 2.0, 0.0), 1)])
def test_on_a_symmetric_mesh_partners_are_mirror_images(axis: object, column: int) -> None:
    x, _ = plane_with_sides()
    own = np.flatnonzero(x[:, column] < x[:, column].min() + 0.21)
    twin = mirror(ow.Handle(own), x, axis)
    assert len(twin.vertices) == len(own)
    middle = (x[:, column].min() + x[:, column].max()) / 2.0
    images = reflected(x[own], np.eye(3)[column], middle)
    assert {tuple(p) for p in images.round(9) + 0.0} == {tuple(p) for p in x[twin.vertices].round(9) + 0.0}


def test_twice_mirrored_is_the_handle_itself() -> None:
    x, _ = plane_with_sides()
    handle = ow.Handle(np.flatnonzero(x[:, 0] < 3.3), axis=(1.0, 2.0, 3.0), angle=50.0, stretch=(1.0, 2.0, 3.0))
    twice = mirror(mirror(handle, x), x)
    np.testing.assert_array_equal(twice.vertices, handle.vertices)
    np.testing.assert_allclose(twice.rotation, handle.rotation, atol=EXACT)
    tensor = twice.frame @ np.diag(twice.stretch) @ twice.frame.T
    np.testing.assert_allclose(tensor, np.diag([1.0, 2.0, 3.0]), atol=EXACT)


def test_sides_of_other_density_still_match() -> None:
    left, right = ow.shapes.grid(10, 10, width=0.5)[0], ow.shapes.grid(23, 23, width=0.5)[0] * [-1.0, 1.0, 1.0]
    x = np.concatenate([left, right])
    own = np.flatnonzero((np.arange(len(x)) < len(left)) & (x[:, 0] > 0.4))
    found, partner = mirror_vertices(x, own, Plane(np.array([1.0, 0.0, 0.0]), 0.0), 0.1)
    assert (found >= len(left)).all()
    # Each has its image nearest to its partner: within half a cell of the coarser side.
    images = reflected(x[found], np.array([1.0, 0.0, 0.0]), 0.0)
    assert np.abs(images - x[own[partner]]).max() < 0.5 * 0.1 + EXACT
    assert abs(x[found][:, 0].max() + 0.4) < 0.05


def test_what_both_sides_share_stays_with_the_handle_given() -> None:
    x, _ = ow.shapes.grid(10, 10)
    own = np.flatnonzero(x[:, 0] < 0.65)
    twin = mirror(ow.Handle(own), x)
    assert not np.intersect1d(twin.vertices, own).size
    np.testing.assert_array_equal(twin.vertices, np.flatnonzero(x[:, 0] > 0.65))


def test_the_tolerance_says_how_symmetric_a_mesh_has_to_be() -> None:
    x, _ = ow.shapes.grid(10, 10)
    handle = ow.Handle(x[:, 0] < 0.15)
    with pytest.raises(ow.InputError, match=r"no vertex lies within 0\.01414"):
        mirror(handle, x, at=0.48)  # images lie 0.04 beside the vertices
    np.testing.assert_array_equal(mirror(handle, x, at=0.48, tolerance=0.05).vertices, np.flatnonzero(x[:, 0] > 0.85))


def test_what_has_no_other_side_is_named() -> None:
    x, _ = ow.shapes.grid(10, 10)
    with pytest.raises(ow.InputError, match=r"handle 'edge': no vertex lies within .* the nearest is 0.3 away"):
        mirror(ow.Handle(x[:, 0] < 0.05, name="edge"), x, at=0.65)
    with pytest.raises(ow.InputError, match="its own mirror image"):
        mirror(ow.Handle(np.abs(x[:, 0] - 0.5) < 0.15), x)
    with pytest.raises(ow.InputError, match="there is no axis 'w'"):
        mirror(ow.Handle([0]), x, "w")
    with pytest.raises(ow.InputError, match="no vertex is selected"):
        mirror(ow.Handle([]), x)


# ---------------------------------------------------------------------- what comes of it


def test_a_deformation_by_both_handles_is_symmetric() -> None:
    x, faces = plane_with_sides()
    handle = ow.Handle(x[:, 0] < 3.1, axis=(0.3, 1.0, 0.4), angle=60.0, stretch=1.3)
    body = ow.Handle(np.abs(x[:, 0] - 3.5) < 0.1, held=True)
    # Uniform weights: cotangents of quads depend on their first corners, which are not symmetric.
    y = ow.Deformer(x, faces, weights="uniform").solve([handle, mirror(handle, x), body]).x
    images = reflected(y, np.array([1.0, 0.0, 0.0]), 3.5)
    mirrored = reflected(x, np.array([1.0, 0.0, 0.0]), 3.5)
    partner = np.argmin(np.linalg.norm(x[:, None] - mirrored, axis=2), axis=1)
    np.testing.assert_allclose(y, images[partner], atol=SOLVED)
    assert np.abs(y - x).max() > 0.1
