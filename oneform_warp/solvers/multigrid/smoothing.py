"""Chebyshev smoothing of degree two on the rows of one level, and the residual it leaves.

Everything is float32, since a cycle only preconditions. Kernels share rows among lanes, see `lanes`.
"""

from __future__ import annotations

import warp as wp

from oneform_warp.solvers.multigrid.lanes import launch_rows, sum_over_lanes
from oneform_warp.solvers.rows import LaplacianRows

__all__ = ["FIRST", "first_step", "product_of_lane", "residual", "second_step", "smooth_from_zero"]

# Chebyshev polynomials on [A, B] of the spectrum of D^-1 A, which is in [0, 2] by Gershgorin. No eigenvalue needs an
# estimate: they shrink every error in (0, A + B), and A + B is above 2.
_A, _B = 0.3, 1.8
_CENTRE, _RADIUS = (_B + _A) / 2.0, (_B - _A) / 2.0
_RHO = 1.0 / (2.0 * _CENTRE / _RADIUS - _RADIUS / _CENTRE)
FIRST = wp.constant(wp.float32(1.0 / _CENTRE))
"""The first step: d_0 = FIRST D^-1 r."""
AGAIN = wp.constant(wp.float32(_RHO * _RADIUS / _CENTRE))
"""The second: d_1 = AGAIN d_0 + SECOND D^-1 r_1."""
SECOND = wp.constant(wp.float32(2.0 * _RHO / _RADIUS))


@wp.func
def product_of_lane(
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    x: wp.array[wp.vec3],
    i: int,
    lane: int,
    lanes: int,
) -> wp.vec3:
    """A lane's share of (A x)_i = sum_h w_h (x_i - x_j) + attachment_i x_i."""
    x_i = x[i]
    part = wp.vec3()
    for h in range(offsets[i] + lane, offsets[i + 1], lanes):
        part += weight[h] * (x_i - x[neighbours[h]])
    if lane == 0 and attachment.shape[0] > 0:
        part += attachment[i] * x_i
    return part


@wp.kernel(enable_backward=False)
def _smooth_from_zero(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    r: wp.array[wp.vec3],
    lanes: int,
    # Out:
    x_out: wp.array[wp.vec3],
):
    t = wp.tid()
    i = t // lanes
    lane = t - i * lanes
    part = wp.vec3()
    d = wp.vec3()
    if i < r.shape[0]:
        d = FIRST * inverse_diagonal[i] * r[i]
        for h in range(offsets[i] + lane, offsets[i + 1], lanes):
            j = neighbours[h]
            part += weight[h] * (d - FIRST * inverse_diagonal[j] * r[j])
        if lane == 0 and attachment.shape[0] > 0:
            part += attachment[i] * d
    product = sum_over_lanes(part, lanes)
    if lane == 0 and i < r.shape[0]:
        x_out[i] = d + AGAIN * d + SECOND * inverse_diagonal[i] * (r[i] - product)


def smooth_from_zero(rows: LaplacianRows, lanes: int, r: wp.array[wp.vec3], x_out: wp.array[wp.vec3]) -> None:
    """X <- two steps towards A^-1 r from zero, in one pass over the rows."""
    launch_rows(_smooth_from_zero, r.shape[0], lanes, [*rows.arguments(), r], [x_out], r.device)


@wp.kernel(enable_backward=False)
def _first_step(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    r: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
    lanes: int,
    # Out:
    d_out: wp.array[wp.vec3],
    x_out: wp.array[wp.vec3],
):
    t = wp.tid()
    i = t // lanes
    lane = t - i * lanes
    part = wp.vec3()
    if i < r.shape[0]:
        part = product_of_lane(offsets, neighbours, weight, attachment, x, i, lane, lanes)
    product = sum_over_lanes(part, lanes)
    if lane == 0 and i < r.shape[0]:
        d = FIRST * inverse_diagonal[i] * (r[i] - product)
        d_out[i] = d
        x_out[i] = x[i] + d


@wp.kernel(enable_backward=False)
def _second_step(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    r: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
    d: wp.array[wp.vec3],
    lanes: int,
    # Out:
    x_out: wp.array[wp.vec3],
):
    t = wp.tid()
    i = t // lanes
    lane = t - i * lanes
    part = wp.vec3()
    if i < r.shape[0]:
        part = product_of_lane(offsets, neighbours, weight, attachment, x, i, lane, lanes)
    product = sum_over_lanes(part, lanes)
    if lane == 0 and i < r.shape[0]:
        x_out[i] = x[i] + AGAIN * d[i] + SECOND * inverse_diagonal[i] * (r[i] - product)


def first_step(
    rows: LaplacianRows,
    lanes: int,
    r: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
    d_out: wp.array[wp.vec3],
    x_out: wp.array[wp.vec3],
) -> None:
    """The first of two steps from x towards A^-1 r, and its direction d."""
    launch_rows(_first_step, r.shape[0], lanes, [*rows.arguments(), r, x], [d_out, x_out], r.device)


def second_step(
    rows: LaplacianRows,
    lanes: int,
    r: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
    d: wp.array[wp.vec3],
    x_out: wp.array[wp.vec3],
) -> None:
    """The second, from what the first one left."""
    launch_rows(_second_step, r.shape[0], lanes, [*rows.arguments(), r, x, d], [x_out], r.device)


@wp.kernel(enable_backward=False)
def _residual(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    r: wp.array[wp.vec3],
    x: wp.array[wp.vec3],
    lanes: int,
    # Out:
    residual_out: wp.array[wp.vec3],
):
    t = wp.tid()
    i = t // lanes
    lane = t - i * lanes
    part = wp.vec3()
    moves = bool(False)
    if i < r.shape[0]:
        moves = inverse_diagonal[i] > 0.0
        if moves:
            part = product_of_lane(offsets, neighbours, weight, attachment, x, i, lane, lanes)
    product = sum_over_lanes(part, lanes)
    if lane == 0 and i < r.shape[0]:
        residual = wp.vec3()
        if moves:
            residual = r[i] - product
        residual_out[i] = residual


def residual(
    rows: LaplacianRows, lanes: int, r: wp.array[wp.vec3], x: wp.array[wp.vec3], residual_out: wp.array[wp.vec3]
) -> None:
    """R - A x where nodes move, zero where they do not."""
    launch_rows(_residual, r.shape[0], lanes, [*rows.arguments(), r, x], [residual_out], r.device)
