"""glTF and GLB: the positions of all nodes in world space, written back into the accessors that hold them."""

from collections import Counter
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import FileError
from oneform_warp.filters.formats.gltf_container import Container, read_container
from oneform_warp.filters.formats.gltf_scene import Part, check_scene, parts
from oneform_warp.filters.formats.motion import Floats, Motion, Polygons
from oneform_warp.filters.formats.records import Records, packed_triangles

__all__ = ["GltfRecords"]

TYPES = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
STRIP, FAN, TRIANGLES = 5, 6, 4


@dataclass(frozen=True, eq=False)
class GltfRecords(Records):
    """The parts of a scene: each primitive of each node, in the order in which MeshLab loads them too."""

    container: Container
    parts: tuple[Part, ...] = field(repr=False)

    @classmethod
    def load(cls, path: Path) -> "GltfRecords":
        """Read a scene with its buffers; FileError for one that cannot be deformed, or is none."""
        try:
            container = read_container(path)
            check_scene(container.scene)
            found = tuple(parts(container.scene))
            counts = [container.scene["accessors"][part.positions]["count"] for part in found]
            records = cls(container.data, sum(counts), 0, container, found)
            return cls(container.data, sum(counts), len(records.triangles), container, found)
        except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError) as error:
            if isinstance(error, FileError):
                raise
            text = " ".join(str(error).split())
            what = text if type(error) is ValueError else f"this is not glTF ({type(error).__name__}: {text})"
            fix = "export plain meshes, each by itself" if type(error) is ValueError else "check the file"
            raise FileError(what, where=str(path), fix=fix) from None

    def _view(self, accessor: int, buffers: Mapping[int, Any]) -> NDArray[Any]:
        """An accessor's numbers (count, width) in the memory of its buffer."""
        scene = self.container.scene
        entry = scene["accessors"][accessor]
        if "sparse" in entry or "bufferView" not in entry:
            raise ValueError(f"accessor {accessor} is sparse")
        view = scene["bufferViews"][entry["bufferView"]]
        dtype, width = np.dtype("<" + TYPES[entry["componentType"]]), WIDTHS[entry["type"]]
        offset = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        step = view.get("byteStride", width * dtype.itemsize)
        if min(offset, step, entry["count"]) < 0:
            raise ValueError(f"accessor {accessor} lies outside its buffer")
        try:
            return np.ndarray((entry["count"], width), dtype, buffers[view["buffer"]], offset, (step, dtype.itemsize))
        except (TypeError, ValueError):
            raise ValueError(f"accessor {accessor} lies outside its buffer") from None

    def read(self, accessor: int) -> NDArray[Any]:
        """An accessor's numbers (count, width)."""
        return self._view(accessor, self.container.buffers)

    @cached_property
    def spans(self) -> list[slice]:
        """The vertices of each part."""
        ends = np.cumsum([0, *(len(self.read(part.positions)) for part in self.parts)]).tolist()
        return [slice(a, b) for a, b in pairwise(ends)]

    @cached_property
    def triangles(self) -> NDArray[np.int32]:
        """The faces (F, 3) of all parts; points and lines have none."""
        found = [np.zeros((0, 3), dtype=np.int64)]
        for part, span in zip(self.parts, self.spans, strict=True):
            count = span.stop - span.start
            indices = np.arange(count) if part.indices is None else self.read(part.indices)[:, 0].astype(np.int64)
            if indices.size and indices.max() >= count:
                raise ValueError(f"a face uses vertex {indices.max()} (from 0) of {count}")
            found.append(_triangles(indices, part.mode) + span.start)
        return np.concatenate(found).astype(np.int32)

    def positions(self) -> Floats:
        """The accessors of all parts in world space."""
        if not self.parts:
            return np.zeros((0, 3))
        return np.concatenate([part.outside(self.read(part.positions).astype(np.float64)) for part in self.parts])

    def polygons(self) -> Polygons:
        """All triangles."""
        return packed_triangles(self.triangles)

    def normals(self) -> Floats | None:
        """The stored normals (V, 3) in world space; None where a part has none."""
        if not self.parts or any(part.normals is None for part in self.parts):
            return None
        return np.concatenate([part.normals_outside(self.read(part.normals or 0)) for part in self.parts])

    def colors(self) -> Floats | None:
        """The vertices' colours (V, 4) in 0..1; None where a part has none."""
        if not self.parts or any(part.colors is None for part in self.parts):
            return None
        found = []
        for part in self.parts:
            values = self.read(part.colors or 0)
            scale = 1.0 if values.dtype.kind == "f" else np.iinfo(values.dtype).max
            found.append(np.ones((len(values), 4)))
            found[-1][:, : values.shape[1]] = values / scale
        return np.concatenate(found)

    def groups(self) -> Mapping[str, NDArray[np.int32]]:
        """The vertices of each named node."""
        members: dict[str, list[NDArray[np.int32]]] = {}
        for part, span in zip(self.parts, self.spans, strict=True):
            if part.name:
                members.setdefault(part.name, []).append(np.arange(span.start, span.stop, dtype=np.int32))
        return {name: np.concatenate(each) for name, each in members.items()}

    def companions(self) -> tuple[str, ...]:
        """The files of buffers and images."""
        return self.container.references()

    def contents(self) -> tuple[str, ...]:
        """By what the parts and the scene have."""
        scene = self.container.scene
        attributes = {name for mesh in scene.get("meshes", ()) for p in mesh["primitives"] for name in p["attributes"]}
        words = {"NORMAL": "normals", "TANGENT": "tangents", "TEXCOORD_0": "UVs", "COLOR_0": "colours"}
        found = [word for name, word in words.items() if name in attributes]
        found += [f"property {name}" for name in sorted(attributes) if name.startswith("_")]
        found += [name for name in ("materials", "textures", "animations", "cameras") if scene.get(name)]
        return (*found, "nodes")

    def moved(self, motion: Motion) -> bytes:
        """The first of `files`."""
        return next(iter(self.files(motion, "mesh").values()))

    def files(self, motion: Motion, name: str, taken: Set[str] = frozenset()) -> Mapping[str, bytes]:
        """The scene with other positions, normals and tangents in its accessors, and the buffers beside it."""
        buffers = {number: bytearray(data) for number, data in self.container.buffers.items()}
        bounds: dict[int, dict[str, list[float]]] = {}
        self.check_shared(motion)
        for part, span in zip(self.parts, self.spans, strict=True):
            rows = motion.rows[(motion.rows >= span.start) & (motion.rows < span.stop)]
            if len(rows):
                bounds[part.positions] = self._move(buffers, part, rows - span.start, motion.after[rows])
        self._turn(buffers, motion)
        changed = {n: bytes(data) for n, data in buffers.items() if data != self.container.buffers[n]}
        return self.container.files(name, changed, bounds, taken) if changed else {name: self.data}

    def check_shared(self, motion: Motion) -> None:
        """Vertices that several primitives of a node use are there once, and cannot be in two places."""
        uses, first = Counter(part.positions for part in self.parts), dict[int, slice]()
        for part, span in zip(self.parts, self.spans, strict=True):
            other = first.setdefault(part.positions, span)
            if uses[part.positions] > 1 and not np.array_equal(motion.after[other], motion.after[span]):
                raise ValueError(f"vertices that primitives of {part.name!r} share would come apart")

    def _move(
        self, buffers: Mapping[int, bytearray], part: Part, rows: NDArray[np.int64], points: Floats
    ) -> dict[str, list[float]]:
        """Write points (n, 3) in world space into rows of a part -> its new bounds."""
        view = self._view(part.positions, buffers)
        with np.errstate(over="ignore"):
            view[rows] = part.inside(points)
        if not np.isfinite(view).all():
            raise ValueError("a coordinate is too large for glTF's 32-bit numbers")
        return {"min": view.min(axis=0).astype(float).tolist(), "max": view.max(axis=0).astype(float).tolist()}

    def _turn(self, buffers: Mapping[int, bytearray], motion: Motion) -> None:
        """Turn normals, and along with them tangents, in all parts."""
        for part in range(len(self.parts)):
            for _, accessor, rows, values in self.turned(part, motion):
                self._view(accessor, buffers)[rows, :3] = values

    def turned(self, part: int, motion: Motion) -> Iterator[tuple[str, int, NDArray[np.int64], Floats]]:
        """Normals and tangents of a part that turn: attribute, accessor, rows (n,), values (n, 3) on the node."""
        each, span = self.parts[part], self.spans[part]
        if motion.normals == "keep" or (each.normals is None and each.tangents is None):
            return
        vertices, corners = np.arange(span.start, span.stop), motion.polygons[0].astype(np.int64)
        own = np.where((corners >= span.start) & (corners < span.stop), corners - span.start, len(vertices))
        if each.normals is not None:
            stored = each.normals_outside(self.read(each.normals))
            after = motion.turned(stored, vertices, own)
            rows = np.flatnonzero((after != stored).any(axis=1))
            yield "NORMAL", each.normals, rows, each.normals_inside(after[rows])
        if each.tangents is not None and motion.normals == "rotate":
            stored = each.tangents_outside(self.read(each.tangents)[:, :3])
            after = motion.turned(stored, vertices, own)
            rows = np.flatnonzero((after != stored).any(axis=1))
            yield "TANGENT", each.tangents, rows, each.tangents_inside(after[rows])


def _triangles(indices: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """Indices of a primitive -> triangles (n, 3); none for points and lines."""
    if mode == TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    i = np.arange(max(len(indices) - 2, 0))
    if mode == STRIP:
        return indices[np.column_stack([i, i + 1 + i % 2, i + 2 - i % 2])]
    if mode == FAN:
        return indices[np.column_stack([i + 1, i + 2, np.zeros_like(i)])]
    return np.zeros((0, 3), dtype=np.int64)
