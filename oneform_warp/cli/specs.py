"""What the user asks of a handle, as text or as a TOML table: checked here, without loading anything."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from oneform_warp.errors import InputError

__all__ = [
    "HandleSpec",
    "handle_options",
    "number_from",
    "parse_spec",
    "selection_from",
    "specs_from",
    "unknown_name",
    "vector_from",
    "vertex_from",
]


@dataclass(frozen=True)
class HandleSpec:
    """A selection and the keyword arguments of its `Handle`."""

    select: str
    options: Mapping[str, Any] = field(default_factory=dict)
    folder: Path = Path()
    """What the paths of `file:` selections are relative to."""

    @property
    def name(self) -> str:
        """The given name, or the selection."""
        return str(self.options.get("name", self.select))


def specs_from(hold: Iterable[str], handle: Iterable[tuple[str, str]]) -> list[HandleSpec]:
    """The handles of the command line: selections to hold, and selections with what is asked of them."""
    held = [HandleSpec(select, {"held": True}) for select in hold]
    return held + [HandleSpec(select, parse_spec(spec, f"--handle {select!r}")) for select, spec in handle]


def unknown_name(kind: str, name: str, known: Iterable[str], where: str) -> InputError:
    """The error for a name that is not one of `known`, with the nearest one."""
    names = list(known)
    near = get_close_matches(name, names, n=1, cutoff=0.0)[0]
    return InputError(
        f"there is no {kind} {name!r}", where=where, fix=f"did you mean {near!r}? known: {', '.join(names)}"
    )


def parse_spec(text: str, where: str) -> dict[str, Any]:
    """`axis=z,angle=90` -> keyword arguments of `Handle`; InputError for keys and values that do not fit."""
    given: dict[str, Any] = {}
    for part in text.split(","):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not key:
            raise InputError(f"the handle {text!r} has an empty part", where=where, fix="write key=value,key=value")
        if key in given:
            raise InputError(f"{key} is given twice", where=where, fix="give it once")
        if not equals and key not in FLAGS and key in (*READERS, *SHORT):
            raise InputError(f"{key} has no value", where=where, fix=f"write {key}=...")
        given[key] = value if equals else True
    return handle_options(given, where)


def handle_options(given: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Keys and values of a handle, texts or TOML's own -> keyword arguments of `Handle`."""
    options: dict[str, Any] = {}
    for key, value in given.items():
        name = SHORT.get(key, key)
        if name not in READERS:
            raise unknown_name("key", key, READERS, where)
        options[name] = READERS[name](value, f"{where}: {key}")
    if ("axis" in options) != ("angle" in options):
        raise InputError("axis and angle belong together", where=where, fix="give both, as axis=z,angle=90")
    lonely = [name for name in options if name.startswith("mirror_") and "mirror" not in options]
    if lonely:
        raise InputError(f"{lonely[0]} is given without mirror", where=where, fix="say across which axis, as mirror=x")
    return options


def number_from(value: Any, where: str) -> float:
    """A finite number; InputError where it is none."""
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{value!r} is not a number", where=where, fix="give a finite number")
    return number


def vector_from(value: Any, where: str, fix: str) -> tuple[float, ...]:
    """Three finite numbers, as 0:0:1 or as a list; InputError with this advice where there are none."""
    parts = value.replace(":", " ").split() if isinstance(value, str) else value
    if not isinstance(parts, list) or len(parts) != 3:
        raise InputError(f"{value!r} is not three numbers", where=where, fix=fix)
    return tuple(number_from(part, where) for part in parts)


def selection_from(value: Any, where: str) -> str:
    """A selection as text; InputError where it is none."""
    if not isinstance(value, str) or not value:
        raise InputError(f"{value!r} is no selection", where=where, fix='write one as "z > 0.4"')
    return value


def vertex_from(value: Any, where: str) -> int:
    """The number of a vertex; InputError where it is none."""
    number = number_from(value, where)
    if number != int(number):
        raise InputError(f"{value!r} is no vertex", where=where, fix="give its number")
    return int(number)


def _axis(value: Any, where: str) -> str | tuple[float, ...]:
    if isinstance(value, str) and value.lower().lstrip("+-") in ("x", "y", "z"):
        return value
    axis = vector_from(value, where, "use x, y, z, or three numbers as 0:0:1")
    if not any(axis):
        raise InputError("the axis is zero", where=where, fix="use x, y, z, or three numbers as 0:0:1")
    return axis


def _rotation(value: Any, where: str) -> tuple[float, ...] | str | None:
    if value in ("free", "fit"):
        return None if value == "free" else "fit"
    return vector_from(value, where, "give radians as 0:0:3.14, free or fit")


def _stretch(value: Any, where: str) -> float | tuple[float, ...] | None:
    if value == "free":
        return None
    several = isinstance(value, list) or (isinstance(value, str) and ":" in value)
    factors = vector_from(value, where, "give 1:1:2") if several else (number_from(value, where),)
    for factor in factors:
        if factor <= 0.0:
            raise InputError(f"the stretch is {factor:g}", where=where, fix="give a factor > 0, 1:1:2, or free")
    return factors if several else factors[0]


def _point(value: Any, where: str) -> tuple[float, ...]:
    return vector_from(value, where, "give three numbers as 0:0:1")


def _pivot(value: Any, where: str) -> tuple[float, ...] | str:
    return value if value == "centroid" else vector_from(value, where, "give a point as 0:0:1, or centroid")


def _weight(value: Any, where: str) -> float:
    weight = number_from(value, where)
    if weight <= 0.0:
        raise InputError(
            f"the weight is {weight:g}", where=where, fix="give a number > 0; without one places are exact"
        )
    return weight


def _path(value: Any, where: str) -> str:
    if not isinstance(value, str) or not value:
        raise InputError(f"{value!r} is not a file", where=where, fix="give a mesh file with target positions")
    return value


def _name(value: Any, where: str) -> str:
    if not isinstance(value, str) or not value:
        raise InputError(f"the name is {value!r}", where=where, fix="give a text")
    return value


def _flag(value: Any, where: str) -> bool:
    words = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
    word = str(value).lower()
    if word not in words:
        raise InputError(f"{value!r} is neither true nor false", where=where, fix="write held, or held=false")
    return words[word]


def _distance(value: Any, where: str) -> float:
    distance = number_from(value, where)
    if distance <= 0.0:
        raise InputError(f"the distance is {distance:g}", where=where, fix="give a length > 0")
    return distance


READERS: dict[str, Callable[[Any, str], Any]] = {
    "axis": _axis,
    "angle": number_from,
    "rotation": _rotation,
    "stretch": _stretch,
    "name": _name,
    "frame": _point,
    "held": _flag,
    "mirror": _axis,
    "mirror_at": number_from,
    "mirror_tolerance": _distance,
    "to": _path,
    "move": _point,
    "pivot": _pivot,
    "weight": _weight,
    "snap": _flag,
}
FLAGS = ("held", "snap")
SHORT = {"r": "rotation"}
