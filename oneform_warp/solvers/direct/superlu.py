"""SuperLU, which comes with SciPy: the direct solver that is always there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.solvers.direct.factored import Direct, HostCorrection, Substitution, singular
from oneform_warp.solvers.direct.free_matrix import FreeMatrix
from oneform_warp.solvers.refinement import State
from oneform_warp.solvers.system import System

__all__ = ["SuperLU"]

PANEL = 4
"""Columns eliminated at once: the factors of a surface have few in common, 20 (SuperLU's choice) takes 1.2 times."""


@dataclass(frozen=True)
class SuperLU(Direct):
    """Gaussian elimination by SciPy's SuperLU in float64, on the host: |codiff(v - dx)| <= tol |codiff v|.

    `prepare` factorises for one graph and its pins, `solve` substitutes: for many v on one mesh. tol: as for CG.
    """

    def prepare(self, graph: Graph, pinned: NDArray[np.bool_], attachment: NDArray[np.float64] | None = None) -> State:
        """The factors for these pinned (n,) and attached (n,) nodes; they serve any v and start."""
        system = System.of(graph, pinned, attachment)
        matrix = FreeMatrix.of(system)
        return State(system, HostCorrection(system, matrix, _factorise(matrix)))


def _factorise(matrix: FreeMatrix) -> Substitution:
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    if not matrix.size:
        return np.zeros_like
    rows = matrix.full
    try:
        # The pattern is symmetric and the diagonal positive: order for A + A^T, and take the pivots where they stand.
        factors = splu(
            csc_array((rows.data, rows.indices, rows.indptr), shape=rows.shape),  # symmetric: its rows are its columns
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            panel_size=PANEL,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise singular("SuperLU", error) from error
    return lambda r: factors.solve(np.asfortranarray(r))
