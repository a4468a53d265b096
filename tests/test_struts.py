"""Struts: who faces whom, what they weigh, and what they keep of a bar's volume."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from oneform_warp.struts import FIRMNESS, Struts, struts
from oneform_warp.surface import fan

EXACT = 1.0e-12
"""Rounding of float64 over a few operations."""

RAYS = 1.0e-4
"""Rays are float32, so of a thousand vertices one may face another corner when the mesh is turned."""


def lengths(x: np.ndarray, made: Struts) -> np.ndarray:
    return np.linalg.norm(x[made.pairs[:, 1]] - x[made.pairs[:, 0]], axis=1)


def volume(x: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = x[faces].transpose(1, 0, 2)
    return float((np.cross(a, b) * c).sum() / 6.0)


# ---------------------------------------------------------------------- who faces whom


@pytest.mark.parametrize("level", [2, 3])
def test_on_a_sphere_antipodes_face_each_other(level: int, device: str) -> None:
    x, faces = ow.shapes.sphere(level)
    made = struts(x, faces, device=device)
    # The icosphere is its own mirror image through the centre.
    np.testing.assert_allclose(x[made.pairs[:, 0]], -x[made.pairs[:, 1]], atol=EXACT)
    assert len(made.pairs) == len(x) // 2


def test_across_a_bar_struts_are_level_and_as_long_as_it_is_wide() -> None:
    x, faces = ow.shapes.bar(width=0.2, segments=20, sides=8, quads=True)
    made = struts(x, faces)
    first, second = x[made.pairs[:, 0]], x[made.pairs[:, 1]]
    # Off the edges, where the normals of two sides meet.
    low, high = np.minimum(first, second), np.maximum(first, second)
    inner = (np.abs(first[:, :2]).min(axis=1) < 0.09) & (low[:, 2] > 0.01) & (high[:, 2] < 0.99)
    assert inner.sum() > 200
    across = np.abs(second - first)[inner]
    np.testing.assert_allclose(across.max(axis=1), 0.2, atol=EXACT)
    np.testing.assert_allclose(np.sort(across, axis=1)[:, :2], 0.0, atol=EXACT)


def test_no_strut_runs_along_a_limb() -> None:
    x, faces = ow.shapes.bar(length=2.0, width=0.2, segments=40)
    # The ends' middles look along the whole bar; the longest way across a section is its diagonal.
    assert lengths(x, struts(x, faces)).max() < 0.2 * np.sqrt(2.0) + EXACT


def test_parts_keep_to_themselves_and_what_lies_inside_is_passed() -> None:
    x, faces = ow.shapes.sphere(3)
    both = np.concatenate([x, 0.5 * x]), np.concatenate([faces, faces + len(x)])
    made = struts(*both)
    alone = struts(x, faces)
    outer = (made.pairs < len(x)).all(axis=1)
    assert ((made.pairs < len(x)).any(axis=1) == outer).all()
    np.testing.assert_array_equal(made.pairs[outer], alone.pairs)
    np.testing.assert_array_equal(made.pairs[~outer] - len(x), alone.pairs)


# ---------------------------------------------------------------------- what does not matter


def test_seams_and_polygons_change_nothing() -> None:
    x, quads = ow.shapes.bar(segments=10, sides=4, quads=True)
    made = struts(x, quads)
    soup = np.arange(quads.size).reshape(quads.shape)
    apart = struts(x[quads.ravel()], soup)
    number = quads.ravel()  # the first vertex of a node stands for it, whichever of its copies that is
    np.testing.assert_array_equal(np.unique(np.sort(number[apart.pairs], axis=1), axis=0), made.pairs)
    triangles = fan(quads.ravel(), np.arange(0, quads.size + 1, 4))
    np.testing.assert_array_equal(struts(x, triangles).pairs, made.pairs)
    np.testing.assert_array_equal(struts(x, triangles).weights, made.weights)


def test_inside_out_faces_have_the_same_inside() -> None:
    x, faces = ow.shapes.torus(24, 12)
    np.testing.assert_array_equal(struts(x, faces[:, ::-1]).pairs, struts(x, faces).pairs)


@settings(max_examples=20)
@given(
    turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    scale=st.floats(1.0e-3, 1.0e3),
    shift=st.tuples(*[st.floats(-10.0, 10.0)] * 3),
)
def test_struts_move_with_the_mesh(turn: tuple, scale: float, shift: tuple) -> None:
    x, faces = ow.shapes.starfish(level=3, core=0.4)
    # Off the symmetric: where a ray hits the middle of a face, rounding decides which corner is nearest.
    x = x * (1.0 + 0.01 * np.sin(37.0 * np.arange(len(x))))[:, None]
    here = struts(x, faces)
    y = scale * (Rotation.from_rotvec(turn).apply(x) + shift)
    there = struts(y, faces)
    as_sets = [{tuple(pair) for pair in made.pairs.tolist()} for made in (here, there)]
    assert len(as_sets[0] ^ as_sets[1]) <= np.ceil(RAYS * len(x)) + 1
    weight = dict(zip(map(tuple, here.pairs.tolist()), here.weights, strict=True))
    common = [
        (weight[tuple(p)], w) for p, w in zip(there.pairs.tolist(), there.weights, strict=True) if tuple(p) in weight
    ]
    one, other = np.array(common).T
    assert np.isclose(one, other, rtol=1.0e-9).mean() > 1.0 - 10.0 * RAYS


def test_the_same_input_gives_the_same_bits() -> None:
    x, faces = ow.shapes.starfish(level=3)
    first, second = struts(x, faces), struts(x, faces)
    np.testing.assert_array_equal(first.pairs, second.pairs)
    np.testing.assert_array_equal(first.weights, second.weights)


# ---------------------------------------------------------------------- what they weigh


def test_weights_on_a_sphere_in_closed_form() -> None:
    x, faces = ow.shapes.sphere(3, radius=2.5)
    made = struts(x, faces)
    a, b, c = x[faces].transpose(1, 0, 2)
    third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
    area = sum(np.bincount(corner, third, len(x)) for corner in faces.T)
    # Both ends look at each other, so a pair counts twice.
    expected = 2.0 * FIRMNESS * np.minimum(*area[made.pairs.T]) / 5.0**2
    np.testing.assert_allclose(made.weights, expected, rtol=1.0e-9)


def test_all_struts_of_a_body_weigh_alike_whatever_its_mesh() -> None:
    total = []
    for level in (3, 4, 5):
        x, faces = ow.shapes.sphere(level)
        made = struts(x, faces)
        total.append(float((made.weights * lengths(x, made) ** 2).sum()) / FIRMNESS)
    # Of a sphere the whole area, but for what the smaller end of each pair lacks.
    np.testing.assert_allclose(total, 4.0 * np.pi, rtol=0.05)


# ---------------------------------------------------------------------- what has no inside


@pytest.mark.parametrize(
    "mesh",
    [ow.shapes.grid(4, 4), ow.shapes.cylinder(closed=False), (ow.shapes.sphere(1)[0], ow.shapes.sphere(1)[1][1:])],
    ids=["grid", "tube", "hole"],
)
def test_a_mesh_without_an_inside_is_named(mesh: tuple) -> None:
    with pytest.raises(ow.InputError, match=r"no part of the mesh is closed.*close its holes"):
        struts(*mesh)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.3, 0.7, -0.2)])
def test_a_sheet_of_two_sides_has_no_inside(turn: tuple) -> None:
    x, faces = ow.shapes.bumpy_plane(12, 12)
    # Turned and far away, its volume is not 0 but rounding.
    there = Rotation.from_rotvec(turn).apply(x) + 100.0 * np.array(turn)
    with pytest.raises(ow.InputError, match="no part of the mesh is closed"):
        struts(there, np.concatenate([faces, np.roll(faces, 1, axis=0)[:, ::-1]]))


def test_open_parts_beside_closed_ones_have_none_and_are_counted() -> None:
    x, faces = ow.shapes.sphere(2)
    y, others = ow.shapes.grid(3, 3)
    lonely = np.array([[9.0, 9.0, 9.0]])
    made = struts(np.concatenate([x, y + 5.0, lonely]), np.concatenate([faces, others + len(x)]))
    np.testing.assert_array_equal(made.pairs, struts(x, faces).pairs)
    assert made.hollow == 1
    assert struts(x, faces).hollow == 0


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_any_faces_give_pairs_or_a_named_error(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 30))
    x = rng.normal(size=(count, 3)) * rng.choice([0.0, 1.0], size=(count, 1), p=[0.1, 0.9])
    faces = rng.integers(0, count, size=(int(rng.integers(1, 40)), int(rng.integers(3, 6))))
    if rng.random() < 0.7:
        faces = np.concatenate([faces, faces[:, ::-1] if rng.random() < 0.3 else np.roll(faces, 1, axis=0)[:, ::-1]])
    try:
        made = struts(x, faces)
    except ow.InputError:
        return
    assert (made.pairs[:, 0] < made.pairs[:, 1]).all()
    assert np.isfinite(made.weights).all()
    assert ((made.weights > 0.0) & (made.weights <= FIRMNESS)).all()


# ---------------------------------------------------------------------- what they are for


def twisted(x: np.ndarray, faces: np.ndarray, handles: list[ow.Handle], made: Struts | None) -> np.ndarray:
    extra = {} if made is None else {"extra_edges": made.pairs, "extra_weight": made.weights}
    return ow.Deformer(x, faces, **extra).solve(handles).x


def ideal(x: np.ndarray, handles: list[ow.Handle], axis: int) -> np.ndarray:
    """The helicoid: every section turned as a whole, evenly between the handles."""
    along = x[:, axis]
    low, high = along[handles[0].vertices].max(), along[handles[1].vertices].min()
    part = np.clip((along - low) / (high - low), 0.0, 1.0)
    centre = (x.min(axis=0) + x.max(axis=0)) / 2.0
    return Rotation.from_rotvec(part[:, None] * handles[1].rotation).apply(x - centre) + centre


def edge_change(x: np.ndarray, y: np.ndarray, faces: np.ndarray) -> float:
    """RMS of the relative change of the edges' lengths."""
    edges = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    before, after = (np.linalg.norm(z[edges[:, 1]] - z[edges[:, 0]], axis=1) for z in (x, y))
    return float(np.sqrt(np.mean((after / before - 1.0) ** 2)))


