"""Measures of a deformation against closed forms, brute force and what libigl's energy says written out."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from oneform_warp.errors import InputError
from oneform_warp.intersections import intersection_counts
from oneform_warp.measures import Measures, measures

ROUNDING = 1.0e-12  # sums of a few thousand products of float64 numbers of size 1


def rough_sphere(level: int = 2, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    x, faces = ow.shapes.sphere(level)
    return x * (1.0 + 0.1 * np.random.default_rng(seed).normal(size=(len(x), 1))), np.asarray(faces)


def still(m: Measures) -> dict[str, float]:
    """What a rigid motion must leave at its value."""
    return {
        "edge_rms": 0.0, "edge_max": 0.0, "arap": 0.0, "arap_spokes": 0.0, "symmetric_dirichlet": 4.0,
        "singular_min": 1.0, "singular_05": 1.0, "singular_50": 1.0, "singular_95": 1.0, "singular_max": 1.0,
        "area": 1.0, "volume": 1.0, "dihedral_rms": 0.0, "dihedral_max": 0.0,
    }  # fmt: skip


# ------------------------------------------------------------------ closed forms


@given(st.tuples(*[st.floats(-4.0, 4.0)] * 6))
def test_a_rigid_motion_changes_nothing(motion: tuple[float, ...]) -> None:
    x, faces = rough_sphere()
    m = measures(x, Rotation.from_rotvec(motion[:3]).apply(x) + motion[3:], faces, intersections=False)
    for name, value in still(m).items():
        # Angles of almost equal normals lose half the digits nowhere, but are in degrees.
        assert getattr(m, name) == pytest.approx(value, abs=1e-10), name


def test_a_scaled_sphere() -> None:
    x, faces = rough_sphere()
    m = measures(x, 2.0 * x, faces)
    assert m.edge_rms == pytest.approx(1.0, abs=ROUNDING)
    assert (m.area, m.volume) == pytest.approx((4.0, 8.0), abs=ROUNDING)
    assert (m.singular_min, m.singular_max) == pytest.approx((2.0, 2.0), abs=ROUNDING)
    assert m.symmetric_dirichlet == pytest.approx(2 * 4.0 + 2 * 0.25, abs=ROUNDING)
    assert m.dihedral_max == pytest.approx(0.0, abs=1e-10)
    # Every edge counts once, with d - R s = s: E = sum mu |s|^2 = twice the Dirichlet energy of x, 2 * 2 areas.
    areas = np.linalg.norm(np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]), axis=1) / 2
    assert m.arap == pytest.approx(2.0 * areas.sum(), rel=1e-12)
    assert m.arap_spokes == pytest.approx(m.arap, rel=1e-12)


def test_a_sheared_square() -> None:
    x, faces = ow.shapes.grid(8, 8)
    m = measures(x, x @ np.array([[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]]), faces)
    large, small = np.linalg.svd(np.array([[1.0, 0.5], [0.0, 1.0]]), compute_uv=False)
    assert (m.singular_max, m.singular_min) == pytest.approx((large, small), abs=ROUNDING)
    assert m.symmetric_dirichlet == pytest.approx(large**2 + small**2 + large**-2 + small**-2, abs=ROUNDING)
    assert m.area == pytest.approx(1.0, abs=ROUNDING)
    assert m.volume is None


def test_a_folded_sheet_and_a_cube_of_polygons() -> None:
    x = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]], dtype=float)
    folded = x.copy()
    folded[4:] = [[1, 0, 1], [1, 1, 1]]
    m = measures(x, folded, [[0, 1, 2, 3], [1, 4, 5, 2]])
    assert (m.dihedral_rms, m.dihedral_max) == pytest.approx((90.0, 90.0))
    assert m.edge_max == 0.0
    corners = np.array([[a, b, c] for a in (0, 1) for b in (0, 1) for c in (0, 1)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    m = measures(corners, corners * [3.0, 1.0, 1.0], quads)
    assert m.volume == pytest.approx(3.0)
    assert m.edge_rms == pytest.approx(np.sqrt(4 * 2.0**2 / 12)), "four of twelve edges are three times as long"


def test_the_fold_is_signed() -> None:
    """From 170 degrees upwards to 170 downwards are 20 the short way, past the fold."""
    x, faces = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0]], dtype=float), [[0, 2, 1], [0, 1, 3]]

    def bent(degrees: float) -> np.ndarray:
        y = x.copy()
        y[3] = [-np.cos(np.radians(degrees)), 0.0, np.sin(np.radians(degrees))]
        return y

    assert measures(bent(10.0), bent(-10.0), faces).dihedral_max == pytest.approx(20.0)
    assert measures(bent(170.0), bent(-170.0), faces).dihedral_max == pytest.approx(20.0)
    flipped = [faces[0], faces[1][::-1]]
    assert measures(bent(170.0), bent(-170.0), flipped).dihedral_max == pytest.approx(20.0)


def test_only_closed_surfaces_have_a_volume() -> None:
    x, faces = rough_sphere()
    assert measures(x, 2.0 * x, faces[1:]).volume is None
    assert measures(x, 2.0 * x, np.concatenate([faces[1:], faces[:1, ::-1]])).volume is None
    assert measures(x, 2.0 * x, faces[:, ::-1]).volume == pytest.approx(8.0)


# ------------------------------------------------------------------ the energy, written out


def written_out(x: np.ndarray, y: np.ndarray, faces: np.ndarray, turns: np.ndarray) -> tuple[float, float]:
    """Rims and spokes with these rotation vectors, as loops."""
    rotations = Rotation.from_rotvec(turns).as_matrix()
    rims = spokes = 0.0
    for face in faces:
        for k in range(3):
            i, j, o = face[k], face[(k + 1) % 3], face[(k + 2) % 3]
            a, b = x[i] - x[o], x[j] - x[o]
            half = 0.5 * (a @ b) / np.linalg.norm(np.cross(a, b))
            gap = [half * np.sum((y[j] - y[i] - rotations[v] @ (x[j] - x[i])) ** 2) for v in (i, j, o)]
            rims += sum(gap) / 3.0
            spokes += 0.5 * (gap[0] + gap[1])
    return rims, spokes


def test_energies_are_least_over_rotations() -> None:
    rng = np.random.default_rng(3)
    faces = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    x = rng.normal(size=(4, 3))
    y = x + 0.5 * rng.normal(size=x.shape)
    m = measures(x, y, faces)
    for value, kind in ((m.arap, 0), (m.arap_spokes, 1)):
        least = min(
            minimize(lambda t, k=kind: written_out(x, y, faces, t.reshape(-1, 3))[k], rng.normal(size=x.size)).fun
            for _ in range(6)
        )
        # The optimiser stops at gradients of 1e-5; some of its starts end elsewhere, at half a turn.
        assert value == pytest.approx(least, rel=1e-6)


def test_libigl_minimises_this_energy() -> None:
    igl = pytest.importorskip("igl")
    x, faces = rough_sphere(1)
    pins = np.array([0, len(x) // 2], dtype=np.int32)
    data = igl.ARAPData()
    data.energy, data.max_iter = igl.ARAP_ENERGY_TYPE_SPOKES_AND_RIMS, 2000
    igl.arap_precomputation(x, faces.astype(np.int64), 3, pins, data)
    y = igl.arap_solve(1.3 * x[pins], data, x.copy())
    step = 1e-4 * np.random.default_rng(0).normal(size=x.shape)
    step[pins] = 0.0
    here, ahead, back = (measures(x, y + t * step, faces, intersections=False).arap for t in (0.0, 1.0, -1.0))
    curved = ahead + back - 2.0 * here
    # At a minimum a step to either side raises the energy by the same.
    assert curved > 0.0
    assert abs(ahead - back) < 1e-2 * curved


def test_the_refinement_lowers_the_same_energy() -> None:
    """On a mesh without clamped cotangents it is the refinement's own, to the last digits."""
    x, faces = ow.shapes.sphere(3)
    handles = [ow.Handle(x[:, 2] < -0.8, held=True), ow.Handle(x[:, 2] > 0.8, axis="x", angle=60, move=(0.2, 0.0, 0.1))]
    deformation = ow.Deformer(x, faces).solve(handles, refine=30)
    scale = deformation._rest.scale
    assert measures(x, deformation.x, faces).arap == pytest.approx(
        # After the last step the positions are integrated once more, which lowers it by less than a step.
        deformation.refined.energies[-1] * scale**2,
        rel=1e-3,
    )


