"""Edge weights mu: how strongly each edge asks for its vector; on the device."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.errors import InputError

__all__ = [
    "COTANGENT_RANGE",
    "KINDS",
    "LENGTH_RATIO",
    "Listing",
    "NodeFaces",
    "Weights",
    "check_weights",
    "cotangent_weights",
    "inverse_length_weights",
    "kind_named",
    "with_listed_weights",
]

COTANGENT_RANGE = (0.01, 100.0)
"""Cotangent weights are clamped to this range: obtuse pairs would be negative, needles infinite."""

LENGTH_RATIO = 100.0
"""Inverse length weights grow to at most this many times the weight of an edge of mean length."""

Weights = Any
"""A kind of weights ("cotangent", "uniform", "inverse_length"), or one number > 0 per edge."""

KINDS = ("cotangent", "uniform", "inverse_length")


@dataclass(frozen=True, eq=False)
class Listing:
    """Edges as they were listed: the polygons' corners, each to the next, then extra pairs."""

    first: wp.array[wp.int32]
    """The node where each listed pair starts, (k,)."""
    order: wp.array[wp.int32]
    """Listed pairs, those of one edge together, (k,); loops at the end."""
    offsets: wp.array[wp.int32]
    """Unique edge u has the pairs order[offsets[u]] to order[offsets[u + 1]], (m + 1,)."""
    unique_of: wp.array[wp.int32]
    """The u of each edge of the graph, (m,)."""


@dataclass(frozen=True, eq=False)
class NodeFaces:
    """Polygons in nodes: face f has the corners offsets[f] to offsets[f + 1]."""

    corners: wp.array[wp.int32]
    offsets: wp.array[wp.int32]


def kind_named(weights: str, *, faces: bool) -> str:
    """A checked kind; InputError with the nearest one, or where cotangents have no faces."""
    if weights not in KINDS:
        near = get_close_matches(weights, KINDS, n=1) or [KINDS[0]]
        raise InputError(
            f"there is no kind {weights!r}",
            where="weights",
            fix=f"did you mean {near[0]!r}? kinds: {', '.join(KINDS)}",
        )
    if weights == "cotangent" and not faces:
        raise InputError(
            "cotangents need faces, this graph has none", where="weights", fix="use 'uniform' or 'inverse_length'"
        )
    return weights


def check_weights(mu: NDArray[np.float64], count: int, where: str = "weights") -> NDArray[np.float64]:
    """The caller's mu, (m,) > 0 and finite, as float64; InputError with the first edge that is not."""
    if mu.shape != (count,):
        raise InputError(f"{mu.shape} weights for {count} edges", where=where, fix=f"give shape ({count},)")
    wrong = ~(np.isfinite(mu) & (mu > 0.0))
    if wrong.any():
        edge = int(np.argmax(wrong))
        raise InputError(f"the weight of edge {edge} is {mu[edge]}", where=where, fix="edge weights are > 0 and finite")
    return mu.astype(np.float64)


@wp.func
def cotangent_at(apex: wp.vec3d, p: wp.vec3d, q: wp.vec3d, limit: wp.float64) -> wp.float64:
    """The cotangent of the angle p-apex-q, within +-limit; 0 where the angle has no sides."""
    a = p - apex
    b = q - apex
    area = wp.length(wp.cross(a, b))
    dot = wp.dot(a, b)
    # Also true for an area that underflows: the quotient would be infinite or undefined.
    if wp.abs(dot) >= limit * area:
        return wp.sign(dot) * wp.where(dot == wp.float64(0.0), wp.float64(0.0), limit)
    return dot / area


@wp.func
def face_at(face_offsets: wp.array[wp.int32], corner: int) -> int:
    """The face of a corner, by bisection: looked for once in a graph's life, and so not kept."""
    low = int(0)
    high = face_offsets.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if face_offsets[middle] <= corner:
            low = middle
        else:
            high = middle
    return low


