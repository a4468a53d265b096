"""Recipes: a chain of filters and the names of its outputs, in a TOML file.

    title = "Twist by a quarter turn"

    [output]
    name = "{folder}/{name}.ply"

    [[steps]]
    filter = "compute_selection_by_condition_per_vertex"
    condselect = "z < zmin + 0.1*(zmax-zmin)"

A recipe is data: nothing in it is evaluated but MeshLab's conditions, by MeshLab.
"""

import hashlib
import json
import os
import re
import tomllib
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import msgspec

from oneform_warp.errors import FileError, InputError
from oneform_warp.filters.chain import Chain, Step
from oneform_warp.filters.names import DEFAULT, checked_pattern
from oneform_warp.filters.native import native_filters

__all__ = ["Input", "Output", "Recipe", "read_recipe", "recipe_text"]


class Input(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which files of a folder are taken: their extensions, as ".ply"; empty for every kind of mesh."""

    extensions: tuple[str, ...] = ()


class Output(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an output is called below the output folder."""

    name: str = DEFAULT


class Recipe(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Steps as tables: `filter`, and beside it the filter's parameters by name."""

    steps: tuple[dict[str, Any], ...]
    title: str = ""
    description: str = ""
    input: Input = Input()
    output: Output = Output()

    @classmethod
    def of(cls, chain: Chain) -> "Recipe":
        """The recipe of a chain that was made in Python."""
        return cls(tuple({"filter": step.filter, **step.parameters} for step in chain.steps))

    def chain(self) -> Chain:
        """The steps, checked whole and in their order; InputError names the step that cannot be used."""
        chain = Chain([_step(table, number) for number, table in enumerate(self.steps, 1)])
        chain.check_order()
        return chain

    @property
    def has_own_steps(self) -> bool:
        """Whether a step is not MeshLab's, so that kernels may have to be compiled."""
        return not {step["filter"] for step in self.steps} <= native_filters()

    @property
    def digest(self) -> str:
        """SHA-256 of the steps: titles, comments, the order of keys and ways to write a number do not count."""
        steps = [[step.filter, dict(step.parameters)] for step in self.chain().steps]
        return hashlib.sha256(json.dumps(steps, sort_keys=True).encode()).hexdigest()


def read_recipe(path: str | os.PathLike[str]) -> Recipe:
    """A recipe from its file, checked whole; InputError names the file, the key and what is allowed."""
    where = str(path)
    try:
        tables = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"cannot be read: {error.strerror}", where=where, fix="check the path") from None
    except ValueError as error:  # of TOML or of UTF-8
        raise FileError(f"this is not TOML: {error}", where=where, fix="see toml.io for the format") from None
    try:
        return checked_recipe(tables)
    except InputError as error:
        raise InputError(error.what, where=": ".join(filter(None, (where, error.where))), fix=error.fix) from None


def checked_recipe(tables: Mapping[str, Any]) -> Recipe:
    """The recipe of a file's tables; InputError names the key."""
    _check_keys(tables, Recipe, "")
    for name, kind in (("input", Input), ("output", Output)):
        if isinstance(tables.get(name), dict):
            _check_keys(tables[name], kind, name)
    try:
        recipe = msgspec.convert(tables, Recipe)
    except msgspec.ValidationError as error:
        raise _misfit(str(error)) from None
    if not recipe.steps:
        raise InputError("there are no steps", where="steps", fix='add [[steps]] with a line as filter = "..."')
    checked_pattern(recipe.output.name, "output.name")
    for extension in recipe.input.extensions:
        if not extension.startswith("."):
            raise InputError(f"{extension!r} has no dot", where="input.extensions", fix=f"write '.{extension}'")
    recipe.chain()
    return recipe


def recipe_text(recipe: Recipe) -> str:
    """The recipe as TOML, without what has its default value."""
    import tomli_w

    tables = {name: value for name, value in msgspec.to_builtins(recipe).items() if value != _default(name)}
    steps = tables.pop("steps")
    return tomli_w.dumps({**tables, "steps": list(steps)})


def _default(name: str) -> Any:
    return msgspec.to_builtins(getattr(Recipe(()), name)) if name != "steps" else None


def _step(table: Mapping[str, Any], number: int) -> Step:
    if not isinstance(table.get("filter"), str):
        raise InputError("there is no filter", where=f"step {number}", fix='add a line as filter = "..."')
    return Step(table["filter"], {key: value for key, value in table.items() if key != "filter"})


def _check_keys(table: Mapping[str, Any], kind: type[msgspec.Struct], where: str) -> None:
    known = [each.name for each in msgspec.structs.fields(kind)]
    for key in table:
        if key not in known:
            raise _unknown_key(key, known, where)


def _unknown_key(key: str, known: Iterable[str], where: str) -> InputError:
    names = list(known)
    near = get_close_matches(key, names, n=1, cutoff=0.0)[0]
    return InputError(f"there is no key {key!r}", where=where, fix=f"did you mean {near!r}? known: {', '.join(names)}")


TOML_WORDS = {"array": "list", "bool": "true or false", "float": "number", "int": "whole number", "object": "table"} | {
    "str": "text"
}


def _misfit(message: str) -> InputError:
    """msgspec's message in TOML's words: "Expected `str`, got `int` - at `$.output.name`"."""
    what, _, place = message.partition(" - at ")
    words = re.sub(r"`(\w+)`", lambda found: TOML_WORDS.get(found[1], found[1]), what)
    where = place.strip("`").removeprefix("$").removeprefix(".")
    fix = "write [[steps]] above each step" if "steps" in where or "steps" in what else "see docs/batch.md"
    return InputError(words[:1].lower() + words[1:], where=where, fix=fix)