# ------------------------------------------------------------------ self-intersections


def exactly_pierces(p: np.ndarray, q: np.ndarray, triangle: np.ndarray) -> bool:
    """In fractions, by solving for where the segment meets the plane."""
    (p, q, a, b, c) = ([Fraction(float(v)) for v in point] for point in (p, q, *triangle))
    minus = lambda u, v: [s - t for s, t in zip(u, v, strict=True)]  # noqa: E731
    dot = lambda u, v: sum(s * t for s, t in zip(u, v, strict=True))  # noqa: E731
    cross = lambda u, v: [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]  # noqa: E731
    normal = cross(minus(b, a), minus(c, a))
    along = dot(normal, minus(q, p))
    if along == 0:
        return False
    t = dot(normal, minus(a, p)) / along
    point = [s + t * d for s, d in zip(p, minus(q, p), strict=True)]
    inside = [dot(normal, cross(minus(v, u), minus(point, u))) for u, v in ((a, b), (b, c), (c, a))]
    return 0 < t < 1 and all(s > 0 for s in inside)


@given(st.integers(0, 10_000), st.floats(-9.0, 9.0))
def test_triangles_intersect_as_in_exact_arithmetic(seed: int, far: float) -> None:
    rng = np.random.default_rng(seed)
    x = rng.uniform(size=(12, 3)) + 10.0**far * np.array([1.0, -1.0, 0.5])
    triangles = np.sort(rng.permuted(np.tile(np.arange(12), (8, 1)), axis=1)[:, :3])
    count = np.zeros(8, dtype=int)
    for f in range(8):
        for g in range(f):
            common = set(triangles[f]) & set(triangles[g])
            if len(common) > 1:
                continue
            for u, v in ((f, g), (g, f)):
                sides = [(triangles[u][k], triangles[u][k - 1]) for k in range(3)]
                if any(not {i, j} & common and exactly_pierces(x[i], x[j], x[triangles[v]]) for i, j in sides):
                    count[[f, g]] += 1
                    break
    assert np.array_equal(intersection_counts(x, triangles), count)


