"""Distances by heat against closed forms: spheres, bars, grids, paths, and what has no surface."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import warp as wp

import oneform_warp as ow
from oneform_warp.geodesics import geodesic_distance
from oneform_warp.solvers import CG, Multigrid, SuperLU

HEAT_ERROR = 0.012  # of the farthest distance, on a sphere of 642 vertices: first order in the edge length
CORNER_ERROR = 0.06  # of the farthest distance: on 41 x 41 points, where the source is a corner or single point
RIM_ERROR = 6.7e-3  # of the side, on 41 x 41 points; what bends along the rim adds a tenth
PATH_ERROR = 1e-6  # the solver's tol: on a path every step is exact


def on_sphere(level: int, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """Distances from vertex 17 by heat and exactly, over pi."""
    x, faces = ow.shapes.sphere(level)
    exact = np.arccos(np.clip(x @ x[17], -1.0, 1.0))
    return geodesic_distance(ow.Graph.from_faces(x, faces), x, [17], **options) / np.pi, exact / np.pi


def test_the_distance_on_a_sphere_converges_to_arcs() -> None:
    errors = [np.abs(np.subtract(*on_sphere(level))).max() for level in (3, 4, 5)]
    assert errors[0] <= HEAT_ERROR
    assert all(coarse / fine >= 1.8 for coarse, fine in pairwise(errors))


@pytest.mark.parametrize("solver", [CG(), Multigrid()])
def test_every_solver_finds_the_same_distance(solver: Any) -> None:
    assert np.abs(on_sphere(4, solver=solver)[0] - on_sphere(4, solver=SuperLU())[0]).max() <= PATH_ERROR


@pytest.mark.parametrize("quads", [False, True])
def test_the_distance_goes_around_corners(quads: bool) -> None:
    x, faces = ow.shapes.bar(segments=60, quads=quads)
    d = geodesic_distance(ow.Graph.from_faces(x, faces), x, x[:, 2] == 0.0)
    side = x[:, 2] < x[:, 2].max()
    assert np.abs(d - x[:, 2])[side].max() <= HEAT_ERROR * x[:, 2].max()
    # On the far end it goes on, from the rim to the middle.
    middle = np.argmin(np.linalg.norm(x - [0.0, 0.0, x[:, 2].max()], axis=1))
    assert d[middle] == pytest.approx(x[:, 2].max() + 0.1, rel=HEAT_ERROR)


def test_the_distance_from_a_region_is_that_from_its_rim() -> None:
    x, faces = ow.shapes.grid(41, 41)
    inside = np.linalg.norm(x - x.mean(axis=0), axis=1) < 0.2
    d = geodesic_distance(ow.Graph.from_faces(x, faces), x, inside)
    exact = np.linalg.norm(x[:, None] - x[inside], axis=2).min(axis=1)
    assert np.abs(d - exact).mean() <= RIM_ERROR


@pytest.mark.parametrize("shape", [(41, 41), (15, 15, 15)])
def test_graphs_without_faces_have_distances_too(shape: tuple[int, ...]) -> None:
    x = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, len(shape)) * 1.0
    d = geodesic_distance(ow.Graph.from_grid(shape), x, [0])
    exact = np.linalg.norm(x, axis=1)
    assert np.abs(d - exact).mean() <= CORNER_ERROR / 2 * exact.max()


@pytest.mark.parametrize("count", [2, 400, 3000])
def test_on_a_path_the_distance_is_its_length(count: int) -> None:
    x = np.concatenate([[0.0], np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, size=count))])
    d = geodesic_distance(ow.Graph.from_polyline(len(x)), x, [count // 4])
    assert d == pytest.approx(np.abs(x - x[count // 4]), abs=PATH_ERROR * x[-1])


def test_a_source_is_at_distance_zero_and_another_component_infinitely_far() -> None:
    x, faces = ow.shapes.grid(9, 9)
    both, twice = np.concatenate([x, x + 5.0]), np.concatenate([faces, faces + len(x)])
    d = geodesic_distance(ow.Graph.from_faces(both, twice), both, np.arange(30))
    assert (d[:30] == 0.0).all()
    assert (d[30 : len(x)] > 0.0).all()
    assert np.isinf(d[len(x) :]).all()


def test_vertices_without_an_edge_are_no_obstacle() -> None:
    x = np.array([0.0, 1.0, 2.0, 3.0])
    d = geodesic_distance(ow.Graph.from_edges(4, [[0, 1]]), x, [0, 3])
    assert d.tolist() == [0.0, pytest.approx(1.0), np.inf, 0.0]
    assert geodesic_distance(ow.Graph.from_edges(2, np.zeros((0, 2), int)), x[:2], [1]).tolist() == [np.inf, 0.0]


def test_distances_have_the_unit_of_x() -> None:
    x, faces = ow.shapes.sphere(3)
    graph = ow.Graph.from_faces(x, faces)
    assert geodesic_distance(graph, 1000.0 * x, [3]) == pytest.approx(1000.0 * geodesic_distance(graph, x, [3]))


def test_a_degenerate_face_spoils_nothing() -> None:
    x, faces = ow.shapes.grid(11, 11)
    more = np.concatenate([faces, [[0, 1, 1], [5, 5, 5], [2, 3, 4]]])  # the last on a line
    d = geodesic_distance(ow.Graph.from_faces(x, more), x, [60])
    assert np.abs(d - np.linalg.norm(x - x[60], axis=1)).max() <= 2 * CORNER_ERROR * d.max()


def test_many_meshes_have_distances_of_their_own() -> None:
    x, faces = ow.shapes.sphere(2)
    both = np.concatenate([x, 100.0 + 50.0 * x])
    graph = ow.Graph.from_faces(both, np.concatenate([faces, faces + len(x)]))
    d = geodesic_distance(graph, both, [5, len(x) + 5])
    assert d[len(x) :] == pytest.approx(50.0 * d[: len(x)], rel=1e-4, abs=1e-4)


def test_distances_are_the_same_on_every_device(device: str) -> None:
    x, faces = ow.shapes.sphere(4)
    d = geodesic_distance(ow.Graph.from_faces(x, faces, device=device), x, [17], solver=Multigrid())
    assert np.abs(d / np.pi - on_sphere(4)[0]).max() <= PATH_ERROR
    assert wp.get_device(device).is_cpu or wp.get_device(device).is_cuda
