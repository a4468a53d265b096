"""How much each handle counts at each node: few handles need no solving for the fields of a changed rotation."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.grip import Pins
from oneform_warp.solvers import Solution, States

__all__ = ["COLUMNS", "Influence", "influence"]

COLUMNS = 3
"""Handles whose influence one solve finds; with more, solving for the field itself is less work."""


@wp.kernel(enable_backward=False)
def _blend(
    # Graph:
    component: wp.array[wp.int32],
    # In:
    owner: wp.array[wp.int32],
    weight: wp.array[wp.vec3d],
    value: wp.array[wp.vec3d],
    column: wp.array[wp.vec3d],
    mean: wp.array[wp.vec3d],
    # Out:
    value_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    h = owner[i]
    if h >= 0:
        value_out[i] = value[h]
    else:
        # From the mean on: where all handles of a component agree, so does everything between them, to the last bit.
        m = mean[component[i]]
        total = m
        for k in range(column.shape[0]):
            total += weight[i][k] * (column[k] - m)
        value_out[i] = total


@dataclass(frozen=True, eq=False)
class Influence:
    """Harmonic weights w_k of up to three handles: 1 at the nodes of handle k, 0 at those of the others."""

    handles: NDArray[np.int64]
    """The handle of each column, (k,)."""
    solution: Solution
    """x: the weights per node, one column for each handle."""

    def blend(self, pins: Pins, values: NDArray[np.float64]) -> wp.array[wp.vec3d]:
        """mean + sum_k w_k (value_k - mean), the harmonic 0-form with the pinned values (handles, 3), on the device."""
        graph = pins.graph
        result = wp.empty(graph.node_count, dtype=wp.vec3d, device=graph.device)
        tables = [
            wp.array(np.ascontiguousarray(rows), dtype=wp.vec3d, device=graph.device)
            for rows in (values, values[self.handles], pins.means(values))
        ]
        inputs = [graph.component_of_node, pins.owner, self.solution.x, *tables]
        wp.launch(_blend, dim=graph.node_count, inputs=inputs, outputs=[result], device=graph.device)
        return result


_KNOWN: WeakKeyDictionary[Pins, Influence] = WeakKeyDictionary()


def influence(pins: Pins, states: States) -> Influence | None:
    """The weights of the handles that pin something, found once for as long as the pins live; None for too many."""
    handles = np.unique(pins.shares[1])
    if len(handles) > COLUMNS:
        return None
    if pins not in _KNOWN:
        indicators = np.zeros((int(handles.max(initial=0)) + 1, 3))
        indicators[handles, np.arange(len(handles))] = 1.0
        start = pins.spread_out(indicators, pins.means(indicators))
        no_form = wp.zeros(0, dtype=wp.vec3d, device=pins.graph.device)
        _KNOWN[pins] = Influence(handles, states.solver.solve(states.of(pins.mask), no_form, start))
    return _KNOWN[pins]
