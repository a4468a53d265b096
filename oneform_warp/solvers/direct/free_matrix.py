"""The graph Laplacian of the nodes that a direct solver may move: symmetric, positive definite, in float64."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.graph import Graph
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
    full: Any
    """The whole matrix, a scipy csr_array (k, k) with sorted rows and int32 indices."""
    scale: float

    @property
    def size(self) -> int:
        """Rows, k."""
        return len(self.nodes)

    @cached_property
    def upper(self) -> Any:
        """The upper triangle with the diagonal, like `full`."""
        from scipy.sparse import triu

        return triu(self.full, format="csr")

    @classmethod
    def of(cls, system: System) -> FreeMatrix:
        """Made on the host, whatever the device of the graph."""
        graph = system.graph
        tail, head, mu = graph.tail.numpy(), graph.head.numpy(), graph.mu.numpy()
        count = graph.node_count
        scale = 1.0 / power_of_two(float(mu.max(initial=0.0)))
        mu = scale * mu
        diagonal = np.bincount(tail, mu, count) + np.bincount(head, mu, count)
        attachment = scale * system.attachment.numpy() if system.attachment.shape[0] else np.zeros(count)
        nodes = _free_nodes(system, attachment, diagonal)
        return cls(nodes, _rows(graph, nodes, (diagonal + attachment)[nodes], mu), scale)


def _rows(graph: Graph, nodes: NDArray[np.int64], diagonal: NDArray[np.float64], mu: NDArray[np.float64]) -> Any:
    """The rows of the graph's half-edges between these nodes, with a diagonal (k,) in its place in each."""
    from scipy.sparse import csr_array

    size = len(nodes)
    row_of = np.full(graph.node_count, -1, dtype=np.int32)
    row_of[nodes] = np.arange(size, dtype=np.int32)
    row, column = np.repeat(row_of, np.diff(graph.offsets.numpy())), row_of[graph.neighbours.numpy()]
    kept = np.flatnonzero((row >= 0) & (column >= 0))
    row, column, incident = row[kept], column[kept], graph.incident.numpy()[kept]
    below = column < row
    starts = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=size) + 1)])
    # In each row before, and in this one before what is above it, a diagonal stands.
    place = np.arange(len(kept)) + row + ~below
    middle = starts[:-1] + np.bincount(row[below], minlength=size)
    indices, data = np.empty(starts[-1], dtype=np.int32), np.empty(starts[-1])
    indices[place], data[place] = column, -mu[np.maximum(incident, ~incident)]
    indices[middle], data[middle] = np.arange(size), diagonal
    return csr_array((data, indices, starts.astype(np.int32)), shape=(size, size))


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
