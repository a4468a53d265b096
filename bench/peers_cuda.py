"""Peers on CUDA: each solves L e = r over the free nodes in float64, the matrix and r already on the device."""

from __future__ import annotations

import sys
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from bench.methods import Counter, Method, by_columns
from bench.peers import MOST
from bench.problem import Problem


def cuda_peers() -> list[Method]:
    return [cudss(), cholespy_cuda(), cupy_cg(), warp_cg()]


def _on_device(problem: Problem) -> tuple[Any, Any, Any]:
    """CuPy, the matrix, and r by columns."""
    import cupy
    from cupyx.scipy.sparse import csr_matrix

    cupy.cuda.Device(wp.get_device().ordinal).use()
    return cupy, csr_matrix(problem.matrix), cupy.asfortranarray(cupy.asarray(problem.right_hand_side))


def _fetched(problem: Problem, displacement: Any) -> Any:
    return problem.moved(displacement.get())


def cudss() -> Method:
    """NVIDIA's direct solver through nvmath-python: plan and factorize, then all three columns at once."""

    def load(problem: Problem) -> Any:
        from nvmath.sparse.advanced import DirectSolver, DirectSolverMatrixType

        options: dict[str, Any] = {"sparse_system_type": DirectSolverMatrixType.SPD}
        threads = _threading_layer()
        if threads:
            options["multithreading_lib"] = threads
        return DirectSolver, options, *_on_device(problem)

    def setup(data: Any) -> Any:
        make, options, _, matrix, r = data
        solver = make(matrix, r, options=options)
        solver.plan()
        solver.factorize()
        return solver

    def solve(solver: Any, _tol: float) -> tuple[Any, int]:
        return solver.solve(), 1

    return Method("cuDSS", load, setup, solve, _fetched, direct=True, free=lambda solver: solver.free())


def _threading_layer() -> str | None:
    """The library with which cuDSS uses all cores to plan, where pip has put it."""
    for folder in sys.path:
        found = sorted(Path(folder).glob("nvidia/*/lib/libcudss_mtlayer_gomp.so*")) if folder else []
        if found:
            return str(found[0])
    return None


def cholespy_cuda() -> Method:
    """CHOLMOD's simplicial factor made on the host, triangular solves on the device."""

    def load(problem: Problem) -> Any:
        import cholespy

        cupy, matrix, r = _on_device(problem)
        return cholespy, cupy, matrix, cupy.ascontiguousarray(r)

    def setup(data: Any) -> Any:
        module, cupy, a, r = data
        return module.CholeskySolverD(a.shape[0], a.indptr, a.indices, a.data, module.MatrixType.CSR), cupy, r

    def solve(state: Any, _tol: float) -> tuple[Any, int]:
        solver, cupy, r = state
        x = cupy.zeros_like(r)
        solver.solve(r, x)
        return x, 1

    return Method("cholespy, CUDA", load, setup, solve, _fetched, direct=True, largest=700_000)


def cupy_cg() -> Method:
    """CuPy's conjugate gradients with the Jacobi preconditioner, column by column."""

    def setup(data: Any) -> Any:
        from cupyx.scipy.sparse.linalg import LinearOperator

        cupy, matrix, r = data
        inverse = 1.0 / matrix.diagonal()
        jacobi = LinearOperator(matrix.shape, matvec=lambda x: inverse * x.ravel(), dtype=matrix.dtype)
        return cupy, matrix, [cupy.ascontiguousarray(r[:, d]) for d in range(r.shape[1])], jacobi

    def solve(state: Any, tol: float) -> tuple[Any, int]:
        from cupyx.scipy.sparse.linalg import cg

        cupy, matrix, columns, jacobi = state
        tolerance = {"rtol" if "rtol" in signature(cg).parameters else "tol": tol}

        def one(b: Any) -> tuple[Any, int]:
            counter = Counter()
            return cg(matrix, b, maxiter=MOST, M=jacobi, callback=counter, **tolerance)[0], counter.count

        solutions, count = by_columns(one, columns)
        return cupy.stack(solutions, axis=1), count

    return Method("CuPy CG, Jacobi", _on_device, setup, solve, _fetched, largest=3_000_000)


def warp_cg() -> Method:
    """warp.optim.linear.cg with its Jacobi preconditioner on a warp.sparse matrix, column by column."""

    def load(problem: Problem) -> Any:
        device, coo = problem.graph.device, problem.matrix.tocoo()
        entries = [wp.array(index, dtype=wp.int32, device=device) for index in (coo.row, coo.col)]
        entries.append(wp.array(coo.data, dtype=wp.float64, device=device))
        columns = problem.right_hand_side.T
        return problem.matrix.shape, entries, [wp.array(c, dtype=wp.float64, device=device) for c in columns]

    def setup(data: Any) -> Any:
        from warp.optim.linear import preconditioner
        from warp.sparse import bsr_from_triplets

        shape, entries, columns = data
        matrix = bsr_from_triplets(*shape, *entries)
        return matrix, columns, preconditioner(matrix, "diag")

    def solve(state: Any, tol: float) -> tuple[Any, int]:
        from warp.optim.linear import cg

        matrix, columns, jacobi = state

        def one(b: Any) -> tuple[Any, int]:
            x = wp.zeros_like(b)
            count, _, _ = cg(matrix, b, x, tol=tol, maxiter=MOST, M=jacobi)
            return x, int(count)

        return by_columns(one, columns)

    def positions(problem: Problem, columns: list[Any]) -> Any:
        return problem.moved(np.stack([column.numpy() for column in columns], axis=1))

    return Method("warp.optim.linear.cg", load, setup, solve, positions, largest=3_000_000)
