"""Geomview OFF in text, with N, C and ST before it: normals, colours and UVs after the coordinates."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from oneform_warp.filters.formats.motion import Floats, Motion, Polygons
from oneform_warp.filters.formats.records import Records
from oneform_warp.filters.formats.text import Splice, Words

__all__ = ["OffRecords"]

GAP = rb"(?:\s|#[^\n]*)*"
HEADER = re.compile(
    GAP + rb"((?:ST|C|N)*(?:OFF)?)(?![A-Za-z])" + GAP + rb"(\d+)\s+(\d+)(?:[ \t]+\d+)?[ \t\r]*(?:#[^\n]*)?\n"
)
SHORTEST = len(b"0 0 0\n")
REMARK = re.compile(rb"^[^#\n]*[^#\s][^#\n]*#", re.M)
GLUED = re.compile(GAP + rb"[A-Z]*OFF[ \t]*\d")


@dataclass(frozen=True, eq=False)
class OffRecords(Records):
    """The vertices as lines of at least three numbers, the faces with line breaks anywhere."""

    kind: bytes
    begin: int

    @classmethod
    def read(cls, data: bytes) -> "OffRecords":
        """Read the counts of the header; ValueError for binary files and other dimensions."""
        match = HEADER.match(data)
        if match is None:
            raise ValueError("not an OFF header")
        return cls(data, int(match[2]), int(match[3]), match[1], match.end())

    @cached_property
    def words(self) -> Words:
        """All words after the header."""
        return Words(self.data, self.begin, comment=b"#")

    @cached_property
    def table(self) -> NDArray[np.int64]:
        """The number of the first word of each vertex, (V,): a line each, or without lines three words each."""
        if self.by_lines:
            return self.words.first[: self.vertices]
        if self.kind not in (b"OFF", b"") or len(self.words) < 3 * self.vertices:
            raise ValueError("a vertex has less than three numbers")
        return 3 * np.arange(self.vertices)

    @cached_property
    def by_lines(self) -> bool:
        """Whether each vertex has a line, as almost always."""
        return len(self.words.first) >= self.vertices and bool((self.words.counts()[: self.vertices] >= 3).all())

    def positions(self) -> Floats:
        """The first three numbers of the vertices."""
        return self.words.floats(self._places(0))

    def _places(self, column: int) -> NDArray[np.int64]:
        """The words (V, 3) of the vertices from a column on."""
        return np.asarray(self.table[:, None] + np.arange(column, column + 3))

    @cached_property
    def text(self) -> bytes:
        """The lines of the faces, without comments and empty lines."""
        ends = np.flatnonzero(np.frombuffer(self.data, dtype=np.uint8)[self.begin :] == ord("\n"))
        records = len(ends) == self.vertices + self.faces or (len(ends) == self.vertices + self.faces - 1)
        if records and self.vertices and b"#" not in self.data and (np.diff(ends) >= SHORTEST).all():
            return self.data[self.begin + int(ends[self.vertices - 1]) + 1 :].strip()
        first = np.append(self.words.first, len(self.words))
        after = int(first[self.vertices]) if self.by_lines else 3 * self.vertices
        rest = self.data[int(self.words.starts[after]) :] if after < len(self.words) else b""
        return re.sub(rb"\s*\n\s*", b"\n", re.sub(rb"#[^\n]*", b"", rest).strip())

    @cached_property
    def unusual(self) -> bool:
        """Whether records share or break lines, or comments end them, as OFF allows.

        MeshLab then fails, crashes, or after such a comment takes wrong numbers and says nothing.
        """
        remarks = b"#" in self.data and REMARK.search(self.data) is not None
        return remarks or GLUED.match(self.data) is not None or self.text.count(b"\n") + 1 != self.faces

    def polygons(self) -> Polygons:
        """The face records, one in a line (then with colours) or with line breaks anywhere."""
        numbers = np.fromstring(self.text.decode("ascii"), dtype=np.float64, sep=" ")
        table = numbers.reshape(self.faces, -1) if len(numbers) % self.faces == 0 else np.zeros((1, 0))
        size = int(table[0, 0]) if table.size else 0
        if 0 < size < table.shape[1] and np.all(table[:, 0] == size):
            indices = table[:, 1 : size + 1].astype(np.int32).ravel()
            return indices, np.arange(0, len(indices) + 1, size, dtype=np.int32)
        rows = [row.split() for row in self.text.splitlines()]
        if len(rows) == self.faces and all(len(row) > int(row[0]) for row in rows):
            return _pack(map(int, row[1 : int(row[0]) + 1]) for row in rows)
        words = (int(word) for row in rows for word in row)
        return _pack([list(islice(words, next(words))) for _ in range(self.faces)])

    def contents(self) -> tuple[str, ...]:
        """By the header's letters and the lengths of the lines."""
        words = {b"N": "normals", b"C": "colours", b"ST": "UVs"}
        found = [word for letters, word in words.items() if letters in self.kind.removesuffix(b"OFF")]
        found += ["polygons"] if self.faces and len(self.polygons()[0]) != 3 * self.faces else []
        lines = self.words.counts()[self.vertices : self.vertices + self.faces]
        colours = not self.unusual and len(lines) == self.faces and len(self.polygons()[0]) < (lines - 1).sum()
        return (*found, *(["face colours"] if colours else []), *(["comments"] if b"#" in self.data else []))

    def moved(self, motion: Motion) -> bytes:
        """Replace the first three numbers of the vertices, and with N the next three."""
        splice = Splice()
        splice.respell(self.words, self._places(0)[motion.rows], motion.after[motion.rows])
        if b"N" in self.kind.removesuffix(b"OFF") and self.words.counts()[: self.vertices].min(initial=6) >= 6:
            stored = self.words.floats(self._places(3))
            turned = motion.turned_at_vertices(stored).round(6) + 0.0
            rows = np.flatnonzero((turned != stored.round(6)).any(axis=1))
            splice.respell(self.words, self._places(3)[rows], turned[rows])
        return splice.on(self.data)

    def flowed(self) -> bytes:
        """The same mesh with one record in a line and no comments; where lines were broken, colours are left out."""
        if self.by_lines and self.text.count(b"\n") + 1 == self.faces:
            head = b"%s\n%d %d 0\n" % (self.kind or b"OFF", self.vertices, self.faces)
            return head + re.sub(rb"\s*\n\s*", b"\n", re.sub(rb"#[^\n]*", b"", self.data[self.begin :]).strip()) + b"\n"
        indices, offsets = self.polygons()
        faces = np.split(indices, offsets[1:-1])
        rows = [*self.positions().tolist(), *([len(face), *face.tolist()] for face in faces)]
        return f"OFF\n{self.vertices} {self.faces} 0\n".encode() + b"\n".join(map(_line, rows)) + b"\n"


def _pack(faces: Iterable[Iterable[int]]) -> Polygons:
    """Faces of any size as one array of vertex indices and the offsets of the faces in it."""
    lists = [list(face) for face in faces]
    offsets = np.cumsum([0, *map(len, lists)], dtype=np.int32)
    return np.array([vertex for face in lists for vertex in face], dtype=np.int32), offsets


def _line(row: Iterable[float]) -> bytes:
    return " ".join(map(repr, row)).encode()
