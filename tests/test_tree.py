"""Spanning trees against a brute-force Kruskal, and the integral along them."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

import oneform_warp as ow
from oneform_warp.forms import node_differential
from oneform_warp.rings import integrate_rings
from oneform_warp.tree import integrate_nodes
from references import RandomGraph, components, random_graph

SEEDS = st.integers(0, 10**6)
KINDS = ["min_depth", "maximal", "minimal"]


def tree_of(kind: str, graph: ow.Graph, problem: RandomGraph) -> ow.SpanningTree:
    v = graph.merge(problem.v)
    if kind == "min_depth":
        return ow.spanning_tree(graph)
    cost = ow.edge_energy(graph, problem.start, v)
    # Many real edges have exactly zero energy: so must these, for the ties.
    cost[::3] = 0.0
    return ow.spanning_tree(graph, -cost if kind == "maximal" else cost)


@settings(max_examples=60)
@given(seed=SEEDS, kind=st.sampled_from(KINDS))
def test_trees_span_every_component_without_cycles(seed: int, kind: str) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    graph = problem.graph()
    tree = tree_of(kind, graph, problem)
    assert len(tree.edges) == graph.node_count - graph.component_count
    assert len(np.unique(tree.edges)) == len(tree.edges)
    with_tree = components(problem.vertex_count, graph.edges[tree.edges])
    assert len(with_tree) == graph.component_count
    assert sorted(graph.components[tree.roots]) == list(range(graph.component_count))


@settings(max_examples=60)
@given(seed=SEEDS, kind=st.sampled_from(KINDS), dtype=st.sampled_from([np.float32, np.float64]))
def test_integrating_dx_gives_x_up_to_one_translation_per_component(seed: int, kind: str, dtype: type) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    graph = problem.graph()
    dx = ow.differential(graph, problem.start.astype(dtype))
    x = ow.integrate_tree(tree_of(kind, graph, problem), dx)
    assert x.dtype == dtype
    tolerance = 40 * 4 * np.finfo(dtype).eps  # a path of up to 40 edges of length up to 4
    for group in components(problem.vertex_count, problem.edges):
        moved = (x - problem.start)[group]
        assert np.ptp(moved, axis=0).max() <= tolerance


def brute_force(graph: ow.Graph, cost: np.ndarray) -> set[int]:
    """Kruskal in plain Python, ties by edge number."""
    chosen: list[int] = []
    for e in sorted(range(graph.edge_count), key=lambda e: (cost[e], e)):
        before = len(components(graph.vertex_count, graph.edges[chosen]))
        if len(components(graph.vertex_count, graph.edges[[*chosen, e]])) < before:
            chosen.append(e)
    return set(chosen)


@settings(max_examples=25)
@given(seed=SEEDS, sign=st.sampled_from([1.0, -1.0]))
def test_weighted_trees_are_kruskals(seed: int, sign: float) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    graph = problem.graph()
    cost = sign * ow.edge_energy(graph, problem.start, graph.merge(problem.v))
    cost[::3] = 0.0
    assert set(ow.spanning_tree(graph, cost).edges.tolist()) == brute_force(graph, cost)


@settings(max_examples=25)
@given(seed=SEEDS)
def test_weighted_trees_from_roots_are_kruskals_of_the_graph_with_all_roots_joined(seed: int) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    graph = problem.graph()
    cost = np.random.default_rng(seed).random(graph.edge_count)
    roots = problem.fixed if len(problem.fixed) else np.array([0])
    number = np.arange(problem.vertex_count)
    for group in components(problem.vertex_count, problem.edges):
        inside = np.intersect1d(group, roots)
        number[inside] = inside.min(initial=problem.vertex_count)
    chosen: list[int] = []
    for e in np.argsort(cost, kind="stable"):
        before = len(components(problem.vertex_count, number[graph.edges[chosen]]))
        if len(components(problem.vertex_count, number[graph.edges[[*chosen, e]]])) < before:
            chosen.append(int(e))
    assert set(ow.spanning_tree(graph, cost, roots=roots).edges.tolist()) == set(chosen)


@settings(max_examples=40)
@given(seed=SEEDS)
def test_depth_is_the_distance_from_the_root(seed: int) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    graph = problem.graph()
    tree = ow.spanning_tree(graph)
    distance = np.full(problem.vertex_count, np.inf)
    distance[tree.roots] = 0
    for _ in range(problem.vertex_count):
        i, j = graph.edges.T
        np.minimum.at(distance, i, distance[j] + 1)
        np.minimum.at(distance, j, distance[i] + 1)
    assert (tree.depth[graph.node_of] == distance).all()


def test_the_root_is_in_the_middle_of_a_path() -> None:
    tree = ow.spanning_tree(ow.Graph.from_polyline(101))
    assert tree.depth.max() == 50
    assert tree.roots == pytest.approx([50])


@settings(max_examples=60)
@given(seed=SEEDS, kind=st.sampled_from(KINDS))
def test_trees_from_roots_have_x_at_every_root(seed: int, kind: str) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    graph = problem.graph()
    cost = None
    if kind != "min_depth":
        sign = -1.0 if kind == "maximal" else 1.0
        cost = sign * ow.edge_energy(graph, problem.start, graph.merge(problem.v))
    tree = ow.spanning_tree(graph, cost, roots=problem.fixed)
    assert set(problem.fixed) <= set(tree.roots)
    assert len(tree.edges) == graph.node_count - len(tree.roots)
    # Of components without a chosen root there is one, and every node hangs from a root of its own component.
    without = np.setdiff1d(np.arange(graph.component_count), graph.components[problem.fixed])
    assert len(tree.roots) == len(problem.fixed) + len(without)
    assert len(components(problem.vertex_count, graph.edges[tree.edges])) == len(tree.roots)
    start = np.pad(problem.start, ((0, 0), (0, 3 - problem.start.shape[1])))
    x = wp.array(start[graph.vertex_at], dtype=wp.vec3d, device=graph.device)
    dx = node_differential(graph, x)
    assert np.abs(integrate_nodes(tree, dx, x).numpy() - x.numpy()).max(initial=0.0) < 1e-12
    assert (integrate_rings(tree, dx, x).numpy() == x.numpy()).all()


@settings(max_examples=30)
@given(seed=SEEDS)
def test_rings_are_means_over_the_ring_before(seed: int) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0), dimension=3)
    graph = problem.graph()
    v = graph.merge(problem.v)
    tree = ow.spanning_tree(graph, roots=problem.fixed)
    depth, node = tree.depth, {tuple(edge): e for e, edge in enumerate(graph.node_of[graph.edges].tolist())}
    x = problem.start[graph.vertex_at].copy()
    for j in np.argsort(depth, kind="stable"):
        ways = [(i, e, s) for (a, b), e in node.items() for i, k, s in ((a, b, 1.0), (b, a, -1.0)) if k == j]
        ways = [way for way in ways if depth[way[0]] < depth[j]]
        if ways:
            mu = graph.mu.numpy()[[e for _, e, _ in ways]]
            x[j] = np.average([x[i] + s * v[e] for i, e, s in ways], axis=0, weights=mu)
    start = wp.array(problem.start[graph.vertex_at], dtype=wp.vec3d, device=graph.device)
    found = integrate_rings(tree, wp.array(v, dtype=wp.vec3d, device=graph.device), start).numpy()
    assert np.abs(found - x).max(initial=0.0) < 1e-12


def test_bad_roots_are_named() -> None:
    with pytest.raises(ow.InputError, match="roots"):
        ow.spanning_tree(ow.Graph.from_polyline(4), roots=[4])


def test_bad_costs_are_named() -> None:
    graph = ow.Graph.from_polyline(4)
    with pytest.raises(ow.InputError, match=r"cost: a cost of shape \(2,\) for 3 edges"):
        ow.spanning_tree(graph, [1.0, 2.0])
    with pytest.raises(ow.InputError, match="give 3 finite numbers"):
        ow.spanning_tree(graph, [1.0, np.nan, 2.0])
