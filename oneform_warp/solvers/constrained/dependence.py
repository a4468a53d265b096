"""Which rows follow from those before them, and whether they agree with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack
from scipy.sparse.csgraph import connected_components

__all__ = ["Dependence", "dependence"]

DEPENDENT = 1.0e-7
"""Distance of a row of length 1 to the span of those before it: less than single precision can tell from none."""

BLOCK = 4096
"""Coordinates that are brought into triangular form at once."""


@dataclass(frozen=True, eq=False)
class Dependence:
    """Rows in the order given: those that say something new, and how the others are made of them."""

    kept: NDArray[np.int64]
    dropped: NDArray[np.int64]
    combination: NDArray[np.float64]
    """(dropped, kept): a dropped row is this sum of kept ones."""

    def misfit(self, d: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far the right-hand side of each dropped row is from the same sum of kept ones, (dropped,)."""
        return d[self.dropped] - self.combination @ d[self.kept]

    def slack(self, d: NDArray[np.float64]) -> NDArray[np.float64]:
        """The size of the terms of that sum, (dropped,): rounding errors are in proportion."""
        return 1.0 + np.abs(d[self.dropped]) + np.abs(self.combination) @ (1.0 + np.abs(d[self.kept]))


def dependence(rows: Any) -> Dependence:
    """rows: csr_array (r, coordinates), each of length 1 before the coordinates that cannot move were left out."""
    count, cluster = connected_components(abs(rows) @ abs(rows).T)
    parts = []
    for number in range(count):
        members = np.flatnonzero(cluster == number)
        kept, dropped, combination = _among(rows[members])
        parts.append((members[kept], members[dropped], combination))
    kept, dropped = (np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *(p[k] for p in parts)])) for k in (0, 1))
    combination = np.zeros((len(dropped), len(kept)))
    for own_kept, own_dropped, own in parts:
        combination[np.ix_(np.searchsorted(dropped, own_dropped), np.searchsorted(kept, own_kept))] = own
    return Dependence(kept, dropped, combination)


def _among(rows: Any) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Kept and dropped rows of a cluster, which share coordinates directly or through others, and the combination."""
    triangle = _triangle(rows)
    everything = np.arange(rows.shape[0])
    # The diagonal is the distance of each row to the span of those before it, as long as none of them vanishes.
    if len(triangle) == len(everything) and (np.abs(np.diag(triangle)) > DEPENDENT).all():
        return everything, everything[:0], np.zeros((0, len(everything)))
    basis = np.zeros((len(triangle), len(triangle)), order="F")
    kept: list[int] = []
    for number, row in enumerate(triangle.T):
        known = basis[:, : len(kept)]
        # Twice is enough: the second pass removes what rounding left of the first.
        rest = row - known @ (known.T @ row)
        rest = rest - known @ (known.T @ rest)
        distance = float(np.linalg.norm(rest))
        if distance > DEPENDENT:
            basis[:, len(kept)] = rest / distance
            kept.append(number)
    which = np.array(kept, dtype=np.int64)
    dropped: NDArray[np.int64] = np.setdiff1d(everything, which)
    if not len(which):
        return which, dropped, np.zeros((len(dropped), 0))
    combination: NDArray[np.float64] = np.linalg.lstsq(triangle[:, which], triangle[:, dropped], rcond=None)[0].T
    return which, dropped, combination


def _triangle(rows: Any) -> NDArray[np.float64]:
    """R of rows^T = Q R, (at most r, r): column k is row k in an orthonormal basis; made block by block."""
    count = rows.shape[0]
    compact = _merged(rows)
    triangle = np.zeros((0, count))
    for first in range(0, compact.shape[0], BLOCK):
        block = compact[first : first + BLOCK].toarray()
        triangle = np.linalg.qr(np.concatenate([triangle, block]), mode="r")
    return triangle


def _merged(rows: Any) -> Any:
    """rows^T with coordinates that all rows have in the same proportions made one: a centroid has many of them.

    -> csr_array (fewer coordinates, r) with the same products of rows.
    """
    columns = rows.tocsc()
    columns.eliminate_zeros()
    columns.sort_indices()
    size = np.diff(columns.indptr)
    made = [csr_array((0, rows.shape[0]))]
    for count in np.unique(size[size > 0]):
        at = columns.indptr[:-1][size == count, None] + np.arange(count)
        values = columns.data[at]
        table = np.concatenate([columns.indices[at], values / values[:, :1]], axis=1)
        kinds, kind = np.unique(table, axis=0, return_inverse=True)
        length = np.sqrt(np.bincount(kind.ravel(), values[:, 0] ** 2))
        ends = count * np.arange(len(kinds) + 1)
        parts = (length[:, None] * kinds[:, count:]).ravel(), kinds[:, :count].ravel().astype(np.int64), ends
        made.append(csr_array(parts, shape=(len(kinds), rows.shape[0])))
    return csr_array(vstack(made))
