"""Peers on the CPU: each solves L e = r over the free nodes, float64, the matrix and r given."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import LinearOperator, cg, splu

from bench.methods import Counter, Method, by_columns
from bench.problem import Problem

MOST = 50_000
"""Iterations after which a peer may give up."""


def cpu_peers() -> list[Method]:
    return [
        scipy_cg(),
        pyamg_cg("pyamg SA, default", "smoothed_aggregation_solver"),
        pyamg_cg("pyamg SA, filtered", "smoothed_aggregation_solver", strength=("symmetric", {"theta": 0.08})),
        pyamg_cg("pyamg RS", "ruge_stuben_solver"),
        cvxopt_cholmod(),
        pardiso(),
        cholespy(),
        superlu(),
    ]


def _matrix_and_columns(problem: Problem) -> tuple[Any, list[Any]]:
    r = problem.right_hand_side
    return problem.matrix, [np.ascontiguousarray(column) for column in r.T]


def _matrix_and_block(problem: Problem) -> tuple[Any, Any]:
    return problem.matrix, problem.right_hand_side


def _stacked(problem: Problem, columns: list[Any]) -> Any:
    return problem.moved(np.stack(columns, axis=1))


def _cg(matrix: Any, b: Any, tol: float, preconditioner: Any) -> tuple[Any, int]:
    counter = Counter()
    x, _ = cg(matrix, b, rtol=tol, maxiter=MOST, M=preconditioner, callback=counter)
    return x, counter.count


def _cg_columns(state: Any, tol: float) -> tuple[list[Any], int]:
    matrix, columns, preconditioner = state
    return by_columns(lambda b: _cg(matrix, b, tol, preconditioner), columns)


def scipy_cg() -> Method:
    """Conjugate gradients with the Jacobi preconditioner, column by column."""

    def setup(data: Any) -> Any:
        matrix, columns = data
        inverse = 1.0 / matrix.diagonal()
        return matrix, columns, LinearOperator(matrix.shape, matvec=lambda x: inverse * x.ravel())

    return Method("scipy CG, Jacobi", _matrix_and_columns, setup, _cg_columns, _stacked)


def pyamg_cg(name: str, maker: str, **options: Any) -> Method:
    """Conjugate gradients with one V-cycle of pyamg as the preconditioner, column by column."""

    def load(problem: Problem) -> Any:
        import pyamg

        return *_matrix_and_columns(problem), getattr(pyamg, maker)

    def setup(data: Any) -> Any:
        matrix, columns, make = data
        np.random.seed(0)  # noqa: NPY002 - pyamg estimates eigenvalues with it; every setup shall be the same
        return matrix, columns, make(matrix, **options).aspreconditioner(cycle="V")

    return Method(name, load, setup, _cg_columns, _stacked, largest=3_000_000)


def cvxopt_cholmod() -> Method:
    """CHOLMOD as cvxopt ships it: supernodal, its own ordering (AMD), OpenBLAS."""

    def load(problem: Problem) -> Any:
        from cvxopt import cholmod, matrix, spmatrix

        lower = sparse.tril(problem.matrix, format="csc").tocoo()
        a = spmatrix(lower.data, lower.row.astype(np.int64), lower.col.astype(np.int64), problem.matrix.shape)
        return cholmod, a, matrix, problem.right_hand_side

    def setup(data: Any) -> Any:
        module, a, matrix, r = data
        module.options["supernodal"] = 2
        factor = module.symbolic(a)
        module.numeric(a, factor)
        return module, factor, matrix, r

    def solve(state: Any, _tol: float) -> tuple[Any, int]:
        module, factor, matrix, r = state
        b = matrix(r)
        module.solve(factor, b)
        return b, 1

    return Method(
        "cvxopt CHOLMOD", load, setup, solve, lambda p, b: p.moved(np.array(b)), direct=True, largest=3_000_000
    )


def pardiso() -> Method:
    """MKL PARDISO for a symmetric positive definite matrix: nested dissection, threads as allowed."""

    def load(problem: Problem) -> Any:
        import pypardiso

        upper = sparse.triu(problem.matrix, format="csr")
        upper.sort_indices()
        return pypardiso.PyPardisoSolver, upper, np.asfortranarray(problem.right_hand_side)

    def setup(data: Any) -> Any:
        make, upper, r = data
        solver = make(mtype=2)
        solver._check_A(upper)
        solver.set_phase(12)
        solver._call_pardiso(upper, np.zeros((len(r), 1)))
        solver.set_phase(33)
        return solver, upper, r

    def solve(state: Any, _tol: float) -> tuple[Any, int]:
        solver, upper, r = state
        # Not solver.solve: that compares the whole matrix with the factored one each time.
        return solver._call_pardiso(upper, r), 1

    return Method(
        "pypardiso",
        load,
        setup,
        solve,
        direct=True,
        largest=3_000_000,
        free=lambda state: state[0].free_memory(everything=True),
    )


def cholespy() -> Method:
    """CHOLMOD as cholespy ships it: simplicial."""

    def load(problem: Problem) -> Any:
        import cholespy

        return cholespy, problem.matrix, np.ascontiguousarray(problem.right_hand_side)

    def setup(data: Any) -> Any:
        module, a, r = data
        return module.CholeskySolverD(a.shape[0], a.indptr, a.indices, a.data, module.MatrixType.CSR), r

    def solve(state: Any, _tol: float) -> tuple[Any, int]:
        solver, r = state
        x = np.zeros_like(r)
        solver.solve(r, x)
        return x, 1

    return Method("cholespy", load, setup, solve, direct=True, largest=300_000)


def superlu() -> Method:
    """SuperLU as scipy ships it, in its symmetric mode."""

    def setup(data: Any) -> Any:
        matrix, r = data
        options = {"SymmetricMode": True}
        return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options), r

    def solve(state: Any, _tol: float) -> tuple[Any, int]:
        factor, r = state
        return factor.solve(r), 1

    return Method("scipy SuperLU", _matrix_and_block, setup, solve, direct=True, largest=200_000)
