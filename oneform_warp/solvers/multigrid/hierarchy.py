"""Levels of smoothed aggregation: the structure is made once per graph, the matrices once per set of pins."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.solvers.multigrid.aggregates import aggregate, strong_edges
from oneform_warp.solvers.multigrid.compact import Rows
from oneform_warp.solvers.multigrid.galerkin import coarse_pattern, galerkin_values, product_pattern
from oneform_warp.solvers.multigrid.prolongation import Prolongation, smoothed_prolongation
from oneform_warp.solvers.precision import FLOAT32
from oneform_warp.solvers.rows import LaplacianRows
from oneform_warp.solvers.system import System

__all__ = ["Hierarchy", "Structure", "hierarchy", "structure"]

COARSEST = 600
"""At this many unknowns a dense inverse takes over."""

LEVELS = 20
THRESHOLDS = (0.08, 0.03)
"""Edges that count as strong, see `strong_edges`."""

ENOUGH = 0.2
"""Where the first threshold leaves more than this part of the nodes, the second is taken from there on. It keeps more
edges strong; else all matrices together would have 1.4 times the entries of the finest one and more."""

STALL = 0.75
"""A level that shrinks to no less than this part is not worth having."""


@dataclass(frozen=True, eq=False)
class Structure:
    """Prolongations and patterns of every level, from the weights alone: pins come later, as masks."""

    prolongations: tuple[Prolongation, ...]
    patterns: tuple[Rows, ...]
    """Of the coarse matrices."""
    sizes: tuple[int, ...]
    entries: tuple[int, ...]

    @property
    def complexity(self) -> float:
        """Entries of all matrices over those of the finest, diagonals included."""
        return (sum(self.sizes) + sum(self.entries)) / max(self.sizes[0] + self.entries[0], 1)

    def __repr__(self) -> str:
        levels = " -> ".join(str(size) for size in self.sizes)
        return f"Structure({len(self.sizes)} levels: {levels}; operator complexity {self.complexity:.2f})"


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """The matrices of every level for one set of pins, and the dense inverse of the coarsest."""

    structure: Structure
    levels: tuple[LaplacianRows, ...]
    inverse: wp.array[wp.float32]
    """(k, k) over the coarsest nodes that move, constants of floating components projected away."""
    moving: wp.array[wp.int32]
    """The coarsest nodes that move, (k,)."""

    def __repr__(self) -> str:
        return f"Hierarchy({self.structure!r}, coarsest {self.moving.shape[0]} by a dense inverse)"


_KNOWN: WeakKeyDictionary[Graph, Structure] = WeakKeyDictionary()


def structure(graph: Graph) -> Structure:
    """The structure of a graph with its mu, made once for as long as the graph lives."""
    if graph not in _KNOWN:
        fine = LaplacianRows.of(System.of(graph, np.zeros(graph.node_count, dtype=bool)), FLOAT32)
        _KNOWN[graph] = _coarsened(fine)
    return _KNOWN[graph]


def _coarsened(fine: LaplacianRows) -> Structure:
    steps = list[_Step]()
    step = _coarser(fine, THRESHOLDS)
    while step is not None and len(steps) + 1 < LEVELS:
        steps.append(step)
        step = _coarser(step.rows, step.thresholds)
    rows = [fine, *(step.rows for step in steps)]
    return Structure(
        tuple(step.prolongation for step in steps),
        tuple(step.pattern for step in steps),
        tuple(each.inverse_diagonal.shape[0] for each in rows),
        tuple(each.weight.shape[0] for each in rows),
    )


@dataclass(frozen=True, eq=False)
class _Step:
    """From one level to the next coarser one."""

    prolongation: Prolongation
    pattern: Rows
    rows: LaplacianRows
    thresholds: tuple[float, ...]
    """Those that are left for the levels below."""


def _coarser(rows: LaplacianRows, thresholds: tuple[float, ...]) -> _Step | None:
    """The next level; None where there is nothing to gain by one."""
    size = rows.inverse_diagonal.shape[0]
    if size <= COARSEST or not rows.weight.shape[0]:
        return None
    strong = strong_edges(rows, thresholds[0])
    numbers, count = aggregate(rows, strong)
    if count > ENOUGH * size and len(thresholds) > 1:
        return _coarser(rows, thresholds[1:])
    if count == 0 or count > STALL * size:
        return None
    p = smoothed_prolongation(rows, strong, numbers, count)
    product = product_pattern(rows, p)
    pattern = coarse_pattern(p, product)
    return _Step(p, pattern, galerkin_values(rows, p, product, pattern), thresholds)


def hierarchy(system: System) -> Hierarchy:
    """The matrices for the pins and attachments of `system`, on the structure of its graph."""
    made = structure(system.graph)
    levels = [LaplacianRows.of(system, FLOAT32)]
    for p, pattern in zip(made.prolongations, made.patterns, strict=True):
        levels.append(galerkin_values(levels[-1], p, product_pattern(levels[-1], p), pattern))
    inverse, moving = _dense_inverse(levels[-1])
    device = system.graph.device
    return Hierarchy(
        made,
        tuple(levels),
        wp.array(inverse.ravel(), dtype=wp.float32, device=device),
        wp.array(moving, dtype=wp.int32, device=device),
    )


def _dense_inverse(rows: LaplacianRows) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The pseudo-inverse of a small matrix over the nodes that move; none for a large one, which is only smoothed."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    moves = rows.inverse_diagonal.numpy() > 0.0
    moving = np.flatnonzero(moves)
    if len(moving) > 4 * COARSEST or not len(moving):
        return np.zeros((0, 0)), np.zeros(0, dtype=np.int64)
    number = np.cumsum(moves) - 1
    weight, neighbour = rows.weight.numpy().astype(np.float64), rows.neighbours.numpy()
    row = np.repeat(np.arange(len(moves)), np.diff(rows.offsets.numpy()))
    inside, across = moves[row] & moves[neighbour], moves[row] & ~moves[neighbour]
    dense = np.zeros((len(moving), len(moving)))
    dense[number[row[inside]], number[neighbour[inside]]] = weight[inside]
    attached = rows.attachment.numpy()[moving] if rows.attachment.shape[0] else np.zeros(len(moving))
    row_sums = np.bincount(row, weight, len(moves))[moving]
    # Weights to nodes that do not move hold a component as attachments do.
    held = (attached > 0.0) | (np.bincount(row[across], minlength=len(moves))[moving] > 0)
    component_count, label = connected_components(csr_array(dense != 0.0), directed=False)
    floating = np.bincount(label, held, component_count) == 0.0
    matrix = np.diag(row_sums + attached) - (dense + dense.T) / 2.0
    if not floating.any():
        return _inverse_by_blocks(matrix, label), moving
    # Singular where a component floats: made regular by the projector onto constants, which the inverse then loses.
    members = np.where(floating[label], label, -1)
    size = matrix.diagonal().mean()
    projector = (members[:, None] == members) * (floating[label] / np.bincount(label)[label])
    return _inverse_by_blocks(matrix + size * projector, label) - projector / size, moving


def _inverse_by_blocks(matrix: NDArray[np.float64], label: NDArray[np.integer]) -> NDArray[np.float64]:
    """The inverse of a matrix that couples equal labels only: blocks of one size together, many meshes have many."""
    inverse = np.zeros_like(matrix)
    sizes, order = np.bincount(label), np.argsort(label, kind="stable")
    ends = np.cumsum(sizes)
    for size in np.unique(sizes):
        members = order[(ends[sizes == size] - size)[:, None] + np.arange(size)]
        block = members[:, :, None], members[:, None, :]
        inverse[block] = np.linalg.inv(matrix[block])
    return inverse
