"""What every format has: records of vertices and faces, as they stand in the file.

Importers merge, split and drop: MeshLab leaves out vertices with NaN and properties that it does not know, trimesh
makes triangles of everything. Replacing the numbers in the file's own records keeps all the rest of it: polygons,
materials, groups, UVs, colours, custom properties, comments and the order.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Set
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from oneform_warp.filters.formats.motion import Floats, Motion, Polygons

__all__ = ["Polygons", "Records", "packed_triangles"]


@dataclass(frozen=True, eq=False)
class Records(ABC):
    """A file's bytes with its numbers of vertices and faces."""

    data: bytes
    vertices: int
    faces: int

    @abstractmethod
    def positions(self) -> Floats:
        """The coordinates (R, 3) of the vertex records as the file has them, NaN included."""

    @abstractmethod
    def moved(self, motion: Motion) -> bytes:
        """The file after a motion of its vertex records; what did not move keeps every byte."""

    def polygons(self) -> Polygons | None:
        """The faces as vertex indices and offsets (F + 1,), or None where only the importer knows them."""
        return None

    def groups(self) -> Mapping[str, NDArray[np.int32]]:
        """The vertices (sorted) of each named part."""
        return {}

    def companions(self) -> tuple[str, ...]:
        """The files that this one refers to, as it spells them."""
        return ()

    def contents(self) -> tuple[str, ...]:
        """What the file has beside positions and triangles, in the words of `losses`."""
        return ()

    def files(self, motion: Motion, name: str, taken: Set[str] = frozenset()) -> Mapping[str, bytes]:
        """All files to write after a motion, by name; `name` is the mesh's own, `taken` names are not used."""
        return {name: self.moved(motion)}


def packed_triangles(triangles: NDArray[np.int32]) -> Polygons:
    """Triangles (F, 3) as indices and offsets."""
    return triangles.ravel(), np.arange(0, triangles.size + 1, 3, dtype=np.int32)
