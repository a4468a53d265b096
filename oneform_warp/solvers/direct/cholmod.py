"""CHOLMOD through the package cholespy, an optional extra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.solvers.direct.factored import Direct, HostCorrection, Substitution, singular
from oneform_warp.solvers.direct.free_matrix import FreeMatrix
from oneform_warp.solvers.direct.packages import require
from oneform_warp.solvers.refinement import State
from oneform_warp.solvers.system import System

__all__ = ["Cholmod"]


@dataclass(frozen=True)
class Cholmod(Direct):
    """Sparse Cholesky factors by CHOLMOD in float64, on the host: |codiff(v - dx)| <= tol |codiff v|.

    As SuperLU, with one factor in the place of two: a solve takes 0.5 to 0.75 of the time. tol: as for CG.
    Raises InputError where cholespy is not installed: pip install 'oneform-warp[cholmod]'.
    """

    def __post_init__(self) -> None:
        require("Cholmod", ("cholespy",), "cholmod")
        super().__post_init__()

    def prepare(self, graph: Graph, pinned: NDArray[np.bool_], attachment: NDArray[np.float64] | None = None) -> State:
        """The factor for these pinned (n,) and attached (n,) nodes; it serves any v and start."""
        system = System.of(graph, pinned, attachment)
        matrix = FreeMatrix.of(system)
        return State(system, HostCorrection(system, matrix, _factorise(matrix)))


def _factorise(matrix: FreeMatrix) -> Substitution:
    from cholespy import CholeskySolverD, MatrixType

    if not matrix.size:
        return np.zeros_like
    upper = matrix.upper
    try:
        # The rows of the upper triangle are the columns of the lower one, which is what CHOLMOD reads.
        factor = CholeskySolverD(matrix.size, upper.indptr, upper.indices, upper.data, MatrixType.CSC)
    except ValueError as error:
        raise singular("CHOLMOD", error) from error

    def substitute(r: NDArray[np.float64]) -> NDArray[np.float64]:
        e = np.empty(r.shape)
        factor.solve(np.ascontiguousarray(r), e)
        return e

    return substitute
