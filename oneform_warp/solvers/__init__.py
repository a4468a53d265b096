"""Solvers of the least squares problem on the 1-form, as frozen value objects.

`prepare(graph, pinned) -> state` once, `solve(state, v, start) -> Solution` often; every solver has both.
"""

from oneform_warp.solvers.cg import CG
from oneform_warp.solvers.choice import AUTO, SOLVERS, default_solver, iterative_solver, solver_named
from oneform_warp.solvers.direct import Cholmod, CuDSS, SuperLU
from oneform_warp.solvers.jacobi import Jacobi
from oneform_warp.solvers.least_squares import solve
from oneform_warp.solvers.multigrid import Multigrid
from oneform_warp.solvers.refinement import State
from oneform_warp.solvers.solution import Progress, Solution, Status
from oneform_warp.solvers.solver import Solver
from oneform_warp.solvers.states import States

__all__ = [
    "AUTO",
    "CG",
    "SOLVERS",
    "Cholmod",
    "CuDSS",
    "Jacobi",
    "Multigrid",
    "Progress",
    "Solution",
    "Solver",
    "State",
    "States",
    "Status",
    "SuperLU",
    "default_solver",
    "iterative_solver",
    "solve",
    "solver_named",
]
