"""A preset as text or as a TOML table: `bend,angle=90,axis=z`, checked here without loading anything."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from inspect import signature
from pathlib import Path
from typing import Any

from oneform_warp.cli.recipe import Asked
from oneform_warp.cli.selections import select_vertices
from oneform_warp.cli.specs import READERS, HandleSpec, number_from, selection_from, unknown_name, vertex_from
from oneform_warp.errors import InputError
from oneform_warp.filters import MeshFile
from oneform_warp.handles import Handle
from oneform_warp.presets import PRESETS
from oneform_warp.principal import PRINCIPAL

__all__ = ["PresetSpec", "parse_preset", "preset_from", "presets_from"]


@dataclass(frozen=True)
class PresetSpec:
    """A preset's name and its keyword arguments; the joint is a selection still."""

    preset: str
    options: Mapping[str, Any] = field(default_factory=dict)
    folder: Path = Path()
    """What the paths of a `file:` selection are relative to."""

    def handles(self, mesh: MeshFile) -> list[Handle]:
        """The preset's handles on a mesh; InputError where it cannot have them."""
        options = dict(self.options)
        if "joint" in options:
            selection = HandleSpec(options["joint"], {"name": f"the joint of {self.preset}"}, self.folder)
            options |= {"joint": select_vertices(selection, mesh), "faces": mesh.faces}
        return PRESETS[self.preset](mesh.positions, **options)


def parse_preset(text: str, where: str) -> PresetSpec:
    """`bend,angle=90,axis=z` -> the preset; InputError for names and values that do not fit."""
    name, *parts = (part.strip() for part in text.split(","))
    given: dict[str, Any] = {}
    for part in parts:
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not key or key in given:
            what = f"{key} is given twice" if key else f"the preset {text!r} has an empty part"
            raise InputError(what, where=where, fix="write bend,key=value,key=value")
        if not equals and key != "keep_volume":
            raise InputError(f"{key} has no value", where=where, fix=f"write {key}=...")
        given[key] = value if equals else True
    return preset_from(name, given, where)


def preset_from(name: str, given: Mapping[str, Any], where: str, folder: Path = Path()) -> PresetSpec:
    """A preset's name with keys and values, texts or TOML's own."""
    if name not in PRESETS:
        raise unknown_name("preset", name, PRESETS, where)
    known = [key for key in signature(PRESETS[name]).parameters if key not in ("x", "faces")]
    for key in given:
        if key not in known:
            raise unknown_name("key", key, known, where)
    return PresetSpec(name, {key: VALUES[key](value, f"{where}: {key}") for key, value in given.items()}, folder)


def presets_from(asked: Asked) -> list[PresetSpec]:
    """The presets of a recipe, and those of the command line."""
    made = []
    for number, table in enumerate(asked.recipe.presets):
        where, options = f"presets[{number}]", dict(table)
        name = options.pop("preset", None)
        if not isinstance(name, str):
            raise InputError("there is no preset", where=where, fix='add a line as preset = "twist"')
        made.append(preset_from(name, options, where, asked.recipe.folder))
    return made + [parse_preset(text, f"--preset {text!r}") for text in asked.presets]


def _axis(value: Any, where: str) -> Any:
    return None if value == PRINCIPAL else READERS["axis"](value, where)


VALUES: dict[str, Callable[[Any, str], Any]] = {
    "angle": number_from,
    "factor": number_from,
    "axis": _axis,
    "about": _axis,
    "ends": number_from,
    "at": number_from,
    "room": number_from,
    "keep_volume": READERS["held"],
    "joint": selection_from,
    "beyond": vertex_from,
}
