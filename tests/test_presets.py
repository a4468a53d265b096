"""Presets: what each does to shapes whose answer is known, on any axis and any mesh, from Python and as filters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from oneform_warp import presets
from oneform_warp.principal import Span, across, principal

EXACT = 1.0e-12
"""Rounding of float64 over a few operations."""

SOLVED = 1.0e-4
"""The default tolerance of a solve, on shapes of size 1."""

X, FACES = ow.shapes.bar(segments=40, sides=6)
COMPROMISE = 0.06
"""Radians that a free end stays behind: least squares shares out what the edges cannot all have."""

END = 0.1 + 1.0e-6
TOP, BOTTOM = X[:, 2] > 1.0 - END, X[:, 2] < END

turns = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)


def solved(handles: list[ow.Handle], x: np.ndarray = X, faces: np.ndarray = FACES) -> np.ndarray:
    return ow.Deformer(x, faces).solve(handles).x


def best_turn(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The rotation vector that takes points to points best."""
    return Rotation.align_vectors(y - y.mean(axis=0), x - x.mean(axis=0))[0].as_rotvec()


def thickness(x: np.ndarray, at: float) -> float:
    """The mean distance of the section at a height from its centre, in the rest pose's rings."""
    ring = np.abs(X[:, 2] - at) < 1.0e-6
    return float(np.linalg.norm((x[ring] - x[ring].mean(axis=0))[:, :2], axis=1).mean())


# ---------------------------------------------------------------------- what each does to a bar


def test_a_bend_turns_the_far_end_and_holds_the_near_one() -> None:
    y = solved(presets.bend(X, 70.0, about="x"))
    np.testing.assert_array_equal(y[BOTTOM], X[BOTTOM])
    np.testing.assert_allclose(best_turn(X[TOP], y[TOP]), np.radians([70.0, 0.0, 0.0]), atol=COMPROMISE)


def test_without_a_direction_a_bend_is_the_easy_one() -> None:
    flat = X * [1.0, 3.0, 1.0]  # a ruler in y and z bends about y, out of its plane
    turned = presets.bend(flat, 30.0)[1]
    np.testing.assert_allclose(turned.rotation, np.radians([0.0, 30.0, 0.0]), atol=EXACT)


def test_a_twist_turns_about_the_axis_whole_turns_and_all() -> None:
    handles = presets.twist(X, 720.0)
    np.testing.assert_allclose(handles[1].rotation, [0.0, 0.0, 4.0 * np.pi], atol=EXACT)
    middle = np.abs(X[:, 2] - 0.5) < 1.0e-6
    omega = ow.Deformer(X, FACES).solve(handles).omega
    np.testing.assert_allclose(omega[middle, 2], 2.0 * np.pi, atol=0.05)


@pytest.mark.parametrize("factor", [0.5, 1.6])
def test_a_taper_changes_the_thickness_and_not_the_length(factor: float) -> None:
    y = solved(presets.taper(X, factor))
    assert np.isclose(thickness(y, 1.0) / thickness(X, 1.0), factor, rtol=0.03)
    assert np.isclose(np.ptp(y[:, 2]), 1.0, rtol=0.02)
    heights = [thickness(y, z) for z in (0.1, 0.3, 0.5, 0.7, 0.9)]
    assert (np.diff(heights) * np.sign(factor - 1.0) > -1.0e-3).all()


@pytest.mark.parametrize(("factor", "keep"), [(1.5, False), (0.7, False), (2.0, True)])
def test_a_stretch_is_even(factor: float, keep: bool) -> None:
    y = solved(presets.stretch(X, factor, keep_volume=keep))
    across = factor**-0.5 if keep else 1.0
    np.testing.assert_allclose(y, X * [across, across, factor], atol=SOLVED)


def test_a_swelling_is_where_it_was_asked_for() -> None:
    y = solved(presets.swell(X, 1.8, at=0.3))
    np.testing.assert_array_equal(y[BOTTOM | TOP], X[BOTTOM | TOP])
    sections = np.linspace(0.0, 1.0, 41)
    widths = np.array([thickness(y, z) / thickness(X, z) for z in sections])
    assert abs(sections[np.argmax(widths)] - 0.3) < 0.1
    assert np.isclose(widths.max(), 1.8, rtol=0.15)


