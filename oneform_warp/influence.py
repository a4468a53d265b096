"""How much each handle counts at each node: few handles need no solving for the fields of a changed rotation."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.grip import Pins
from oneform_warp.solvers import Solution

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
    column: wp.array2d[wp.vec3d],
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
        c = component[i]
        m = mean[c]
        total = m
        for k in range(wp.static(COLUMNS)):
            total += weight[i][k] * (column[c, k] - m)
        value_out[i] = total


@dataclass(frozen=True, eq=False)
class Influence:
    """Weights w_k of up to three handles in each component: 1 at the nodes of one, 0 at those of others."""

    column: NDArray[np.int64]
    """The column of each handle, (handles,); handles that meet in no component may share one."""
    solution: Solution
    """x: the weights per node, by column."""

    def blend(self, pins: Pins, values: NDArray[np.float64]) -> wp.array[wp.vec3d]:
        """mean + sum_k w_k (value_k - mean), the 0-form with the pinned values (handles, 3), on the device."""
        graph = pins.graph
        result = wp.empty(graph.node_count, dtype=wp.vec3d, device=graph.device)
        component, handle, _ = pins.shares
        means = pins.means(values)
        columns = np.repeat(means[:, None, :], COLUMNS, axis=1)  # where there is no such handle, nothing is added
        columns[component, self.column[handle]] = values[handle]
        value, column, mean = (
            wp.array(np.ascontiguousarray(rows), dtype=wp.vec3d, device=graph.device)
            for rows in (values, columns, means)
        )
        inputs = [graph.component_of_node, pins.owner, self.solution.x, value, column, mean]
        wp.launch(_blend, dim=graph.node_count, inputs=inputs, outputs=[result], device=graph.device)
        return result


_KNOWN: WeakKeyDictionary[Pins, dict[Hashable, Influence]] = WeakKeyDictionary()


def influence(pins: Pins, kind: Hashable, solve: Callable[[wp.array[wp.vec3d]], Solution]) -> Influence | None:
    """The weights of the handles that pin something, found once for as long as the pins live; None for too many.

    solve: linear, from a start with the pinned values to the 0-form of this kind.
    """
    known = _KNOWN.setdefault(pins, {})
    if kind not in known:
        column = _columns(pins)
        if column is None:
            return None
        indicators = (column[:, None] == np.arange(COLUMNS)).astype(np.float64)
        known[kind] = Influence(column, solve(pins.spread_out(indicators, pins.means(indicators))))
    return known[kind]


def _columns(pins: Pins) -> NDArray[np.int64] | None:
    """A column for each handle, others for those that meet in a component; None where there are too few.

    So many meshes at once, with a few handles each, take the way that each would take alone.
    """
    component, handle, _ = pins.shares
    column = np.full(int(handle.max(initial=0)) + 1, -1, dtype=np.int64)
    if not len(handle):
        return column
    taken = np.zeros(pins.graph.component_count, dtype=np.int64)  # a bit for each column
    order = np.argsort(handle, kind="stable")
    groups = np.split(component[order], np.flatnonzero(np.diff(handle[order])) + 1)
    for number, touched in zip(np.unique(handle), groups, strict=True):
        used = int(np.bitwise_or.reduce(taken[touched]))
        free = next((k for k in range(COLUMNS) if not used >> k & 1), None)
        if free is None:
            return None
        column[number] = free
        taken[touched] |= 1 << free
    return column