@wp.kernel(enable_backward=False)
def _cotangents(
    # Graph:
    order: wp.array[wp.int32],
    listed_offsets: wp.array[wp.int32],
    unique_of: wp.array[wp.int32],
    corners: wp.array[wp.int32],
    face_offsets: wp.array[wp.int32],
    # In:
    x: wp.array[wp.vec3d],
    low: wp.float64,
    high: wp.float64,
    # Out:
    mu_out: wp.array[wp.float64],
):
    e = wp.tid()
    u = unique_of[e]
    total = wp.float64(0.0)
    faced = int(0)
    for k in range(listed_offsets[u], listed_offsets[u + 1]):
        c = order[k]
        if c < corners.shape[0]:
            f = face_at(face_offsets, c)
            first = face_offsets[f]
            last = face_offsets[f + 1] - 1
            if last - first >= 2:
                # The fan triangle on this side has its third corner at the fan's centre, or next to it.
                opposite = first
                if c == first:
                    opposite = first + 2
                if c == last:
                    opposite = last - 1
                following = wp.where(c == last, first, c + 1)
                total += cotangent_at(x[corners[opposite]], x[corners[c]], x[corners[following]], high)
                faced = 1
    mu_out[e] = wp.where(faced == 1, wp.clamp(total / wp.float64(2.0), low, high), wp.float64(1.0))


def cotangent_weights(listing: Listing, faces: NodeFaces, x: wp.array[wp.vec3d]) -> wp.array[wp.float64]:
    """mu_ij = (cot alpha + cot beta) / 2 over the angles that face edge ij, clamped to COTANGENT_RANGE.

    Polygons above 3 corners are cut into the fan around their first corner; the fan's inner edges are not edges of
    the graph and their cotangents are dropped. Angles in triangles without area count as 0 or as the clamp.
    x: node positions, (n,) -> (m,). An edge that no triangle has gets weight 1. Source: Pinkall and Polthier 1993.
    """
    mu = wp.empty(listing.unique_of.shape[0], dtype=wp.float64, device=x.device)
    inputs = [listing.order, listing.offsets, listing.unique_of, faces.corners, faces.offsets, x]
    wp.launch(_cotangents, dim=mu.shape[0], inputs=[*inputs, *COTANGENT_RANGE], outputs=[mu], device=x.device)
    return mu


@wp.kernel(enable_backward=False)
def _lengths(
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    # In:
    x: wp.array[wp.vec3d],
    # Out:
    length_out: wp.array[wp.float64],
):
    e = wp.tid()
    length_out[e] = wp.length(x[head[e]] - x[tail[e]])


def inverse_length_weights(
    tail: wp.array[wp.int32], head: wp.array[wp.int32], x: wp.array[wp.vec3d]
) -> wp.array[wp.float64]:
    """mu_ij = mean length / |x_j - x_i|, at most LENGTH_RATIO; lengths of any unit -> (m,)."""
    lengths = wp.empty(tail.shape[0], dtype=wp.float64, device=x.device)
    wp.launch(_lengths, dim=tail.shape[0], inputs=[tail, head, x], outputs=[lengths], device=x.device)
    host = lengths.numpy()
    mean = float(host.mean()) if len(host) else 0.0
    if mean == 0.0:
        return wp.ones(len(host), dtype=wp.float64, device=x.device)
    with np.errstate(divide="ignore", over="ignore"):
        return wp.array(np.minimum(mean / host, LENGTH_RATIO), dtype=wp.float64, device=x.device)


@wp.kernel(enable_backward=False)
def _add_listed(
    # Graph:
    order: wp.array[wp.int32],
    listed_offsets: wp.array[wp.int32],
    unique_of: wp.array[wp.int32],
    # In:
    corner_count: int,
    listed_mu: wp.array[wp.float64],
    # Out:
    mu_out: wp.array[wp.float64],
):
    e = wp.tid()
    u = unique_of[e]
    total = wp.float64(0.0)
    faced = int(0)
    for k in range(listed_offsets[u], listed_offsets[u + 1]):
        listed = order[k]
        if listed < corner_count:
            faced = 1
        else:
            total += listed_mu[listed - corner_count]
    mu_out[e] = wp.where(faced == 1, mu_out[e], wp.float64(0.0)) + total


def with_listed_weights(
    listing: Listing, corner_count: int, listed_mu: wp.array[wp.float64], mu: wp.array[wp.float64]
) -> wp.array[wp.float64]:
    """Adds the weights of the pairs after the corners; an edge that only they have keeps nothing else. In place."""
    inputs = [listing.order, listing.offsets, listing.unique_of, corner_count, listed_mu]
    wp.launch(_add_listed, dim=mu.shape[0], inputs=inputs, outputs=[mu], device=mu.device)
    return mu
