"""What a piece of code launches, kernel by kernel, with the bytes that each launch cannot avoid to move."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import warp as wp


@dataclass(frozen=True, eq=False)
class Launch:
    """One kernel launch, to be launched again at will."""

    kernel: str
    size: int
    """Rows that it works on."""
    bytes: int
    """Of every array that goes in and of every array that comes out, each once; one that does both counts twice."""
    again: Callable[[], None]


def recorded(work: Callable[[], None]) -> list[Launch]:
    """Runs `work` and returns its launches in order, those of wp.launch and of wp.launch_tiled."""
    found: list[Launch] = []
    plain = {name: getattr(wp, name) for name in ("launch", "launch_tiled")}

    def listening(launch: Callable[..., Any]) -> Callable[..., Any]:
        def call(kernel: Any, dim: Any, inputs: Any = (), outputs: Any = (), **options: Any) -> Any:
            def again() -> None:
                launch(kernel, dim=dim, inputs=inputs, outputs=outputs, **options)

            names = _output_names(kernel, len(outputs))
            both = [array for array, name in zip(outputs, names, strict=True) if reads(kernel, name)]
            moved = array_bytes([*inputs, *both]) + array_bytes(outputs)
            found.append(Launch(kernel.func.__name__.lstrip("_"), _rows(dim, [*inputs, *outputs]), moved, again))
            return again()

        return call

    try:
        for name, launch in plain.items():
            setattr(wp, name, listening(launch))
        work()
    finally:
        for name, launch in plain.items():
            setattr(wp, name, launch)
    return found


def array_bytes(things: Iterable[Any]) -> int:
    """Bytes of the Warp arrays among the arguments, each array once."""
    arrays = {a.ptr: a for a in things if isinstance(a, wp.array) and a.size}
    return sum(a.size * wp.types.type_size_in_bytes(a.dtype) for a in arrays.values())


def _rows(dim: Any, arguments: list[Any]) -> int:
    """Threads of a plain launch; of one by chunks, whose lanes stride over nodes, the longest array of vectors."""
    if isinstance(dim, int):
        return dim
    vectors = (wp.vec3, wp.vec3d)
    return max((a.shape[0] for a in arguments if isinstance(a, wp.array) and a.dtype in vectors), default=0)


def _output_names(kernel: Any, count: int) -> list[str]:
    names = [argument.label for argument in kernel.adj.args]
    return names[len(names) - count :]


def reads(kernel: Any, name: str) -> bool:
    """Whether a kernel also reads an output: `name[` on the right of an assignment, or a +=."""
    for line in kernel.adj.source.splitlines():
        left, _, right = line.partition("=")
        if re.search(rf"\b{name}\[", right) or (re.search(rf"\b{name}\[", left) and left.rstrip().endswith(("+", "-"))):
            return True
    return False
