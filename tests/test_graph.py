"""Graphs from faces, edges, points, grids and polylines: edges, welds, weights, components, order."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

import oneform_warp as ow
from oneform_warp.incidence import check_limits
from oneform_warp.polygons import as_polygons
from oneform_warp.sorting import iota
from oneform_warp.weights import COTANGENT_RANGE, LENGTH_RATIO
from oneform_warp.weld import weld
from references import components, random_graph

SEEDS = st.integers(0, 10**6)


def edge_set(pairs: np.ndarray) -> set[tuple[int, int]]:
    return {(min(i, j), max(i, j)) for i, j in np.asarray(pairs).tolist() if i != j}


@settings(max_examples=60)
@given(seed=SEEDS)
def test_incidence_lists_every_edge_from_both_ends(seed: int) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    graph = problem.graph()
    assert edge_set(graph.edges) == edge_set(problem.edges)
    assert len(graph.edges) == graph.edge_count
    offsets, neighbours, incident = (a.numpy() for a in (graph.offsets, graph.neighbours, graph.incident))
    tail, head = graph.tail.numpy(), graph.head.numpy()
    rows = np.repeat(np.arange(graph.node_count), np.diff(offsets))
    along = incident >= 0
    edge = np.where(along, incident, ~incident)
    assert (rows == np.where(along, tail[edge], head[edge])).all()
    assert (neighbours == np.where(along, head[edge], tail[edge])).all()
    assert (np.bincount(edge, minlength=graph.edge_count) == 2).all()


@settings(max_examples=60)
@given(seed=SEEDS)
def test_components_stand_together_those_with_edges_first(seed: int) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    graph = problem.graph()
    expected = {frozenset(group.tolist()) for group in components(problem.vertex_count, problem.edges)}
    found = {frozenset(np.flatnonzero(graph.components == c).tolist()) for c in range(graph.component_count)}
    assert found == expected
    assert (np.diff(graph.node_component) >= 0).all()
    sizes = np.diff(graph.component_offsets)
    assert (sizes[: graph.solved_components] > 1).all()
    assert (sizes[graph.solved_components :] == 1).all()


def test_polygons_keep_their_own_edges() -> None:
    faces = [[0, 1, 2, 3, 4], [1, 5, 2], [6, 7]]
    graph = ow.Graph.from_faces(np.random.default_rng(0).normal(size=(9, 3)), faces, weights="uniform")
    assert edge_set(graph.edges) == {(0, 1), (1, 2), (2, 3), (3, 4), (0, 4), (1, 5), (2, 5), (6, 7)}
    assert graph.component_count == 3


def cotangent(a: np.ndarray, apex: np.ndarray, b: np.ndarray) -> float:
    p, q = a - apex, b - apex
    return float(p @ q / np.linalg.norm(np.cross(p, q)))


@settings(max_examples=40)
@given(sizes=st.lists(st.integers(0, 7), max_size=12), seed=SEEDS)
def test_edges_and_cotangents_of_polygons_of_any_size(sizes: list[int], seed: int) -> None:
    x = np.random.default_rng(seed).normal(size=(max(sum(sizes), 1), 3))
    numbers = iter(range(sum(sizes)))
    faces = [[next(numbers) for _ in range(size)] for size in sizes]
    expected: dict[tuple[int, int], float] = {}
    for f in faces:
        fan = [(f[0], f[k], f[k + 1]) for k in range(1, len(f) - 1)]
        for i, j in ((f[k], f[(k + 1) % len(f)]) for k in range(len(f)) if len(f) > 1):
            opposite = [next(iter(set(t) - {i, j})) for t in fan if {i, j} <= set(t)]
            half = sum(cotangent(x[i], x[o], x[j]) for o in opposite) / 2
            expected[min(i, j), max(i, j)] = float(np.clip(half, *COTANGENT_RANGE)) if opposite else 1.0
    graph = ow.Graph.from_faces(x, faces)
    found = {(min(e), max(e)): w for e, w in zip(graph.edges.tolist(), graph.mu.numpy().tolist(), strict=True)}
    assert found == pytest.approx(expected)


def test_the_three_spellings_of_faces_agree() -> None:
    array = np.array([[0, 1, 2, 3], [3, 2, 4, 5]])
    for faces in (array, array.tolist(), (array.ravel(), np.array([0, 4, 8]))):
        polygons = as_polygons(faces, 6)
        assert polygons.indices.tolist() == array.ravel().tolist()
        assert polygons.offsets.tolist() == [0, 4, 8]


def groups_of(x: np.ndarray, tolerance: float | None = 0.0) -> np.ndarray:
    groups = weld(wp.array(x, dtype=wp.vec3d, device="cpu"), tolerance)
    of, first = groups.of_vertex.numpy(), groups.first.numpy()
    assert sorted(set(of)) == list(range(len(first)))
    assert all(np.flatnonzero(of == g)[0] == first[g] for g in range(len(first)))
    return of


@settings(max_examples=40)
@given(seed=SEEDS, repeats=st.integers(1, 4))
def test_exact_weld_groups_equal_positions(seed: int, repeats: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 3, size=(20, 3)).astype(float)
    points[rng.random(20) < 0.2] *= -0.0  # -0.0 is the same place as 0.0
    x = np.tile(points, (repeats, 1))
    groups = groups_of(x)
    assert ((groups[:, None] == groups[None]) == (x[:, None] == x[None]).all(axis=2)).all()


def test_a_collision_of_hashes_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0]])
    module = importlib.import_module("oneform_warp.weld")
    monkeypatch.setattr(module, "sort_by_key", lambda key: (wp.zeros_like(key), iota(len(x), key.device)))
    assert groups_of(x).tolist() == [0, 1, 0, 1]


def test_weld_by_tolerance_and_off() -> None:
    x = np.array([[0.0, 0, 0], [0.9e-3, 0, 0], [1.8e-3, 0, 0], [5e-3, 0, 0], [0, 0, 0]])
    apart = [[0, 1, 2, 4], [3]]
    assert [np.flatnonzero(groups_of(x, 1e-3) == g).tolist() for g in range(2)] == apart
    assert groups_of(x, 0.0)[4] == groups_of(x, 0.0)[0]
    assert groups_of(x, None).tolist() == [0, 1, 2, 3, 4]


def soup(x: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each triangle with corners of its own, as STL files have them."""
    return x[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def test_a_soup_welds_to_the_mesh_that_it_came_from() -> None:
    x, faces = ow.shapes.bar()
    y, loose = soup(x, faces)
    graph = ow.Graph.from_faces(y, loose)
    assert graph.node_count == len(x)
    assert graph.component_count == 1
    assert graph.vertices_from(graph.nodes_from(y)) == pytest.approx(y, abs=0.0)
    assert sorted(graph.mu.numpy()) == pytest.approx(sorted(ow.Graph.from_faces(x, faces).mu.numpy()))


def test_cotangent_weights_of_equilateral_and_right_triangles() -> None:
    height = np.sqrt(3.0) / 2.0
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, height, 0], [0.5, -height, 0]])
    graph = ow.Graph.from_faces(x, [[0, 1, 2], [1, 0, 3]])
    for (i, j), mu in zip(graph.edges.tolist(), graph.mu.numpy(), strict=True):
        assert mu == pytest.approx((2 if {i, j} == {0, 1} else 1) * 0.5 / np.tan(np.pi / 3))
    rectangle = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]])
    quad = ow.Graph.from_faces(rectangle, [[0, 1, 2, 3]])
    for (i, j), mu in zip(quad.edges.tolist(), quad.mu.numpy(), strict=True):
        long = abs(rectangle[i, 0] - rectangle[j, 0]) == 2.0
        assert mu == pytest.approx(0.5 * (0.5 if long else 2.0))


