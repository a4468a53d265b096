"""Falloffs: profiles, overlaps, biharmonic fields against dense ones, and what is kept of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oneform_warp as ow
from oneform_warp.falloff import Biharmonic, Geodesic, Painted, Smoothing
from oneform_warp.fields import Fields, smooth_fields
from oneform_warp.forms import vertex_areas
from oneform_warp.geodesics import geodesic_distance
from oneform_warp.profiles import PROFILES
from oneform_warp.solvers import CG, Multigrid, SuperLU
from references import components, random_graph

SEEDS = st.integers(0, 10**6)
REACH_ERROR = 1e-3  # of the weights: beyond the radius directions are rougher, which bends those below it a little
SOLVER_ERROR = 1e-4  # tol 1e-6 times the condition number of the graphs here
BIHARMONIC_ERROR = 2e-4  # 1e-7 in the energy's norm, on up to 40 vertices with weights over two decades


def blender(profile: str, s: np.ndarray) -> np.ndarray:
    """The curves of Blender's proportional editing at s = 1 - distance / radius."""
    curves = {
        "smooth": 3 * s**2 - 2 * s**3,
        "sphere": np.sqrt(2 * s - s**2),
        "root": np.sqrt(s),
        "inverse_square": s * (2 - s),
        "sharp": s**2,
        "linear": s,
        "constant": np.where(s > 0.0, 1.0, 0.0),
    }
    return curves[profile]


@pytest.mark.parametrize("profile", [name for name in PROFILES if name != "random"])
def test_a_lone_handle_falls_off_by_its_profile(profile: str, device: str) -> None:
    x, faces = ow.shapes.sphere(3)
    graph = ow.Graph.from_faces(x, faces, device=device)
    d = geodesic_distance(graph, x, [17])
    fields = smooth_fields(
        graph, [ow.Handle([17], axis="z", angle=90, stretch=2.0)], x=x, falloff=Geodesic(1.2, profile)
    )
    weight = blender(profile, np.clip(1.0 - d / 1.2, 0.0, 1.0))
    near, far = d < 1.19, d > 1.21
    assert fields.omega[near, 2] == pytest.approx(np.pi / 2 * weight[near], abs=REACH_ERROR)
    assert fields.sigma[near] == pytest.approx(2.0 ** weight[near], abs=REACH_ERROR)
    assert (fields.omega[far] == 0.0).all()
    assert (fields.sigma[far] == 1.0).all()


def test_the_random_profile_stays_below_the_linear_one_and_repeats() -> None:
    x, faces = ow.shapes.sphere(3)
    handle, graph = ow.Handle([17], axis="z", angle=90), ow.Graph.from_faces(x, faces)
    random, again, linear = (
        smooth_fields(graph, [handle], x=x, falloff=Geodesic(2.0, name)).omega[:, 2]
        for name in ("random", "random", "linear")
    )
    part = random[linear > 0.1] / linear[linear > 0.1]
    assert (random == again).all()
    assert random[17] == np.pi / 2
    assert part.min() >= 0.0
    assert part.max() <= 1.0
    assert np.abs(part.mean() - 0.5) < 0.1
    assert part.std() > 0.2