def test_a_pose_turns_all_beyond_the_joint_about_it() -> None:
    y = solved(presets.pose(X, 60.0, about="x", at=0.4, room=0.2))
    low, high = X[:, 2] < 0.3 + 1.0e-6, X[:, 2] > 0.5 + 1.0e-6
    np.testing.assert_array_equal(y[low], X[low])
    joint = np.array([0.0, 0.0, 0.4])
    # The joint is the middle of the free rings, which end between two heights.
    expected = Rotation.from_rotvec(np.radians([60.0, 0.0, 0.0])).apply(X[high] - joint) + joint
    np.testing.assert_allclose(y[high], expected, atol=0.02)
    np.testing.assert_allclose(best_turn(X[high], y[high]), np.radians([60.0, 0.0, 0.0]), atol=1.0e-6)


def test_a_pose_at_selected_vertices_turns_the_smaller_side() -> None:
    band = np.abs(X[:, 2] - 0.7) < 0.06
    y = solved(presets.pose(X, 45.0, about="y", joint=band, faces=FACES))
    low, high = X[:, 2] < 0.63, X[:, 2] > 0.77
    np.testing.assert_array_equal(y[low], X[low])
    pivot = X[band].mean(axis=0)
    expected = Rotation.from_rotvec(np.radians([0.0, 45.0, 0.0])).apply(X[high] - pivot) + pivot
    np.testing.assert_allclose(y[high], expected, atol=EXACT)
    other = presets.pose(X, 45.0, joint=band, faces=FACES, beyond=int(np.argmin(X[:, 2])))
    np.testing.assert_array_equal(other[1].vertices, X[:, 2] < 0.63)


def test_a_joint_on_a_seam_cuts_both_sides_of_it() -> None:
    soup = X[FACES].reshape(-1, 3)
    corners = np.arange(len(soup)).reshape(-1, 3)
    band = np.abs(soup[:, 2] - 0.7) < 0.06
    low, high = presets.pose(soup, 45.0, joint=band, faces=corners)
    np.testing.assert_array_equal(high.vertices, soup[:, 2] > 0.77)
    np.testing.assert_array_equal(low.vertices, soup[:, 2] < 0.63)


def test_one_vertex_of_a_seam_stands_for_all_of_them() -> None:
    soup = X[FACES].reshape(-1, 3)
    corners = np.arange(len(soup)).reshape(-1, 3)
    _, first = np.unique(soup.round(9), axis=0, return_index=True)
    band = first[np.abs(soup[first, 2] - 0.7) < 0.06]
    low, high = presets.pose(soup, 45.0, joint=band, faces=corners)
    np.testing.assert_array_equal(high.vertices, soup[:, 2] > 0.77)
    np.testing.assert_array_equal(low.vertices, soup[:, 2] < 0.63)


def test_a_plane_bends_tapers_stretches_and_poses_within_itself() -> None:
    x, faces = ow.shapes.grid(40, 8, width=1.0, depth=0.2)
    flat = x[:, :2]
    for make in (presets.bend, presets.taper, presets.stretch, presets.swell, presets.pose):
        y = solved(make(flat), flat, faces)
        assert y.shape == flat.shape
        assert np.isfinite(y).all()
        assert np.abs(y - flat).max() > 0.02
    np.testing.assert_allclose(presets.bend(flat, 30.0)[1].rotation, np.radians([0.0, 0.0, 30.0]), atol=EXACT)
    with pytest.raises(ow.InputError, match="in D = 2"):
        presets.twist(flat)


# ---------------------------------------------------------------------- along the shape


@settings(max_examples=30)
@given(turn=turns, size=st.floats(0.01, 100.0), shift=turns)
def test_the_principal_axis_turns_with_the_shape(turn: np.ndarray, size: float, shift: np.ndarray) -> None:
    rotation = Rotation.from_rotvec(turn)
    x = size * rotation.apply(X * [1.0, 2.0, 1.0]) + shift
    along, beside = rotation.apply([0.0, 0.0, 1.0]), rotation.apply([0.0, 1.0, 0.0])
    assert np.isclose(abs(principal(x) @ along), 1.0, atol=1.0e-9)
    assert np.isclose(abs(across(x, principal(x)) @ beside), 1.0, atol=1.0e-9)
    assert principal(x)[np.argmax(np.abs(principal(x)))] > 0.0


