"""Selections: a condition, box:..., file:... or group:NAME -> the mask of a mesh's vertices."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import vertex_mask
from oneform_warp.cli.mesh_facts import box_text
from oneform_warp.cli.specs import HandleSpec, unknown_name
from oneform_warp.conditions import select, vertex_variables
from oneform_warp.errors import FileError, InputError
from oneform_warp.filters import MeshFile

__all__ = ["select_vertices"]

Mask = NDArray[np.bool_]


def select_vertices(spec: HandleSpec, mesh: MeshFile) -> Mask:
    """The vertices (V,) that a handle's selection means; InputError where it means none."""
    kind, colon, rest = spec.select.partition(":")
    # A condition has a colon only after a question mark.
    if colon and re.fullmatch(r"\s*\w+\s*", kind):
        if kind.strip() not in KINDS:
            raise unknown_name("kind of selection", kind.strip(), KINDS, repr(spec.select))
        mask = KINDS[kind.strip()](rest.strip(), spec, mesh)
    else:
        variables = vertex_variables(mesh.positions, colors=mesh.colors, normals=mesh.normals, quality=mesh.quality)
        mask = select(spec.select, variables)
    if not mask.any():
        extent = box_text(mesh.positions)
        raise InputError("no vertex is selected", where=f"handle {spec.name!r}", fix=f"the mesh has {extent}")
    return mask


def _box(text: str, spec: HandleSpec, mesh: MeshFile) -> Mask:
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) != 6 or not np.isfinite(numbers).all() or (numbers[:3] > numbers[3:]).any():
        raise InputError(
            "a box is six numbers, the smaller ones first",
            where=repr(spec.select),
            fix="write box:xmin,ymin,zmin,xmax,ymax,zmax",
        )
    inside = (mesh.positions >= numbers[:3]) & (mesh.positions <= numbers[3:])
    return np.asarray(inside.all(axis=1))


def _file(text: str, spec: HandleSpec, mesh: MeshFile) -> Mask:
    path = spec.folder / Path(text).expanduser()
    try:
        words = path.read_text(encoding="utf-8").replace(",", " ").split()
    except OSError as error:
        raise FileError(f"cannot be read: {error.strerror}", where=str(path), fix="check the path") from None
    except UnicodeDecodeError:
        raise FileError("this is not text", where=str(path), fix="write vertex numbers, from 0") from None
    wrong = [word for word in words if not re.fullmatch(r"[+-]?\d{1,18}", word)]
    if wrong:
        what = f"{wrong[0]!r} is not a vertex number"
        raise FileError(what, where=str(path), fix="write vertex numbers, from 0, between spaces or commas")
    return vertex_mask(np.array(words, dtype=np.int64), len(mesh.positions), str(path))


def _group(text: str, spec: HandleSpec, mesh: MeshFile) -> Mask:
    if not mesh.groups:
        raise InputError(
            "the file has no groups", where=repr(spec.select), fix="use a condition, or an OBJ with groups"
        )
    if text not in mesh.groups:
        raise unknown_name("group", text, mesh.groups, str(mesh.path))
    return vertex_mask(mesh.groups[text], len(mesh.positions), text)


KINDS: dict[str, Callable[[str, HandleSpec, MeshFile], Mask]] = {"box": _box, "file": _file, "group": _group}