@settings(max_examples=60)
@given(seed=SEEDS, flat=st.sampled_from([0.0, 1e-12, 1.0]))
def test_weights_are_positive_and_clamped_on_any_triangles(seed: int, flat: float) -> None:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(12, 3)) * [1.0, flat, flat]
    x[:3] = x[0]  # zero-length edges
    faces = rng.integers(0, 12, size=(20, 3))
    for weld_tolerance in (0.0, None):
        cotangent = ow.Graph.from_faces(x, faces, weld=weld_tolerance).mu.numpy()
        assert ((cotangent >= COTANGENT_RANGE[0]) & (cotangent <= COTANGENT_RANGE[1])).all()
        inverse = ow.Graph.from_faces(x, faces, weights="inverse_length", weld=weld_tolerance).mu.numpy()
        assert ((inverse > 0.0) & (inverse <= LENGTH_RATIO)).all()


def test_extra_edges_join_components_and_add_their_weight() -> None:
    x = np.concatenate([np.eye(3), np.eye(3) + 5.0])
    faces = [[0, 1, 2], [3, 4, 5]]
    plain = ow.Graph.from_faces(x, faces, weights="uniform")
    joined = ow.Graph.from_faces(x, faces, weights="uniform", extra_edges=[[0, 3], [0, 1]], extra_weight=0.25)
    assert plain.component_count == 2
    assert joined.component_count == 1
    mu = {(min(e), max(e)): w for e, w in zip(joined.edges.tolist(), joined.mu.numpy(), strict=True)}
    assert mu[0, 3] == 0.25
    assert mu[0, 1] == 1.25
    assert mu[0, 2] == 1.0