def shares(weights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """W sum o v / sum o with W = 1 - prod (1 - w) and the odds o = w / (1 - w); weights (handles, V) below 1."""
    odds = weights / (1.0 - weights)
    together = 1.0 - np.prod(1.0 - weights, axis=0)
    total = odds.sum(axis=0)
    return np.where(total > 0.0, together / np.where(total > 0.0, total, 1.0), 0.0)[:, None] * (odds.T @ values)


@settings(max_examples=20)
@given(seed=SEEDS, count=st.integers(1, 8))
def test_overlapping_handles_share_by_their_odds(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.permutation(40)[:count]
    painted = rng.uniform(0.0, 0.99, size=(count, 40)) * (rng.random((count, 40)) < 0.6)
    turns = rng.normal(size=(count, 3))
    handles = [ow.Handle([v], rotation=turn) for v, turn in zip(vertices, turns, strict=True)]
    omega = smooth_fields(ow.Graph.from_polyline(40), handles, falloff=Painted(painted)).omega
    expected = shares(painted, turns)
    expected[vertices] = turns
    assert np.abs(omega - expected).max() <= 1e-12
    assert (np.abs(omega).max(axis=0) <= np.abs(turns).max(axis=0) + 1e-12).all()


def test_equal_handles_do_not_add_up_and_a_held_one_stays() -> None:
    x, faces = ow.shapes.bar(segments=40)
    z, graph = x[:, 2], ow.Graph.from_faces(x, faces)
    low, high = ow.Handle(z < 0.2, axis="x", angle=30), ow.Handle(z > 0.8, axis="x", angle=30)
    omega = smooth_fields(graph, [low, high], x=x, falloff=Geodesic(0.5)).omega[:, 0]
    assert omega.max() <= np.radians(30.0) + 1e-12
    assert omega.min() > 0.0
    stiff = smooth_fields(graph, [ow.Handle(z < 0.2, held=True), high], x=x, falloff=Geodesic(0.8)).omega[:, 0]
    assert (stiff[z < 0.2] == 0.0).all()
    assert (stiff[z > 0.8] == np.radians(30.0)).all()
    ring = np.array([stiff[np.isclose(z, level)].mean() for level in np.unique(z)])
    assert (np.diff(ring) >= -1e-3).all()


def test_a_radius_is_a_length() -> None:
    x, faces = ow.shapes.bar()
    handles = [ow.Handle(x[:, 2] < 0.1, held=True), ow.Handle(x[:, 2] > 0.9, axis="y", angle=70)]
    small = ow.deform(x, faces, handles, falloff=Geodesic(0.4))
    large = ow.deform(1000.0 * x, faces, handles, falloff=Geodesic(400.0))
    assert np.abs(large / 1000.0 - small).max() <= SOLVER_ERROR


def test_what_no_handle_reaches_is_not_turned() -> None:
    x, faces = ow.shapes.bar(segments=60)
    z = x[:, 2]
    handles = [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, axis="x", angle=45)]
    y = ow.deform(x, faces, handles, falloff=Geodesic(0.3))
    # Between 0.4 and 0.6 both influences are 0: that part keeps its shape where it was.
    assert np.abs(y - x)[z < 0.55].max() <= 0.02
    assert np.abs(y - x)[z > 0.9].max() >= 0.05


def bilaplacian(graph: ow.Graph, areas: np.ndarray) -> np.ndarray:
    """L a^-1 L as a dense matrix."""
    i, j = graph.edges.T
    mu, matrix = graph.mu.numpy(), np.zeros((graph.vertex_count, graph.vertex_count))
    np.add.at(matrix, (i, j), -mu)
    np.add.at(matrix, (j, i), -mu)
    matrix -= np.diag(matrix.sum(axis=1))
    return matrix @ np.diag(1.0 / areas) @ matrix


@settings(max_examples=40)
@given(seed=SEEDS)
def test_biharmonic_fields_are_those_of_the_dense_matrix(seed: int) -> None:
    problem, rng = random_graph(seed, mu=(0.1, 10.0)), np.random.default_rng(seed)
    graph, count = problem.graph(), problem.vertex_count
    x = rng.normal(size=(count, 3))
    areas = np.empty(count)
    areas[graph.vertex_at] = vertex_areas(graph, graph.nodes_from(x))
    chosen = rng.permutation(count)[: max(1, count // 3)]
    turns = rng.normal(size=(len(chosen), 3))
    handles = [ow.Handle([v], rotation=turn) for v, turn in zip(chosen, turns, strict=True)]
    omega = smooth_fields(graph, handles, x=x, falloff=Biharmonic(), solver=SuperLU()).omega
    expected = np.zeros((count, 3))
    expected[chosen] = turns
    matrix = bilaplacian(graph, np.maximum(areas, 1e-6 * areas.mean() or 1.0))
    for group in components(count, problem.edges):
        inside, free = np.intersect1d(group, chosen), np.setdiff1d(group, chosen)
        if len(inside) and len(free):
            right = -matrix[np.ix_(free, inside)] @ expected[inside]
            expected[free] = np.linalg.solve(matrix[np.ix_(free, free)], right)
    assert np.abs(omega - expected).max() <= BIHARMONIC_ERROR * max(np.ptp(expected), 1.0)
    assert (omega[chosen] == turns).all()


def test_biharmonic_fields_leave_the_handles_without_a_bend() -> None:
    x, faces = ow.shapes.bar(segments=60)
    z, graph = x[:, 2], ow.Graph.from_faces(x, faces)
    handles = [ow.Handle(z < 0.2, held=True), ow.Handle(z > 0.8, axis="z", angle=90)]
    bend = {}
    for falloff in (None, Biharmonic()):
        omega = smooth_fields(graph, handles, x=x, falloff=falloff).omega[:, 2]
        ring = np.array([omega[np.isclose(z, level)].mean() for level in np.unique(z)])
        bend[falloff] = np.abs(np.diff(ring, 2)).max()
    # Clamped at both ends the cubic bends 4.5 times less than the kink of the straight line, on edges of 1/60.
    assert bend[Biharmonic()] <= 0.3 * bend[None]


@pytest.mark.parametrize("solver", [CG(), Multigrid()])
def test_every_solver_finds_the_same_biharmonic_field(solver: Any) -> None:
    x, faces = ow.shapes.sphere(4)
    graph = ow.Graph.from_faces(x, faces)
    handles = [ow.Handle(x[:, 2] < -0.7), ow.Handle(x[:, 2] > 0.8, axis="z", angle=90)]
    found = [
        smooth_fields(graph, handles, x=x, falloff=Biharmonic(), solver=each).omega for each in (solver, SuperLU())
    ]
    assert np.abs(found[0] - found[1]).max() <= 1e-5


def test_a_changed_rotation_measures_nothing_anew() -> None:
    x, faces = ow.shapes.sphere(3)
    deformer = ow.Deformer(x, faces)

    def solved(angle: float, falloff: Any) -> ow.Deformation:
        handles = [ow.Handle(x[:, 2] < -0.9, held=True), ow.Handle(x[:, 2] > 0.9, axis="x", angle=angle)]
        return deformer.solve(handles, falloff=falloff)

    seen = []
    for falloff in (Geodesic(1.0), Geodesic(0.5), Biharmonic(), Smoothing()):
        first, again = solved(40.0, falloff), solved(70.0, falloff)
        assert len(first.solutions) > 1
        assert all(a is b for a, b in zip(first.solutions[:-1], again.solutions[:-1], strict=True))
        # What is kept of one falloff serves no other.
        assert all(np.abs(again.omega - omega).max() > 0.01 for omega in seen)
        seen.append(again.omega)


def refusals() -> list[tuple[Any, str]]:
    x, faces = ow.shapes.bar()
    graph, handle = ow.Graph.from_faces(x, faces), ow.Handle([0], axis="z", angle=9)

    def spread(**options: Any) -> Fields:
        return smooth_fields(graph, [handle], **options)

    return [
        (lambda: Geodesic(0.0), "falloff: radius is 0.0; give a length > 0"),
        (lambda: Geodesic(1.0, "smoth"), "there is no profile 'smoth'; did you mean 'smooth'"),
        (lambda: Painted([0.5, 1.5]), "no rows of numbers in 0..1"),
        (lambda: Painted([np.nan]), "no rows of numbers in 0..1"),
        (lambda: spread(falloff=Painted(np.ones(3))), r"shape \(1, 3\) for 1 handles on 794 vertices"),
        (lambda: spread(falloff=Geodesic(1.0)), "this falloff needs positions; pass x"),
        (lambda: spread(falloff=Biharmonic()), "this falloff needs positions; pass x"),
        (lambda: spread(falloff=Biharmonic(), sweeps=3), "falloff and sweeps are both given"),
        (lambda: spread(x=x, falloff=Biharmonic(), length=3.0), "falloff and length are both given"),
        (lambda: spread(falloff="geodesic"), "'geodesic' is no falloff; give Smoothing"),
        (lambda: geodesic_distance(graph, x, []), "vertices: no vertex is given"),
        (lambda: geodesic_distance(graph, x, [800]), "vertex number 800 does not exist"),
    ]


@pytest.mark.parametrize("number", range(len(refusals())))
def test_what_is_refused_and_how(number: int) -> None:
    call, text = refusals()[number]
    with pytest.raises(ow.InputError, match=text):
        call()
