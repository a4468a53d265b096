"""The vertex and face records of OBJ, OFF and PLY files, as they stand in the file.

Importers merge, split and drop: MeshLab leaves out vertices with NaN and triangulates the polygons of a
PLY file when it writes it; trimesh triangulates everything. Replacing the numbers in the file's own vertex
records keeps all the rest of it: polygons, materials, groups, UVs, colours, comments and the order.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["ObjRecords", "OffRecords", "Polygons", "Records", "corner_normals", "scan"]

Floats = NDArray[np.float64]
Polygons = tuple[NDArray[np.int32], NDArray[np.int32]]

OBJ_VERTEX = re.compile(rb"^([ \t]*v[ \t]+)(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.M)
OBJ_NORMAL = re.compile(rb"^([ \t]*vn[ \t]+)(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.M)
OBJ_FACE = re.compile(rb"^[ \t]*f[ \t]+((?:[^\r\n\\]|\\\r?\n)+)", re.M)
OBJ_GROUP = re.compile(rb"^[ \t]*([gof])[ \t]+((?:[^\r\n\\]|\\\r?\n)+)", re.M)
OFF_HEADER = re.compile(rb"(?:\s|#[^\n]*)*(?:ST)?C?N?(?:OFF)?(?:\s|#[^\n]*)*(\d+)\s+(\d+)(?:[ \t]+\d+)?[^\n]*\n")
OFF_VERTEX = re.compile(rb"((?:\s|#[^\n]*)*)([^\s#]+)[ \t]+([^\s#]+)[ \t]+([^\s#]+)[^\n]*")
PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip


def scan(path: Path) -> "Records | None":
    """The records of an OBJ, OFF or PLY file, or None for other formats and for dialects not known here."""
    kinds: dict[str, type[Records]] = {".obj": ObjRecords, ".off": OffRecords, ".ply": PlyRecords}
    kind = kinds.get(path.suffix.lower())
    try:
        return kind.read(path.read_bytes()) if kind else None
    except (ValueError, KeyError, IndexError, AttributeError, StopIteration):
        return None


def corner_normals(points: Floats, polygons: Polygons, ids: NDArray[np.int64], count: int) -> Floats:
    """Sum the area vectors of the faces at all corners with one id: (count, 3), unit length or zero."""
    indices, offsets = polygons
    following = np.arange(1, len(indices) + 1)
    following[offsets[1:] - 1] = offsets[:-1]
    edges = np.cross(points[indices], points[indices[following]])
    areas = np.repeat(np.add.reduceat(edges, offsets[:-1]), np.diff(offsets), axis=0)
    normals = np.stack([np.bincount(ids, areas[:, axis], count) for axis in range(3)], axis=1)
    lengths: Floats = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(lengths > 0, lengths, 1))


@dataclass(frozen=True)
class Records(ABC):
    """A file's bytes with its numbers of vertices and faces."""

    data: bytes
    vertices: int
    faces: int

    @classmethod
    @abstractmethod
    def read(cls, data: bytes) -> "Records":
        """Read the counts; raises an error of Python's own where the bytes are not understood."""

    @abstractmethod
    def positions(self) -> Floats:
        """The coordinates (V, 3) as the file has them, NaN included."""

    @abstractmethod
    def moved(self, positions: Floats, polygons: Polygons) -> bytes:
        """The file with other coordinates, (V, 3), and normals that fit them; all else as it was."""

    def polygons(self) -> Polygons | None:
        """The faces as vertex indices and offsets (F + 1,), or None where only the importer knows them."""
        return None

    def groups(self) -> Mapping[str, NDArray[np.int32]]:
        """The vertices (sorted) of each named group."""
        return {}


