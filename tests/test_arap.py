"""ARAP refinement: rotations against SVD, the energy against NumPy and finite differences, descent, invariance."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from oneform_warp import cells as cells_module
from oneform_warp.arap import Arap, Ending, field_rotations, nearest_vectors
from oneform_warp.arap_energy import CellEnergy, Fit
from oneform_warp.cells import LARGEST, Cells, edge_cells, face_cells
from oneform_warp.forms import node_differential
from oneform_warp.procrustes import nearest_rotation
from oneform_warp.solvers import State
from oneform_warp.solvers.system import System
from oneform_warp.weights import COTANGENT_RANGE

BOX = 1e-5  # of the bounding box: what the default precision promises
NOBODY: Any = None
"""No inner solver: the energy asks for none."""

SUMS = 1e-11  # relative: sums of some thousand terms in float64


@wp.kernel(enable_backward=False)
def _nearest(b: wp.array[wp.mat33d], old: wp.array[wp.mat33d], rotation_out: wp.array[wp.mat33d]):
    i = wp.tid()
    rotation_out[i] = nearest_rotation(b[i], old[i])


def nearest(b: np.ndarray, device: str) -> np.ndarray:
    old = np.broadcast_to(np.eye(3), b.shape).copy()
    arrays = [wp.array(each, dtype=wp.mat33d, device=device) for each in (b, old)]
    result = wp.empty(len(b), dtype=wp.mat33d, device=device)
    wp.launch(_nearest, dim=len(b), inputs=arrays, outputs=[result], device=device)
    return result.numpy()


@pytest.mark.parametrize("kind", ["any", "flat", "line", "reflection", "tiny", "near equal"])
def test_the_nearest_rotation_is_a_rotation_and_reaches_what_svd_reaches(kind: str, device: str) -> None:
    rng = np.random.default_rng(1)
    b = rng.normal(size=(2000, 3, 3))
    if kind == "flat":
        b[:, 2] = 0.0
    elif kind == "line":
        b = rng.normal(size=(2000, 3, 1)) * rng.normal(size=(2000, 1, 3))
    elif kind == "reflection":
        b[np.linalg.det(b) > 0] *= -1.0
    elif kind == "tiny":
        b *= 1e-150
    elif kind == "near equal":
        b = Rotation.random(2000, rng=1).as_matrix() @ (np.diag([1.0, 1.0, -1.0]) + 1e-7 * b)
    rotation = nearest(b, device)
    assert np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max() < 1e-9
    assert (np.linalg.det(rotation) > 0.0).all()
    u, s, v = np.linalg.svd(b)
    best = s[:, 0] + s[:, 1] + s[:, 2] * np.sign(np.linalg.det(u @ v))
    short = best - np.einsum("nij,nij->n", rotation, b)
    assert (short < 1e-7 * s[:, 0]).all()  # the old rotation has a part of 1e-8 in what is maximised
    assert np.median(short / s[:, 0]) < 1e-9


def brute_energy(cells: Cells, s: np.ndarray, x: np.ndarray) -> float:
    """sum over cells of 1/n sum over corners and edges of w |d - R s|^2, rotations by NumPy's SVD."""
    offsets, corners, weight = (a.numpy() for a in (cells.offsets, cells.corners, cells.weight))
    covariance, rings = np.zeros((len(x), 3, 3)), []
    for begin, end in itertools.pairwise(offsets):
        ring = corners[begin:end]
        rings.append((ring, x[np.roll(ring, -1)] - x[ring], s[begin:end], weight[begin:end]))
        for i in ring:
            covariance[i] += np.einsum("e,ea,eb->ab", rings[-1][3], rings[-1][1], rings[-1][2]) / len(ring)
    u, _, v = np.linalg.svd(covariance)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    rotation = u @ v
    total = 0.0
    for ring, d, rest, w in rings:
        misfits = [w @ ((d - rest @ rotation[i].T) ** 2).sum(axis=1) for i in ring]
        total += float(np.mean(misfits))
    return total


