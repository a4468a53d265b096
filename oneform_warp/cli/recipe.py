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

__all__ = ["Recipe", "read_recipe"]


@dataclass(frozen=True)
class Recipe:
    """Handles, and those settings that are given."""

    handles: tuple[HandleSpec, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)


def read_recipe(path: Path | None) -> Recipe:
    """A recipe from its file; None is the empty one. InputError names the file and the key."""
    if path is None:
        return Recipe()
    tables = _load(path)
    handles = tables.pop("handles", [])
    if not isinstance(handles, list) or not all(isinstance(table, dict) for table in handles):
        raise InputError("handles are not tables", where=str(path), fix="write [[handles]] above each")
    known = [each.name for each in fields(Settings)]
    for key, value in tables.items():
        if key not in known:
            raise unknown_name("key", key, ["handles", *known], str(path))
        checked_setting(key, value, f"{path}: {key}")
    return Recipe(tuple(_handle(table, path, number) for number, table in enumerate(handles)), tables)


def _load(path: Path) -> dict[str, Any]:
    import tomllib

    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"cannot be read: {error.strerror}", where=str(path), fix="check the path") from None
    except ValueError as error:  # of TOML or of UTF-8
        raise FileError(f"this is not TOML: {error}", where=str(path), fix="see toml.io for the format") from None


def _handle(table: dict[str, Any], path: Path, number: int) -> HandleSpec:
    where = f"{path}: handles[{number}]"
    options = dict(table)
    select = options.pop("select", None)
    for key in options:
        if key not in READERS:
            raise unknown_name("key", key, ["select", *READERS], where)
    if not isinstance(select, str):
        raise InputError("there is no selection", where=where, fix='add a line as select = "z > 0.9"')
    return HandleSpec(select, handle_options(options, where), path.parent)
