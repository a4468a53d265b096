"""MeshLab's filter scripts (.mlx), with steps of our own between MeshLab's.

MeshLab writes six digits of a number, which does not repeat a run; here all digits are written, and a script that is
replayed gives the same bits. Lengths of MeshLab's filters are absolute in a script, as they were when they were used.
"""

from __future__ import annotations

import copy
import keyword
import os
import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab

from oneform_warp.errors import FileError, InputError
from oneform_warp.filters.filter import Filter, nearest
from oneform_warp.filters.native import native_filters
from oneform_warp.filters.registry import own_filters
from oneform_warp.filters.step import Step

__all__ = ["Applied", "read_script", "recorded", "write_script"]

HEADER = "<!DOCTYPE FilterScript>\n"
LARGEST = 16 * 2**20
"""Bytes of a script that is read."""

# Filters that are younger than pymeshlab's own list of MeshLab's names.
YOUNGER = {
    "Alpha Wrap": "generate_alpha_wrap",
    "Colorize by approximated geodesic distance from the selected points":
        "compute_scalar_by_heat_geodesic_distance_from_selection_per_vertex",
    "Compute Ambient occlusion": "compute_scalar_ambient_occlusion",
    "Compute Obscurance": "compute_scalar_by_volumetric_obscurance",
    "Compute Shape-Diameter Function": "compute_scalar_by_shape_diameter_function_per_vertex",
    "Cubic stylization": "apply_coord_cubic_stylization",
    "Dodecahedron (symmetric)": "create_dodecahedron_sym",
    "Make mesh developable": "apply_coord_developability_of_mesh",
    "Per Face Normal Function": "compute_normal_by_function_per_face",
    "Re-Orient all faces coherently": "meshing_re_orient_faces_coherently",
    "Reorient face normals by geometry": "meshing_re_orient_faces_by_geometry",
    "Subdivision Surfaces: Doo Sabin": "meshing_surface_subdivision_doo_sabin",
}  # fmt: skip


@dataclass(frozen=True)
class Applied:
    """A filter as it stands in a script: the step, and for a native one what MeshLab says of it."""

    step: Step
    element: ET.Element | None = None


def read_script(path: str | os.PathLike[str]) -> list[Applied]:
    """The filters of a script, in order; FileError, naming the filter, for what is not known or cannot be read."""
    source = Path(path).absolute()
    try:
        with source.open("rb") as file:
            text = file.read(LARGEST + 1)
    except OSError as error:
        raise FileError(f"cannot be read: {error.strerror}", where=str(source), fix="check the path") from None
    if len(text) > LARGEST or b"<!ENTITY" in text:
        raise FileError("this is not a filter script", where=str(source), fix="save one by save_filter_script")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise FileError(f"this is not XML: {error}", where=str(source), fix="save it again") from None
    if root.tag != "FilterScript":
        raise FileError(f"<{root.tag}> is not a filter script", where=str(source), fix="save it by MeshLab or MeshSet")
    return [_applied(element, f"{source}: filter {number}") for number, element in enumerate(root, 1)]


def write_script(path: str | os.PathLike[str], applied: Iterable[Applied]) -> None:
    """Writes a script whole or not at all; FileError where it cannot be written."""
    target = Path(path).absolute()
    root = ET.Element("FilterScript")
    root.extend(_element(each) for each in applied)
    ET.indent(root, " ")
    text = HEADER + ET.tostring(root, encoding="unicode") + "\n"
    try:
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".") as folder:
            part = Path(folder) / "script"
            part.write_text(text, encoding="utf-8")
            os.replace(part, target)
    except OSError as error:
        raise FileError(f"cannot be written: {error.strerror}", where=str(target), fix="check the folder") from None


def recorded(script: Path, used: Mapping[int, Mapping[str, Any]]) -> dict[int, ET.Element]:
    """The filters of a script that pymeshlab wrote, by number, with all digits of the values that were used."""
    elements = list(ET.parse(script).getroot())
    return {number: _exact(elements[number], values) for number, values in used.items()}


def _applied(element: ET.Element, where: str) -> Applied:
    shown = element.get("name", "")
    name = _python_name(shown)
    if name is None:
        known = {**dict.fromkeys(own_filters()), **dict.fromkeys(sorted(native_filters()))}
        raise FileError(f"there is no filter {shown!r}", where=where, fix=nearest(shown, known).split(" known:")[0])
    try:
        values = {_lower(each.get("name", "")): _value(each) for each in element.iter("Param")}
        given = {key: value for key, value in values.items() if value is not None}
        if name in own_filters():
            return Applied(Step(name, own_filters()[name].plain(given)))
    except (KeyError, ValueError) as error:
        raise FileError(f"{shown}: {error}", where=where, fix="save the script again") from None
    return Applied(Step(name, given), element)


