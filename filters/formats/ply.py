"""Stanford PLY, text or binary: elements in any order, with numbers and lists of any names."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.filters.formats.motion import Floats, Motion, Polygons
from oneform_warp.filters.formats.ply_layout import Binary, Body, Columns, Element, Property, Text, walk
from oneform_warp.filters.formats.records import Records

__all__ = ["PlyRecords"]

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
TEXTURE = re.compile(r"^comment[ \t]+TextureFile[ \t]+([^\r\n]+)", re.M)
FACE_LISTS = ("vertex_indices", "vertex_index")
# What a vertex or a face has in most formats; anything else is somebody's own.
COMMON = {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha", *FACE_LISTS}


@dataclass(frozen=True, eq=False)
class PlyRecords(Records):
    """The header's elements, and where the body begins."""

    start: int
    format: str
    elements: Mapping[str, Element]

    @classmethod
    def read(cls, data: bytes) -> "PlyRecords":
        """Read the header; ValueError where it is none, or where coordinates are not floating-point numbers."""
        end = re.compile(rb"^end_header[ \t\r]*\n", re.M).search(data)
        if end is None or not data.startswith(b"ply"):
            raise ValueError("not a PLY header")
        elements: dict[str, Element] = {}
        encoding = ""
        for words in (line.split() for line in data[: end.start()].decode("latin-1").splitlines()):
            if words[:1] == ["format"]:
                encoding = words[1]
            elif words[:1] == ["element"]:
                elements[words[1]] = Element(int(words[2]), {})
            elif words[:1] == ["property"]:
                types = [TYPES[word] for word in words[1:-1] if word != "list"]
                last = next(reversed(elements.values()))
                last.properties[words[-1]] = Property(types[-1], types[0] if words[1] == "list" else None)
        vertex = elements["vertex"]
        if any(vertex.properties[axis].type[0] != "f" or vertex.properties[axis].count for axis in "xyz"):
            raise ValueError("coordinates are not floating-point numbers")
        faces = elements["face"].count if "face" in elements else 0
        return cls(data, vertex.count, faces, end.end(), encoding, elements)

    @cached_property
    def body(self) -> Body:
        """What follows the header."""
        if self.format == "ascii":
            return Text(self.data, self.start)
        return Binary(self.data, self.start, ">" if "big" in self.format else "<")

    @cached_property
    def _vertex(self) -> Columns:
        return self._columns("vertex")

    def _columns(self, wanted: str) -> Columns:
        """The columns of an element; what follows it is not looked at."""
        begin = self.body.begin
        for name, element in self.elements.items():
            columns, begin = walk(self.body, element, begin)
            if name == wanted:
                return columns
        raise KeyError(wanted)

    def scalars(self) -> Mapping[str, Floats]:
        """All properties of the vertices that are single numbers, (V,) each, by name."""
        properties = self.elements["vertex"].properties
        return {name: self._column(name) for name, each in properties.items() if each.count is None}

    def _column(self, name: str) -> Floats:
        return self._table([name])[:, 0]

    def _table(self, names: Sequence[str]) -> Floats:
        """Properties of the vertices as columns, (V, len(names))."""
        kind = self.elements["vertex"].properties[names[0]].type
        first = self._vertex[names[0]].places
        if self._stand_together(names):
            return self.body.read(first, kind, len(names)).astype(kind).astype(np.float64)
        return np.concatenate([self._table([name]) for name in names], axis=1)

    def _stand_together(self, names: Sequence[str]) -> bool:
        """Whether properties follow each other in every record, in this order and with one type."""
        properties = self.elements["vertex"].properties
        listed = list(properties)
        at = listed.index(names[0])
        types = {(properties[name].type, properties[name].count) for name in names}
        return listed[at : at + len(names)] == list(names) and types == {(properties[names[0]].type, None)}

    def positions(self) -> Floats:
        """The properties x, y and z."""
        return self._table("xyz")

    def plain(self) -> tuple[Floats, NDArray[np.int32]] | None:
        """Positions (V, 3) and triangles (F, 3) where MeshLab would read the very same; None where it may not.

        It reads digits in its own way, cuts larger faces, leaves out degenerate ones, and takes flags at their word.
        """
        face, vertex = self.elements.get("face"), self.elements["vertex"]
        name = next((name for name in FACE_LISTS if face and name in face.properties), None)
        if self.format == "ascii" or face is None or name is None or "flags" in {*vertex.properties, *face.properties}:
            return None
        try:
            polygons = self.polygons() if face.properties[name].type in ("i4", "u4") else None
        except (ValueError, IndexError):
            return None
        if polygons is None or not self.faces or len(polygons[0]) != 3 * self.faces:
            return None
        triangles = polygons[0].reshape(-1, 3)
        a, b, c = triangles.T
        whole = (np.diff(polygons[1]) == 3).all() and not ((a == b) | (b == c) | (c == a)).any()
        return (self.positions(), triangles) if whole else None

    def polygons(self) -> Polygons | None:
        """The lists of vertex indices; None where there are none, as with triangle strips."""
        face = self.elements.get("face")
        name = next((name for name in FACE_LISTS if face and name in face.properties), None)
        if face is None or name is None:
            return None
        column, kind = self._columns("face")[name], face.properties[name].type
        if isinstance(column.counts, int) and column.counts:
            indices = self.body.read(column.places, kind, column.counts).astype(np.int32).ravel()
            return indices, np.arange(self.faces + 1, dtype=np.int32) * column.counts
        counts = np.broadcast_to(column.counts, column.places.shape)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        within = np.arange(offsets[-1]) - np.repeat(offsets[:-1], counts)
        places = np.repeat(column.places, counts) + within * self.body.size(kind)
        return self.body.read(places, kind)[:, 0].astype(np.int32), offsets.astype(np.int32)

    def companions(self) -> tuple[str, ...]:
        """The textures that MeshLab names in comments."""
        header = os.fsdecode(self.data[: self.start])
        return tuple(match[1].strip() for match in TEXTURE.finditer(header))

    def contents(self) -> tuple[str, ...]:
        """By the names of elements and properties."""
        vertex = self.elements["vertex"].properties
        face = self.elements["face"].properties if "face" in self.elements else {}
        found = [word for name, word in (("nx", "normals"), ("red", "colours")) if name in vertex]
        found += ["UVs"] if "texcoord" in face or {"s", "t"} <= vertex.keys() or {"u", "v"} <= vertex.keys() else []
        found += ["face colours"] if "red" in face else []
        found += [f"property {name}" for name in vertex if name not in COMMON | {"s", "t", "u", "v"}]
        found += [f"face property {name}" for name in face if name not in COMMON | {"texcoord", "texnumber"}]
        found += [f"element {name}" for name in self.elements if name not in ("vertex", "face")]
        polygons = self.polygons() if self.faces else None
        found += ["polygons"] if polygons is not None and len(polygons[0]) != 3 * self.faces else []
        found += ["textures"] if self.companions() else []
        return (*found, *(["comments"] if b"\ncomment" in self.data[: self.start] else []))

    def moved(self, motion: Motion) -> bytes:
        """Replace x, y, z, and nx, ny, nz where these turn, in the file's own number types."""
        edits = self._edits(("x", "y", "z"), motion.rows, motion.after)
        names, properties = ("nx", "ny", "nz"), self.elements["vertex"].properties
        if all(name in properties and properties[name].type[0] == "f" for name in names):
            stored = self._table(names)
            turned = motion.turned_at_vertices(stored)
            rows = np.flatnonzero((turned != stored).any(axis=1))
            if self.format == "ascii":
                turned = turned.round(6) + 0.0
            edits += self._edits(names, rows, turned)
        return self.body.changed(edits)

    def _edits(
        self, names: Sequence[str], rows: NDArray[np.int64], values: Floats
    ) -> list[tuple[NDArray[np.int64], Any]]:
        """Rows of three columns (V, 3), in the file's types, and where they go."""
        types = [self.elements["vertex"].properties[name].type for name in names]
        together = [slice(0, 3)] if self._stand_together(names) else [slice(k, k + 1) for k in range(3)]
        edits = []
        for columns in together:
            first = columns.start
            with np.errstate(over="ignore"):
                typed = np.take(values[:, columns].astype(types[first]), rows, axis=0)
            if not np.isfinite(typed).all():
                raise ValueError(f"a number is too large for {names[first]}, which has {8 * typed.itemsize} bits")
            edits.append((self._vertex[names[first]].places[rows], typed))
        return edits
