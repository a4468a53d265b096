"""A mesh written by MeshLab, whole or not at all, and what is lost on the way."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from oneform_warp.errors import FileError
from oneform_warp.filters.formats import scan
from oneform_warp.filters.formats.companions import copy_companions, find_companions, sync
from oneform_warp.filters.formats.losses import lost
from oneform_warp.filters.meshfile import SCENES
from oneform_warp.filters.meshset import MeshSet
from oneform_warp.filters.native import NATIVE_ERRORS

__all__ = ["check_rewritable", "save_by_meshlab"]

QUALITY = {"quality", "property quality"}
"""In PLY files MeshLab keeps it."""


def check_rewritable(target: Path) -> None:
    """FileError for glTF, which MeshLab does not write."""
    if target.suffix.lower() in SCENES:
        what = "glTF is written only where the chain moves vertices and changes nothing else"
        raise FileError(what, where=str(target), fix="choose .ply or .obj")


def save_by_meshlab(meshes: MeshSet, source: Path, target: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Writes the current mesh, made from the file `source`, with its companions; -> what is lost, and warnings.

    Textures are copied from the folder of `source`, and only from there. Raises FileError.
    """
    check_rewritable(target)
    if not np.array_equal(meshes.current_mesh().transform_matrix(), np.eye(4)):
        meshes.apply_filter("apply_matrix_freeze")  # pymeshlab leaves it out
    mesh, records = meshes.current_mesh(), scan(source)
    textures = mesh.textures()
    safe = all(name == Path(name).name and name not in ("", ".", "..") for name in textures)
    embedded = any(image.width() > 0 for image in textures.values()) and safe
    try:
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".") as folder:
            meshes.save_current_mesh(Path(folder) / target.name, save_textures=embedded)
            made = sorted(Path(folder).iterdir())
            own = [path for path in made if path.name.startswith(target.stem) and path.name != target.name]
            images = [path for path in made if path not in own and path.name != target.name]
            notes = [*copy_companions(images, Path(folder), target.parent)]
            for path in [*own, Path(folder) / target.name]:  # the mesh refers to the others
                sync(path)
                os.replace(path, target.parent / path.name)
            sync(target.parent)
    except (*NATIVE_ERRORS, OSError, IndexError) as error:
        reason = " ".join(str(error).split())
        fix = "choose another format or folder"
        raise FileError(f"cannot be written: {reason}", where=str(target), fix=fix) from None
    if textures and source.parent.resolve() != target.parent.resolve():
        there = {path.name for path in images}
        names = [name for name in textures if name not in there]
        files, missing = find_companions(source.parent, names)
        notes += [*missing, *copy_companions(files, source.parent, target.parent)]
    contents = () if records is None else records.contents()
    return _lost((*contents, *_looks(mesh)), target.suffix.lower()), tuple(dict.fromkeys(notes))


def _lost(contents: tuple[str, ...], suffix: str) -> tuple[str, ...]:
    """What MeshLab's files of this kind do not hold, each once."""
    words = dict.fromkeys(lost(contents, suffix))
    return tuple(word for word in words if suffix != ".ply" or word not in QUALITY)


def _looks(mesh: pymeshlab.Mesh) -> list[str]:
    """What a mesh has; one colour or quality for all is what MeshLab gives every mesh."""
    faces = mesh.face_number() > 0
    has = {
        "colours": mesh.has_vertex_color() and _varies(mesh.vertex_color_array()),
        "face colours": faces and mesh.has_face_color() and _varies(mesh.face_color_array()),
        "quality": mesh.has_vertex_scalar() and _varies(mesh.vertex_scalar_array()),
    }
    return [name for name, there in has.items() if there]


def _varies(values: NDArray[np.generic]) -> bool:
    return bool(len(values)) and bool((values != values[0]).any())
