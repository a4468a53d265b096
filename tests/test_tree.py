"""Spanning trees against a brute-force Kruskal, and the integral along them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oneform_warp as ow
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


def test_bad_costs_are_named() -> None:
    graph = ow.Graph.from_polyline(4)
    with pytest.raises(ow.InputError, match=r"cost: a cost of shape \(2,\) for 3 edges"):
        ow.spanning_tree(graph, [1.0, 2.0])
    with pytest.raises(ow.InputError, match="give 3 finite numbers"):
        ow.spanning_tree(graph, [1.0, np.nan, 2.0])
