"""The outer loop of every solver: float64 residual by differences, a cheap correction, and again.

    r = codiff(v - dx)             float64, decides `converged`
    L e = r                        the inner solver, in float32 unless asked otherwise
    x <- x + e                     float64

One restart is usual. The unknown inside is the displacement e, so what need not move does not move by one bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.solvers.goals import Account, Goals
from oneform_warp.solvers.solution import Progress, Solution, Status
from oneform_warp.solvers.system import System

__all__ = ["Correction", "Inner", "Refining", "State", "Watch", "refine"]

Watch = Callable[[int, NDArray[np.float64]], bool]
"""Called with the iterations of this correction and the recursion's residual norms; true asks to stop."""


@dataclass(frozen=True, eq=False)
class Correction:
    """What an inner solver found: the displacement scale * unit * e per node."""

    e: wp.array[Any]
    scale: float
    unit: wp.array[wp.vec3d]
    """Per component and column."""
    iterations: Callable[[], int]
    """How many were made, to be asked when there is nothing else to do: a GPU has to be waited for."""


class Inner(Protocol):
    """Solves L e = r roughly, on the same device."""

    @property
    def floor(self) -> float:
        """The relative residual that one correction can reach in its precision."""

    def correct(self, r: wp.array[wp.vec3d], budget: int, watch: Watch | None) -> Correction:
        """From |r| down to the aim per component and column, in at most `budget` iterations; zero where it is there."""


