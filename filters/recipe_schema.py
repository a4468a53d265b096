"""The JSON schema of recipes, by which editors complete and check TOML: every filter and its parameters."""

from collections.abc import Mapping
from typing import Any

import msgspec
import pymeshlab

from oneform_warp.filters.native import ABORTING, native_filters
from oneform_warp.filters.parameters import Choice, Flag, Length, Number, Parameter, Text, Whole
from oneform_warp.filters.recipe import Recipe
from oneform_warp.filters.registry import own_filters

__all__ = ["recipe_schema"]

TYPES: dict[type[Parameter], Any] = {
    Flag: "boolean",
    Number: "number",
    Whole: "integer",
    Text: "string",
    Choice: "string",
    Length: ["number", "string"],
}


def recipe_schema() -> dict[str, Any]:
    """The schema, with MeshLab's filters and those that are registered here."""
    schema = msgspec.json.schema(Recipe)
    own, native = own_filters(), sorted(native_filters() - ABORTING)
    names = [*own, *native]
    choices = [_step(each.name, {one.name: _parameter(one) for one in each.parameters}) for each in own.values()]
    choices += [_step(name, {key: {} for key in keys}) for name in native if (keys := _native_keys(name)) is not None]
    schema["$defs"]["Recipe"]["properties"]["steps"] = {
        "type": "array",
        "minItems": 1,
        "items": {
            "type": "object",
            "required": ["filter"],
            "properties": {"filter": {"enum": names}},
            "allOf": choices,
        },
    }
    return schema


def _step(name: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    known = {"filter": {}, **parameters}
    return {
        "if": {"properties": {"filter": {"const": name}}},
        "then": {"properties": known, "additionalProperties": False},
    }


def _native_keys(name: str) -> list[str] | None:
    """The parameters of a native filter; None where pymeshlab tells them only of a mesh with more than a cube has."""
    meshes = pymeshlab.MeshSet()
    meshes.create_cube()
    try:
        return list(meshes.filter_parameter_values(name))
    except Exception:  # noqa: BLE001 - pymeshlab raises several kinds of its own
        return None


def _parameter(parameter: Parameter) -> dict[str, Any]:
    kind = TYPES.get(type(parameter), "array")
    described: dict[str, Any] = {"type": kind, "description": parameter.help, "default": parameter.default}
    if isinstance(parameter, Choice):
        described["enum"] = list(parameter.words)
    return described
