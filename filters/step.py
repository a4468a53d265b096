"""A step of a chain: a filter's name and its parameters as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

__all__ = ["Step"]


@dataclass(frozen=True)
class Step:
    """A filter, MeshLab's or one of ours, and the parameters that are given; the others have their defaults.

    Lengths are a pymeshlab.PercentageValue or a text as "5%", or a number in the unit of the mesh. A Chain turns all
    values into plain data.
    """

    filter: str
    parameters: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
