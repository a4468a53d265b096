"""STL, text or binary: a soup of triangles, each with its normal."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from oneform_warp.filters.formats.motion import Floats, Motion, Polygons
from oneform_warp.filters.formats.records import Records
from oneform_warp.filters.formats.text import Splice, Words

__all__ = ["StlRecords"]

TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEAD = 84  # bytes: a title, and the number of triangles


@dataclass(frozen=True, eq=False)
class StlRecords(Records):
    """Three vertex records for each triangle, in its order."""

    binary: bool

    @classmethod
    def read(cls, data: bytes) -> "StlRecords":
        """Tell the two kinds apart by the size, since binary files may begin with `solid` too."""
        count = int.from_bytes(data[HEAD - 4 : HEAD], "little")
        if len(data) >= HEAD and len(data) == HEAD + count * TRIANGLE.itemsize:
            return cls(data, 3 * count, count, True)
        if not data.lstrip()[:5].lower() == b"solid":
            raise ValueError("neither text nor as long as its number of triangles says")
        count = data.count(b"endfacet") or data.lower().count(b"endfacet")
        return cls(data, 3 * count, count, False)

    @cached_property
    def words(self) -> Words:
        """All words of a text."""
        return Words(self.data)

    def _numbers(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The words of the normals (F, 3) and of the corners (3 F, 3)."""
        words = self.words
        facets, corners = (
            words.first[words.firsts(kind) | words.firsts(kind.upper())] for kind in (b"facet", b"vertex")
        )
        if len(facets) != self.faces or len(corners) != self.vertices:
            raise ValueError("facets without three vertices")
        return facets[:, None] + np.arange(2, 5), corners[:, None] + np.arange(1, 4)

    @cached_property
    def table(self) -> NDArray[np.void]:
        """The triangles of a binary file."""
        return np.frombuffer(self.data, TRIANGLE, self.faces, HEAD)

    def positions(self) -> Floats:
        """The corners of all triangles, (3 F, 3)."""
        if self.binary:
            return self.table["corners"].reshape(-1, 3).astype(np.float64)
        return self.words.floats(self._numbers()[1]).astype(np.float32).astype(np.float64)

    def polygons(self) -> Polygons:
        """Three records after the other."""
        return np.arange(self.vertices, dtype=np.int32), np.arange(0, self.vertices + 1, 3, dtype=np.int32)

    def contents(self) -> tuple[str, ...]:
        """Bytes that some programs use for colours."""
        return (
            ("facet normals", "attribute bytes")
            if self.binary and self.table["attribute"].any()
            else ("facet normals",)
        )

    def moved(self, motion: Motion) -> bytes:
        """Replace the corners that moved, and the normals of triangles that turned."""
        after = motion.after.astype(np.float32)
        if not np.isfinite(after).all():
            raise ValueError("a coordinate is too large for STL's 32-bit numbers")
        return self._packed(motion, after) if self.binary else self._spelled(motion, after)

    def _packed(self, motion: Motion, after: NDArray[np.float32]) -> bytes:
        table, stored = self.table.copy(), self.table["normal"].astype(np.float64)
        table["corners"] = np.where((motion.before == motion.after), self.positions(), after).reshape(-1, 3, 3)
        turned = motion.turned_facets(stored)
        rows = (turned != stored).any(axis=1)
        table["normal"][rows] = turned[rows]
        return self.data[:HEAD] + table.tobytes()

    def _spelled(self, motion: Motion, after: NDArray[np.float32]) -> bytes:
        words, splice = self.words, Splice()
        facets, corners = self._numbers()
        stored = words.floats(facets)
        turned = motion.turned_facets(stored)
        rows = np.flatnonzero((turned != stored).any(axis=1))
        values = turned[rows].round(6) + 0.0
        splice.respell(words, facets[rows], values)
        splice.respell(words, corners[motion.rows], after[motion.rows])
        return splice.on(self.data)
