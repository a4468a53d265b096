"""The small system for the multipliers: the Schur complement C L^-1 C^T, bordered by what nothing else holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve

from oneform_warp.solvers.system import System

__all__ = ["Constants", "Schur"]

Floats = NDArray[np.float64]

OPEN = 1.0e-10
"""Singular value, of the largest, below which the rows say nothing about a constant."""

RIGID = 1.0e-12
"""Of the softest row: a row that gives way less than this only moves components as a whole."""


@dataclass(frozen=True, eq=False)
class Constants:
    """The components that float, and have a part in a constraint: L does not see a translation of them."""

    components: NDArray[np.int64]
    """(f,)"""
    vertices: Floats
    """How many each has, (f,): where rows leave translations open, the common centroid moves least."""
    sums: Floats
    """The sum of each scalar form over each of them, (k, f)."""

    @classmethod
    def of(cls, system: System, pinned: NDArray[np.bool_], nodes: NDArray[np.int64], forms: Any) -> Constants:
        """pinned: (n,) mask of nodes; forms: (touched, k) over the touched nodes (touched,)."""
        graph = system.graph
        floating = np.zeros(graph.component_count, dtype=bool)
        floating[: graph.solved_components] = system.floating
        # A node without an edge goes wherever a constraint wants it.
        alone = np.arange(graph.component_offsets[graph.solved_components], graph.node_count)
        floating[graph.node_component[alone]] = ~pinned[alone]
        component = graph.node_component[nodes]
        components = np.unique(component[floating[component]]).astype(np.int64)
        vertices = np.bincount(graph.node_component[graph.node_of], minlength=graph.component_count)
        belongs = (component[:, None] == components).astype(np.float64)
        return cls(components, vertices[components].astype(np.float64), np.asarray(forms.T @ belongs))


@dataclass(frozen=True, eq=False)
class Schur:
    """[C L^-1 C^T + 1/w, -C N; -N^T C^T, 0] [lambda; c] = [C x - d; 0], N the translations of floating components.

    Then x - L^-1 C^T lambda + N c holds the rows.
    """

    rows: NDArray[np.int64]
    """The rows that it is made of; the others get no multiplier."""
    count: int
    """All rows."""
    _scale: Floats
    _factors: Any
    _translations: Floats
    """From the unknowns of the border to c, (3 f, unknowns)."""

    @classmethod
    def of(
        cls, rows: NDArray[np.int64], mixing: Any, table: Floats, compliance: Floats, length: Floats, loose: Constants
    ) -> Schur:
        """mixing: (3 rows, k) and table: (k, k) of the scalar forms; compliance, length |C_r|: (rows,)."""
        axes = [mixing[3 * rows + axis] for axis in range(3)]
        complement = sum(np.asarray((axis @ table) @ axis.T) for axis in axes) + np.diag(compliance[rows])
        # Translations of component c come as x, y, z of c together.
        moved = np.stack([np.asarray(axis @ loose.sums) for axis in axes], axis=2).reshape(
            len(rows), 3 * len(loose.components)
        )
        scale = _equilibration(np.diag(complement), length[rows])
        weight = 1.0 / np.sqrt(np.repeat(loose.vertices, 3))
        border, size, back = np.linalg.svd(scale[:, None] * moved * weight, full_matrices=False)
        told = size > OPEN * size.max(initial=0.0)
        border, back = border[:, told], weight[:, None] * (back[told].T / size[told])
        corner = np.zeros((border.shape[1],) * 2)
        matrix = np.block([[scale[:, None] * complement * scale, -border], [-border.T, corner]])
        return cls(rows, len(compliance), scale, lu_factor(matrix) if len(matrix) else None, back)

    def solve(self, misfit: Floats) -> tuple[Floats, Floats]:
        """The multipliers (rows,) and translations (f, 3) that remove a misfit (rows,)."""
        multipliers = np.zeros(self.count)
        if self._factors is None:
            return multipliers, np.zeros((len(self._translations) // 3, 3))
        right = np.zeros(len(self._factors[0]))
        right[: len(self.rows)] = self._scale * misfit[self.rows]
        found = lu_solve(self._factors, right)
        multipliers[self.rows] = self._scale * found[: len(self.rows)]
        return multipliers, (self._translations @ found[len(self.rows) :]).reshape(-1, 3)


def _equilibration(diagonal: Floats, length: Floats) -> Floats:
    """Factors that bring the diagonal to 1, and rows that do not give way to the size of the others."""
    give = np.divide(diagonal, length**2, out=np.zeros(len(length)), where=length > 0.0)
    most = float(give.max(initial=0.0)) or 1.0
    give = np.where(give > RIGID * most, give, most)
    return 1.0 / (np.sqrt(give) * np.where(length > 0.0, length, 1.0))
