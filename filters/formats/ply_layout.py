"""Where each number of a PLY file is: in bytes of a binary body, in words of a text."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from oneform_warp.filters.formats.text import Splice, Words

__all__ = ["Binary", "Body", "Column", "Columns", "Element", "Property", "Text", "walk"]

Places = NDArray[np.int64]


@dataclass(frozen=True)
class Property:
    """NumPy's type of a number, or of the items of a list and of their count."""

    type: str
    count: str | None


@dataclass(frozen=True)
class Element:
    """How many records there are, and what each has."""

    count: int
    properties: dict[str, Property]


@dataclass(frozen=True, eq=False)
class Column:
    """The places (n,) of a property, or of the first items of its lists, and the lengths of these."""

    places: Places
    counts: Places | int = 1


Columns = dict[str, Column]


class Body(ABC):
    """The numbers after the header; places count in its own units, from `begin` to `end`."""

    begin: int
    end: int

    @abstractmethod
    def size(self, kind: str) -> int:
        """The units that a number takes."""

    @abstractmethod
    def read(self, places: Places, kind: str, together: int = 1) -> NDArray[Any]:
        """The numbers (n, together) that stand one after the other from places (n,) on."""

    @abstractmethod
    def length(self, place: int, kind: str) -> int:
        """The one number at a place, where lists differ in length and come one by one."""

    @abstractmethod
    def changed(self, edits: Sequence[tuple[Places, NDArray[Any]]]) -> bytes:
        """The whole file with other numbers (n, k), of the file's type, that stand together from places (n,) on."""


class Text(Body):
    """Words, whatever the lines."""

    def __init__(self, data: bytes, start: int) -> None:
        self.words = Words(data, start)
        self.begin, self.end = 0, len(self.words)

    def size(self, kind: str) -> int:
        """A word."""
        return 1

    def read(self, places: Places, kind: str, together: int = 1) -> NDArray[Any]:
        """The words as numbers."""
        return self.words.floats(places[:, None] + np.arange(together))

    def length(self, place: int, kind: str) -> int:
        """The word as a number."""
        return int(self.words.data[self.words.starts[place] : self.words.ends[place]])

    def changed(self, edits: Sequence[tuple[Places, NDArray[Any]]]) -> bytes:
        """Numbers in the fewest digits."""
        splice = Splice()
        for places, values in edits:
            splice.respell(self.words, places[:, None] + np.arange(values.shape[1]), values)
        return splice.on(self.words.data)


class Binary(Body):
    """Bytes in one order."""

    def __init__(self, data: bytes, start: int, order: Literal["<", ">"]) -> None:
        self.data, self.order = data, order
        self.begin, self.end = start, len(data)

    def size(self, kind: str) -> int:
        """The type's own size."""
        return int(kind[1])

    def read(self, places: Places, kind: str, together: int = 1) -> NDArray[Any]:
        """The bytes as numbers."""
        size = self.size(kind) * together
        if len(places) and places.max() + size > self.end:
            raise ValueError("the file ends too early")
        taken = _pieces(self.data, size)[places]
        return taken.view(np.dtype(self.order + kind)).reshape(-1, together)

    def length(self, place: int, kind: str) -> int:
        """The bytes as a number."""
        taken = self.data[place : place + self.size(kind)]
        return int.from_bytes(taken, "big" if self.order == ">" else "little", signed=kind[0] == "i")

    def changed(self, edits: Sequence[tuple[Places, NDArray[Any]]]) -> bytes:
        """The numbers' own bytes."""
        data = bytearray(self.data)
        for places, values in edits:
            ordered = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder(self.order))
            size = ordered.itemsize * ordered.shape[1]
            _pieces(data, size)[places] = ordered.view(f"V{size}").ravel()
        return bytes(data)


def _pieces(data: bytes | bytearray, size: int) -> NDArray[np.void]:
    """Piece i are the `size` bytes from byte i on."""
    return np.ndarray((max(0, len(data) - size + 1),), dtype=f"V{size}", buffer=data, strides=(1,))


def walk(body: Body, element: Element, begin: int) -> tuple[Columns, int]:
    """The columns of an element whose records begin at a place, and where they end."""
    columns, width = _even(body, element, begin)
    end = begin + element.count * width
    lists = [name for name, each in element.properties.items() if each.count is not None]
    if end <= body.end and all(_is_even(body, element.properties[name], columns[name]) for name in lists):
        return columns, end
    if not lists:
        raise ValueError("the file ends too early")
    return _uneven(body, element, begin)


def _even(body: Body, element: Element, begin: int) -> tuple[Columns, int]:
    """The columns if all lists were as long as those of the first record, and the size of a record then."""
    at, lengths, first = begin, {}, {}
    for name, each in element.properties.items():
        if each.count is not None and element.count:
            lengths[name] = body.length(at, each.count) if at < body.end else 0
            at += body.size(each.count)
        first[name] = at
        at += lengths.get(name, 1 if each.count is None else 0) * body.size(each.type)
    steps = (at - begin) * np.arange(element.count)
    return {name: Column(place + steps, lengths.get(name, 1)) for name, place in first.items()}, at - begin


def _is_even(body: Body, property_: Property, column: Column) -> bool:
    """Whether the lists of a column are as long as that of the first record."""
    assert property_.count is not None
    counts = body.read(column.places - body.size(property_.count), property_.count)[:, 0]
    return bool((counts == column.counts).all())


def _uneven(body: Body, element: Element, begin: int) -> tuple[Columns, int]:
    """The columns of records that differ in size, one after the other."""
    sizes = {name: body.size(each.type) for name, each in element.properties.items()}
    places: dict[str, list[int]] = {name: [] for name in element.properties}
    counts: dict[str, list[int]] = {name: [] for name in element.properties}
    at = begin
    for _ in range(element.count):
        for name, each in element.properties.items():
            length = 1
            if each.count is not None:
                if at >= body.end:
                    raise ValueError("the file ends too early")
                length = body.length(at, each.count)
                at += body.size(each.count)
                counts[name].append(length)
            places[name].append(at)
            at += length * sizes[name]
        if at > body.end:
            raise ValueError("the file ends too early")
    return {
        name: Column(
            np.array(places[name], dtype=np.int64), np.array(counts[name], dtype=np.int64) if each.count else 1
        )
        for name, each in element.properties.items()
    }, at