def test_where_no_direction_is_longer_the_axes_of_space_are_taken() -> None:
    ball = ow.shapes.sphere(3)[0]
    np.testing.assert_allclose(principal(ball), [1.0, 0.0, 0.0], atol=1.0e-9)
    np.testing.assert_allclose(across(ball, principal(ball)), [0.0, 1.0, 0.0], atol=1.0e-9)
    nearly = ball * [1.0, 1.0, 1.005]  # what nobody sees must not decide
    np.testing.assert_allclose(principal(nearly), [1.0, 0.0, 0.0], atol=0.02)
    ring = ow.shapes.torus(24, 12)[0]
    np.testing.assert_allclose(principal(ring), [1.0, 0.0, 0.0], atol=1.0e-9)


@given(seed=st.integers(0, 9999), part=st.floats(0.01, 0.49))
def test_ends_are_never_empty_and_never_meet(seed: int, part: float) -> None:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(int(rng.integers(2, 300)), 3)) ** int(rng.integers(1, 10))
    low, high = Span.of(x, None).ends(part)
    assert low.any()
    assert high.any()
    assert not (low & high).any()


def test_the_axis_can_be_named_and_its_sign_says_which_end_stays() -> None:
    up, down = presets.twist(X, axis="z"), presets.twist(X, axis="-z")
    np.testing.assert_array_equal(up[0].vertices, down[1].vertices)
    np.testing.assert_array_equal(up[1].rotation, -down[1].rotation)
    np.testing.assert_array_equal(presets.twist(X, axis=(0.0, 0.0, 7.0))[1].rotation, up[1].rotation)
    np.testing.assert_allclose(presets.twist(X, axis="principal")[1].rotation, up[1].rotation, atol=EXACT)


# ---------------------------------------------------------------------- what cannot be meant

WRONG = [
    (lambda: presets.bend(X, axis="w"), "there is no axis 'w'"),
    (lambda: presets.bend(X, ends=0.5), "ends is 0.5"),
    (lambda: presets.bend(np.zeros((5, 3))), "the mesh has no extent"),
    (lambda: presets.bend(X * [1.0, 1.0, 0.0], axis="z"), "no extent along the axis"),
    (lambda: presets.bend(np.zeros((0, 3))), "0 vertices"),
    (lambda: presets.taper(X, 0.0), "factor is 0"),
    (lambda: presets.swell(X, -1.0), "factor is -1"),
    (lambda: presets.swell(X, at=1.0), "at is 1"),
    (lambda: presets.swell(X[BOTTOM | TOP]), "no vertex is left between the ends"),
    (lambda: presets.pose(X, at=0.05, room=0.2), "no vertex lies before the joint"),
    (lambda: presets.pose(X, at=0.95, room=0.2), "no vertex lies beyond the joint"),
    (lambda: presets.pose(X, joint=X[:, 2] > 0.5), "a joint needs faces"),
    (lambda: presets.pose(X, joint=[5], faces=FACES), "does not cut the mesh in two"),
    (lambda: presets.pose(X, joint=[], faces=FACES), "no vertex is selected"),
]


@pytest.mark.parametrize(("make", "text"), WRONG, ids=[text for _, text in WRONG])
def test_wrong_values_are_named(make: object, text: str) -> None:
    with pytest.raises(ow.InputError, match=text):
        make()  # type: ignore[operator]


@pytest.mark.parametrize("name", list(presets.PRESETS))
@pytest.mark.parametrize("folder", ["quads", "ugly"])
def test_every_preset_deforms_every_mesh(meshes: Path, folder: str, name: str) -> None:
    from oneform_warp.filters.meshfile import read_mesh

    # The folder paper holds the large ones; these two have what is broken and what is not triangles.
    for path in sorted((meshes / folder).glob("*.o[bf][jf]")):
        mesh = read_mesh(path)
        if len(mesh.positions) > 5000:
            continue
        if name == "swell" and len(mesh.positions) == 8:
            continue  # a cube has no vertex between its ends
        handles = presets.PRESETS[name](mesh.positions)
        solution = ow.Deformer(mesh.positions, mesh.faces).solve(handles)
        assert np.isfinite(solution.x).all(), path.name
        assert np.abs(solution.x - mesh.positions).max() > 1.0e-3 * np.ptp(mesh.positions), path.name
