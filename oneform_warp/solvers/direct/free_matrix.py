"""The graph Laplacian of the nodes that a direct solver may move: symmetric, positive definite, in float64."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.solvers.rows import power_of_two
from oneform_warp.solvers.system import System

__all__ = ["FreeMatrix"]

WEAKEST_HOLD = 1.0e-13
"""Mean attachment over largest diagonal: below it the attachment is lost in the rounding of the diagonal."""


@dataclass(frozen=True, eq=False)
class FreeMatrix:
    """Rows and columns of the free nodes of L, scaled by a power of two that brings its largest weight near 1."""

    nodes: NDArray[np.int64]
    """The node of each row, (k,), ascending."""
    upper: Any
    """The upper triangle with the diagonal, a scipy csr_array (k, k) with sorted rows and int32 indices."""
    scale: float

    @property
    def size(self) -> int:
        """Rows, k."""
        return len(self.nodes)

    @classmethod
    def of(cls, system: System) -> FreeMatrix:
        """Made on the host, whatever the device of the graph."""
        from scipy.sparse import coo_array

        graph = system.graph
        tail, head, mu = graph.tail.numpy(), graph.head.numpy(), graph.mu.numpy()
        count = graph.node_count
        scale = 1.0 / power_of_two(float(mu.max(initial=0.0)))
        mu = scale * mu
        diagonal = np.bincount(tail, mu, count) + np.bincount(head, mu, count)
        attachment = scale * system.attachment.numpy() if system.attachment.shape[0] else np.zeros(count)
        nodes = _free_nodes(system, attachment, diagonal)
        row_of = np.full(count, -1, dtype=np.int32)
        row_of[nodes] = own = np.arange(len(nodes), dtype=np.int32)
        i, j = row_of[tail], row_of[head]
        kept = (i >= 0) & (j >= 0)
        i, j = np.minimum(i[kept], j[kept]), np.maximum(i[kept], j[kept])
        values = np.concatenate([(diagonal + attachment)[nodes], -mu[kept]])
        where = np.concatenate([own, i]), np.concatenate([own, j])
        upper = coo_array((values, where), shape=(len(nodes), len(nodes))).tocsr()
        upper.sort_indices()
        return cls(nodes, upper, scale)


def _free_nodes(system: System, attachment: NDArray[np.float64], diagonal: NDArray[np.float64]) -> NDArray[np.int64]:
    """Nodes with an edge, less the pinned ones, less the first of each component that nothing holds.

    Without that one the matrix is singular; fixing it loses nothing, since the residuals of such a component sum to
    zero.
    """
    graph = system.graph
    count = graph.solved_components
    starts = graph.component_offsets[: count + 1]
    free: NDArray[np.bool_] = system.pinned.numpy()[: starts[-1]] == 0
    component = graph.node_component[: starts[-1]]
    pins = np.bincount(component, ~free, count)
    hold = np.bincount(component, attachment[: starts[-1]], count) / np.diff(starts)
    largest = np.zeros(count)
    np.maximum.at(largest, component, diagonal[: starts[-1]])
    free[starts[:-1][(pins == 0) & (hold <= WEAKEST_HOLD * largest)]] = False
    return np.flatnonzero(free)
