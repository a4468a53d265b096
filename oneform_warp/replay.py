"""Launches recorded and made again with other arrays: on small meshes preparing one takes as long as its work."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import warp as wp

__all__ = ["Replay"]


class Replay:
    """A recorded launch, some of whose arrays change."""

    def __init__(self, launch: wp.Launch, changing: Sequence[str], keep: Sequence[Any]) -> None:
        """changing: names of the kernel's arguments; keep: arrays that have to live as long as this."""
        names = [argument.label for argument in launch.kernel.adj.args]
        self.launch, self.places, self.keep = launch, [names.index(name) for name in changing], tuple(keep)

    def __call__(self, *arrays: wp.array[Any]) -> None:
        """The launch with these in place of what changes; they are not kept."""
        for place, array in zip(self.places, arrays, strict=True):
            self.launch.set_param_at_index_from_ctype(place, array.__ctype__())
        self.launch.launch()
