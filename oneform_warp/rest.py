"""The rest pose: the caller's positions, and the same centred and scaled per node."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import Rows
from oneform_warp.errors import InputError
from oneform_warp.graph import Graph
from oneform_warp.solvers.rows import power_of_two

__all__ = ["Rest", "box_of"]


def box_of(data: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """The centre of positions (V, 3), and the power of two near their size."""
    if not len(data):
        return np.zeros(3), 1.0
    # By column: a reduction over rows of three takes ten times as long.
    low, high = (np.array([each(column) for column in data.T]) for each in (np.min, np.max))
    size = float((high - low).max())
    if not np.isfinite(size):
        raise InputError("the positions span more than float64 holds", where="x", fix="use a larger unit")
    return low / 2.0 + high / 2.0, power_of_two(size)


class Rest:
    """Positions centred and scaled to about the unit box, by a power of two: exact, and float32 cannot overflow."""

    def __init__(self, rows: Rows, graph: Graph) -> None:
        if len(rows.data) != graph.vertex_count:
            raise InputError(
                f"{len(rows.data)} positions for a graph of {graph.vertex_count} vertices",
                where="x",
                fix="give one row per vertex",
            )
        self.rows, self.graph = rows, graph
        self.centre, self.scale = box_of(rows.data)
        self.x: wp.array[wp.vec3d] = graph.nodes_from(self.inside(rows.data))
        """Per node, (n,), on the graph's device."""

    @property
    def dimension(self) -> int:
        """D."""
        return self.rows.dimension

    @property
    def diagonal(self) -> float:
        """Of the box of the rest pose, in the caller's unit."""
        return float(np.linalg.norm([np.ptp(column) for column in self.rows.data.T])) if len(self.rows.data) else 0.0

    def inside(self, data: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions (V, 3) in the caller's unit -> centred and scaled."""
        inside: NDArray[np.float64] = (data - self.centre) / self.scale
        return inside

    def outside(self, x: wp.array[wp.vec3d]) -> Any:
        """Positions per node -> the caller's: rest plus displacement, so that what did not move keeps every bit."""
        moved = np.take(x.numpy() - self.x.numpy(), self.graph.node_of, axis=0)
        moved *= self.scale
        # A sum with zero would make 0 of -0.
        return self.rows.like(np.where(moved == 0.0, self.rows.data, self.rows.data + moved))
