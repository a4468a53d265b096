"""Edge weights mu: how strongly each edge asks for its vector."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.polygons import Polygons, fan_corners

__all__ = [
    "COTANGENT_RANGE",
    "LENGTH_RATIO",
    "Weights",
    "check_weights",
    "cotangent_weights",
    "edge_weights",
    "inverse_length_weights",
]

Weights = Any
"""A kind of weights ("cotangent", "uniform", "inverse_length"), or one number > 0 per edge."""

KINDS = ("cotangent", "uniform", "inverse_length")


COTANGENT_RANGE = (0.01, 100.0)
"""Cotangent weights are clamped to this range: obtuse pairs would be negative, needles infinite."""

LENGTH_RATIO = 100.0
"""Inverse length weights grow to at most this many times the weight of an edge of mean length."""

Edges = NDArray[np.integer]


def edge_weights(
    weights: Weights,
    x: NDArray[np.float64] | None,
    pairs: Edges,
    polygons: Polygons | None = None,
    corner_edge: NDArray[np.int64] | None = None,
) -> NDArray[np.float64]:
    """The one place that reads `weights`: a kind, or values per edge -> mu (m,) float64.

    x: node positions (n, 3), needed by "cotangent" (with faces) and "inverse_length".
    """
    if not isinstance(weights, str):
        return check_weights(np.asarray(weights, dtype=np.float64), len(pairs))
    if weights == "uniform":
        return np.ones(len(pairs))
    if weights not in KINDS:
        near = get_close_matches(weights, KINDS, n=1) or [KINDS[0]]
        raise InputError(
            f"there is no kind {weights!r}",
            where="weights",
            fix=f"did you mean {near[0]!r}? kinds: {', '.join(KINDS)}",
        )
    if x is None:
        raise InputError(f"{weights!r} needs rest positions", where="weights", fix="pass x as well")
    if weights == "inverse_length":
        return inverse_length_weights(x, pairs)
    if polygons is None or corner_edge is None:
        raise InputError(
            "cotangents need faces, this graph has none",
            where="weights",
            fix="use 'uniform' or 'inverse_length'",
        )
    return cotangent_weights(x, polygons, corner_edge, len(pairs))


def cotangent_weights(
    x: NDArray[np.float64], polygons: Polygons, corner_edge: NDArray[np.int64], edge_count: int
) -> NDArray[np.float64]:
    """mu_ij = (cot alpha + cot beta) / 2 over the angles that face edge ij, clamped to COTANGENT_RANGE.

    Polygons above 3 corners are cut into the fan around their first corner; the fan's inner edges are not edges of
    the graph and their cotangents are dropped. Angles in triangles without area count as 0 or as the clamp.
    x: (V, 3); corner_edge: the edge from each corner to the next, -1 for none -> (edge_count,) float64.
    An edge that no triangle has gets weight 1. Source: Pinkall and Polthier 1993.
    """
    low, high = COTANGENT_RANGE
    corners = fan_corners(polygons)
    points = x[polygons.indices]
    is_last = np.zeros(len(polygons.indices), dtype=bool)
    is_last[polygons.offsets[1:][np.diff(polygons.offsets) > 0] - 1] = True
    sums, faced = np.zeros(edge_count), np.zeros(edge_count, dtype=bool)
    for side in range(3):
        i, j, apex = (corners[:, (side + k) % 3] for k in range(3))
        own = (j == i + 1) | ((side == 2) & is_last[i])
        edge = np.where(own, corner_edge[i], -1)
        i, j, apex, edge = i[edge >= 0], j[edge >= 0], apex[edge >= 0], edge[edge >= 0]
        sums += np.bincount(edge, _cotangent(points[i] - points[apex], points[j] - points[apex]), edge_count)
        faced[edge] = True
    return np.where(faced, np.clip(sums / 2.0, low, high), 1.0)


def _cotangent(p: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64]:
    high = COTANGENT_RANGE[1]
    twice_area = np.linalg.norm(np.cross(p, q), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.einsum("ij,ij->i", p, q) / twice_area
    return np.clip(np.nan_to_num(ratio, nan=0.0, posinf=high, neginf=-high), -high, high)


def inverse_length_weights(x: NDArray[np.float64], edges: Edges) -> NDArray[np.float64]:
    """mu_ij = mean length / |x_j - x_i|, at most LENGTH_RATIO; lengths of any unit -> (m,) float64."""
    lengths = np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1)
    mean = float(lengths.mean()) if len(lengths) else 0.0
    if mean == 0.0:
        return np.ones(len(edges))
    with np.errstate(divide="ignore", over="ignore"):
        return np.minimum(mean / lengths, LENGTH_RATIO)


def check_weights(mu: NDArray[np.float64], count: int, where: str = "weights") -> NDArray[np.float64]:
    """The caller's mu, (m,) > 0 and finite, as float64; InputError with the first edge that is not."""
    if mu.shape != (count,):
        raise InputError(f"{mu.shape} weights for {count} edges", where=where, fix=f"give shape ({count},)")
    wrong = ~(np.isfinite(mu) & (mu > 0.0))
    if wrong.any():
        edge = int(np.argmax(wrong))
        raise InputError(f"the weight of edge {edge} is {mu[edge]}", where=where, fix="edge weights are > 0 and finite")
    return mu.astype(np.float64)