def test_graphs_without_faces() -> None:
    grid = ow.Graph.from_grid((3, 4))
    assert edge_set(grid.edges) == {(4 * r + c, 4 * r + c + 1) for r in range(3) for c in range(3)} | {
        (4 * r + c, 4 * r + 4 + c) for r in range(2) for c in range(4)
    }
    assert edge_set(ow.Graph.from_polyline(4, closed=True).edges) == {(0, 1), (1, 2), (2, 3), (0, 3)}
    assert ow.Graph.from_grid((2, 2, 2)).edge_count == 12
    points = np.random.default_rng(1).normal(size=(50, 3))
    points[10:14] = points[9]  # coincident points have one another as nearest
    graph = ow.Graph.from_points(points, neighbours=5)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    degree = np.bincount(graph.edges.ravel(), minlength=50)
    assert (degree >= 5).all()
    reach = np.sort(distance, axis=1)[:, 4]
    i, j = graph.edges.T
    assert (distance[i, j] <= np.maximum(reach[i], reach[j])).all()


def test_a_random_numbering_is_put_in_order() -> None:
    x, faces = ow.shapes.grid(60, 60)
    rng = np.random.default_rng(0)
    shuffled = rng.permutation(len(x))
    graph = ow.Graph.from_faces(x[np.argsort(shuffled)], shuffled[faces], weights="uniform")
    spread = np.abs(graph.tail.numpy() - graph.head.numpy())
    # Rings of up to 61 vertices on a CPU, a Morton curve on a GPU; a random order has a mean of V / 3, about 1,200.
    assert spread.mean() < 200


def test_int32_limits_are_checked_before_anything_is_allocated() -> None:
    check_limits(1000, 2**30 - 1)
    with pytest.raises(ow.InputError, match="more than int32 can number"):
        check_limits(1000, 2**30)
    with pytest.raises(ow.InputError, match="more than int32 can number"):
        check_limits(2**31, 10)


SPELLINGS = {
    "int32": lambda x, f: (x, f.astype(np.int32)),
    "uint32": lambda x, f: (x, f.astype(np.uint32)),
    "float32, rows not in order of memory": lambda x, f: (
        np.asfortranarray(x.astype(np.float32)),
        np.asfortranarray(f),
    ),
    "Warp": lambda x, f: (wp.array(x, dtype=wp.vec3d), wp.array(f.astype(np.int32), dtype=wp.int32)),
    "Warp, float32 and vec3i": lambda x, f: (wp.array(x, dtype=wp.vec3), wp.array(f.astype(np.int32), dtype=wp.vec3i)),
    "flat Warp rows": lambda x, f: (wp.array(x, dtype=wp.float64), wp.array(f.astype(np.int64), dtype=wp.int64)),
    "indices and offsets": lambda x, f: (x, (f.ravel(), 3 * np.arange(len(f) + 1))),
    "lists": lambda x, f: (x.tolist(), f.tolist()),
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_every_spelling_of_a_mesh_makes_the_same_graph(spelling: str, device: str) -> None:
    x, faces = ow.shapes.sphere(2)
    x = x.astype(np.float32).astype(np.float64)
    expected = ow.Graph.from_faces(x, faces, device=device)
    graph = ow.Graph.from_faces(*SPELLINGS[spelling](x, faces), device=device)
    assert (graph.edges == expected.edges).all()
    assert (graph.mu.numpy() == expected.mu.numpy()).all()


@pytest.mark.parametrize("dtype", [np.int32, np.int64, np.uint32])
def test_the_first_bad_number_is_named(dtype: type, device: str) -> None:
    x, faces = ow.shapes.sphere(2)
    far = faces.astype(dtype)
    far[7, 1], far[9, 0] = 2**31 - 1, 2**31 - 1
    with pytest.raises(ow.InputError, match="face 7: vertex number 2147483647 does not exist"):
        ow.Graph.from_faces(x, far, device=device)
    far[7, 1] = -1 if dtype is not np.uint32 else 2**32 - 1
    with pytest.raises(ow.InputError, match=r"face 7: vertex number (-1|4294967295) does not exist"):
        ow.Graph.from_faces(x, far, device=device)
    x = x.copy()
    x[5, 1], x[100, 0] = np.inf, np.nan
    for rows in (x, wp.array(x, dtype=wp.vec3d), wp.array(x, dtype=wp.vec3)):
        with pytest.raises(ow.InputError, match=r"x: row 5 is \[.*inf.*\], not finite"):
            ow.Graph.from_faces(rows, faces, device=device)


def test_more_corners_than_int32_can_number_are_refused_before_anything_is_made(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from oneform_warp import incidence, intake

    x, faces = ow.shapes.sphere(1)
    monkeypatch.setattr(incidence, "INT32_LIMIT", faces.size - 2)
    with pytest.raises(ow.InputError, match="more than int32 can number"):
        intake.faces_on(faces, len(x), "cpu")
