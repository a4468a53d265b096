"""Any solver with linear constraints on top: min phi(x) with C x = d, and w (C x - d)^2 added where they are soft.

    L x + C^T lambda = codiff v        the gradient, judged in float64 by differences
    C x - lambda / w = d               hard rows have 1 / w = 0

What the solver found without them is x; multipliers come from the Schur complement, and lead to x - L^-1 C^T lambda.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.centroids import keep_centroids
from oneform_warp.graph import Graph
from oneform_warp.solvers.constrained.equations import Equations
from oneform_warp.solvers.constrained.plan import Plan
from oneform_warp.solvers.constrained.schur import Schur
from oneform_warp.solvers.constrained.state import ConstrainedState
from oneform_warp.solvers.refinement import worst
from oneform_warp.solvers.solution import Progress, Solution, Status
from oneform_warp.solvers.solver import Solver

__all__ = ["Constrained", "ConstrainedSolution"]

Floats = NDArray[np.float64]

TURNS = 20
"""Turns of positions and multipliers; one or two are usual."""

RESPONSE = 1.0e-6
"""Relative residual of one response: in float32 a single correction, and the next turn mends it."""

EXACT = 1.0e-9
"""Of the mesh's size: how far a hard row may be off, whatever the tolerance of the gradient."""


@dataclass(frozen=True, eq=False)
class ConstrainedSolution(Solution):
    """A solution, and what the constraints took; rows are those of all constraints, one after the other."""

    multipliers: Floats
    """lambda, the forces that hold the rows, (rows,); 0 for dropped ones."""
    misfit: Floats
    """C x - d, (rows,), in the units of the solve."""
    dropped: NDArray[np.int64]
    """The rows that follow from earlier ones."""


@dataclass(frozen=True, eq=False)
class Constrained:
    """A solver for the same least squares problem under C x = d.

    solver: does the work. equations: the constraints. home: positions per node, (n,): floating components keep the
    centroids that they have there, as far as no constraint moves them; None for those of the start.
    """

    solver: Solver
    equations: Equations
    home: wp.array[wp.vec3d] | None = None

    @property
    def tol(self) -> float:
        """That of the solver."""
        return self.solver.tol

    def prepare(
        self, graph: Graph, pinned: NDArray[np.bool_], attachment: NDArray[np.float64] | None = None
    ) -> ConstrainedState:
        """The solver's state, and a third of a solve for each scalar form of the constraints."""
        base = self.solver.prepare(graph, pinned, attachment)
        return ConstrainedState.of(base, self.equations, pinned, max(self.tol, RESPONSE))

    def solve(
        self,
        state: ConstrainedState,
        v: wp.array[wp.vec3d],
        start: wp.array[wp.vec3d],
        *,
        target: wp.array[wp.vec3d] | None = None,
        progress: Progress | None = None,
    ) -> Solution:
        """See `Solver.solve`; InputError for constraints that contradict each other or the pinned nodes.

        Rows that follow a direction take it from the solution without constraints.
        """
        if state.known is not None:
            state.known[0].check(state.at(start))
        base = self.solver.solve(state.base, v, start, target=target, progress=progress)
        graph = state.system.graph
        keep_centroids(graph, state.base.floating, base.x, start if self.home is None else self.home)
        plan, schur = state.plan(base.x)
        if state.known is None:
            plan.check(state.at(start))
        turns = _Turns(state, plan, schur, self.tol, v, start if target is None else target)
        return turns.from_solution(base)


class _Turns:
    """One solve: multipliers for the misfit, positions for the multipliers, until gradient and misfit are small."""

    def __init__(
        self,
        state: ConstrainedState,
        plan: Plan,
        schur: Schur,
        tol: float,
        v: wp.array[wp.vec3d],
        target: wp.array[wp.vec3d],
    ) -> None:
        self.state, self.plan, self.schur, self.tol = state, plan, schur, tol
        self.v, self.target = v, target
        self.multipliers = np.zeros(plan.equations.count)

    def from_solution(self, base: Solution) -> ConstrainedSolution:
        """From the solution without constraints; one that gave up is not improved any more, only held once."""
        # Responses set goals of their own in the arrays that the base shows.
        x, norms, goal, status = base.x, base.residual.copy(), base.goal.copy(), base.status
        least, before, turn, history = goal, np.inf, 0, list(base.history)
        limit = {Status.CONVERGED: TURNS, Status.CANCELLED: 0, Status.NON_FINITE: 0}.get(status, 1)
        while turn < limit:
            turn += 1
            x = self._hold(x)
            r, norms, goal = self._gradient(x, least)
            ratio = max(worst(norms, goal), self._misfit_ratio(x))
            history.append((base.iterations + turn, ratio))
            status = self._judge(ratio, before, base.status)
            if status is not Status.MAX_ITERATIONS:
                break
            before = ratio
            if (norms > goal).any():
                x = self.state.relaxed(x, r)
        return ConstrainedSolution(
            x,
            status,
            base.iterations + turn,
            base.restarts + max(turn - 1, 0),
            norms,
            goal,
            tuple(history),
            self.multipliers,
            self.plan.misfit(self.state.at(x)),
            self.plan.dropped,
        )

    @staticmethod
    def _judge(ratio: float, before: float, base: Status) -> Status:
        """How it ends here; MAX_ITERATIONS to go on."""
        if not np.isfinite(ratio):
            return Status.NON_FINITE
        if ratio <= 1.0:
            return Status.CONVERGED
        if base is not Status.CONVERGED:
            return base
        return Status.STAGNATED if ratio > 0.5 * before else Status.MAX_ITERATIONS

    def _hold(self, x: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
        """X with the misfit of the rows removed, by a change of the multipliers."""
        change, translations = self.schur.solve(self._misfit(x))
        self.multipliers += change
        return self.state.pushed(x, self.plan.load(change), translations)

    def _gradient(self, x: wp.array[wp.vec3d], least: Floats) -> tuple[wp.array[wp.vec3d], Floats, Floats]:
        """codiff(v - dx) + w (t - x) - C^T lambda at the nodes, its norms, and how small they have to be."""
        state, system = self.state, self.state.system
        r = wp.empty_like(x)
        system.residual(x, self.v, self.target, r)
        forces = self.plan.load(self.multipliers)
        state.response.add_load(r, state.nodes, -forces)
        norms = state.response.balance(r)
        forces[state.pinned] = 0.0
        squares = np.zeros((system.graph.component_count, 3))
        np.add.at(squares, system.graph.node_component[self.plan.equations.nodes], forces**2)
        goal = np.maximum(least, self.tol * np.sqrt(squares[: len(least)]))
        return r, norms, goal

    def _misfit(self, x: wp.array[wp.vec3d]) -> Floats:
        return self.plan.misfit(self.state.at(x)) - self.plan.equations.compliance * self.multipliers

    def _misfit_ratio(self, x: wp.array[wp.vec3d]) -> float:
        """The largest misfit of the rows that count, over what it may be."""
        rows = self.schur.rows
        least = self.plan.rounding(self.state.at(x))
        goal = min(self.tol, EXACT) * self.plan.length + least
        return worst(np.abs(self._misfit(x))[rows], goal[rows])