def scene(kind: str, seed: int, device: str = "cpu") -> tuple[ow.Graph, np.ndarray, np.ndarray]:
    """A graph with rest nodes and moved nodes (n, 3)."""
    rng = np.random.default_rng(seed)
    if kind == "quads":
        x, faces = ow.shapes.torus(8, 6, quads=True)
    elif kind == "open":
        x, faces = ow.shapes.bumpy_plane(6, 5)
    else:
        x, faces = ow.shapes.sphere(1)
    if kind == "pinched":
        x[faces[0][1]] = x[faces[0][0]]  # welded: two triangles have a node twice
    extra = [[0, 7], [3, 20]] if kind == "struts" else None
    graph = ow.Graph.from_faces(x, faces, extra_edges=extra, extra_weight=0.3, device=device)
    rest = graph.nodes_from(x).numpy()
    bend = Rotation.from_rotvec(np.outer(rest[:, 0], rng.normal(size=3)))
    return graph, rest, bend.apply(rest) + 0.05 * rng.normal(size=rest.shape)


def energy_at(graph: ow.Graph, cells: Cells, rest: np.ndarray, x: np.ndarray, pinned: Any = None) -> tuple[Any, Fit]:
    device = graph.device
    mask = np.zeros(graph.node_count, dtype=bool) if pinned is None else pinned
    system = System.of(graph, mask)
    form = node_differential(graph, wp.array(rest, dtype=wp.vec3d, device=device))
    free = wp.zeros(graph.node_count, dtype=wp.int32, device=device)
    state = State(system, NOBODY)
    energy = CellEnergy(cells, form, state, wp.array(x, dtype=wp.vec3d, device=device), free)
    start = field_rotations(wp.zeros(graph.node_count, dtype=wp.vec3d, device=device))
    x_nodes = wp.array(x, dtype=wp.vec3d, device=device)
    # The old rotation has a part of 1e-8 in the new one: the second fit has itself for the old one.
    return energy, energy.fit(x_nodes, energy.fit(x_nodes, start).rotation)


def cells_of(kind: str, graph: ow.Graph, rest: np.ndarray) -> Cells:
    nodes = wp.array(rest, dtype=wp.vec3d, device=graph.device)
    return edge_cells(graph) if kind == "spokes" else face_cells(graph, nodes)


@pytest.mark.parametrize("kind", ["triangles", "quads", "open", "struts", "pinched"])
@pytest.mark.parametrize("spokes", ["spokes", "rims"])
def test_the_energy_is_the_sum_over_cells(kind: str, spokes: str) -> None:
    graph, rest, x = scene(kind, 3)
    cells = cells_of(spokes, graph, rest)
    energy, fit = energy_at(graph, cells, rest, x)
    assert fit.energy == pytest.approx(brute_energy(cells, energy.arms.s.numpy(), x), rel=SUMS)
    shares = np.bincount(np.maximum(cells.edge.numpy(), ~cells.edge.numpy()), cells.weight.numpy(), graph.edge_count)
    mu = graph.mu.numpy()
    clamped = (mu == COTANGENT_RANGE[0]) & (spokes == "rims")
    assert np.allclose(shares[~clamped], mu[~clamped], rtol=SUMS)
    assert (shares[clamped] < COTANGENT_RANGE[0]).all()


def test_on_triangles_it_is_a_third_of_the_spokes_and_rims_energy() -> None:
    x, faces = ow.shapes.sphere(1)
    graph, rest, moved = scene("triangles", 5)
    node = graph.node_of[np.asarray(faces)]
    _, fit = energy_at(graph, face_cells(graph, wp.array(rest, dtype=wp.vec3d, device=graph.device)), rest, moved)
    covariance, terms = np.zeros((len(x), 3, 3)), []
    for triangle in node:
        for k in range(3):
            i, j, apex = triangle[k], triangle[(k + 1) % 3], triangle[(k + 2) % 3]
            a, b = rest[i] - rest[apex], rest[j] - rest[apex]
            half = 0.5 * (a @ b) / np.linalg.norm(np.cross(a, b))
            terms.append((triangle, half, moved[j] - moved[i], rest[j] - rest[i]))
            covariance[triangle] += half * np.outer(terms[-1][2], terms[-1][3])
    u, _, v = np.linalg.svd(covariance)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    expected = sum(half * ((d - u[i] @ v[i] @ s) ** 2).sum() for t, half, d, s in terms for i in t)
    assert 3.0 * fit.energy == pytest.approx(expected, rel=SUMS)


