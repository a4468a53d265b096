"""Welding: coincident positions become one node, so that soups and UV seams deform as one piece."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError

__all__ = ["weld"]


def weld(x: NDArray[np.float64], tolerance: float | None = 0.0) -> NDArray[np.int64]:
    """The group of each vertex, numbered by first appearance: equal groups are to be one node.

    x: positions, shape (V, 3). tolerance: 0.0 joins exactly equal positions; > 0 joins, transitively, positions
    closer than this length; None joins nothing.
    """
    if tolerance is None:
        return np.arange(len(x), dtype=np.int64)
    if not np.isfinite(tolerance) or tolerance < 0.0:
        raise InputError(
            f"the weld tolerance is {tolerance}",
            where="weld",
            fix="give a length >= 0, or None to weld nothing",
        )
    groups = _by_distance(x, tolerance) if tolerance > 0.0 else _by_equality(x)
    return _by_first_appearance(groups)


def _by_equality(x: NDArray[np.float64]) -> NDArray[np.int64]:
    order = np.lexsort(x.T)
    ordered = x[order]
    differs = np.any(ordered[1:] != ordered[:-1], axis=1)
    groups = np.zeros(len(x), dtype=np.int64)
    groups[order[1:]] = np.cumsum(differs)
    return groups


def _by_distance(x: NDArray[np.float64], tolerance: float) -> NDArray[np.int64]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(x).query_pairs(tolerance, output_type="ndarray")
    near = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(x), len(x)))
    groups: NDArray[np.int64] = connected_components(near, directed=False)[1].astype(np.int64)
    return groups


def _by_first_appearance(groups: NDArray[np.int64]) -> NDArray[np.int64]:
    _, first, inverse = np.unique(groups, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    return rank[inverse]
