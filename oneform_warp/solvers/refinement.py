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

from oneform_warp.segments import Segments, launch_chunks
from oneform_warp.solvers.goals import Goals
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

    def correct(self, r: wp.array[wp.vec3d], goals: Goals, budget: int, watch: Watch | None) -> Correction:
        """From |r| down to the aim per component and column, in at most `budget` iterations; zero where it is there."""


@dataclass(frozen=True, eq=False)
class State:
    """What `prepare` made: the problem for one graph and one set of pins, and a solver that is ready for it."""

    system: System
    inner: Inner


@wp.kernel(enable_backward=False)
def _add(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    # In:
    e: wp.array[Any],
    scale: wp.float64,
    unit: wp.array[wp.vec3d],
    # Out:
    x_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    by = scale * unit[chunk_component[k]]
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        x_out[i] = x_out[i] + wp.cw_mul(by, wp.vec3d(e[i]))


def add_correction(segments: Segments, x: wp.array[wp.vec3d], correction: Correction) -> None:
    """X <- x + e, in float64."""
    inputs = [segments.chunk_component, correction.e, wp.float64(correction.scale), correction.unit]
    launch_chunks(_add, segments, inputs, [x])


def refine(
    state: State,
    v: wp.array[wp.vec3d],
    x: wp.array[wp.vec3d],
    *,
    target: wp.array[wp.vec3d],
    tol: float,
    max_iterations: int,
    progress: Progress | None = None,
) -> Solution:
    """Improves x in place until |r| <= tol |codiff v| in every component and column; x holds the pinned values.

    Where v is co-closed to rounding, as v = 0 is, the residual of the start takes the place of |codiff v|; and no
    column is asked for less than the rounding error of its own residual. The host first looks at the residual after
    the first correction, which is usually the last.
    """
    system, inner, segments = state.system, state.inner, state.system.graph.segments
    given = wp.clone(x) if len(system.anchors.nodes) else x
    r, before = wp.zeros_like(x), wp.empty_like(x)
    goals = system.open(x, v, target, tol, r)
    log = _Log(goals, max_iterations, progress)
    # Looking costs nothing on a CPU; a GPU is left alone unless somebody wants to know.
    watch = None if system.graph.device.is_cuda and progress is None else log.watch
    if watch is not None:
        log.begin(goals.norm.numpy())
    status = None
    while status is None:
        wp.copy(before, x)
        goals.take_aim(inner.floor)
        correction = inner.correct(r, goals, log.budget, watch)
        add_correction(segments, x, correction)
        goals.measure(system.residual(x, v, target, r))
        status = log.judge(correction)
    if status is Status.NON_FINITE:
        wp.copy(x, before)
    system.anchors.restore(x, given)
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
            wp.clone(start),
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

    @property
    def budget(self) -> int:
        """Iterations that are left."""
        return self.max_iterations - self.iterations

    def begin(self, norms: NDArray[np.float64]) -> None:
        self.history.append((0, worst(norms, self.goals.goal.numpy())))

    def watch(self, count: int, norms: NDArray[np.float64]) -> bool:
        ratio = worst(norms, self.goals.goal.numpy())
        self.history.append((self.iterations + count, ratio))
        if self.progress is not None and self.progress(self.iterations + count, ratio):
            self.cancelled = True
        return self.cancelled

    def judge(self, correction: Correction) -> Status | None:
        """How the solve ends after this correction, None to go on; waits for the device."""
        norms, before, goal = (a.numpy() for a in (self.goals.norm, self.goals.before, self.goals.goal))
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
        goals = self.goals
        norms = goals.before if status is Status.NON_FINITE else goals.norm
        found = norms.numpy(), goals.goal.numpy()
        return Solution(x, status, self.iterations, self.restarts, *found, tuple(self.history))


def worst(norms: NDArray[np.float64], goal: NDArray[np.float64]) -> float:
    """The largest residual / goal; a residual of zero has reached any goal."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(norms == 0.0, 0.0, norms / goal)
    return float(ratio.max(initial=0.0))