@pytest.mark.parametrize("kind", ["quads", "open", "struts", "pinched"])
@pytest.mark.parametrize("spokes", ["spokes", "rims"])
def test_the_residual_is_half_the_falling_gradient(kind: str, spokes: str) -> None:
    graph, rest, x = scene(kind, 8)
    cells = cells_of(spokes, graph, rest)
    pinned = np.zeros(graph.node_count, dtype=bool)
    pinned[:3] = True
    _, fit = energy_at(graph, cells, rest, x, pinned)
    r = fit.r.numpy()
    assert not r[:3].any()
    towards = np.random.default_rng(0).normal(size=x.shape) * ~pinned[:, None]
    step = 1e-5
    ahead, behind = (energy_at(graph, cells, rest, x + sign * step * towards)[1].energy for sign in (1.0, -1.0))
    assert (ahead - behind) / (2.0 * step) == pytest.approx(-2.0 * (r * towards).sum(), rel=1e-6)


def bent_bar(**options: Any) -> tuple[ow.Deformer, list[ow.Handle]]:
    x, faces = ow.shapes.bar()
    z = x[:, 2]
    handles = [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, axis="x", angle=80, move=(0.1, -0.4, -0.3), **options)]
    return ow.Deformer(x, faces), handles


@pytest.mark.parametrize("cells", ["spokes", "spokes_and_rims"])
@pytest.mark.parametrize("smooth", [0.0, 0.02])
@pytest.mark.parametrize("weight", [None, 2.0])
def test_the_energy_falls_in_every_step(cells: str, smooth: float, weight: float | None) -> None:
    deformer, handles = bent_bar(weight=weight)
    refined = deformer.solve(handles, refine=Arap(40, cells=cells, smooth=smooth)).refined
    assert refined is not None
    assert (np.diff(refined.energies) <= 0.0).all()
    assert refined.energies[-1] < 0.9 * refined.energies[0]


def test_smooth_rotations_differ_less() -> None:
    deformer, handles = bent_bar()
    plain, smooth = (deformer.solve(handles, refine=Arap(60, smooth=s)) for s in (0.0, 0.1))
    i, j = deformer.graph.edges.T
    jumps = [np.linalg.norm(s.omega[i] - s.omega[j], axis=1).max() for s in (plain, smooth)]
    assert jumps[1] < 0.8 * jumps[0]


def test_lightly_smoothed_rotations_arrive_in_few_steps() -> None:
    deformer, handles = bent_bar()
    ten, many = (deformer.solve(handles, refine=Arap(steps, smooth=1e-4)).refined for steps in (10, 300))
    assert ten is not None
    assert many is not None
    assert ten.energies[-1] < 1.03 * many.energies[-1]


def test_many_steps_end_where_the_gradient_is_zero() -> None:
    deformer, handles = bent_bar()
    solution = deformer.solve(handles, refine=400)
    refined = solution.refined
    assert refined is not None
    start = np.abs(deformer.solve(handles, refine=1).refined.fit.r.numpy()).max()  # type: ignore[union-attr]
    assert np.abs(refined.fit.r.numpy()).max() < 1e-4 * start
    assert solution.converged


def test_a_tolerance_ends_the_steps() -> None:
    deformer, handles = bent_bar()
    refined = deformer.solve(handles, refine=Arap(500, tol=1e-3)).refined
    assert refined is not None
    assert refined.ending is Ending.CONVERGED
    assert refined.energies[-2] - refined.energies[-1] <= 1e-3 * refined.energies[-2]
    assert len(refined.energies) < 50


def test_what_is_at_rest_stays_to_the_last_bit() -> None:
    x, faces = ow.shapes.bar()
    y = ow.deform(x, faces, [ow.Handle(x[:, 2] < 0.1, held=True), ow.Handle(x[:, 2] > 0.9)], refine=5)
    assert y.tobytes() == x.tobytes()


