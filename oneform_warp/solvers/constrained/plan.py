"""The rows with their directions known: which of them count, whether they agree, and their multipliers' system."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import diags_array

from oneform_warp.errors import InputError
from oneform_warp.solvers.constrained.dependence import Dependence, dependence
from oneform_warp.solvers.constrained.equations import Equations
from oneform_warp.solvers.constrained.schur import Constants, Schur

__all__ = ["Plan"]

Floats = NDArray[np.float64]

AGREE = 1.0e-6
"""Of the mesh's size: by how much the right-hand sides of dependent rows may differ; float32 input passes."""

TAKES_PART = 1.0e-6
"""Coefficient from which a row is named among those that make up another one."""


@dataclass(frozen=True, eq=False)
class Plan:
    """C x = d over the touched nodes, (rows, 3 touched)."""

    equations: Equations
    matrix: Any
    right: Floats
    length: Floats
    """|C_r|, (rows,)."""
    free: NDArray[np.bool_]
    """The coordinates that may move, (3 touched,)."""
    hard: NDArray[np.int64]
    """The hard rows, which `dependence` numbers."""
    dependence: Dependence

    @classmethod
    def of(cls, equations: Equations, factors: Floats, pinned: NDArray[np.bool_]) -> Plan:
        """factors: see `Equations.factors`; pinned: (touched,)."""
        matrix = equations.matrix(factors)
        length = np.sqrt(np.asarray((matrix**2).sum(axis=1)))
        free = np.repeat(~pinned, 3)
        hard = np.flatnonzero(equations.hard)
        unit = diags_array(1.0 / np.where(length > 0.0, length, 1.0)) @ matrix
        rows = unit.tocsr()[hard][:, np.flatnonzero(free)]
        return cls(equations, matrix, equations.right_hand_side(factors), length, free, hard, dependence(rows))

    def asking(self, equations: Equations) -> Plan:
        """The same rows, complete ones, with another d."""
        return replace(self, equations=equations, right=equations.right_hand_side(np.ones((equations.count, 3))))

    @property
    def dropped(self) -> NDArray[np.int64]:
        """Hard rows that follow from earlier ones."""
        return self.hard[self.dependence.dropped]

    def schur(self, mixing: Any, table: Floats, loose: Constants) -> Schur:
        """The system for the multipliers of all rows but the dropped ones and those without an entry."""
        rows = np.setdiff1d(np.flatnonzero(self.length > 0.0), self.dropped)
        return Schur.of(rows, mixing, table, self.equations.compliance, self.length, loose)

    def misfit(self, x: Floats) -> Floats:
        """C x - d, (rows,), for positions of the touched nodes, (touched, 3)."""
        misfit: Floats = self.matrix @ x.ravel() - self.right
        return misfit

    def rounding(self, x: Floats) -> Floats:
        """The rounding error of the same, (rows,)."""
        size: Floats = abs(self.matrix) @ np.abs(x.ravel()) + np.abs(self.right)
        return 4.0 * np.finfo(np.float64).eps * size

    def pull(self, x: Floats) -> Floats:
        """w (C x - d) of the soft rows, 0 for hard ones, (rows,)."""
        soft = np.where(self.equations.hard, np.inf, self.equations.compliance)
        pull: Floats = self.misfit(x) / soft
        return pull

    def load(self, multipliers: Floats) -> Floats:
        """C^T lambda at the touched nodes, (touched, 3)."""
        load: Floats = (self.matrix.T @ multipliers).reshape(-1, 3)
        return load

    def check(self, x: Floats) -> None:
        """InputError, with names, where hard rows contradict each other or the pinned nodes of x, (touched, 3)."""
        held = np.where(self.free, 0.0, x.ravel())
        d = (self.right - self.matrix @ held) / np.where(self.length > 0.0, self.length, 1.0)
        d = d[self.hard]
        wrong = np.abs(self.dependence.misfit(d)) > AGREE * self.dependence.slack(d)
        if not wrong.any():
            return
        first = int(np.argmax(wrong))
        others = self.dependence.kept[np.abs(self.dependence.combination[first]) > TAKES_PART]
        rows = self.hard[np.append(others, self.dependence.dropped[first])]
        names = list(dict.fromkeys(f"{self.equations.label(int(row))!r}" for row in rows))
        if abs(self.matrix[rows][:, np.flatnonzero(~self.free)]).sum() > 0.0:
            names.append("the held vertices")
        what = "contradict each other" if len(names) > 1 else "contradicts itself"
        raise InputError(
            f"{' and '.join(names)} {what}",
            where="constraints",
            fix="drop one of them, or give it a weight: soft ones may disagree",
        )
