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

from oneform_warp.solvers.solution import Progress, Solution, Status
from oneform_warp.solvers.system import System

__all__ = ["Correction", "Inner", "Refining", "State", "Watch", "refine"]

SAFETY = 0.5
"""The inner solver aims below the goal, since its residual drifts from the true one."""


Watch = Callable[[int, NDArray[np.float64]], bool]
"""Called with the iterations of this correction and the recursion's residual norms; true asks to stop."""


@dataclass(frozen=True, eq=False)
class Correction:
    """What an inner solver found: the displacement `scale * e` per node, after `iterations`."""

    e: wp.array[Any]
    scale: float
    iterations: int


class Inner(Protocol):
    """Solves L e = r roughly, on the same device."""

    @property
    def floor(self) -> float:
        """The relative residual that one correction can reach in its precision."""

    def correct(
        self,
        r: wp.array[wp.vec3d],
        norms: NDArray[np.float64],
        aim: NDArray[np.float64],
        budget: int,
        watch: Watch | None,
    ) -> Correction:
        """From |r| = norms down to `aim` per component and column, in at most `budget` iterations."""


@dataclass(frozen=True, eq=False)
class State:
    """What `prepare` made: the problem for one graph and one set of pins, and a solver that is ready for it."""

    system: System
    inner: Inner


@wp.kernel(enable_backward=False)
def _add(
    # In:
    e: wp.array[wp.vec3d],
    scale: wp.float64,
    # Out:
    x_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    x_out[i] = x_out[i] + scale * e[i]


@wp.kernel(enable_backward=False)
def _add_single(
    # In:
    e: wp.array[wp.vec3],
    scale: wp.float64,
    # Out:
    x_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    x_out[i] = x_out[i] + scale * wp.vec3d(e[i])


def add_correction(x: wp.array[wp.vec3d], correction: Correction) -> None:
    """X <- x + e, in float64."""
    kernel = _add if correction.e.dtype is wp.vec3d else _add_single
    wp.launch(kernel, dim=x.shape[0], inputs=[correction.e, correction.scale], outputs=[x], device=x.device)


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
    column is asked for less than the rounding error of its own residual.
    """
    system, inner = state.system, state.inner
    given = wp.clone(x) if len(system.anchors.nodes) else x
    r = wp.zeros_like(x)
    norms = system.residual(x, v, target, r)
    reference, rounding = system.scales(x, v)
    goal = np.maximum(tol * np.where(reference > rounding, reference, norms), rounding)
    log = _Log(goal, progress)
    log.restart(norms)
    previous = np.full_like(norms, np.inf)
    # Looking costs nothing on a CPU; a GPU is left alone unless somebody wants to know.
    watch = None if system.graph.device.is_cuda and progress is None else log.watch
    while (status := _judge(norms, previous, log, max_iterations)) is None:
        aim = np.maximum(SAFETY * goal, inner.floor * norms)
        before = wp.clone(x)
        correction = inner.correct(r, norms, aim, max_iterations - log.iterations, watch)
        add_correction(x, correction)
        log.iterations += correction.iterations
        previous, norms = norms, system.residual(x, v, target, r)
        if not np.isfinite(norms).all():
            wp.copy(x, before)
            system.anchors.restore(x, given)
            return log.solution(x, Status.NON_FINITE, previous)
        log.restart(norms)
    system.anchors.restore(x, given)
    return log.solution(x, status, norms)


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
    """What happened so far in one solve."""

    def __init__(self, goal: NDArray[np.float64], progress: Progress | None) -> None:
        self.goal, self.progress = goal, progress
        self.iterations, self.restarts, self.cancelled = 0, -1, False
        self.history: list[tuple[int, float]] = []

    def watch(self, count: int, norms: NDArray[np.float64]) -> bool:
        ratio = worst(norms, self.goal)
        self.history.append((self.iterations + count, ratio))
        if self.progress is not None and self.progress(self.iterations + count, ratio):
            self.cancelled = True
        return self.cancelled

    def restart(self, norms: NDArray[np.float64]) -> None:
        self.restarts += 1
        self.history.append((self.iterations, worst(norms, self.goal)))

    def solution(self, x: wp.array[wp.vec3d], status: Status, norms: NDArray[np.float64]) -> Solution:
        return Solution(x, status, self.iterations, self.restarts, norms, self.goal, tuple(self.history))


def _judge(norms: NDArray[np.float64], previous: NDArray[np.float64], log: _Log, max_iterations: int) -> Status | None:
    """How the solve ends here, None to go on."""
    if not np.isfinite(norms).all():
        return Status.NON_FINITE
    waiting = norms > log.goal
    if not waiting.any():
        return Status.CONVERGED
    if log.cancelled:
        return Status.CANCELLED
    if log.iterations >= max_iterations:
        return Status.MAX_ITERATIONS
    # A restart that does not halve any waiting residual is at the limit of its precision.
    if (norms > 0.5 * previous)[waiting].all():
        return Status.STAGNATED
    return None


def worst(norms: NDArray[np.float64], goal: NDArray[np.float64]) -> float:
    """The largest residual / goal; a residual of zero has reached any goal."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(norms == 0.0, 0.0, norms / goal)
    return float(ratio.max(initial=0.0))
