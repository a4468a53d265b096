"""The solver that is used where the caller names none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from oneform_warp.errors import InputError
from oneform_warp.graph import Graph
from oneform_warp.solvers.cg import CG
from oneform_warp.solvers.direct import Cholmod, CuDSS, SuperLU
from oneform_warp.solvers.jacobi import Jacobi
from oneform_warp.solvers.multigrid import Multigrid
from oneform_warp.solvers.solver import Solver

__all__ = ["AUTO", "SOLVERS", "default_solver", "iterative_solver", "solver_named"]

AUTO = "auto"
"""The name of the choice."""

SOLVERS: dict[str, Any] = {
    "cg": CG,
    "cholmod": Cholmod,
    "cudss": CuDSS,
    "jacobi": Jacobi,
    "multigrid": Multigrid,
    "superlu": SuperLU,
}
"""Every solver by the name that people type."""

MULTIGRID_FROM = 4_000
"""Nodes from which a hierarchy pays for itself in one solve."""

DIRECT_UP_TO = 60_000
"""Nodes up to which factors are made and used once in less time than a hierarchy, on one core."""

DIRECT_AGAIN_UP_TO = 250_000
"""The same for factors that are used MANY times."""

MANY = 10
"""Right-hand sides for the same pins."""

TAME = 1.0e10
"""The largest weight over the smallest: far from the fifteen decades that float64 cannot factorise."""


def default_solver(graph: Graph, solves: int = 1) -> Solver:
    """The fastest solver that needs nothing else installed; measured, see docs/solvers.md.

    solves: how many right-hand sides the same pins will have. On a CPU the edges of a surface are factorised,
    SuperLU(), up to 60,000 nodes, and up to 250,000 for 10 solves or more. Elsewhere CG() below 4,000 nodes and
    Multigrid() from there on: a GPU, and a graph that is no surface, whose factors may fill up.
    """
    limit = DIRECT_UP_TO if solves < MANY else DIRECT_AGAIN_UP_TO
    if not graph.device.is_cuda and graph.node_count <= limit and _is_tame_surface(graph):
        return SuperLU()
    return iterative_solver(graph)


def iterative_solver(graph: Graph) -> Solver:
    """CG() below 4,000 nodes, Multigrid() from there on."""
    return CG() if graph.node_count < MULTIGRID_FROM else Multigrid()


def solver_named(name: str, graph: Graph, options: Mapping[str, Any]) -> Solver:
    """The solver of this name with these options, as people type them; InputError for an option that it has not.

    "auto" is the default solver; an option that only iterations have makes it an iterative one.
    """
    if name == AUTO:
        chosen: Any = default_solver(graph)
        chosen = chosen if options.keys() <= _options(chosen) else iterative_solver(graph)
    else:
        chosen = SOLVERS[name]()
    for option in sorted(options.keys() - _options(chosen)):
        raise InputError(
            f"{type(chosen).__name__} has no {option}", where="solver", fix=f"leave {option} out, or take multigrid"
        )
    return replace(chosen, **options)


def _options(solver: Any) -> set[str]:
    return {field.name for field in fields(solver) if field.init}


def _is_tame_surface(graph: Graph) -> bool:
    """Polygons without extra edges, with weights that a factorisation survives."""
    if graph.faces is None or graph.listed_mu is not None or not graph.edge_count:
        return False
    mu = graph.mu.numpy()
    return bool(mu.max() <= TAME * mu.min())
