"""Stretches by three factors: the tensor's exponential, smoothing in log space, closed forms on a bar."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from oneform_warp.fields import Fields, NodeFields, smooth_fields
from references import components, random_graph

SEEDS = st.integers(0, 10**6)
ROUNDING = 4e-10  # of the vector: factors from 1/400 to 400, and their logarithms by eigenvalues, lose six digits
FIELD_ERROR = 1e-4  # tol 1e-6 times the condition number of the graphs here
SOLVER_ERROR = 1e-5  # of the size, tol 1e-6
RAMP_ERROR = 2e-3  # of the length: the mean of logs on edges of 1/60 against the integral


def log_of(stretch: Any, frame: np.ndarray) -> np.ndarray:
    """F diag(log s) F^T."""
    return frame @ np.diag(np.log(np.broadcast_to(stretch, 3))) @ frame.T


def exponential(symmetric: np.ndarray) -> np.ndarray:
    """exp of symmetric matrices (k, 3, 3), by their eigenvalues."""
    values, axes = np.linalg.eigh(symmetric)
    return np.einsum("vik,vk,vjk->vij", axes, np.exp(values), axes)


@settings(max_examples=40)
@given(seed=SEEDS)
def test_edges_are_stretched_by_the_mean_logarithm_and_then_turned(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, omega = rng.normal(size=(12, 3)), 4.0 * rng.normal(size=(12, 3))
    frames = Rotation.random(12, random_state=seed).as_matrix()
    factors = np.exp(rng.uniform(-6.0, 6.0, size=(12, 3)))
    logs = np.array([log_of(s, f) for s, f in zip(factors, frames, strict=True)])
    graph = ow.Graph.from_edges(12, rng.permutation(np.stack(np.triu_indices(12, 1), axis=1))[:30])
    nodes = NodeFields.of(graph, Fields(omega, stretch=exponential(logs)), 3)
    v = nodes.form(graph, graph.nodes_from(x)).numpy()
    i, j = graph.edges.T
    tensors = expm((logs[i] + logs[j]) / 2.0)
    stretched = np.einsum("eij,ej->ei", tensors, x[j] - x[i])
    expected = Rotation.from_rotvec((omega[i] + omega[j]) / 2.0).apply(stretched)
    assert (np.abs(v - expected).max(axis=1) <= ROUNDING * np.linalg.norm(tensors, axis=(1, 2))).all()


@settings(max_examples=40)
@given(seed=SEEDS)
def test_all_six_numbers_are_harmonic(seed: int) -> None:
    problem, rng = random_graph(seed, mu=(0.1, 10.0)), np.random.default_rng(seed)
    graph, count = problem.graph(), problem.vertex_count
    chosen = rng.permutation(count)[: max(1, count // 4)]
    frames = Rotation.random(len(chosen), random_state=seed).as_matrix()
    factors = np.exp(rng.normal(size=(len(chosen), 3)))
    handles = [
        ow.Handle([i], stretch=s, frame=f, rotation=rng.normal(size=3))
        for i, s, f in zip(chosen, factors, frames, strict=True)
    ]
    fields = smooth_fields(graph, handles)
    i, j = graph.edges.T
    mu, matrix = graph.mu.numpy(), np.zeros((count, count))
    np.add.at(matrix, (i, j), -mu)
    np.add.at(matrix, (j, i), -mu)
    matrix -= np.diag(matrix.sum(axis=1))
    logs = np.zeros((count, 9))
    logs[chosen] = [log_of(s, f).ravel() for s, f in zip(factors, frames, strict=True)]
    pinned = logs.copy()
    for group in components(count, problem.edges):
        inside, free = np.intersect1d(group, chosen), np.setdiff1d(group, chosen)
        if len(inside) and len(free):
            logs[free] = np.linalg.solve(matrix[np.ix_(free, free)], -matrix[np.ix_(free, inside)] @ pinned[inside])
    expected = exponential(logs.reshape(-1, 3, 3))
    assert np.abs(fields.stretch / expected.max() - expected / expected.max()).max() <= FIELD_ERROR
    assert fields.sigma == pytest.approx(np.linalg.det(fields.stretch) ** (1.0 / 3.0), rel=1e-9)


def bar() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    x, faces = ow.shapes.bar(segments=60)
    return x, faces, x[:, 2] < 0.1, x[:, 2] > 0.9


def test_a_bar_grows_twice_as_long_and_no_thicker() -> None:
    x, faces, low, high = bar()
    y = ow.deform(x, faces, [ow.Handle(low, stretch=(1, 1, 2)), ow.Handle(high, stretch=(1, 1, 2))])
    expected = x * [1.0, 1.0, 2.0]
    assert np.abs((y - y.mean(axis=0)) - (expected - expected.mean(axis=0))).max() <= SOLVER_ERROR


def test_a_ramp_of_stretches_along_the_bar_is_its_exponential() -> None:
    x, faces, _, _ = bar()
    z = x[:, 2]
    handles = [ow.Handle(z == 0.0, held=True), ow.Handle(z == z.max(), stretch=(1.0, 1.0, 3.0))]
    y = ow.deform(x, faces, handles)
    # log S_zz = z log 3: z goes to the integral of 3^z.
    assert np.abs(y[:, 2] - (3.0**z - 1.0) / np.log(3.0)).max() <= RAMP_ERROR * y[:, 2].max()
    assert np.abs(y[:, :2] - x[:, :2]).max() <= SOLVER_ERROR


def test_a_stretch_in_a_frame_is_that_of_a_turned_mesh() -> None:
    x, faces, low, high = bar()
    turn = Rotation.from_rotvec([0.3, -1.1, 0.6])
    here = [ow.Handle(low, held=True), ow.Handle(high, stretch=(1.5, 0.5, 2.0), rotation=(0.0, 0.0, 1.0))]
    there = [
        ow.Handle(low, held=True),
        ow.Handle(high, stretch=(1.5, 0.5, 2.0), frame=turn.as_matrix(), rotation=turn.apply([0.0, 0.0, 1.0])),
    ]
    y = ow.deform(turn.apply(x), faces, there)
    assert np.abs(y - turn.apply(ow.deform(x, faces, here))).max() <= SOLVER_ERROR


def test_the_rotation_acts_after_the_stretch() -> None:
    x, faces, low, high = bar()
    same = {"stretch": (1.0, 1.0, 2.0), "axis": "x", "angle": 90}
    y = ow.deform(x, faces, [ow.Handle(low, **same), ow.Handle(high, **same)])
    # The bar's own axis is stretched in the rest pose, and points to -y afterwards.
    assert np.ptp(y, axis=0) == pytest.approx([0.2, 2.0, 0.2], abs=SOLVER_ERROR)


def test_three_equal_factors_are_one_to_the_last_bit() -> None:
    x, faces, low, high = bar()
    one, three = (
        ow.Deformer(x, faces).solve([ow.Handle(low, held=True), ow.Handle(high, stretch=s, axis="z", angle=90)])
        for s in (1.7, (1.7, 1.7, 1.7))
    )
    assert (one.x == three.x).all()
    assert three.stretch is None


def test_a_factor_beside_three_counts_in_every_direction() -> None:
    x, faces, low, high = bar()
    deformation = ow.Deformer(x, faces).solve([ow.Handle(low, stretch=2.0), ow.Handle(high, stretch=(1.0, 1.0, 4.0))])
    assert deformation.stretch[low] == pytest.approx(np.broadcast_to(2.0 * np.eye(3), (low.sum(), 3, 3)))
    assert deformation.stretch[high] == pytest.approx(np.broadcast_to(np.diag([1.0, 1.0, 4.0]), (high.sum(), 3, 3)))
    assert deformation.sigma[high] == pytest.approx(4.0 ** (1.0 / 3.0))


def test_given_tensors_do_what_handles_made_of_them() -> None:
    x, faces, low, high = bar()
    deformer, held = ow.Deformer(x, faces), ow.Handle(low, held=True)
    made = deformer.solve([held, ow.Handle(high, stretch=(0.5, 1.0, 2.0), frame=(0.0, 0.4, 0.0), axis="z", angle=90)])
    again = deformer.solve([held], fields=Fields(made.omega, stretch=made.stretch))
    assert np.abs(made.x - again.x).max() <= SOLVER_ERROR
    assert np.abs(made.stretch - again.stretch).max() <= ROUNDING


def test_refining_keeps_a_stretch_that_fits() -> None:
    x, faces, low, high = bar()
    handles = [
        ow.Handle(low, held=True, stretch=(1, 1, 1)),
        ow.Handle(high, stretch=(1.0, 1.0, 2.0), axis="z", angle=60),
    ]
    plain, refined = (ow.Deformer(x, faces).solve(handles, refine=steps).x for steps in (0, 5))
    assert np.ptp(refined[:, 2]) > 1.3
    assert np.abs(plain - refined).max() <= 0.02


def test_in_the_plane_two_factors_count() -> None:
    x, faces = ow.shapes.grid(21, 21)
    flat = x[:, :2]
    left, right = flat[:, 0] < 0.1, flat[:, 0] > 0.9
    same: dict[str, Any] = {"stretch": (2.0, 0.5, 1.0), "frame": (0.0, 0.0, np.pi / 2)}
    solution = ow.Deformer(flat, faces).solve([ow.Handle(left, **same), ow.Handle(right, **same)])
    expected = (flat - flat.mean(axis=0)) * [0.5, 2.0] + flat.mean(axis=0)
    assert np.abs(solution.x - expected).max() <= SOLVER_ERROR
    assert solution.stretch.shape == (len(x), 2, 2)
    assert solution.sigma == pytest.approx(np.ones(len(x)))


def refusals() -> list[tuple[Any, str]]:
    x, faces = ow.shapes.grid(3, 3)
    graph, whole = ow.Graph.from_faces(x, faces), np.broadcast_to(np.eye(3), (16, 3, 3))
    tilted = ow.Handle([0], stretch=(1, 2, 3), frame=(0.5, 0.0, 0.0), name="tip")
    first, second = ow.Handle([0, 1], stretch=(1, 2, 3)), ow.Handle([1], stretch=(1, 2, 4))

    def given(**fields: Any) -> NodeFields:
        return NodeFields.of(graph, Fields(**fields), 3)

    return [
        (lambda: smooth_fields(graph, [tilted], dimension=2), "handle 'tip': the stretch leaves D = 2; turn the frame"),
        (lambda: smooth_fields(graph, [first, second]), "handle 0 and handle 1 give different stretches"),
        (lambda: given(stretch=whole, sigma=np.ones(16)), "fields: sigma and stretch are both given"),
        (lambda: given(stretch=whole[:4]), r"tensors of shape \(4, 3, 3\); give \(16, 3, 3\)"),
        (lambda: given(stretch=-whole), "the stretch of vertex 0 is no such tensor; give symmetric tensors"),
        (lambda: given(stretch=np.triu(np.ones((16, 3, 3)))), "the stretch of vertex 0 is no such tensor"),
        (lambda: given(stretch=np.nan * whole), "the stretch of vertex 0 is no such tensor"),
    ]


@pytest.mark.parametrize("number", range(len(refusals())))
def test_what_is_refused_and_how(number: int) -> None:
    call, text = refusals()[number]
    with pytest.raises(ow.InputError, match=text):
        call()
