"""Handles whose influences overlap: each counts by its odds, and together they leave as much of the rest as all leave.

    w_h                           weight of handle h, 1 at its own nodes
    W = 1 - prod_h (1 - w_h)      how much the handles count together
    o_h = w_h / (1 - w_h)         the odds of h
    value = W sum_h o_h value_h / sum_h o_h

Alone a handle counts w_h; at the nodes of one handle the others count nothing; equal values stay that value times W;
and what no handle reaches gets 0, the identity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.grip import Pins

__all__ = ["COLUMNS", "Overlap"]

COLUMNS = 3
"""Handles in one array of weights."""

CERTAIN = 1.0e-12
"""Of 1 - w: two handles with weight 1 at one node share it equally."""


@wp.kernel(enable_backward=False)
def _gather(
    # In:
    weight: wp.array[wp.vec3d],
    value: wp.mat33d,
    least: wp.float64,
    # Out:
    left_out: wp.array[wp.float64],
    odds_out: wp.array[wp.float64],
    sum_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    one = wp.float64(1.0)
    w = weight[i]
    odds = wp.vec3d(
        w[0] / wp.max(one - w[0], least), w[1] / wp.max(one - w[1], least), w[2] / wp.max(one - w[2], least)
    )
    left_out[i] = left_out[i] * (one - w[0]) * (one - w[1]) * (one - w[2])
    odds_out[i] = odds_out[i] + odds[0] + odds[1] + odds[2]
    sum_out[i] = sum_out[i] + odds * value


@wp.kernel(enable_backward=False)
def _share(
    # In:
    owner: wp.array[wp.int32],
    value: wp.array[wp.vec3d],
    left: wp.array[wp.float64],
    odds: wp.array[wp.float64],
    # Out:
    sum_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    h = owner[i]
    if h >= 0:
        sum_out[i] = value[h]
    elif odds[i] > wp.float64(0.0):
        sum_out[i] = (wp.float64(1.0) - left[i]) / odds[i] * sum_out[i]


@dataclass(frozen=True, eq=False)
class Overlap:
    """Weights in 0..1 of handles at each node, on the graph's device."""

    handles: NDArray[np.int64]
    """The numbers of the handles, (k,)."""
    weights: Sequence[wp.array[wp.vec3d]]
    """Those of three handles in each array, (n,): handle handles[3 g + c] has the column c of array g."""

    def blend(self, pins: Pins, values: NDArray[np.float64]) -> wp.array[wp.vec3d]:
        """The 0-form (n,) with the values (handles, 3) at the handles' own nodes, blended elsewhere."""
        count, device = pins.graph.node_count, pins.graph.device
        left = wp.ones(count, dtype=wp.float64, device=device)
        odds = wp.zeros(count, dtype=wp.float64, device=device)
        total: wp.array[wp.vec3d] = wp.zeros(count, dtype=wp.vec3d, device=device)
        for group, weight in enumerate(self.weights):
            rows = np.zeros((COLUMNS, 3))
            chosen = self.handles[COLUMNS * group : COLUMNS * (group + 1)]
            rows[: len(chosen)] = values[chosen]
            inputs = [weight, wp.mat33d(*rows.ravel()), CERTAIN]
            wp.launch(_gather, dim=count, inputs=inputs, outputs=[left, odds, total], device=device)
        table = wp.array(np.ascontiguousarray(values), dtype=wp.vec3d, device=device)
        wp.launch(_share, dim=count, inputs=[pins.owner, table, left, odds], outputs=[total], device=device)
        return total