@dataclass(frozen=True, eq=False)
class State:
    """What `prepare` made: the problem for one graph and one set of pins, and a solver that is ready for it."""

    system: System
    inner: Inner

    @property
    def floating(self) -> NDArray[np.bool_]:
        """Components with edges whose translation a solve leaves open: they keep their centroid."""
        return self.system.floating

    @property
    def pulls(self) -> bool:
        """Whether anything beside edges and attachments pulls softly."""
        return False

    def held(self, x: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
        """The minimiser under what else has to hold, where x (n,) is the one without it."""
        return x

    def soft_energy(self, x: wp.array[wp.vec3d]) -> float:
        """What else pulls softly adds this to the energy at x (n,)."""
        return 0.0

    def add_soft_pull(self, x: wp.array[wp.vec3d], r: wp.array[wp.vec3d]) -> None:
        """Adds half of the downhill gradient of the same to r (n,), in place."""


@wp.kernel(enable_backward=False)
def _add(
    # Graph:
    component: wp.array[wp.int32],
    # In:
    x: wp.array[wp.vec3d],
    e: wp.array[Any],
    scale: wp.float64,
    unit: wp.array[wp.vec3d],
    # Out:
    x_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    c = component[i]
    by = wp.vec3d()
    # Components without an edge have no unit, and stay.
    if c < unit.shape[0]:
        by = scale * wp.cw_mul(unit[c], wp.vec3d(e[i]))
    x_out[i] = x[i] + by


# Known before the first launch, so that kernels can be compiled ahead.
_VECTORS: tuple[Any, ...] = (wp.vec3, wp.vec3d)
for _vector in _VECTORS:
    wp.overload(_add, {"e": wp.array(dtype=_vector)})


def corrected(graph: Graph, x: wp.array[wp.vec3d], correction: Correction) -> wp.array[wp.vec3d]:
    """X + e, in float64."""
    result = wp.empty_like(x)
    inputs = [graph.component_of_node, x, correction.e, wp.float64(correction.scale), correction.unit]
    wp.launch(_add, dim=x.shape[0], inputs=inputs, outputs=[result], device=x.device)
    return result


def refine(
    state: State,
    v: wp.array[wp.vec3d],
    start: wp.array[wp.vec3d],
    *,
    target: wp.array[wp.vec3d],
    tol: float,
    max_iterations: int,
    progress: Progress | None = None,
) -> Solution:
    """From `start`, which holds the pinned values, to |r| <= tol |codiff v| in every component and column.

    Where v is co-closed to rounding, as v = 0 is, the residual of the start takes the place of |codiff v|; and no
    column is asked for less than the rounding error of its own residual. The host first looks at the residual after
    the first correction, which is usually the last.
    """
    system, inner, goals = state.system, state.inner, state.system.goals
    x, r = start, wp.empty_like(start)
    system.open(x, v, target, tol, r)
    log = _Log(goals, max_iterations, progress)
    # Looking costs nothing on a CPU; a GPU is left alone unless somebody wants to know.
    watch = None if system.graph.device.is_cuda and progress is None else log.watch
    if watch is not None:
        log.begin(goals.account().norm)
    status = None
    while status is None:
        goals.take_aim(inner.floor)
        correction = inner.correct(r, log.budget, watch)
        before, x = x, corrected(system.graph, x, correction)
        system.residual(x, v, target, r)
        status = log.judge(correction)
    if status is Status.NON_FINITE:
        x = wp.clone(before)
    system.anchors.restore(x, start)
    return log.solution(x, status)


class Refining:
    """A solver whose `solve` is `refine`: its fields say how far, its states hold what improves x."""

    tol: float
    max_iterations: int

    def solve(
        self,
        state: State,
        v: wp.array[wp.vec3d],
        start: wp.array[wp.vec3d],
        *,
        target: wp.array[wp.vec3d] | None = None,
        progress: Progress | None = None,
    ) -> Solution:
        """From `start` (n,), which holds the pinned values, to the minimiser for v (m,); all per node."""
        return refine(
            state,
            v,
            start,
            target=start if target is None else target,
            tol=self.tol,
            max_iterations=self.max_iterations,
            progress=progress,
        )


class _Log:
    """What happened so far in one solve, on the host."""

    def __init__(self, goals: Goals, max_iterations: int, progress: Progress | None) -> None:
        self.goals, self.max_iterations, self.progress = goals, max_iterations, progress
        self.iterations, self.restarts, self.cancelled = 0, 0, False
        self.history: list[tuple[int, float]] = []
        self.account: Account

    @property
    def budget(self) -> int:
        """Iterations that are left."""
        return self.max_iterations - self.iterations

    def begin(self, norms: NDArray[np.float64]) -> None:
        self.history.append((0, worst(norms, self.goals.account().goal)))

    def watch(self, count: int, norms: NDArray[np.float64]) -> bool:
        ratio = worst(norms, self.goals.account().goal)
        self.history.append((self.iterations + count, ratio))
        if self.progress is not None and self.progress(self.iterations + count, ratio):
            self.cancelled = True
        return self.cancelled

    def judge(self, correction: Correction) -> Status | None:
        """How the solve ends after this correction, None to go on; waits for the device."""
        self.account = norms, before, goal = self.goals.account()
        if not self.history:
            self.begin(before)
        made = correction.iterations()
        self.iterations += made
        if made:
            self.restarts += self.iterations > made
            self.history.append((self.iterations, worst(norms, goal)))
        if not np.isfinite(norms).all():
            return Status.NON_FINITE
        waiting = norms > goal
        if not waiting.any():
            return Status.CONVERGED
        if self.cancelled:
            return Status.CANCELLED
        if self.iterations >= self.max_iterations:
            return Status.MAX_ITERATIONS
        # A restart that does not halve any waiting residual is at the limit of its precision.
        if (norms > 0.5 * before)[waiting].all():
            return Status.STAGNATED
        return None

    def solution(self, x: wp.array[wp.vec3d], status: Status) -> Solution:
        norms, before, goal = self.account
        reached = before if status is Status.NON_FINITE else norms
        return Solution(x, status, self.iterations, self.restarts, reached, goal, tuple(self.history))


def worst(norms: NDArray[np.float64], goal: NDArray[np.float64]) -> float:
    """The largest residual / goal; a residual of zero has reached any goal."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(norms == 0.0, 0.0, norms / goal)
    return float(ratio.max(initial=0.0))
