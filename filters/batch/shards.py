"""One part of a batch that is divided among machines."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from oneform_warp.errors import InputError

__all__ = ["Shard"]

T = TypeVar("T")


@dataclass(frozen=True)
class Shard:
    """Part `number` of `count`, counted from 1; the whole is part 1 of 1."""

    number: int = 1
    count: int = 1

    @classmethod
    def parsed(cls, text: str) -> "Shard":
        """A shard from "3/8"."""
        found = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
        if not found or not 1 <= int(found[1]) <= int(found[2]):
            raise InputError(f"{text!r} is no shard", where="shard", fix="write I/N with I from 1 to N, as 3/8")
        return cls(int(found[1]), int(found[2]))

    @property
    def suffix(self) -> str:
        """What the shard's own files are told apart by."""
        return f"-{self.number}-of-{self.count}" if self.count > 1 else ""

    def of(self, items: Sequence[T]) -> list[T]:
        """Every `count`-th item: neighbours, which are often alike in size, go to different machines."""
        return list(items[self.number - 1 :: self.count])
