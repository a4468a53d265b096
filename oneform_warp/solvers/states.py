"""States that a solver prepared, kept for the pins that come again: a changed rotation then prepares nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.solvers.refinement import State
from oneform_warp.solvers.solver import Solver

__all__ = ["States"]

KEPT = 4
"""Fields of rotation, fields of stretch, positions, and one to change to and fro."""


class _Kept(NamedTuple):
    pinned: NDArray[np.bool_]
    attachment: NDArray[np.float64] | None
    state: State


class States:
    """What `solver.prepare` makes for a graph, the most recent kept by their pins and attachments."""

    def __init__(self, solver: Solver, graph: Graph) -> None:
        self.solver, self.graph = solver, graph
        self._kept: list[_Kept] = []

    def of(self, pinned: NDArray[np.bool_], attachment: NDArray[np.float64] | None = None) -> State:
        """The state for these pinned (n,) and attached (n,) nodes; pinned cannot be written to from then on."""
        known = next((k for k in self._kept if k.pinned is pinned and _same(k.attachment, attachment)), None)
        if known is None:
            matching = (k for k in self._kept if _same(k.pinned, pinned) and _same(k.attachment, attachment))
            known = next(matching, None)
        if known is None:
            pinned.flags.writeable = False
            known = _Kept(pinned, attachment, self.solver.prepare(self.graph, pinned, attachment))
        self._kept = [known, *(k for k in self._kept if k is not known)][:KEPT]
        return known.state

    def changed(self, solver: Solver, change: Callable[[Any], State]) -> States:
        """Those of another solver, each made from one of these."""
        others = States(solver, self.graph)
        others._kept = [kept._replace(state=change(kept.state)) for kept in self._kept]
        return others


def _same(a: NDArray[np.generic] | None, b: NDArray[np.generic] | None) -> bool:
    return a is b or (a is not None and b is not None and np.array_equal(a, b))