@settings(max_examples=8)
@given(seed=st.integers(0, 10_000))
def test_a_turned_scene_gives_the_turned_result(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, faces = ow.shapes.bar(segments=12)
    z = x[:, 2]
    turn, shift, size = Rotation.random(rng=seed), rng.normal(size=3), float(np.exp(rng.normal()))
    to = x[z > 0.9] + rng.normal(size=3) * 0.1
    plain = ow.Deformer(x, faces, solver=ow.SuperLU()).solve(
        [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, to=to)], refine=4
    )
    there = size * turn.apply(x) + shift
    handles = [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, to=size * turn.apply(to) + shift)]
    turned = ow.Deformer(there, faces, solver=ow.SuperLU()).solve(handles, refine=4)
    assert np.abs(turned.x - size * turn.apply(plain.x) - shift).max() < BOX * size


def test_a_handle_that_only_turns_keeps_its_turn() -> None:
    x, faces = ow.shapes.bar()
    z = x[:, 2]
    solution = ow.Deformer(x, faces).solve(
        [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, axis="z", angle=360)], refine=30
    )
    assert np.abs(solution.omega[z > 0.9] - [0.0, 0.0, 2.0 * np.pi]).max() < 1e-12
    middle = np.abs(z - 0.5) < 0.02
    assert np.abs(solution.omega[middle].mean(axis=0) - [0.0, 0.0, np.pi]).max() < 0.3


def test_in_a_plane_nothing_is_mirrored() -> None:
    x, faces = ow.shapes.grid(10, 10)
    plane = x[:, :2]
    left, right = plane[:, 0] == plane[:, 0].min(), plane[:, 0] == plane[:, 0].max()
    handles = [ow.Handle(left, held=True), ow.Handle(right, angle=150, move=(-0.5, 0.4))]
    solution = ow.Deformer(plane, faces).solve(handles, refine=20)
    assert solution.refined is not None
    rotation = solution.refined.fit.rotation.numpy()
    assert np.abs(rotation[:, 2, 2] - 1.0).max() < 1e-9
    assert solution.omega.shape == (len(x),)


def test_a_line_of_vertices_bends_without_faces() -> None:
    x = np.stack([np.linspace(0.0, 1.0, 40), *np.zeros((2, 40))], axis=1)
    handles = [ow.Handle([0, 1], held=True), ow.Handle([38, 39], axis="z", angle=90, move=(-0.2, 0.4, 0.0))]
    solution = ow.Deformer(x, ow.Graph.from_polyline(40)).solve(handles, refine=50)
    lengths = np.linalg.norm(np.diff(solution.x, axis=0), axis=1)
    assert solution.converged
    assert np.abs(39.0 * lengths - 1.0).max() < 0.1
    assert np.abs(39.0 * np.linalg.norm(np.diff(x * 0.8, axis=0), axis=1) - 1.0).min() > 0.1  # what a chord would need


@settings(max_examples=50)
@given(seed=st.integers(0, 10_000), turns=st.integers(-3, 3))
def test_rotation_vectors_keep_their_turns(seed: int, turns: int) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    omega = (2.0 * np.pi * turns + rng.uniform(-3.0, 3.0)) * axis
    near = omega + 0.01 * rng.normal(size=3)
    found = nearest_vectors(Rotation.from_rotvec(omega).as_matrix()[None], near[None])[0]
    assert np.abs(found - omega).max() < 1e-6


@pytest.mark.parametrize("device_dtype", ["float32"])
def test_runs_repeat_bit_for_bit(device_dtype: str, device: str) -> None:
    x, faces = ow.shapes.starfish()
    handles = [ow.Handle(x[:, 0] < -0.5, held=True), ow.Handle(x[:, 0] > 0.6, axis="z", angle=50, move=(0, 0.2, 0))]
    runs = [ow.Deformer(x, faces, solver=ow.Multigrid(), device=device).deform(handles, refine=5) for _ in range(2)]
    assert runs[0].tobytes() == runs[1].tobytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"steps": -1}, "steps is -1"),
        ({"steps": 2.5}, "steps is 2.5"),
        ({"cells": "faces"}, "there are no cells 'faces'"),
        ({"smooth": -1.0}, "smooth is -1.0"),
        ({"tol": np.nan}, "tol is nan"),
    ],
)
def test_options_that_cannot_be_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ow.InputError, match=message):
        Arap(**options)


