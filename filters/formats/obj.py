"""Wavefront OBJ: `v`, `vn`, `f`, `g`, `o` and `mtllib` lines."""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from oneform_warp.filters.formats.motion import Floats, Motion, Polygons
from oneform_warp.filters.formats.records import Records
from oneform_warp.filters.formats.text import Splice, Words, spelled

__all__ = ["ObjRecords"]

Indices = NDArray[np.int64]

NAMED = re.compile(rb"^[ \t]*([go])[ \t]+((?:[^\r\n\\]|\\\r?\n)+)", re.M)
LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", re.M)
INDENT = np.zeros(256, dtype=bool)
INDENT[[9, 32]] = True
DECIMALS = 6  # of normals, as exporters write them


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of all faces: vertex and normal of each (c,), from 0, normal -1 where there is none.

    `starts` and `ends` are where the file has the index of the normal.
    """

    vertices: Indices
    normals: Indices
    starts: Indices
    ends: Indices


@dataclass(frozen=True, eq=False)
class ObjRecords(Records):
    """The lines of an OBJ file, and whether some of them name groups or objects."""

    grouped: bool

    @classmethod
    def read(cls, data: bytes) -> "ObjRecords":
        """Count the `v` and `f` lines."""
        buffer = np.frombuffer(data, dtype=np.uint8)
        begins = np.concatenate([[0], np.flatnonzero(buffer == ord("\n")) + 1])
        begins = begins[begins < len(data) - 1]
        while (indented := INDENT[buffer[begins]]).any():
            begins = begins + indented
            begins = begins[begins < len(data) - 1]
        letters = buffer[begins][INDENT[buffer[begins + 1]]]
        counts = {letter: int(np.count_nonzero(letters == ord(letter))) for letter in "vfgo"}
        return cls(data, counts["v"], counts["f"], counts["g"] + counts["o"] > 0)

    @cached_property
    def words(self) -> Words:
        """All words but those of comments."""
        return Words(self.data, comment=b"#", joined=True)

    def numbers(self, kind: bytes) -> Indices:
        """The first three words (n, 3) after the word that lines of a kind begin with."""
        words, wanted = self.words, self.words.firsts(kind)
        if (words.counts()[wanted] < 4).any():
            raise ValueError(f"a line '{kind.decode()}' has less than three numbers")
        return words.first[wanted][:, None] + np.arange(1, 4)

    def positions(self) -> Floats:
        """The numbers of the `v` lines."""
        return self.words.floats(self.numbers(b"v"))

    @cached_property
    def corners(self) -> Corners:
        """What the `f` lines say; negative indices count back from their line."""
        words, wanted = self.words, self.words.firsts(b"f")
        sizes = words.counts()[wanted] - 1
        lines = np.repeat(words.first[wanted] + 1, sizes)
        each = lines + np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        starts, ends = words.starts[each], words.ends[each]
        slashes = np.append(np.flatnonzero(np.frombuffer(self.data, dtype=np.uint8) == ord("/")), [len(self.data)] * 2)
        first = np.searchsorted(slashes, starts)
        one = np.minimum(slashes[first], ends)
        two = np.minimum(slashes[np.minimum(first + 1, len(slashes) - 1)], ends)
        vertices = self._indices(starts, one, each, b"v")
        return Corners(vertices, self._indices(np.minimum(two + 1, ends), ends, each, b"vn"), two + 1, ends)

    def _indices(self, starts: Indices, ends: Indices, words: Indices, kind: bytes) -> Indices:
        """Indices from 0, of the records of a kind, that stand in these places; -1 where there is nothing."""
        texts = self.words.texts(starts, ends)
        indices = np.where(texts == b"", b"0", texts).astype(np.int64)
        back = np.flatnonzero(indices < 0)
        so_far = np.searchsorted(self.words.first[self.words.firsts(kind)], words[back])
        indices[back] += so_far + 1
        return indices - 1

    def polygons(self) -> Polygons:
        """The `f` lines."""
        sizes = self.words.counts()[self.words.firsts(b"f")] - 1
        offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
        return self.corners.vertices.astype(np.int32), offsets

    def groups(self) -> Mapping[str, NDArray[np.int32]]:
        """The vertices that the faces after each `g` or `o` line use."""
        if not self.grouped:
            return {}
        indices, offsets = self.polygons()
        faces = self.words.starts[self.words.first[self.words.firsts(b"f")]]
        members: dict[str, list[NDArray[np.int32]]] = {}
        for kind in (b"g", b"o"):
            lines = [match for match in NAMED.finditer(self.data) if match[1] == kind]
            begins = np.searchsorted(faces, [line.start() for line in lines]).tolist()
            for line, begin, end in zip(lines, begins, [*begins, len(faces)][1:], strict=True):
                text = line[2].decode("utf-8", "replace").strip()
                for name in text.split() if kind == b"g" else [text]:
                    members.setdefault(name, []).append(indices[offsets[begin] : offsets[end]])
        parts = {name: np.unique(np.concatenate(lists)) for name, lists in members.items()}
        return {name: part for name, part in parts.items() if len(part)}

    def companions(self) -> tuple[str, ...]:
        """The material libraries."""
        if b"mtllib" not in self.data:
            return ()
        return tuple(os.fsdecode(match[1].strip()) for match in LIBRARY.finditer(self.data))

    def contents(self) -> tuple[str, ...]:
        """Named by the kinds of lines."""
        kinds = {b"vt": "UVs", b"vn": "corner normals", b"g": "groups", b"o": "objects", b"usemtl": "materials",
                 b"l": "lines", b"p": "points", b"s": "smoothing groups"}  # fmt: skip
        found = [word for kind, word in kinds.items() if self.words.firsts(kind).any()]
        found += ["names of materials"] if "materials" in found else []
        found += ["colours"] if (self.words.counts()[self.words.firsts(b"v")] >= 7).any() else []
        found += ["polygons"] if len(self.polygons()[0]) != 3 * self.faces else []
        return (*found, *(["comments"] if b"#" in self.data else []))

    def moved(self, motion: Motion) -> bytes:
        """Replace the numbers of the `v` lines, and of the `vn` lines that turn.

        Where vertices that share a normal turn differently, it becomes several lines, and the faces refer to these.
        """
        splice = Splice()
        places = self.numbers(b"v")
        if len(places) != len(motion.after):
            raise ValueError(f"{len(places)} lines 'v' for {len(motion.after)} vertices")
        splice.respell(self.words, places[motion.rows], motion.after[motion.rows])
        lines = self.numbers(b"vn")
        if len(lines) and motion.normals != "keep":
            self._turn(splice, lines, replace(motion, polygons=self.polygons()))
        return splice.on(self.data)

    def _turn(self, splice: Splice, lines: Indices, motion: Motion) -> None:
        stored, used = self.words.floats(lines), self.corners.normals
        if not (used >= 0).any():  # MeshLab's way for clouds: a line for each vertex
            if len(lines) == len(motion.after):
                turned = motion.turned_at_vertices(stored).round(DECIMALS)
                self._respell(splice, lines, np.where(turned == stored.round(DECIMALS), stored, turned), stored)
            return
        if used.max() >= len(lines):
            raise ValueError(f"a face uses normal {used.max() + 1} of {len(lines)}")
        vertices = len(motion.after)
        keys, pair = np.unique(used * vertices + self.corners.vertices, return_inverse=True)
        keys, pair = keys[keys >= 0], np.where(used < 0, -1, pair - np.count_nonzero(keys < 0))
        line, vertex = keys // vertices, keys % vertices
        turned = motion.turned(stored[line], vertex, np.where(pair < 0, len(keys), pair))
        same = (turned == stored[line]).all(axis=1, keepdims=True)
        values = np.where(same, stored[line], turned.round(DECIMALS) + 0.0)
        kinds, kind = np.unique(np.column_stack([line, values]), axis=0, return_inverse=True)
        owner = kinds[:, 0].astype(np.int64)
        first = np.flatnonzero(np.diff(owner, prepend=-1))
        changed = stored.copy()
        changed[owner[first]] = kinds[first, 1:]
        self._respell(splice, lines, changed, stored)
        extra = np.delete(np.arange(len(kinds)), first)
        if len(extra):
            self._insert(splice, lines[owner[extra], 2], kinds[extra, 1:])
            # Normal 0 .. of the new file: an own line for each kind, those before it counted.
            before = np.searchsorted(owner[extra], np.arange(len(lines)))
            number = (
                before[owner] + owner + np.arange(len(kinds)) - first[np.cumsum(np.diff(owner, prepend=-1) > 0) - 1]
            )
            self._renumber(splice, np.where(pair < 0, -1, number[kind[pair]]))

    def _respell(self, splice: Splice, lines: Indices, values: Floats, stored: Floats) -> None:
        rows = np.flatnonzero((values != stored).any(axis=1))
        splice.respell(self.words, lines[rows], values[rows])

    def _insert(self, splice: Splice, last: Indices, values: Floats) -> None:
        """Add `vn` lines after those whose last number is the word `last` (n,)."""
        newline = b"\r\n" if b"\r\n" in self.data[:4096] else b"\n"
        texts = [newline + b"vn " + b" ".join(spelled(row)) for row in values]
        splice.replace(self.words.ends[last], self.words.ends[last], texts)

    def _renumber(self, splice: Splice, numbers: Indices) -> None:
        """Write the index of each corner's normal, from 0 here, where it is another one now."""
        corners = self.corners
        texts = self.words.texts(np.minimum(corners.starts, corners.ends), corners.ends)
        written = np.where(texts == b"", b"0", texts).astype(np.int64)
        rows = np.flatnonzero((numbers >= 0) & (written != numbers + 1))
        splice.replace(
            corners.starts[rows], corners.ends[rows], [b"%d" % each for each in (numbers[rows] + 1).tolist()]
        )
