"""The solver that is used where the caller names none."""

from __future__ import annotations

from oneform_warp.graph import Graph
from oneform_warp.solvers.cg import CG
from oneform_warp.solvers.multigrid import Multigrid
from oneform_warp.solvers.solver import Solver

__all__ = ["MULTIGRID_FROM", "default_solver"]

MULTIGRID_FROM = 4_000
"""Nodes from which a hierarchy pays for itself in one solve."""


def default_solver(graph: Graph) -> Solver:
    """CG() below MULTIGRID_FROM nodes, Multigrid() from there on."""
    return CG() if graph.node_count < MULTIGRID_FROM else Multigrid()
