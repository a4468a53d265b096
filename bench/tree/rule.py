"""The starts that the package has, as it makes them, and what its default rule looks at."""

from __future__ import annotations

from typing import Any

import warp as wp

import oneform_warp as ow
from bench.tree.cases import Problem
from oneform_warp.cycles import short_cycle_misses
from oneform_warp.forms import node_energy
from oneform_warp.rings import integrate_rings
from oneform_warp.starts import AREA, COHERENT, STARTS, WALK, worthwhile
from oneform_warp.starts import Problem as Start
from oneform_warp.tree import spanning_tree

WORTHWHILE = worthwhile(ow.Multigrid(), wp.get_device("cpu"))
"""Of the rest pose's energy: what the integral must have for multigrid."""


def package_start(name: str, problem: Problem, solver: Any) -> Any:
    """Rows per node from a start of the package, the held nodes at rest; `auto` goes by the solver."""
    gain = worthwhile(solver, problem.graph.device)
    start = Start(problem.graph, problem.rest, problem.v, None, pinned=problem.shape.pinned, gain=gain)
    made = STARTS[name](start)
    return made if name in ("auto", "rings", "rest") else problem.held(made)


def looked_at(problem: Problem) -> dict[str, Any]:
    """q, rho, the energy that they predict for the integral over rings, and that energy, both over the rest pose's."""
    graph = problem.graph
    found = short_cycle_misses(graph, problem.rest, problem.v)
    q, rho = float(found.q[0]), float(found.rho[0])
    rings = integrate_rings(spanning_tree(graph, roots=problem.roots), problem.v, problem.rest).to(graph.device)
    resting = node_energy(graph, problem.rest, problem.v)[0]
    return {
        "q": q,
        "rho": rho,
        "predicted": q * (AREA * graph.node_count if rho > COHERENT else WALK),
        "rings": node_energy(graph, rings, problem.v)[0] / resting,
        "least over rest": problem.least / resting,
    }