class ObjRecords(Records):
    """Wavefront OBJ: `v`, `vn`, `f`, `g` and `o` lines."""

    @classmethod
    def read(cls, data: bytes) -> "ObjRecords":
        """Count the `v` and `f` lines."""
        count = len(re.findall(rb"^[ \t]*v[ \t]", data, re.M))
        return cls(data, count, len(re.findall(rb"^[ \t]*f[ \t]", data, re.M)))

    @cached_property
    def corners(self) -> tuple[list[list[bytes]], NDArray[np.int64]]:
        """The corners of each face as written, and the number of `v` lines before each face."""
        faces = list(OBJ_FACE.finditer(self.data))
        before = np.searchsorted([m.start() for m in OBJ_VERTEX.finditer(self.data)], [m.start() for m in faces])
        return [match[1].replace(b"\\", b" ").split(b"#")[0].split() for match in faces], before

    def positions(self) -> Floats:
        """The numbers of the `v` lines."""
        return np.array([m.group(2, 3, 4) for m in OBJ_VERTEX.finditer(self.data)]).astype(np.float64)

    def polygons(self) -> Polygons:
        """The `f` lines; negative indices count back from the line."""
        faces, before = self.corners
        return _pack(
            [_index(corner.split(b"/")[0], n) for corner in face] for face, n in zip(faces, before, strict=True)
        )

    def groups(self) -> Mapping[str, NDArray[np.int32]]:
        """The vertices that the faces after each `g` or `o` line use."""
        if not re.search(rb"^[ \t]*[go][ \t]", self.data, re.M):
            return {}
        indices, offsets = self.polygons()
        current: dict[bytes, list[str]] = {b"g": [], b"o": []}
        members: dict[str, list[NDArray[np.int32]]] = {}
        face = 0
        for match in OBJ_GROUP.finditer(self.data):
            if match[1] == b"f":
                for name in current[b"g"] + current[b"o"]:
                    members.setdefault(name, []).append(indices[offsets[face] : offsets[face + 1]])
                face += 1
            else:
                text = match[2].decode("utf-8", "replace").strip()
                current[match[1]] = text.split() if match[1] == b"g" else [text]
        return {name: np.unique(np.concatenate(parts)) for name, parts in members.items()}

    def moved(self, positions: Floats, polygons: Polygons) -> bytes:
        """Replace the numbers of the `v` lines, and of the `vn` lines that faces use."""
        data = _substitute(OBJ_VERTEX, self.data, positions)
        count = len(OBJ_NORMAL.findall(data))
        texts = [corner.split(b"/") for face in self.corners[0] for corner in face] if count else []
        if (
            not texts
            or not all(len(text) == 3 and text[2].isdigit() for text in texts)
            or len(texts) != len(polygons[0])
        ):
            return data  # normals by negative indices, or not at all corners
        ids = np.array([int(text[2]) - 1 for text in texts])
        new = corner_normals(positions, polygons, ids, count)
        old = np.array([m.group(2, 3, 4) for m in OBJ_NORMAL.finditer(data)]).astype(np.float64)
        new = np.where(np.any(new, axis=1, keepdims=True), new.round(6), old)
        return _substitute(OBJ_NORMAL, data, new)


class OffRecords(Records):
    """Geomview OFF in text, one vertex in a line, also with normals, colours or UVs after the coordinates."""

    @classmethod
    def read(cls, data: bytes) -> "OffRecords":
        """Read the counts of the header."""
        match = OFF_HEADER.match(data)
        if match is None:
            raise ValueError("not an OFF header")
        return cls(data, int(match[1]), int(match[2]))

    @cached_property
    def lines(self) -> list["re.Match[bytes]"]:
        """The vertex records."""
        header = OFF_HEADER.match(self.data)
        return list(islice(OFF_VERTEX.finditer(self.data, header.end() if header else 0), self.vertices))

    def positions(self) -> Floats:
        """The first three numbers of the vertex lines."""
        return np.array([m.group(2, 3, 4) for m in self.lines]).astype(np.float64)

    @cached_property
    def text(self) -> bytes:
        """The lines of the faces, without comments and empty lines."""
        text = re.sub(rb"#[^\n]*", b"", self.data[self.lines[-1].end() :])
        return re.sub(rb"\s*\n\s*", b"\n", text.strip())

    @cached_property
    def unusual(self) -> bool:
        """Whether records share or break lines, as OFF allows; MeshLab then fails or even crashes."""
        glued = re.match(rb"(?:\s|#[^\n]*)*[A-Z]*OFF[ \t]*\d", self.data) is not None
        return glued or self.text.count(b"\n") + 1 != self.faces

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

    def moved(self, positions: Floats, polygons: Polygons) -> bytes:
        """Replace the first three numbers of the vertex lines."""
        parts, end = [], 0
        for match, row in zip(self.lines, positions.tolist(), strict=True):
            parts += [self.data[end : match.start(2)], b" ".join(repr(value).encode() for value in row)]
            end = match.end(4)
        return b"".join([*parts, self.data[end:]])

    def flowed(self) -> bytes:
        """The same mesh with one record in a line, for importers that need it; colours are left out."""
        indices, offsets = self.polygons()
        faces = np.split(indices, offsets[1:-1])
        rows = [*self.positions().tolist(), *([len(face), *face.tolist()] for face in faces)]
        return f"OFF\n{self.vertices} {self.faces} 0\n".encode() + b"\n".join(map(_join, rows)) + b"\n"


