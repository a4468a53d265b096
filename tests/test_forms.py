"""d, its adjoint, the edge transform and the energy against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from references import random_graph

ROUNDING = 1e-12  # float64 sums of up to a few hundred terms of order one
SEEDS = st.integers(0, 10**6)


@settings(max_examples=60)
@given(seed=SEEDS)
def test_d_of_a_constant_is_zero(seed: int) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    constant = np.tile(problem.start[:1], (problem.vertex_count, 1))
    dx = ow.differential(problem.graph(), constant)
    assert dx.shape == (problem.graph().edge_count, problem.start.shape[1])
    assert (dx == 0.0).all()


@settings(max_examples=60)
@given(seed=SEEDS)
def test_differential_is_the_difference_along_each_edge(seed: int) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    graph = problem.graph()
    i, j = graph.edges.T
    assert (ow.differential(graph, problem.start) == problem.start[j] - problem.start[i]).all()


@settings(max_examples=60)
@given(seed=SEEDS)
def test_codifferential_is_the_adjoint(seed: int) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    graph = problem.graph()
    v = graph.merge(problem.v)
    mu = graph.mu.numpy()[:, None]
    left = (mu * ow.differential(graph, problem.start) * v).sum()
    right = (problem.start * ow.codifferential(graph, v)).sum()
    assert left == pytest.approx(right, abs=ROUNDING * (1.0 + np.abs(mu * v).sum()))


def test_parallel_edges_add_their_weights_and_average_their_forms() -> None:
    graph = ow.Graph.from_edges(2, [[0, 1], [1, 0], [1, 1]], weights=[1.0, 3.0, 5.0])
    sign = 1.0 if graph.edges[0, 0] == 0 else -1.0
    assert graph.edge_count == 1
    assert graph.mu.numpy() == pytest.approx([4.0])
    # 1 x 8 along, and 3 x (-4) against the listed direction: (8 + 12) / 4.
    assert graph.merge([8.0, -4.0, 99.0]) == pytest.approx([sign * 5.0])


@settings(max_examples=60)
@given(seed=SEEDS, turns=st.floats(0.0, 5.0))
def test_transform_matches_rotation_matrices(seed: int, turns: float) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0), dimension=3)
    graph = problem.graph()
    rng = np.random.default_rng(seed)
    omega = rng.normal(size=(problem.vertex_count, 3)) * turns * np.pi
    sigma = np.exp(rng.normal(size=problem.vertex_count))
    dx = ow.differential(graph, problem.start)
    i, j = graph.edges.T
    expected = np.sqrt(sigma[i] * sigma[j])[:, None] * Rotation.from_rotvec((omega[i] + omega[j]) / 2).apply(dx)
    assert ow.transform(graph, dx, omega, sigma) == pytest.approx(expected, abs=1e-11)


def test_transform_in_the_plane_turns_by_the_angle() -> None:
    graph = ow.Graph.from_polyline(2)
    dx = ow.differential(graph, np.array([[0.0, 0.0], [1.0, 0.0]]))
    quarter = ow.transform(graph, dx, np.full(2, np.pi / 2), None)
    assert quarter == pytest.approx(np.array([[-dx[0, 1], dx[0, 0]]]))


def test_small_and_zero_rotations_are_exact() -> None:
    graph = ow.Graph.from_polyline(2)
    dx = ow.differential(graph, np.array([[0.1, 0.2, 0.3], [0.7, -0.4, 0.9]]))
    assert (ow.transform(graph, dx, np.zeros((2, 3)), np.ones(2)) == dx).all()
    tiny = np.full((2, 3), 1e-12)
    assert ow.transform(graph, dx, tiny, None) == pytest.approx(dx + np.cross(tiny[:1], dx), rel=1e-15)


def test_energy_is_its_definition() -> None:
    problem = random_graph(7, mu=(0.1, 10.0), dimension=3)
    graph = problem.graph()
    v = graph.merge(problem.v)
    i, j = graph.edges.T
    difference = problem.start[j] - problem.start[i] - v
    assert ow.energy(graph, problem.start, v) == pytest.approx((graph.mu.numpy()[:, None] * difference**2).sum())
    assert ow.edge_energy(graph, problem.start, v).sum() == pytest.approx(ow.energy(graph, problem.start, v))


def test_dtype_and_shape_come_back_as_they_went_in() -> None:
    graph = ow.Graph.from_polyline(5)
    for x in (np.arange(5.0), np.arange(10.0, dtype=np.float32).reshape(5, 2), np.arange(15.0).reshape(5, 3)):
        dx = ow.differential(graph, x)
        assert dx.dtype == x.dtype
        assert dx.shape == (4, *x.shape[1:])
        assert ow.codifferential(graph, dx).shape == x.shape


def test_integral_along_a_path_is_the_difference_of_its_ends() -> None:
    x, faces = ow.shapes.bar()
    graph = ow.Graph.from_faces(x, faces)
    dx = ow.differential(graph, x)
    path = [0]
    for _ in range(30):
        here = path[-1]
        ends = graph.edges[(graph.edges == here).any(axis=1)].ravel()
        path.append(int(max(set(ends.tolist()) - set(path), default=here)))
    path = path[: path.index(path[-1]) + 1]
    assert ow.path_integral(graph, dx, path) == pytest.approx(x[path[-1]] - x[path[0]], abs=ROUNDING)
    with pytest.raises(ow.InputError, match=r"step 0 of the path: vertices 0 and 793 have no edge"):
        ow.path_integral(graph, dx, [0, 793])


def test_exactness_sees_a_rotation_that_varies() -> None:
    x, faces = ow.shapes.bar()
    graph = ow.Graph.from_faces(x, faces)
    dx = ow.differential(graph, x)
    omega = np.outer(x[:, 2], [0.0, 0.0, np.pi])
    assert ow.is_exact(graph, dx)
    assert ow.is_exact(graph, ow.transform(graph, dx, np.tile([1.0, 2.0, 3.0], (len(x), 1)), np.full(len(x), 2.0)))
    assert not ow.is_exact(graph, ow.transform(graph, dx, omega, None))
