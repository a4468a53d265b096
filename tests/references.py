"""Independent references: random graphs, and dense least squares that shares no code with the package."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import oneform_warp as ow


@dataclass(frozen=True)
class RandomGraph:
    """A listed graph with a 1-form on the list: components, isolated vertices, parallel edges, loops and all."""

    vertex_count: int
    edges: np.ndarray
    weights: np.ndarray
    v: np.ndarray
    fixed: np.ndarray
    start: np.ndarray

    def graph(self) -> ow.Graph:
        return ow.Graph.from_edges(self.vertex_count, self.edges, weights=self.weights)


def random_graph(
    seed: int, *, mu: tuple[float, float], parallel: bool = True, dimension: int | None = None
) -> RandomGraph:
    """A graph of up to 40 vertices; mu spread evenly in its logarithm over the range."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 41))
    dimension = int(rng.integers(1, 4)) if dimension is None else dimension
    edges = rng.integers(0, count, size=(int(rng.integers(0, 3 * count)), 2))
    if parallel and len(edges):
        again = edges[rng.integers(0, len(edges), size=len(edges) // 4)]
        edges = np.concatenate([edges, again[:, ::-1]])
    weights = np.exp(rng.uniform(*np.log(mu), size=len(edges)))
    v = rng.normal(size=(len(edges), dimension))
    fixed = np.flatnonzero(rng.random(count) < rng.choice([0.0, 0.1, 0.4]))
    return RandomGraph(count, edges, weights, v, fixed, rng.normal(size=(count, dimension)))


def dense_solution(problem: RandomGraph) -> np.ndarray:
    """min sum mu |x_j - x_i - v|^2 over the list by NumPy's lstsq; pins kept, else centroids of the start."""
    count, (i, j) = problem.vertex_count, problem.edges.T
    d = np.zeros((len(problem.edges), count))
    rows = np.arange(len(problem.edges))
    np.add.at(d, (rows, j), 1.0)
    np.add.at(d, (rows, i), -1.0)
    root = np.sqrt(problem.weights)[:, None]
    free = np.setdiff1d(np.arange(count), problem.fixed)
    x = problem.start.copy()
    right = root * (problem.v - d[:, problem.fixed] @ x[problem.fixed])
    if len(free) and len(rows):
        x[free] = np.linalg.lstsq(root * d[:, free], right, rcond=None)[0]
    for members in components(count, problem.edges):
        if not np.isin(members, problem.fixed).any():
            x[members] += problem.start[members].mean(axis=0) - x[members].mean(axis=0)
    return x


def components(count: int, edges: np.ndarray) -> list[np.ndarray]:
    """The vertices of each connected component, by union-find in plain Python."""
    name = list(range(count))

    def find(i: int) -> int:
        while name[i] != i:
            i = name[i]
        return i

    for i, j in edges.tolist():
        name[find(i)] = find(j)
    roots = np.array([find(i) for i in range(count)])
    return [np.flatnonzero(roots == root) for root in np.unique(roots)]


def residual_norms(problem: RandomGraph, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """|codiff(v - dx)| over the free vertices, and |codiff v|, per component and column, from the list itself."""
    i, j = problem.edges.T
    r, b = np.zeros_like(problem.start), np.zeros_like(problem.start)
    for total, form in ((r, problem.v - (x[j] - x[i])), (b, problem.v)):
        proper = (i != j)[:, None]
        np.add.at(total, i, -problem.weights[:, None] * form * proper)
        np.add.at(total, j, problem.weights[:, None] * form * proper)
    r[problem.fixed] = 0.0
    groups = components(problem.vertex_count, problem.edges)
    return np.stack([np.linalg.norm(r[g], axis=0) for g in groups]), np.stack(
        [np.linalg.norm(b[g], axis=0) for g in groups]
    )