@dataclass(frozen=True)
class PlyRecords(Records):
    """Stanford PLY, text or binary, with the vertices as its first element."""

    start: int
    format: str
    dtype: "np.dtype[np.void]"

    @classmethod
    def read(cls, data: bytes) -> "PlyRecords":
        """Read the header; raises ValueError where vertices are not first or have lists."""
        start = data.index(b"\n", data.index(b"end_header")) + 1
        lines = [line.split() for line in data[:start].decode("latin-1").splitlines()]
        elements = [row for row in lines if row[:1] == ["element"]]
        counts = {row[1]: int(row[2]) for row in elements}
        if elements[0][1] != "vertex":
            raise ValueError("the first element is not the vertices")
        first = lines.index(elements[0]) + 1
        last = lines.index(elements[1]) if len(elements) > 1 else len(lines)
        fields = [row for row in lines[first:last] if row[:1] == ["property"]]
        encoding = next(row[1] for row in lines if row[:1] == ["format"])
        order = ">" if "big" in encoding else "<"
        dtype = np.dtype([(row[-1], order + PLY_TYPES[row[1]]) for row in fields])
        return cls(data, counts["vertex"], counts.get("face", 0), start, encoding, dtype)

    @cached_property
    def table(self) -> tuple[NDArray[np.void], int]:
        """The vertex records as a structured array (V,), and where they end in the file."""
        if self.format != "ascii":
            table = np.frombuffer(self.data, self.dtype, self.vertices, self.start)
            return table, self.start + table.nbytes
        lines = list(islice(re.compile(rb"[^\n]*\n?").finditer(self.data, self.start), self.vertices))
        rows = [tuple(match[0].split()) for match in lines]
        return np.array(rows, [(name, "S40") for name in self.dtype.names or ()]), lines[-1].end()

    def positions(self) -> Floats:
        """The properties x, y and z."""
        return np.stack([self.table[0][name].astype(np.float64) for name in "xyz"], axis=1)

    def moved(self, positions: Floats, polygons: Polygons) -> bytes:
        """Replace x, y, z and nx, ny, nz, in the file's own number types."""
        values = dict(zip("xyz", positions.T, strict=True))
        if "nx" in (self.dtype.names or ()) and len(polygons[0]):
            normals = corner_normals(positions, polygons, polygons[0].astype(np.int64), self.vertices)
            values |= zip(("nx", "ny", "nz"), normals.T, strict=True)
        table, end = self.table[0].copy(), self.table[1]
        for name, column in values.items():
            typed = column.astype(self.dtype[name])
            table[name] = [str(value).encode() for value in typed] if self.format == "ascii" else typed
        rows = b"\n".join(map(b" ".join, table.tolist())) + b"\n" if self.format == "ascii" else table.tobytes()
        return self.data[: self.start] + rows + self.data[end:]


def _index(text: bytes, vertices: int) -> int:
    """An OBJ index from 0; negative ones count back from the last vertex so far."""
    index = int(text)
    return index - 1 if index > 0 else int(vertices) + index


def _pack(faces: Iterable[Iterable[int]]) -> Polygons:
    """Faces of any size as one array of vertex indices and the offsets of the faces in it."""
    lists = [list(face) for face in faces]
    offsets = np.cumsum([0, *map(len, lists)], dtype=np.int32)
    return np.array([vertex for face in lists for vertex in face], dtype=np.int32), offsets


def _join(row: Iterable[float]) -> bytes:
    return " ".join(map(repr, row)).encode()


def _substitute(pattern: "re.Pattern[bytes]", data: bytes, rows: Floats) -> bytes:
    """Replace the three numbers of each record that the pattern finds, in order."""
    values: Iterator[list[float]] = iter(rows.tolist())
    return pattern.sub(lambda match: match[1] + _join(next(values)), data)
