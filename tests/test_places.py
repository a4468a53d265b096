"""Placed handles: hard and soft targets against dense least squares, rigid motions, fits, contradictions, named errors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import oneform_warp as ow

BOX = 1e-5  # of the bounding box: what the default precision promises
DENSE = 1e-8  # of the box: a direct solver in float64 against lstsq


def bar_ends(length: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    x, faces = ow.shapes.bar()
    z = x[:, 2] / length
    return x, faces, z < 0.1, z > 0.9


def dense_places(
    solution: ow.Deformation, x: np.ndarray, hard: dict[int, np.ndarray], soft: dict[int, tuple[float, np.ndarray]]
) -> np.ndarray:
    """min sum mu |x_j - x_i - v_ij|^2 + sum w |x_i - t_i|^2, hard targets kept, by NumPy's lstsq."""
    edges, mu = solution.graph.edges, solution.graph.mu.numpy()
    rows = np.arange(len(edges))
    d = np.zeros((len(edges) + len(soft), len(x)))
    d[rows, edges[:, 0]], d[rows, edges[:, 1]] = -np.sqrt(mu), np.sqrt(mu)
    right = np.zeros((len(d), 3))
    right[: len(edges)] = np.sqrt(mu)[:, None] * solution.v
    strength = np.bincount(edges.ravel(), np.repeat(mu, 2), len(x))
    for k, (vertex, (weight, target)) in enumerate(soft.items(), start=len(edges)):
        d[k, vertex] = np.sqrt(weight * strength[vertex])
        right[k] = d[k, vertex] * target
    y = np.array(x, dtype=float)
    fixed = np.array(list(hard), dtype=int)
    y[fixed] = np.array(list(hard.values())).reshape(-1, 3)
    free = np.setdiff1d(np.arange(len(x)), fixed)
    y[free] = np.linalg.lstsq(d[:, free], right - d[:, fixed] @ y[fixed], rcond=None)[0]
    return y


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), soft=st.booleans(), snap=st.booleans())
def test_targets_against_dense_least_squares(seed: int, soft: bool, snap: bool) -> None:
    rng = np.random.default_rng(seed)
    x, faces = ow.shapes.sphere(1)
    chosen = rng.permutation(len(x))[:12]
    to = x[chosen[:6]] + rng.normal(size=(6, 3))
    weights = np.exp(rng.uniform(-3, 3, size=6))
    moved = ow.Handle(chosen[:6], rotation=rng.normal(size=3), to=to, weight=weights if soft else None, snap=snap)
    held = ow.Handle(chosen[6:9], held=True)
    solution = ow.Deformer(x, faces, solver=ow.SuperLU(tol=1e-12)).solve([moved, held])
    pull = weights if soft else np.ones(6)
    hard = {int(v): x[v] for v in chosen[6:9]}
    if soft or snap:
        expected = dense_places(
            solution, x, hard, {int(v): (w, t) for v, w, t in zip(chosen[:6], pull, to, strict=True)}
        )
    else:
        expected = dense_places(solution, x, hard | {int(v): t for v, t in zip(chosen[:6], to, strict=True)}, {})
    if snap:
        expected[chosen[:6]] = to
    assert solution.converged
    assert np.abs(solution.x - expected).max() < DENSE * np.abs(expected).max()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_hard_targets_are_met_to_the_last_bit(dtype: type, device: str) -> None:
    x, faces, foot, head = bar_ends()
    x = x.astype(dtype)
    to = (x[head] + np.array([0.3, 0.1, 0.0])).astype(dtype)
    y = ow.deform(x, faces, [ow.Handle(foot, held=True), ow.Handle(head, to=to)], refine=3, device=device)
    assert (y[head] == to).all()
    assert (y[foot] == x[foot]).all()