def _element(applied: Applied) -> ET.Element:
    """A filter as XML."""
    if applied.element is not None:
        return copy.deepcopy(applied.element)
    own = own_filters()[applied.step.filter]
    element = ET.Element("filter", name=own.name)
    for attributes in _parameters(own, applied.step.parameters):
        ET.SubElement(element, "Param", attributes)
    return element


def _parameters(own: Filter, given: Mapping[str, Any]) -> Iterable[dict[str, str]]:
    for each in own.parameters:
        plain = each.plain(given.get(each.name, each.default))
        yield {"type": each.rich, "name": each.name, "tooltip": each.help, **each.attributes(plain)}


# ------------------------------------------------------------------ names


def _python_name(shown: str) -> str | None:
    """pymeshlab's name of a filter from MeshLab's, or a name that is one already."""
    if shown in own_filters() or shown in native_filters():
        return shown
    name = YOUNGER.get(shown, _names().get(re.sub(r"[^a-z0-9]+", "_", shown.lower()).strip("_"), ""))
    return name if name in native_filters() else None


@cache
def _names() -> dict[str, str]:
    """MeshLab's names in lower case -> pymeshlab's, from the table of its own that renames old scripts."""
    lines = Path(pymeshlab.this_path, "keys.txt").read_text(encoding="utf-8").splitlines()
    return dict(pair for line in lines if len(pair := tuple(line.split())) == 2)  # type: ignore[misc]


def _lower(name: str) -> str:
    """A parameter's name as pymeshlab spells it."""
    lower = name.lower()
    return f"{lower}_" if keyword.iskeyword(lower) else lower


# ------------------------------------------------------------------ values


def _length(attributes: Mapping[str, str]) -> float | str:
    text = attributes["value"]
    return text if text.endswith("%") else float(text)


def _vector(attributes: Mapping[str, str]) -> tuple[float, ...]:
    return tuple(float(attributes[axis]) for axis in "xyz")


def _matrix(attributes: Mapping[str, str]) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(attributes[f"val{4 * row + column}"]) for column in range(4)) for row in range(4))


READERS: dict[str, Callable[[Mapping[str, str]], Any]] = {
    "RichBool": lambda attributes: {"true": True, "false": False}[attributes["value"]],
    "RichInt": lambda attributes: int(attributes["value"]),
    "RichFloat": lambda attributes: float(attributes["value"]),
    "RichDynamicFloat": lambda attributes: float(attributes["value"]),
    "RichAbsPerc": _length,
    "RichPercentage": _length,
    "RichEnum": lambda attributes: int(attributes["value"]),
    "RichMesh": lambda attributes: int(attributes["value"]),
    "RichString": lambda attributes: attributes["value"],
    "RichFileOpen": lambda attributes: attributes["value"],
    "RichFileSave": lambda attributes: attributes["value"],
    "RichColor": lambda attributes: tuple(int(attributes[channel]) for channel in "rgba"),
    "RichDirection": _vector,
    "RichPosition": _vector,
    "RichMatrix44f": _matrix,
    "RichMatrix44": _matrix,
}


def _value(param: ET.Element) -> Any:
    """The value of a Param; None for a camera, which pymeshlab cannot take."""
    kind = param.get("type", "")
    if kind.startswith("RichShot"):
        return None
    if kind not in READERS:
        raise InputError(f"parameter {param.get('name')!r} is of the unknown type {kind!r}")
    return READERS[kind](param.attrib)


def _exact(element: ET.Element, used: Mapping[str, Any]) -> ET.Element:
    """The element with all digits of the numbers that were used."""
    exact = copy.deepcopy(element)
    for param in exact.iter("Param"):
        value = used.get(_lower(param.get("name", "")))
        if isinstance(value, float) and "value" in param.attrib:
            param.set("value", repr(value))
        elif isinstance(value, tuple) and param.get("type") != "RichColor":
            numbers = np.ravel(value).tolist()
            names = [f"val{number}" for number in range(16)] if len(numbers) == 16 else list("xyz")
            for name, number in zip(names, numbers, strict=True):
                param.set(name, repr(number))
    return exact
