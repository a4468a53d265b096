"""Recipes of sequences: those of `deform`, with handles at keyframes.

    frames = 48
    fps = 24

    [[handles]]
    select = "z < 0.1"
    held = true

    [[keyframes]]
    t = 0.5
    [[keyframes.handles]]
    select = "z > 0.9"
    name = "top"
    axis = "z"
    angle = 180

    [[keyframes]]
    t = 1.0
    [[keyframes.handles]]
    name = "top"
    axis = "z"
    angle = 90

Handles outside keyframes are those at t = 1. A selection is said once for each name.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from oneform_warp.cli.recipe import OF_SEQUENCES, Recipe, handle_from, load_tables, recipe_from
from oneform_warp.cli.specs import HandleSpec, number_from, unknown_name
from oneform_warp.errors import InputError

__all__ = ["END", "Script", "read_script"]

END = 1.0


@dataclass(frozen=True)
class Script:
    """A recipe, the handles of its keyframes, and how many frames it wants, how many of them in a second."""

    recipe: Recipe = field(default_factory=Recipe)
    keys: Mapping[float, tuple[HandleSpec, ...]] = field(default_factory=dict)
    frames: int | None = None
    fps: float | None = None


def read_script(path: Path | None) -> Script:
    """A script from its file; None is the empty one. InputError names the file and the key."""
    if path is None:
        return Script()
    tables = load_tables(path)
    own = {key: tables.pop(key) for key in OF_SEQUENCES if key in tables}
    recipe = recipe_from(tables, path)
    known = {spec.name: spec.select for spec in recipe.handles}
    keys: dict[float, tuple[HandleSpec, ...]] = {}
    for number, table in enumerate(_tables(own.get("keyframes", []), path, "keyframes")):
        t, handles = _keyframe(table, path, f"keyframes[{number}]", known)
        if t in keys:
            raise InputError(f"there are two keyframes at t = {t:g}", where=str(path), fix="put their handles together")
        keys[t] = handles
    return Script(recipe, keys, *_speed(own, path))


def _tables(value: Any, path: Path, name: str) -> list[dict[str, Any]]:
    if not isinstance(value, list) or not all(isinstance(table, dict) for table in value):
        raise InputError(f"{name} are not tables", where=str(path), fix=f"write [[{name}]] above each")
    return value


def _keyframe(
    table: dict[str, Any], path: Path, place: str, known: dict[str, str]
) -> tuple[float, tuple[HandleSpec, ...]]:
    """The time and the handles of a keyframe; `known` selections by name, to which it adds its own."""
    for key in table:
        if key not in ("t", "handles"):
            raise unknown_name("key", key, ["t", "handles"], f"{path}: {place}")
    t = number_from(table.get("t"), f"{path}: {place}: t")
    if not 0.0 <= t <= END:
        raise InputError(f"t is {t:g}", where=f"{path}: {place}", fix="give a time from 0, at rest, to 1, the end")
    specs = []
    for number, each in enumerate(_tables(table.get("handles", []), path, "keyframes.handles")):
        select = known.get(str(each.get("name")))
        spec = handle_from(each, path, f"{place}.handles[{number}]", select)
        known[spec.name] = spec.select
        specs.append(spec)
    return t, tuple(specs)


def _speed(own: Mapping[str, Any], path: Path) -> tuple[int | None, float | None]:
    frames, fps = own.get("frames"), own.get("fps")
    if frames is not None and (not isinstance(frames, int) or isinstance(frames, bool) or frames < 2):
        raise InputError(f"frames is {frames!r}", where=str(path), fix="give a whole number >= 2")
    if fps is not None and number_from(fps, f"{path}: fps") <= 0.0:
        raise InputError(f"fps is {fps!r}", where=str(path), fix="give a number > 0")
    return frames, fps