def test_rows_of_targets_belong_to_the_vertices_in_their_order() -> None:
    x, faces, foot, head = bar_ends()
    numbers = np.flatnonzero(head)[::-1]
    to = x[numbers] + [0.0, 0.0, 0.2] * np.arange(len(numbers))[:, None] / len(numbers)
    y = ow.deform(x, faces, [ow.Handle(foot, held=True), ow.Handle(numbers, to=to)])
    assert np.array_equal(y[numbers], to)


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_handles_that_all_make_one_rigid_motion_carry_the_mesh_along(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, faces, foot, head = bar_ends()
    omega, pivot, move = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
    handles = [ow.Handle(part, rotation=omega, pivot=pivot, move=move) for part in (foot, head)]
    expected = pivot + Rotation.from_rotvec(omega).apply(x - pivot) + move
    for refine in (0, 2):
        y = ow.deform(x, faces, handles, refine=refine)
        assert np.abs(y - expected).max() < BOX * np.abs(expected).max()


def test_a_stretched_handle_grows_about_its_pivot() -> None:
    x, faces, foot, head = bar_ends()
    axes = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix()
    handle = ow.Handle(head, axis="z", angle=90, stretch=(2.0, 1.0, 0.5), frame=axes, pivot="centroid")
    y = ow.Deformer(x, faces).solve([ow.Handle(foot, held=True), handle]).x
    centre = x[head].mean(axis=0)
    turn = Rotation.from_rotvec([0.0, 0.0, np.pi / 2]).as_matrix()
    expected = centre + (x[head] - centre) @ (turn @ axes @ np.diag([2.0, 1.0, 0.5]) @ axes.T).T
    assert np.abs(y[head] - expected).max() < 1e-14


def test_a_soft_target_is_approached_as_its_weight_grows_and_snapped_on_request() -> None:
    x, faces, foot, head = bar_ends()
    move = np.array([0.02, 0.0, 0.0])
    hold = ow.Handle(foot, held=True)
    gaps = [
        np.linalg.norm(ow.deform(x, faces, [hold, ow.Handle(head, move=move, weight=w)])[head] - x[head] - move)
        for w in (0.001, 0.1, 10.0, 1000.0)
    ]
    assert (np.diff(gaps) < 0).all()
    assert gaps[-1] < 1e-3 * gaps[0]
    snapped = ow.deform(x, faces, [hold, ow.Handle(head, move=move, weight=0.1, snap=True)])
    assert np.array_equal(snapped[head], x[head] + move)


def test_the_fitted_rotation_is_the_one_that_made_the_targets() -> None:
    x, faces, foot, head = bar_ends()
    omega = np.array([0.4, -1.2, 2.0])
    noise = 1e-3 * np.random.default_rng(0).normal(size=(int(head.sum()), 3))
    to = Rotation.from_rotvec(omega).apply(x[head]) + noise
    solution = ow.Deformer(x, faces).solve([ow.Handle(foot, held=True), ow.Handle(head, rotation="fit", to=to)])
    found = solution.omega[head]
    expected = Rotation.align_vectors(to - to.mean(axis=0), x[head] - x[head].mean(axis=0))[0].as_rotvec()
    assert np.abs(found - expected).max() < 1e-9
    assert np.abs(found - omega).max() < 0.05


def test_targets_that_contradict_the_rotations_are_named_and_refining_settles_them() -> None:
    x, faces = ow.shapes.grid(20, 20)
    middle = np.linalg.norm(x[:, :2] - x[:, :2].mean(axis=0), axis=1) < 0.2 * np.ptp(x[:, 0])
    edge = (x[:, 0] == x[:, 0].min()) | (x[:, 0] == x[:, 0].max())
    handles = [ow.Handle(edge, held=True), ow.Handle(middle, move=(0, 0, 0.5 * np.ptp(x[:, 0])), name="bump")]
    deformer = ow.Deformer(x, faces)
    plain = deformer.solve(handles)
    diagonal = np.linalg.norm(np.ptp(x, axis=0))
    assert plain.misses[1] == pytest.approx(0.5 * np.ptp(x[:, 0]), rel=1e-3)
    assert any("'bump'" in text and f"{plain.misses[1] / diagonal:.0%}" in text for text in plain.warnings)
    assert not any("'bump'" in text for text in deformer.solve(handles, refine=20).warnings)


def test_targets_that_agree_with_the_rotations_are_no_reason_to_warn() -> None:
    x, faces, foot, head = bar_ends()
    free = ow.deform(x, faces, [ow.Handle(foot, held=True), ow.Handle(head, axis="x", angle=60)])
    handles = [ow.Handle(foot, held=True), ow.Handle(head, axis="x", angle=60, to=free[head])]
    solution = ow.Deformer(x, faces).solve(handles)
    assert solution.warnings == ()
    assert solution.misses[1] < BOX
    assert np.abs(solution.x - free).max() < BOX


def test_planes_and_lines_have_places_too() -> None:
    x, faces = ow.shapes.grid(8, 8)
    plane = x[:, :2]
    left, right = plane[:, 0] == plane[:, 0].min(), plane[:, 0] == plane[:, 0].max()
    y = ow.deform(plane, faces, [ow.Handle(left, held=True), ow.Handle(right, move=(0.01, 0.02))])
    assert np.allclose(y[right], plane[right] + [0.01, 0.02], atol=1e-15)
    line, chain = np.linspace(0.0, 1.0, 11), ow.Graph.from_polyline(11)
    moved = ow.Deformer(line, chain).solve([ow.Handle([0], held=True), ow.Handle([10], move=1.0)]).x
    assert np.abs(moved - 2.0 * line).max() < BOX


def test_a_component_of_one_vertex_goes_where_it_is_put() -> None:
    x, faces, foot, _ = bar_ends()
    x = np.vstack([x, [[5.0, 5.0, 5.0]]])
    lone = len(x) - 1
    handles = [ow.Handle(np.append(foot, False), held=True), ow.Handle([lone], move=(0, 0, 1.0))]
    assert np.array_equal(ow.Deformer(x, faces).solve(handles).x[lone], [5.0, 5.0, 6.0])


def test_several_meshes_at_once_have_places_of_their_own() -> None:
    x, faces, foot, head = bar_ends()
    big = 100.0 * x + 7.0
    numbers = np.flatnonzero(head)[::-1]
    jobs = [
        [ow.Handle(foot, held=True), ow.Handle(head, axis="z", angle=40, pivot=(0.1, 0.0, 1.0), move=(0.01, 0, 0))],
        [ow.Handle(foot, held=True), ow.Handle(numbers, to=big[numbers] + [1.0, 0.0, 2.0])],
    ]
    together = ow.Deformers([(x, faces), (big, faces)]).deform(jobs)
    for mesh, own, y in zip((x, big), jobs, together, strict=True):
        alone = ow.deform(mesh, faces, own)
        assert np.abs(y - alone).max() < BOX * np.ptp(mesh)


HEAD = [640, 641]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"held": True, "move": (0, 0, 1)}, "held and move are both given"),
        ({"to": [[0, 0, 0]] * 2, "pivot": (0, 0, 0)}, "to and pivot are both given"),
        ({"rotation": "fit"}, "cannot be fitted without targets"),
        ({"weight": 1.0}, "a weight pulls to a place, and none is given"),
        ({"snap": True}, "a weight pulls to a place, and none is given"),
        ({"move": (0, 0, 1), "weight": 0.0}, "weight is 0.0"),
        ({"move": (0, 0, np.nan)}, "move is"),
        ({"pivot": "middle"}, "pivot is 'middle'"),
        ({"stretch": (1.0, -1.0, 1.0)}, "stretch is"),
        ({"frame": np.eye(3)}, "a frame needs three factors"),
        ({"stretch": (1.0, 2.0, 1.0), "frame": np.ones((3, 3))}, "not orthonormal"),
        ({"to": [[0, 0, 0]]}, "to has 1 rows for 2 vertices"),
        ({"to": [[0, 0]] * 2}, "targets of 2 numbers where x has 3"),
        ({"to": [[0, 0, np.inf]] * 2}, "not finite"),
        ({"move": (0, 0, 1), "weight": [1.0, 2.0, 3.0]}, "weight has 3 rows for 2 vertices"),
    ],
)
def test_requests_that_cannot_be_met_are_named(options: dict[str, object], message: str) -> None:
    x, faces = ow.shapes.bar()
    with pytest.raises(ow.InputError, match=message):
        ow.deform(x, faces, [ow.Handle(HEAD, **options)])  # type: ignore[arg-type]


def test_two_places_for_one_vertex_are_named() -> None:
    x, faces, foot, head = bar_ends()
    handles = [ow.Handle(head, move=(0, 0, 1), name="up"), ow.Handle(head | foot, held=True, name="all")]
    with pytest.raises(ow.InputError, match=r"'up' and handle 'all' give different places"):
        ow.Deformer(x, faces).check(handles)
