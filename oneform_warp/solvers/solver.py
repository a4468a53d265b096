"""What every solver is: options by value, `prepare` and `solve`."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.solvers.refinement import State
from oneform_warp.solvers.solution import Progress, Solution

__all__ = ["Solver"]


class Solver(Protocol):
    """A solver by value: options in its fields, everything that costs time in `State`."""

    @property
    def tol(self) -> float:
        """|codiff(v - dx)| <= tol |codiff v| in each component and column."""

    def prepare(self, graph: Graph, pinned: NDArray[np.bool_], attachment: NDArray[np.float64] | None = None) -> State:
        """What depends on the graph and its pins alone."""

    def solve(
        self,
        state: State,
        v: wp.array[wp.vec3d],
        start: wp.array[wp.vec3d],
        *,
        target: wp.array[wp.vec3d] | None = None,
        progress: Progress | None = None,
    ) -> Solution:
        """The minimiser for v from a start that holds the pinned values, per node."""