def test_a_line_has_no_rotations_to_refine() -> None:
    line = np.linspace(0.0, 1.0, 5)
    with pytest.raises(ow.InputError, match="a line has no rotations"):
        ow.Deformer(line, ow.Graph.from_polyline(5)).solve([ow.Handle([0], held=True)], refine=3)


@pytest.mark.parametrize(("angle", "warned"), [(180, False), (270, True)])
def test_a_turn_that_refining_unwinds_is_named(angle: float, warned: bool) -> None:
    x, faces = ow.shapes.bar()
    z = x[:, 2]
    head = ow.Handle(z > 0.9, axis="z", angle=angle, pivot="centroid", name="head")
    solution = ow.Deformer(x, faces).solve([ow.Handle(z < 0.1, held=True), head], refine=2)
    assert any("'head' turns by 270 degrees" in text for text in solution.warnings) == warned


@pytest.mark.parametrize("solver", [ow.CG(), ow.Multigrid(), ow.SuperLU()])
@pytest.mark.parametrize("move", [None, (0.1, 0.2, 0.3)])
def test_a_single_pin_stays_where_it_is(solver: Any, move: Any, device: str) -> None:
    x, faces = ow.shapes.bar()
    pin = ow.Handle([0], held=True) if move is None else ow.Handle([0], move=move)
    handles = [pin, ow.Handle(x[:, 2] > 0.9, axis="x", angle=60)]
    y = ow.Deformer(x, faces, solver=solver, device=device).solve(handles, refine=5).x
    assert np.array_equal(y[0], x[0] + (np.zeros(3) if move is None else np.array(move)))
    assert np.linalg.norm(y - y[0], axis=1).max() < 1.2 * np.linalg.norm(x - x[0], axis=1).max()
    neighbours = np.unique(np.asarray(faces)[(np.asarray(faces) == 0).any(axis=1)])
    assert np.linalg.norm(y[neighbours] - y[0], axis=1).max() < 2.0 * np.linalg.norm(x[neighbours] - x[0], axis=1).max()


def test_large_faces_turn_in_runs(monkeypatch: pytest.MonkeyPatch, device: str) -> None:
    count = 150
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    x, turn = np.concatenate([ring, ring + [0.0, 0.0, 1.0]]), (np.arange(count) + 1) % count
    sides = [[i, turn[i], count + turn[i], count + i] for i in range(count)]
    faces = [list(range(count))[::-1], list(range(count, 2 * count)), *sides]
    graph = ow.Graph.from_faces(x, faces, device=device)
    nodes = graph.nodes_from(x)
    made = face_cells(graph, nodes)
    offsets, corners, edge, weight = (a.numpy() for a in (made.offsets, made.corners, made.edge, made.weight))
    assert np.diff(offsets).max() == LARGEST
    # Each edge joins its corner with the next one of the ring; chords have no weight.
    following = np.arange(1, len(corners) + 1)
    following[offsets[1:] - 1] = offsets[:-1]
    undirected = np.maximum(edge, ~edge)
    ends = np.stack([graph.tail.numpy()[undirected], graph.head.numpy()[undirected]], axis=1)
    ends[edge < 0] = ends[edge < 0][:, ::-1]
    joined = np.stack([corners, corners[following]], axis=1)
    np.testing.assert_array_equal(ends[weight != 0.0], joined[weight != 0.0])
    sums = np.bincount(undirected, weight, graph.edge_count)
    np.testing.assert_allclose(sums, graph.mu.numpy(), rtol=1e-12)
    monkeypatch.setattr(cells_module, "LARGEST", 10 * count)
    whole = face_cells(graph, nodes)
    assert np.diff(whole.offsets.numpy()).max() == count