def test_two_spheres_intersect_where_meshlab_says(device: str) -> None:
    import pymeshlab

    x, faces = ow.shapes.sphere(3)
    both = np.concatenate([x, x + [0.9, 0.3, 0.2]])
    triangles = np.concatenate([faces, np.asarray(faces) + len(x)])
    found = intersection_counts(both, triangles, device=device) > 0
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(both, triangles.astype(np.int32)))
    meshes.compute_selection_by_self_intersections_per_face()
    assert np.array_equal(found, meshes.current_mesh().face_selection_array())
    assert found.any()


def test_a_bar_pushed_through_itself() -> None:
    x, faces = ow.shapes.bar(segments=20, sides=4)
    assert measures(x, x, faces).self_intersections == 0
    through = x.copy()
    low = through[:, 2] < 0.2
    through[low] += [0.03, 0.02, 0.5]
    assert measures(x, through, faces).self_intersections > 0
    assert measures(x, through, faces, intersections=False).self_intersections is None


# ------------------------------------------------------------------ handles and normals


def test_handles_and_normals() -> None:
    x, faces = ow.shapes.sphere(3)
    turn = np.array([0.0, 0.0, 0.5])
    y = Rotation.from_rotvec(turn).apply(x)
    diagonal = np.linalg.norm(np.ptp(x, axis=0))
    m = measures(x, y, faces, targets=([5, 3], y[[5, 3]] + [[0.1, 0.0, 0.0], [0.0, 0.3, 0.0]]))
    assert m.handle_max == pytest.approx(0.3 / diagonal)
    assert m.handle_rms == pytest.approx(np.sqrt((0.01 + 0.09) / 2) / diagonal)
    omega = np.tile(turn, (len(x), 1))
    assert measures(x, y, faces, omega=omega).normal_max == pytest.approx(0.0, abs=1e-10)
    assert measures(x, y, faces, omega=0.0 * omega, normals=x).normal_max < 3.0, "radial normals but for the mesh"
    stale = measures(x, y, faces, omega=omega, normals=x)
    equator = np.abs(x[:, 2]) < 0.05
    assert stale.normal_max == pytest.approx(np.degrees(0.5), abs=3.0)
    assert equator.any()


