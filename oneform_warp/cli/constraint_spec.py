"""A constraint as text or as a TOML table: a kind, a selection where it needs one, and what the kind asks for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from oneform_warp.cli.recipe import Asked
from oneform_warp.cli.selections import select_vertices
from oneform_warp.cli.specs import (
    READERS,
    HandleSpec,
    number_from,
    selection_from,
    unknown_name,
    vector_from,
    vertex_from,
)
from oneform_warp.constraint_kinds import CONSTRAINTS, constraint_of_kind
from oneform_warp.constraints import Constraint
from oneform_warp.errors import InputError
from oneform_warp.filters import MeshFile

__all__ = ["ConstraintSpec", "constraint_from", "constraints_from", "parse_constraint"]

SETS = {"position": "vertices", "centroid": "vertices", "planar": "vertices", "face_normal": "corners"}
"""What the kinds that need a selection call it."""

KINDS = [kind for kind in CONSTRAINTS if kind != "linear"]


@dataclass(frozen=True)
class ConstraintSpec:
    """A kind and its keyword arguments; the vertices are a selection still."""

    kind: str
    options: Mapping[str, Any] = field(default_factory=dict)
    folder: Path = Path()
    """What the paths of a `file:` selection are relative to."""

    def on(self, mesh: MeshFile) -> Constraint:
        """The constraint on the vertices of a mesh; InputError where it cannot be."""
        options = dict(self.options)
        select = options.pop("select", None)
        if select is not None:
            named = {"name": options.get("name", self.kind)}
            chosen = np.flatnonzero(select_vertices(HandleSpec(select, named, self.folder), mesh))
            options[SETS[self.kind]] = chosen
            if self.kind == "position" and "to" in options:
                options["to"] = np.tile(options["to"], (len(chosen), 1))
            if self.kind == "planar" and "normal" not in options:
                options["x"] = mesh.positions
        return constraint_of_kind(self.kind, options)


def parse_constraint(kind: str, text: str, where: str) -> ConstraintSpec:
    """`centroid`, `select=z > 0.4,to=0:0:1` -> the constraint; InputError for names and values that do not fit."""
    given: dict[str, Any] = {}
    for part in text.split(","):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        # A condition has signs of equality of its own.
        if not key or not equals or key in given:
            raise InputError(
                f"{part.strip()!r} is not key=value, or comes twice", where=where, fix="write key=value,..."
            )
        given[key] = value
    return constraint_from(kind, given, where)


def constraint_from(kind: str, given: Mapping[str, Any], where: str, folder: Path = Path()) -> ConstraintSpec:
    """A kind with keys and values, texts or TOML's own."""
    if kind not in KINDS:
        raise unknown_name("kind", kind, KINDS, where)
    known = [key for key in VALUES if key != "select" or kind in SETS]
    for key in given:
        if key not in known:
            raise unknown_name("key", key, known, where)
    if kind in SETS and "select" not in given:
        raise InputError(f"{kind} needs a selection", where=where, fix="add select=CONDITION")
    return ConstraintSpec(kind, {key: VALUES[key](value, f"{where}: {key}") for key, value in given.items()}, folder)


def _vector(value: Any, where: str) -> tuple[float, ...]:
    return vector_from(value, where, "give three numbers as 0:0:1")


VALUES: dict[str, Callable[[Any, str], Any]] = {
    "select": selection_from,
    "name": READERS["name"],
    **dict.fromkeys(("a", "b", "i", "j", "k"), vertex_from),
    **dict.fromkeys(("to", "offset", "direction", "normal", "rotation"), _vector),
    **dict.fromkeys(("length", "height", "ratio", "angle", "weight"), number_from),
    "axis": READERS["axis"],
}


def constraints_from(asked: Asked) -> list[ConstraintSpec]:
    """The constraints of a recipe, and those of the command line."""
    made = []
    for number, table in enumerate(asked.recipe.constraints):
        where, options = f"constraints[{number}]", dict(table)
        kind = options.pop("kind", None)
        if not isinstance(kind, str):
            raise InputError("there is no kind", where=where, fix='add a line as kind = "centroid"')
        made.append(constraint_from(kind, options, where, asked.recipe.folder))
    return made + [parse_constraint(kind, text, f"--constraint {kind!r}") for kind, text in asked.constraints]
