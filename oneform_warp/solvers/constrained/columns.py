"""The few 0-forms of numbers that all rows of C are made of: what L has to be solved for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array

__all__ = ["ScalarColumns"]


class _Part(NamedTuple):
    """One coordinate of one row: factor times a 0-form, which is 1 at its first node."""

    row: int
    nodes: NDArray[np.integer[Any]]
    values: NDArray[np.float64]
    factor: float

    @property
    def key(self) -> tuple[bytes, bytes]:
        return self.nodes.tobytes(), self.values.tobytes()


@dataclass(frozen=True, eq=False)
class ScalarColumns:
    """C taken apart: coordinate a of row r is the 0-form sum_p mixing[3 r + a, p] forms[:, p].

    L is the same for the three coordinates, so L^-1 is needed once for each of the forms, and three are one solve. A
    point that is held needs one, as do the three rows of a centroid and all directions of an edge.
    """

    forms: Any
    """(nodes, k), scipy csc_array."""
    mixing: Any
    """(3 rows, k), scipy csr_array."""

    @classmethod
    def of(cls, coordinates: Any, owner: NDArray[np.int64]) -> ScalarColumns:
        """coordinates: csr_array (3 rows, nodes), coordinate a of row r at 3 r + a; owner: each row's constraint."""
        number: dict[tuple[bytes, bytes], int] = {}
        parts, forms, place = [], [], []
        for own in _by_owner(owner):
            for part in _parts(coordinates, own):
                if part.key not in number:
                    number[part.key] = len(forms)
                    forms.append(part)
                parts.append(part)
                place.append(number[part.key])
        nodes = np.concatenate([np.zeros(0, dtype=np.int32), *(form.nodes for form in forms)])
        values = np.concatenate([np.zeros(0), *(form.values for form in forms)])
        ends = np.cumsum([0, *(len(form.nodes) for form in forms)])
        rows = np.array([part.row for part in parts], dtype=np.int64)
        factors = np.array([part.factor for part in parts])
        columns = np.array(place, dtype=np.int64)
        return cls(
            csc_array((values, nodes, ends), shape=(coordinates.shape[1], len(forms))),
            csr_array((factors, (rows, columns)), shape=(coordinates.shape[0], len(forms))),
        )


def _by_owner(owner: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """The rows of each constraint."""
    order = np.argsort(owner, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(owner[order])) + 1)


def _parts(coordinates: Any, rows: NDArray[np.int64]) -> list[_Part]:
    """The coordinates of one constraint's rows; node by node where that takes fewer forms."""
    whole = [_part(coordinates, 3 * int(row) + axis) for row in rows for axis in range(3)]
    filled = [part for part in whole if len(part.nodes)]
    nodes = {int(node) for part in filled for node in part.nodes[: len(filled) + 1]}
    if len({part.key for part in filled}) <= len(nodes):
        return filled
    return [
        _Part(part.row, part.nodes[k : k + 1], np.ones(1), part.factor * float(part.values[k]))
        for part in filled
        for k in range(len(part.nodes))
    ]


def _part(coordinates: Any, row: int) -> _Part:
    span = slice(coordinates.indptr[row], coordinates.indptr[row + 1])
    values = coordinates.data[span]
    factor = float(values[0]) if len(values) else 1.0
    return _Part(row, coordinates.indices[span], values / factor, factor)
