"""What the direct solvers share: options, the outer loop, and the correction by a factorisation on the host."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.solvers.direct.free_matrix import FreeMatrix
from oneform_warp.solvers.goals import Goals
from oneform_warp.solvers.precision import FLOAT64
from oneform_warp.solvers.refinement import Correction, Refining, Watch
from oneform_warp.solvers.system import System
from oneform_warp.solvers.validation import check_limits

__all__ = ["Direct", "HostCorrection", "Substitution", "nothing_to_do", "singular"]

Substitution = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""From right-hand sides (k, 3), rows of three together, to the solution, (k, 3)."""

CORRECTIONS = 10
"""One is usual, two where weights spread over many decades; a loop that needs more has stagnated before."""


@wp.kernel(enable_backward=False)
def _columns(
    # In:
    node: wp.array[wp.int32],
    r: wp.array[wp.vec3d],
    # Out:
    column_out: wp.array2d[wp.float64],
):
    k = wp.tid()
    for d in range(3):
        column_out[d, k] = r[node[k]][d]


@wp.kernel(enable_backward=False)
def _rows(
    # In:
    node: wp.array[wp.int32],
    column: wp.array2d[wp.float64],
    # Out:
    e_out: wp.array[wp.vec3d],
):
    k = wp.tid()
    e_out[node[k]] = wp.vec3d(column[0, k], column[1, k], column[2, k])


class HostCorrection:
    """Solves L e = r by a factorisation that lies on the host, whatever the device of the graph."""

    floor = FLOAT64.floor

    def __init__(
        self,
        system: System,
        matrix: FreeMatrix,
        substitute: Substitution,
    ) -> None:
        device = system.graph.device
        self.goals, self.matrix, self.substitute = system.goals, matrix, substitute
        self.one = system.goals.one
        self.e = wp.zeros(system.graph.node_count, dtype=wp.vec3d, device=device)
        self._node = wp.array(matrix.nodes, dtype=wp.int32, device=device)
        self._columns = wp.empty((3, matrix.size), dtype=wp.float64, device=device)

    def correct(self, r: wp.array[wp.vec3d], budget: int, watch: Watch | None) -> Correction:
        """See `refinement.Inner`; the whole correction is one iteration."""
        if nothing_to_do(self.goals, watch):
            self.e.zero_()
            return Correction(self.e, self.matrix.scale, self.one, lambda: 0)
        count, device = self.matrix.size, self.e.device
        wp.launch(_columns, dim=count, inputs=[self._node, r], outputs=[self._columns], device=device)
        # Columns one after the other are what factorisations work on.
        found = np.ascontiguousarray(self.substitute(self._columns.numpy().T).T)
        column: Any = wp.array(found, dtype=wp.float64, device=device, copy=False)
        wp.launch(_rows, dim=count, inputs=[self._node, column], outputs=[self.e], device=device)
        return Correction(self.e, self.matrix.scale, self.one, lambda: 1)


def nothing_to_do(goals: Goals, watch: Watch | None) -> bool:
    """Whether the residual is small enough as it is, or somebody asks to stop."""
    norm, _, goal = goals.account()
    return bool((norm <= goal).all()) or (watch is not None and watch(0, norm))


@dataclass(frozen=True)
class Direct(Refining):
    """The options of a direct solver; its own part is `prepare`."""

    tol: float = 1.0e-6
    max_iterations: int = field(default=CORRECTIONS, init=False, repr=False)

    def __post_init__(self) -> None:
        check_limits(self.tol, CORRECTIONS)


def singular(name: str, error: Exception) -> InputError:
    """The named error for a matrix that has no factors in float64."""
    return InputError(
        f"{name} finds no factors of the matrix ({error})",
        where="solver",
        fix="weights span too many decades for a direct solver, use Multigrid()",
    )
