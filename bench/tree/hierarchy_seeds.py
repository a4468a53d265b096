"""Seeds from the multigrid hierarchy: the coarsest graph's solution, and nested iteration."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import warp as wp

from oneform_warp.solvers.goals import Goals
from oneform_warp.solvers.multigrid import hierarchy
from oneform_warp.solvers.multigrid.cycle import Cycle
from oneform_warp.solvers.multigrid.smoothing import residual
from oneform_warp.solvers.multigrid.transfer import prolong, restrict
from oneform_warp.solvers.precision import FLOAT32
from oneform_warp.solvers.refinement import Correction, corrected
from oneform_warp.solvers.rows import LaplacianRows, scaled_right_hand_side
from oneform_warp.solvers.system import System

if TYPE_CHECKING:
    from bench.tree.cases import Problem


def coarsest(problem: Problem) -> Any:
    """The rest pose, corrected by the solution on the coarsest graph alone, interpolated."""
    return _up(problem, cycles=False)


def nested(problem: Problem) -> Any:
    """Nested iteration: from the coarsest graph upwards, one cycle on each level after the interpolation."""
    return _up(problem, cycles=True)


def _up(problem: Problem, *, cycles: bool) -> Any:
    graph = problem.graph
    system = System.of(graph, problem.shape.pinned)
    levels = hierarchy(system)
    cycle = Cycle(levels)
    r = wp.zeros_like(problem.rest)
    system.open(problem.rest, problem.v, problem.rest, 1.0e-12, r)
    goals: Goals = system.goals
    goals.take_aim(FLOAT32.floor)
    rows = LaplacianRows.of(system, FLOAT32)
    fine = rows.vectors()
    scaled_right_hand_side(rows, r, goals.unit, fine)
    right: list[wp.array[wp.vec3]] = [fine]
    ps = levels.structure.prolongations
    for level, p in enumerate(ps):
        right.append(wp.zeros_like(cycle.r[level + 1]))
        restrict(p, right[level], right[-1])
    wp.copy(cycle.r[len(ps)], right[-1])
    cycle._solve(len(ps))
    x = wp.clone(cycle.x[len(ps)])
    for level in range(len(ps) - 1, -1, -1):
        finer = wp.zeros_like(right[level])
        prolong(levels.levels[level], ps[level], x, finer)
        x = _improved(cycle, level, right[level], finer) if cycles else finer
    return corrected(graph, problem.rest, Correction(x, rows.scale, goals.unit, lambda: 0))


def _improved(cycle: Cycle, level: int, right: Any, x: Any) -> Any:
    """X plus one cycle on what it leaves of the right-hand side."""
    rows = cycle.hierarchy.levels[level]
    residual(rows, cycle.lanes[level], right, x, cycle.r[level])
    cycle._solve(level)
    return wp.array(x.numpy() + cycle.x[level].numpy(), dtype=wp.vec3, device=x.device)
