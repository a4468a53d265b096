"""Recipes: handles and settings in a TOML file.

    weights = "cotangent"

    [[handles]]
    select = "z < 0.1"
    held = true

    [[handles]]
    select = "z > 0.9"
    axis = "z"
    angle = 180

Paths in a recipe are relative to its folder.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from oneform_warp.cli.settings import Settings, checked_setting
from oneform_warp.cli.specs import READERS, HandleSpec, handle_options, unknown_name
from oneform_warp.errors import FileError, InputError

__all__ = ["OF_SEQUENCES", "Asked", "Recipe", "handle_from", "load_tables", "read_recipe", "recipe_from"]

OF_SEQUENCES = ("keyframes", "frames", "fps")


@dataclass(frozen=True)
class Recipe:
    """Handles, and those settings that are given."""

    handles: tuple[HandleSpec, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    presets: tuple[Mapping[str, Any], ...] = ()
    """Tables with a preset's name, and below with a constraint's kind, not yet looked at."""
    constraints: tuple[Mapping[str, Any], ...] = ()
    folder: Path = Path()


@dataclass(frozen=True)
class Asked:
    """Presets and constraints as they are typed; what they mean is known once Warp is loaded."""

    presets: tuple[str, ...] = ()
    constraints: tuple[tuple[str, str], ...] = ()
    recipe: Recipe = field(default_factory=Recipe)


def read_recipe(path: Path | None) -> Recipe:
    """A recipe from its file; None is the empty one. InputError names the file and the key."""
    return Recipe() if path is None else recipe_from(load_tables(path), path)


def recipe_from(tables: dict[str, Any], path: Path) -> Recipe:
    """The recipe that the tables of a file are."""
    handles = _tables(tables, "handles", path)
    presets, constraints = _tables(tables, "presets", path), _tables(tables, "constraints", path)
    known = [each.name for each in fields(Settings)]
    for key, value in tables.items():
        if key in OF_SEQUENCES:
            fix = "use `oneform-warp animate`"
            raise InputError(f"{key} are those of a sequence", where=str(path), fix=fix)
        if key not in known:
            raise unknown_name("key", key, ["handles", "presets", "constraints", *known], str(path))
        checked_setting(key, value, f"{path}: {key}")
    specs = [handle_from(table, path, f"handles[{number}]") for number, table in enumerate(handles)]
    return Recipe(tuple(specs), tables, presets, constraints, path.parent)


def _tables(tables: dict[str, Any], key: str, path: Path) -> tuple[dict[str, Any], ...]:
    """Takes the tables of a key out; none where it is not there."""
    found = tables.pop(key, [])
    if not isinstance(found, list) or not all(isinstance(table, dict) for table in found):
        raise InputError(f"{key} are not tables", where=str(path), fix=f"write [[{key}]] above each")
    return tuple(found)


def load_tables(path: Path) -> dict[str, Any]:
    """The content of a TOML file; FileError where it is none."""
    import tomllib

    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"cannot be read: {error.strerror}", where=str(path), fix="check the path") from None
    except ValueError as error:  # of TOML or of UTF-8
        raise FileError(f"this is not TOML: {error}", where=str(path), fix="see toml.io for the format") from None


def handle_from(table: dict[str, Any], path: Path, place: str, select: str | None = None) -> HandleSpec:
    """The handle of a table at a place of a recipe; select: what it selects where the table does not say."""
    where = f"{path}: {place}"
    options = dict(table)
    select = options.pop("select", select)
    for key in options:
        if key not in READERS:
            raise unknown_name("key", key, ["select", *READERS], where)
    if not isinstance(select, str):
        raise InputError("there is no selection", where=where, fix='add a line as select = "z > 0.9"')
    return HandleSpec(select, handle_options(options, where), path.parent)
