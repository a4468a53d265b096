"""Edges made unique, nodes put in an order that keeps neighbours close, and the CSR incidence of both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError

__all__ = ["Incidence", "UniqueEdges", "incidence", "locality_order", "unique_edges"]

INT32_LIMIT = 2**31 - 1


class UniqueEdges(NamedTuple):
    """Undirected edges without loops or repeats, and where each listed edge went."""

    pairs: NDArray[np.int64]
    """(m, 2), the smaller number first, in lexicographic order."""
    edge_of: NDArray[np.int64]
    """The unique edge of each listed edge; -1 for a loop."""


class Incidence(NamedTuple):
    """CSR rows of half-edges: node i has half-edges offsets[i] to offsets[i + 1]."""

    offsets: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    incident: NDArray[np.int32]
    """The edge e of a half-edge that runs along it, ~e of one that runs against it."""


def unique_edges(pairs: NDArray[np.int64], node_count: int) -> UniqueEdges:
    """Listed edges (k, 2) of node numbers -> UniqueEdges. InputError when int32 cannot number them."""
    low, high = pairs.min(axis=1, initial=INT32_LIMIT), pairs.max(axis=1, initial=0)
    proper = low != high
    keys, inverse = np.unique(low[proper] * np.int64(node_count) + high[proper], return_inverse=True)
    check_limits(node_count, len(keys))
    edge_of = np.full(len(pairs), -1, dtype=np.int64)
    edge_of[proper] = inverse
    count = max(node_count, 1)
    return UniqueEdges(np.stack([keys // count, keys % count], axis=1), edge_of)


def check_limits(node_count: int, edge_count: int) -> None:
    """InputError, before anything is allocated, when half-edges cannot be numbered by int32."""
    if max(node_count, 2 * edge_count) > INT32_LIMIT:
        raise InputError(
            f"{node_count} vertices and {edge_count} edges are more than int32 can number",
            where="graph",
            fix="split the mesh into pieces below 2^31 half-edges",
        )


def locality_order(pairs: NDArray[np.int64], node_count: int) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Nodes in solving order, the component of each in that order, and how many components have edges.

    Components stand together, those with edges first, in the order of their first node; inside a component reverse
    Cuthill-McKee keeps neighbours close: a random order costs several times as much per product.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee

    if node_count == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), 0
    ones = np.ones(2 * len(pairs), dtype=np.int8)
    i, j = np.concatenate([pairs, pairs[:, ::-1]]).T
    adjacency = coo_array((ones, (i, j)), shape=(node_count, node_count)).tocsr()
    labels = connected_components(adjacency, directed=False)[1]
    isolated = np.diff(adjacency.indptr) == 0
    _, first = np.unique(labels, return_index=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.lexsort((first, isolated[first]))] = np.arange(len(first))
    order = reverse_cuthill_mckee(adjacency, symmetric_mode=True).astype(np.int64)
    order = order[np.argsort(rank[labels[order]], kind="stable")]
    return order, rank[labels[order]], int((~isolated[first]).sum())


def incidence(tail: NDArray[np.int64], head: NDArray[np.int64], node_count: int) -> Incidence:
    """Edges tail -> head of node numbers -> Incidence; within a row half-edges stand in the order of their edges."""
    edges = np.arange(len(tail), dtype=np.int64)
    origin = np.concatenate([tail, head])
    order = np.lexsort((np.concatenate([edges, edges]), origin))
    offsets = np.zeros(node_count + 1, dtype=np.int32)
    np.cumsum(np.bincount(origin, minlength=node_count), out=offsets[1:])
    neighbours = np.concatenate([head, tail])[order].astype(np.int32)
    incident = np.concatenate([edges, ~edges])[order].astype(np.int32)
    return Incidence(offsets, neighbours, incident)
