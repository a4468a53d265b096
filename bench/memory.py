"""Bytes on the device: the Warp arrays that can be reached from an object, each counted once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from typing import Any

import warp as wp


def device_bytes(*roots: Any) -> int:
    """The sum over all wp.arrays reachable through attributes, lists, tuples and dictionaries."""
    arrays: dict[int, int] = {}
    seen: set[int] = set()
    waiting = list(roots)
    while waiting:
        thing = waiting.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, wp.array):
            if thing.ptr:
                arrays[thing.ptr] = max(arrays.get(thing.ptr, 0), thing.size * wp.types.type_size_in_bytes(thing.dtype))
        else:
            waiting.extend(_parts(thing))
    return sum(arrays.values())


def _parts(thing: Any) -> Iterable[Any]:
    if isinstance(thing, list | tuple | set):
        return thing
    if isinstance(thing, dict):
        return thing.values()
    if is_dataclass(thing) and not isinstance(thing, type):
        return [getattr(thing, f.name) for f in fields(thing)]
    ours = type(thing).__module__.startswith("oneform_warp")
    return vars(thing).values() if ours and hasattr(thing, "__dict__") else []
