"""What a mesh file has that a file of another format, written by MeshLab, does not hold."""

from collections.abc import Iterable

__all__ = ["lost"]

# Tried with pymeshlab 2025.7: written, read again and compared.
HOLDS = {
    ".obj": {"normals", "colours", "UVs", "materials", "textures", "polygons"},
    ".ply": {"colours", "face colours", "UVs", "textures"},
    ".off": {"normals", "colours", "face colours", "polygons"},
    ".stl": {"facet normals"},
    ".xyz": {"normals"},
    ".dae": {"colours", "UVs", "textures"},
    ".wrl": {"colours"},
    ".x3d": {"colours"},
    ".3ds": {"face colours", "UVs"},
}


def lost(contents: Iterable[str], suffix: str) -> tuple[str, ...]:
    """Those of the contents that files with this extension do not hold, in their order.

    contents: words as `Records.contents` gives them, as "UVs", "polygons" or "property heat".
    """
    given, held = tuple(contents), HOLDS.get(suffix, set())
    words = [each for each in given if each not in held]
    # MeshLab gives all corners of an OBJ's polygons the UVs of one.
    return (*words, *(["UVs of polygons"] if suffix == ".obj" and {"UVs", "polygons"} <= set(given) else []))
