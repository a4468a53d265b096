"""Trees of short resistance: shortest paths, and the low-stretch tree of Alon, Karp, Peleg and West.

AKPW here as it is usually simplified: clusters by exponentially shifted shortest paths (Miller, Peng, Xu 2013) on the
graph of clusters, contracted, again with four times the radius. Trees are handed on as costs: 0 for their own edges.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

import oneform_warp as ow
from oneform_warp.tree import SpanningTree, spanning_tree

GROWTH = 4.0
"""Of the clusters' radius from one level to the next."""


def _of_edges(graph: ow.Graph, chosen: NDArray[np.int64], roots: Any) -> SpanningTree:
    """The spanning tree of chosen edges, which span."""
    cost = np.ones(graph.edge_count)
    cost[chosen] = 0.0
    return spanning_tree(graph, cost, roots=roots)


def _ends(graph: ow.Graph, roots: Any) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Ends of the edges where all roots are node 0, and how many nodes that are."""
    label = np.zeros(graph.node_count, dtype=np.int64)
    free = np.ones(graph.node_count, dtype=bool)
    free[graph.node_of[roots]] = False
    label[free] = 1 + np.arange(int(free.sum()))
    return label[graph.tail.numpy()], label[graph.head.numpy()], int(free.sum()) + 1


def _shortest_of_each_pair(
    i: NDArray[np.int64], j: NDArray[np.int64], length: NDArray[np.float64], count: int
) -> tuple[csr_matrix, csr_matrix]:
    """Lengths and edge numbers + 1 by pairs of nodes, loops left out, of parallel edges the shortest; symmetric."""
    a, b = np.minimum(i, j), np.maximum(i, j)
    order = np.lexsort((length, b, a))
    a, b = a[order], b[order]
    first = np.ones(len(a), dtype=bool)
    first[1:] = (a[1:] != a[:-1]) | (b[1:] != b[:-1])
    first &= a != b
    a, b, edge = a[first], b[first], order[first]
    ends = (np.concatenate([a, b]), np.concatenate([b, a]))
    lengths = csr_matrix((np.tile(length[edge], 2), ends), (count, count))
    numbers = csr_matrix((np.tile(edge + 1, 2), ends), (count, count))
    return lengths, numbers


def _edges_to(numbers: csr_matrix, parent: NDArray[np.int64], child: NDArray[np.int64]) -> NDArray[np.int64]:
    found: NDArray[np.int64] = np.asarray(numbers[parent, child]).ravel().astype(np.int64) - 1
    return found


def shortest_paths(graph: ow.Graph, length: NDArray[np.float64], roots: Any) -> SpanningTree:
    """The tree of shortest paths from the roots by a length of each edge (m,)."""
    i, j, count = _ends(graph, roots)
    lengths, numbers = _shortest_of_each_pair(i, j, length, count)
    _, parent = dijkstra(lengths, directed=False, indices=0, return_predecessors=True)
    child = np.flatnonzero(parent >= 0)
    return _of_edges(graph, _edges_to(numbers, parent[child], child), roots)


def akpw(graph: ow.Graph, length: NDArray[np.float64], roots: Any, seed: int = 0) -> SpanningTree:
    """A tree of low average stretch by a length of each edge (m,)."""
    rng = np.random.default_rng(seed)
    i, j, count = _ends(graph, roots)
    radius, chosen = 2.0 * float(np.median(length)), list[NDArray[np.int64]]()
    while count > 1:
        lengths, numbers = _shortest_of_each_pair(i, j, length, count)
        if numbers.nnz == 0:
            break
        late = rng.exponential(radius, count)
        late = late.max() - late
        source = csr_matrix((late + 1e-9 * radius, (np.full(count, count), np.arange(count))), (count + 1, count + 1))
        wide = lengths.copy()
        wide.resize(count + 1, count + 1)
        _, parent = dijkstra(wide + source, directed=True, indices=count, return_predecessors=True)
        child = np.flatnonzero((parent[:count] >= 0) & (parent[:count] < count))
        picked = _edges_to(numbers, parent[child], child)
        chosen.append(picked)
        forest = csr_matrix((np.ones(len(child)), (parent[child], child)), (count, count))
        count, label = connected_components(forest, directed=False)
        i, j = label[i], label[j]
        radius *= GROWTH
    return _of_edges(graph, np.concatenate(chosen), roots)
