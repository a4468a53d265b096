"""The constraints as a solver sees them: rows over nodes and coordinates, in the units of the solve."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from oneform_warp.errors import InputError
from oneform_warp.solvers.constrained.columns import ScalarColumns

__all__ = ["Equations"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Equations:
    """C x = d: row r says that the sum of its value * (x[node, axis] + origin) is d[r]; softly where compliance > 0."""

    names: tuple[str, ...]
    """Of the constraints."""
    owner: Integers
    """The number of each row's constraint, (rows,)."""
    row: Integers
    """Of each entry, (entries,); so are node, axis, value and origin."""
    node: Integers
    axis: Integers
    value: Floats
    origin: Floats
    d: Floats
    """(rows,)"""
    compliance: Floats
    """1 / w of rows that add w (C x - d)^2 to the energy, 0 of hard ones, (rows,)."""
    along: Integers
    """(rows, 2): the nodes a, b between which a row measures, its values still to be multiplied with the direction of
    x_b - x_a; -1 for rows that are complete."""

    @property
    def count(self) -> int:
        """Rows."""
        return len(self.d)

    @property
    def follows(self) -> bool:
        """Whether any row takes its direction from the deformed shape."""
        return bool((self.along >= 0).any())

    @property
    def hard(self) -> NDArray[np.bool_]:
        """The rows that hold exactly, (rows,)."""
        return self.compliance == 0.0

    def has_the_rows_of(self, other: Equations) -> bool:
        """Whether only names and d may differ."""
        parts = ("owner", "row", "node", "axis", "value", "origin", "compliance", "along")
        return all(np.array_equal(getattr(self, part), getattr(other, part)) for part in parts)

    def label(self, row: int) -> str:
        """The name of the row's constraint."""
        return self.names[int(self.owner[row])]

    @cached_property
    def nodes(self) -> Integers:
        """The nodes that have a part in any row, ascending, (touched,)."""
        return np.unique(self.node)

    def factors(self, x: Floats) -> Floats:
        """What values are multiplied with, (rows, 3): the direction x_b - x_a where a row follows one.

        x: positions of `nodes`, (touched, 3). InputError where the two coincide.
        """
        factors = np.ones((self.count, 3))
        rows = np.flatnonzero(self.along[:, 0] >= 0)
        ends = np.searchsorted(self.nodes, self.along[rows])
        span = x[ends[:, 1]] - x[ends[:, 0]]
        length = np.linalg.norm(span, axis=1)
        if not (length > 0.0).all():
            raise InputError(
                "the ends coincide, so there is no direction to measure along",
                where=self.label(int(rows[np.argmin(length)])),
                fix="give the direction",
            )
        factors[rows] = span / length[:, None]
        return factors

    def matrix(self, factors: Floats) -> Any:
        """C as a csr_array (rows, 3 touched), coordinates of a node together."""
        at = 3 * np.searchsorted(self.nodes, self.node) + self.axis
        values = self.value * factors[self.row, self.axis]
        return coo_array((values, (self.row, at)), shape=(self.count, 3 * len(self.nodes))).tocsr()

    def right_hand_side(self, factors: Floats) -> Floats:
        """D less what the origins add, (rows,)."""
        values = self.value * factors[self.row, self.axis] * self.origin
        return self.d - np.bincount(self.row, values, self.count)

    @cached_property
    def scalar_columns(self) -> ScalarColumns:
        """The 0-forms that the rows are made of, before any factors."""
        at = np.searchsorted(self.nodes, self.node)
        shape = (3 * self.count, len(self.nodes))
        coordinates = coo_array((self.value, (3 * self.row + self.axis, at)), shape=shape).tocsr()
        coordinates.eliminate_zeros()
        return ScalarColumns.of(coordinates, self.owner)
