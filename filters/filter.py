"""A filter: a name, a help text, parameters, and what it does to the current mesh of a MeshSet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from oneform_warp.errors import InputError
from oneform_warp.filters.parameters import Parameter

__all__ = ["Filter", "nearest"]


@dataclass(frozen=True)
class Filter:
    """A filter beside MeshLab's own, named after pymeshlab's families.

    `apply(mesh_set, **values)` gets every parameter, checked, lengths in the unit of the current mesh, and may return
    a mapping of results, as pymeshlab's filters do. It raises InputError for what cannot be used, and warns
    OneFormWarning for what the user should look at. A package offers its filters through the entry-point group
    "oneform_warp.filters".
    """

    name: str
    help: str
    parameters: tuple[Parameter, ...]
    apply: Callable[..., Mapping[str, Any] | None]

    def plain(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Given values as plain data, in the order of the parameters; InputError for a name or value that is none."""
        known = {parameter.name: parameter for parameter in self.parameters}
        for name in given:
            if name not in known:
                raise InputError(f"{self.name} has no parameter {name!r}", where=name, fix=nearest(name, known))
        return {name: parameter.plain(given[name]) for name, parameter in known.items() if name in given}

    def values(self, given: Mapping[str, Any], diagonal: float) -> dict[str, Any]:
        """What `apply` gets on a mesh whose bounding box has this diagonal: given values and defaults."""
        plain = {each.name: each.plain(each.default) for each in self.parameters} | self.plain(given)
        return {each.name: each.on(plain[each.name], diagonal) for each in self.parameters}

    def describe(self) -> str:
        """The help text and the parameters, as pymeshlab prints them."""
        lines = [f"\t{each.name} : {each.describe()}\n\t\t{each.help}" for each in self.parameters] or ["\tNone."]
        return "\n".join([self.help, f"{self.name} filter - list of parameter names:", *lines])


def nearest(name: str, known: Mapping[str, Any]) -> str:
    """What to do about a name that is not known."""
    if not known:
        return "give none"
    return f"did you mean {get_close_matches(name, known, n=1, cutoff=0.0)[0]!r}? known: {', '.join(known)}"
