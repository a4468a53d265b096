"""States that a solver prepared, kept for the pins that come again: a changed rotation then prepares nothing."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.solvers.refinement import State
from oneform_warp.solvers.solver import Solver

__all__ = ["States"]

KEPT = 4
"""Fields of rotation, fields of stretch, positions, and one to change to and fro."""


class States:
    """What `solver.prepare` makes for a graph, the most recent kept by their pins and attachments."""

    def __init__(self, solver: Solver, graph: Graph) -> None:
        self.solver, self.graph = solver, graph
        self._kept: OrderedDict[tuple[bytes, bytes], State] = OrderedDict()

    def of(self, pinned: NDArray[np.bool_], attachment: NDArray[np.float64] | None = None) -> State:
        """The state for these pinned (n,) and attached (n,) nodes."""
        key = np.packbits(pinned).tobytes(), b"" if attachment is None else attachment.tobytes()
        if key not in self._kept:
            self._kept[key] = self.solver.prepare(self.graph, pinned, attachment)
        self._kept.move_to_end(key)
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return self._kept[key]