def middle_radius(x: np.ndarray, axis: int, rest: np.ndarray) -> float:
    """The mean distance of the middle section's vertices from their centre."""
    along = rest[:, axis]
    heights = np.unique(along.round(6))
    ring = x[np.abs(along - heights[len(heights) // 2]) < 1.0e-5 * np.ptp(along)]
    return float(np.linalg.norm(ring - ring.mean(axis=0), axis=1).mean())


def check_twist(x: np.ndarray, faces: np.ndarray, axis: int, ends: tuple[np.ndarray, np.ndarray]) -> None:
    """The issue's bounds: 3 % at 180 degrees; at 720 15 %, radius 0.85 and the edges of 1.05 helicoids."""
    made = struts(x, faces)
    for angle, loss in ((180.0, 0.03), (720.0, 0.15)):
        handles = [ow.Handle(ends[0], held=True), ow.Handle(ends[1], axis="xyz"[axis], angle=angle)]
        y = twisted(x, faces, handles, made)
        assert volume(y, faces) / volume(x, faces) > 1.0 - loss
        assert volume(twisted(x, faces, handles, None), faces) / volume(x, faces) < 0.8, "without struts it gets thin"
    assert middle_radius(y, axis, x) > 0.85 * middle_radius(x, axis, x)
    assert edge_change(x, y, faces) < 1.05 * edge_change(x, ideal(x, handles, axis), faces)


@pytest.mark.parametrize(("segments", "sides"), [(30, 6), (60, 12)])
def test_one_strength_keeps_twisted_bars_of_any_mesh(segments: int, sides: int) -> None:
    x, faces = ow.shapes.bar(segments=segments, sides=sides)
    z = x[:, 2]
    check_twist(x, faces, 2, (z < 0.0667, z > 0.9333))


def test_the_same_strength_keeps_the_bar_of_the_survey(meshes: Path) -> None:
    from oneform_warp.filters.meshfile import read_mesh

    mesh = read_mesh(meshes / "arap_demo" / "bar1.off")
    status = np.loadtxt(meshes / "survey" / "made_by_us" / "bar1_twist720.sel", comments="#", dtype=int)
    check_twist(mesh.positions, np.asarray(mesh.faces), 1, (status == 0, status == 2))


def test_a_bent_bar_keeps_its_volume() -> None:
    x, faces = ow.shapes.bar(segments=60, sides=12)
    z = x[:, 2]
    handles = [ow.Handle(z < 0.0667, held=True), ow.Handle(z > 0.9333, axis="x", angle=120.0)]
    made = struts(x, faces)
    assert abs(volume(twisted(x, faces, handles, made), faces) / volume(x, faces) - 1.0) < 0.01
    assert volume(twisted(x, faces, handles, None), faces) / volume(x, faces) < 0.95


def test_a_weight_for_each_extra_edge() -> None:
    x, faces = ow.shapes.sphere(1)
    made = struts(x, faces)
    with pytest.raises(ow.InputError, match="extra_weight"):
        ow.Graph.from_faces(x, faces, extra_edges=made.pairs, extra_weight=made.weights[1:])
    plain = ow.Graph.from_faces(x, faces)
    graph = ow.Graph.from_faces(x, faces, extra_edges=made.pairs, extra_weight=made.weights)
    total = plain.mu.numpy().sum() + made.weights.sum()
    np.testing.assert_allclose(graph.mu.numpy().sum(), total, rtol=EXACT)
