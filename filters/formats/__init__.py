"""Mesh files as they stand on the disk: OBJ, OFF, PLY, STL and glTF, with other coordinates and all else as it was."""

from collections.abc import Callable
from pathlib import Path

from oneform_warp.errors import FileError
from oneform_warp.filters.formats.gltf import GltfRecords
from oneform_warp.filters.formats.obj import ObjRecords
from oneform_warp.filters.formats.off import OffRecords
from oneform_warp.filters.formats.ply import PlyRecords
from oneform_warp.filters.formats.records import Polygons, Records
from oneform_warp.filters.formats.stl import StlRecords

__all__ = ["GltfRecords", "ObjRecords", "OffRecords", "PlyRecords", "Polygons", "Records", "StlRecords", "scan"]

KINDS: dict[str, Callable[[bytes], Records]] = {
    ".obj": ObjRecords.read,
    ".off": OffRecords.read,
    ".ply": PlyRecords.read,
    ".stl": StlRecords.read,
}


def scan(path: Path) -> Records | None:
    """The records of a file, or None for other formats and for dialects not known here.

    Raises FileError for a glTF scene that cannot be deformed, and OSError.
    """
    suffix = path.suffix.lower()
    if suffix in (".glb", ".gltf"):
        return GltfRecords.load(path)
    kind = KINDS.get(suffix)
    try:
        return kind(path.read_bytes()) if kind else None
    except FileError:
        raise
    except (ValueError, KeyError, IndexError):
        return None
