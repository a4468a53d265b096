"""What a solver returns, and the words for how it ended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Progress", "Solution", "Status"]

Progress = Callable[[int, float], bool | None]
"""Called as progress(iterations, residual / goal) every few iterations; a true answer cancels the solve."""


class Status(Enum):
    """How a solve ended; `str(status)` says what to do."""

    CONVERGED = "converged: the float64 residual is at most tol * |codiff v| in every component and column"
    MAX_ITERATIONS = "max_iterations: the iterations ran out; raise max_iterations, or tol if this is enough"
    STAGNATED = "stagnated: restarts no longer lower the residual; raise tol, or use dtype='float64'"
    NON_FINITE = "non_finite: numbers overflowed; check the scale of positions and weights, or use dtype='float64'"
    CANCELLED = "cancelled: the progress callback asked to stop; the positions are the best so far"

    @property
    def word(self) -> str:
        """The status as one word."""
        return self.value.split(":")[0]

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, eq=False)
class Solution:
    """The minimiser of phi(x) = sum mu_ij |x_j - x_i - v_ij|^2 that a solver found."""

    x: Any
    """The 0-form, one row per vertex (per node where a solver object is called directly)."""
    status: Status
    iterations: int
    restarts: int
    residual: NDArray[np.float64]
    """|codiff(v - dx)| in float64 over the free nodes, (components with edges, D columns)."""
    goal: NDArray[np.float64]
    """The residual at which a component's column is converged, same shape."""
    history: tuple[tuple[int, float], ...]
    """(iterations so far, largest residual / goal) at every restart; on CPU, or watched, also between."""

    @property
    def converged(self) -> bool:
        """Whether the float64 residual is small enough everywhere."""
        return self.status is Status.CONVERGED