# ------------------------------------------------------------------ meshes that are not what one wishes


def test_ugly_meshes_give_numbers() -> None:
    x = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 0, 0], [5, 5, 5]], dtype=float)
    y = x + np.array([[0, 0, 0.1], [0, 0, 0], [0, 0, 0], [0, 0.2, 0], [0, 0, 0], [0, 0, 0]])
    faces = [[0, 1, 2], [0, 4, 3], [1, 1, 3], [0, 2, 3], []]
    m = measures(x, y, faces, omega=np.zeros_like(x))
    assert m.flat == 2
    assert all(np.isfinite(value) for value in m.known().values())


def test_collapsed_triangles_are_counted() -> None:
    x, faces = ow.shapes.grid(4, 4)
    m = measures(x, 0.0 * x, faces)
    assert m.collapsed == len(faces)
    assert m.symmetric_dirichlet == np.inf
    assert not any(np.isnan(value) for value in m.known().values())


def test_no_faces_and_the_plane() -> None:
    points = np.random.default_rng(0).normal(size=(5, 3))
    m = measures(points, points, np.zeros((0, 3), dtype=int))
    assert (m.edge_rms, m.arap, m.self_intersections) == (0.0, 0.0, 0)
    x, faces = ow.shapes.grid(4, 4)
    flat = measures(x[:, :2], 2.0 * x[:, :2], faces)
    assert flat.singular_max == pytest.approx(2.0)
    assert flat.self_intersections is None


def test_real_meshes(meshes: Path) -> None:
    from oneform_warp.filters import read_mesh

    for name in (
        "polygons/beritens_bend_644.ply",
        "ugly/libigl_degenerated.obj",
        "ugly/trimesh_bunny.ply",
        "ugly/suzanne.obj",
    ):
        mesh = read_mesh(meshes / name)
        m = measures(mesh.positions, 1.5 * np.asarray(mesh.positions), mesh.faces)
        assert not any(np.isnan(value) for value in m.known().values())
        assert m.area == pytest.approx(2.25), name


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"y": np.zeros((3, 3))}, "y: 3 rows where"),
        ({"targets": ([0], np.zeros((2, 3)))}, "targets: 2 rows where 1"),
        ({"targets": ([10_000], np.zeros((1, 3)))}, "10000 does not exist"),
        ({"omega": np.zeros((2, 3))}, "omega: 2 rows"),
        ({"faces": [[0, 1, 99_999]]}, "99999 does not exist"),
    ],
)
def test_input_errors(wrong: dict[str, object], says: str) -> None:
    x, faces = ow.shapes.sphere(1)
    with pytest.raises(InputError, match=says):
        measures(**{"x": x, "y": x, "faces": faces, **wrong})


# ------------------------------------------------------------------ the filter


def test_the_filter_measures_against_the_rest_pose() -> None:
    from mesh_sets import bar
    from oneform_warp.filters.measures import MEASURES

    meshes = bar()
    x, faces = np.array(meshes.current_mesh().vertex_matrix()), meshes.current_mesh().face_matrix()
    with pytest.raises(InputError, match="there is no deformation to measure"):
        MEASURES.apply(meshes, selfintersections=True, normals=False)
    meshes.set_oneform_handle(condselect="z < 0.1", held=True, name="foot")
    meshes.set_oneform_handle(condselect="z > 0.9", angle=90.0, name="head")
    meshes.apply_coord_oneform_deformation()
    found = MEASURES.apply(meshes, selfintersections=True, normals=True)
    solution = ow.Deformer(x, faces).solve(
        [ow.Handle(x[:, 2] < 0.1, held=True), ow.Handle(x[:, 2] > 0.9, axis="z", angle=90.0)]
    )
    expected = measures(x, solution.x, faces).known()
    assert {name: found[name] for name in expected} == expected
    assert (found["handle_max"], found["self_intersections"]) == (0.0, 0)
    assert 0.0 < found["normal_rms"] < 90.0
