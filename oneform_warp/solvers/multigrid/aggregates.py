"""Aggregates: a maximal set of roots at distance three or more, and to each root the nodes around it."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from oneform_warp.solvers.rows import LaplacianRows
from oneform_warp.sorting import scan

__all__ = ["aggregate", "strong_edges"]

OUT = wp.constant(wp.int64(0))
UNDECIDED = wp.constant(wp.int64(1 << 61))
ROOT = wp.constant(wp.int64(1 << 62))
FIRST_MIX = wp.constant(wp.uint32(2654435761))
SECOND_MIX = wp.constant(wp.uint32(2246822519))
ROUNDS = 4
"""Rounds between two looks at whether all nodes are decided; six or so are usual."""


@wp.kernel(enable_backward=False)
def _strong(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    threshold: wp.float32,
    # Out:
    strong_out: wp.array[wp.uint8],
):
    i = wp.tid()
    for h in range(offsets[i], offsets[i + 1]):
        w = weight[h]
        relative = w * w * inverse_diagonal[i] * inverse_diagonal[neighbours[h]]
        strong_out[h] = wp.uint8(wp.where(w > 0.0 and relative >= threshold * threshold, 1, 0))


def strong_edges(rows: LaplacianRows, threshold: float) -> wp.array[wp.uint8]:
    """1 for the half-edges with a_ij^2 >= threshold^2 a_ii a_jj, the ones that errors are smooth along."""
    strong = wp.empty(rows.weight.shape[0], dtype=wp.uint8, device=rows.segments.device)
    inputs = [rows.offsets, rows.neighbours, rows.weight, rows.inverse_diagonal, threshold]
    wp.launch(_strong, dim=rows.inverse_diagonal.shape[0], inputs=inputs, outputs=[strong], device=strong.device)
    return strong


@wp.kernel(enable_backward=False)
def _first_keys(
    # In:
    inverse_diagonal: wp.array[wp.float32],
    # Out:
    key_out: wp.array[wp.int64],
):
    i = wp.tid()
    # state, 29 bits of a hash, node: packed so that one maximum compares them in this order.
    mixed = wp.uint32(i) * FIRST_MIX
    mixed = (mixed ^ (mixed >> wp.uint32(15))) * SECOND_MIX
    hashed = wp.int64((mixed ^ (mixed >> wp.uint32(13))) >> wp.uint32(3))
    key_out[i] = wp.where(inverse_diagonal[i] > 0.0, UNDECIDED, OUT) | (hashed << wp.int64(32)) | wp.int64(i)


@wp.kernel(enable_backward=False)
def _largest(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    strong: wp.array[wp.uint8],
    # In:
    key: wp.array[wp.int64],
    # Out:
    largest_out: wp.array[wp.int64],
):
    i = wp.tid()
    largest = key[i]
    for h in range(offsets[i], offsets[i + 1]):
        if strong[h] != wp.uint8(0):
            largest = wp.max(largest, key[neighbours[h]])
    largest_out[i] = largest


@wp.kernel(enable_backward=False)
def _decide(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    strong: wp.array[wp.uint8],
    # In:
    nearby: wp.array[wp.int64],
    # Out:
    key_out: wp.array[wp.int64],
    undecided_out: wp.array[wp.int32],
):
    i = wp.tid()
    own = key_out[i]
    if own < UNDECIDED or own >= ROOT:
        return
    largest = nearby[i]
    for h in range(offsets[i], offsets[i + 1]):
        if strong[h] != wp.uint8(0):
            largest = wp.max(largest, nearby[neighbours[h]])
    if largest == own:
        key_out[i] = own - UNDECIDED + ROOT
    elif largest >= ROOT:
        key_out[i] = own - UNDECIDED
    else:
        undecided_out[0] = 1


def _roots(rows: LaplacianRows, strong: wp.array[wp.uint8]) -> wp.array[wp.int64]:
    """Keys whose state tells the roots: a maximal independent set of the square of the strong graph (Luby's rounds)."""
    device, count = strong.device, rows.inverse_diagonal.shape[0]
    key, nearby = (wp.empty(count, dtype=wp.int64, device=device) for _ in range(2))
    table = [rows.offsets, rows.neighbours, strong]
    wp.launch(_first_keys, dim=count, inputs=[rows.inverse_diagonal], outputs=[key], device=device)
    undecided = wp.ones(1, dtype=wp.int32, device=device)
    while undecided.numpy()[0]:
        for _ in range(ROUNDS):
            undecided.zero_()
            wp.launch(_largest, dim=count, inputs=[*table, key], outputs=[nearby], device=device)
            wp.launch(_decide, dim=count, inputs=[*table, nearby], outputs=[key, undecided], device=device)
    return key


@wp.kernel(enable_backward=False)
def _mark_roots(
    # In:
    key: wp.array[wp.int64],
    # Out:
    is_root_out: wp.array[wp.int32],
):
    i = wp.tid()
    is_root_out[i] = wp.where(key[i] >= ROOT, 1, 0)


@wp.kernel(enable_backward=False)
def _number_roots(
    # In:
    key: wp.array[wp.int64],
    number: wp.array[wp.int32],
    # Out:
    aggregate_out: wp.array[wp.int32],
):
    i = wp.tid()
    aggregate_out[i] = wp.where(key[i] >= ROOT, number[i], -1)


@wp.kernel(enable_backward=False)
def _join(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    strong: wp.array[wp.uint8],
    # In:
    aggregate: wp.array[wp.int32],
    # Out:
    aggregate_out: wp.array[wp.int32],
):
    i = wp.tid()
    joined = aggregate[i]
    if joined < 0:
        strongest = wp.float32(0.0)
        for h in range(offsets[i], offsets[i + 1]):
            j = neighbours[h]
            if strong[h] != wp.uint8(0) and aggregate[j] >= 0 and weight[h] > strongest:
                strongest = weight[h]
                joined = aggregate[j]
    aggregate_out[i] = joined


def aggregate(rows: LaplacianRows, strong: wp.array[wp.uint8]) -> tuple[wp.array[wp.int32], int]:
    """The aggregate of each node, (n,), and their number; -1 for nodes that nothing moves.

    Roots are at strong distance three or more; a node next to roots joins the strongest, a node next to those likewise.
    """
    device, count = strong.device, rows.inverse_diagonal.shape[0]
    key = _roots(rows, strong)
    flags = wp.zeros(count + 1, dtype=wp.int32, device=device)
    wp.launch(_mark_roots, dim=count, inputs=[key], outputs=[flags], device=device)
    number, total = scan(flags)
    now, then = (wp.empty(count, dtype=wp.int32, device=device) for _ in range(2))
    wp.launch(_number_roots, dim=count, inputs=[key, number], outputs=[now], device=device)
    table: list[Any] = [rows.offsets, rows.neighbours, rows.weight, strong]
    for source, into in ((now, then), (then, now)):
        wp.launch(_join, dim=count, inputs=[*table, source], outputs=[into], device=device)
    return now, total


def aggregate_sizes(numbers: wp.array[wp.int32], total: int) -> np.ndarray:
    """How many nodes each aggregate has, (total,), on the host."""
    host = numbers.numpy()
    return np.bincount(host[host >= 0], minlength=total)
