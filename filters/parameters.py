"""What a filter can be told: typed parameters with bounds, checked once and never clamped."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from oneform_warp.errors import InputError

__all__ = ["Choice", "ColorValue", "Flag", "Length", "Number", "Parameter", "Text", "Vector", "Whole"]

PERCENTAGE = re.compile(r"\s*([+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)\s*%\s*")


@dataclass(frozen=True)
class Parameter(ABC):
    """A named value of a filter; `help` is one sentence for the user, `default` is a plain value."""

    name: str
    default: Any
    help: str
    rich: ClassVar[str]
    """MeshLab's name of the type in a filter script."""

    @abstractmethod
    def plain(self, value: Any) -> Any:
        """The value as plain data (bool, int, float, str, tuple); InputError where it is of another type or range."""

    def on(self, plain: Any, diagonal: float) -> Any:
        """A plain value as the filter gets it on a mesh whose bounding box has this diagonal."""
        return plain

    def attributes(self, plain: Any) -> Mapping[str, str]:
        """A plain value as the attributes of a filter script."""
        return {"value": str(plain)}

    @abstractmethod
    def describe(self) -> str:
        """Type, default and bounds in pymeshlab's words."""

    def _wrong(self, value: Any, wanted: str) -> InputError:
        return InputError(f"{self.name} is {value!r}", where=self.name, fix=f"give {wanted}")


@dataclass(frozen=True)
class Flag(Parameter):
    """True or false."""

    rich = "RichBool"

    def plain(self, value: Any) -> bool:
        """See Parameter."""
        if not isinstance(value, bool | np.bool_):
            raise self._wrong(value, "true or false")
        return bool(value)

    def attributes(self, plain: Any) -> Mapping[str, str]:
        """See Parameter."""
        return {"value": "true" if plain else "false"}

    def describe(self) -> str:
        """See Parameter."""
        return f"bool = {self.default}"


@dataclass(frozen=True)
class Number(Parameter):
    """A finite number from `low` to `high`; `above` leaves `low` itself out."""

    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    rich = "RichFloat"

    def plain(self, value: Any) -> float:
        """See Parameter."""
        is_number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value) or not self._inside(float(value)):
            raise self._wrong(value, f"a number{self._range()}")
        return float(value)

    def _inside(self, value: float) -> bool:
        return (self.low < value if self.above else self.low <= value) and value <= self.high

    def _range(self) -> str:
        low = "" if self.low == -math.inf else f" {'>' if self.above else '>='} {self.low:g}"
        high = "" if self.high == math.inf else f" <= {self.high:g}"
        return " and".join(part for part in (low, high) if part)

    def attributes(self, plain: Any) -> Mapping[str, str]:
        """See Parameter."""
        return {"value": repr(plain)}

    def describe(self) -> str:
        """See Parameter."""
        return _bounded("float", self.default, self.low, self.high)


@dataclass(frozen=True)
class Whole(Parameter):
    """A whole number from `low` to `high`."""

    low: float = -math.inf
    high: float = math.inf
    rich = "RichInt"

    def plain(self, value: Any) -> int:
        """See Parameter."""
        is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
        if not is_whole or not self.low <= value <= self.high:
            high = "" if self.high == math.inf else f" and <= {self.high:g}"
            low = "" if self.low == -math.inf else f" >= {self.low:g}"
            raise self._wrong(value, f"a whole number{low}{high}")
        return int(value)

    def describe(self) -> str:
        """See Parameter."""
        return _bounded("int", self.default, self.low, self.high)


@dataclass(frozen=True)
class Text(Parameter):
    """A text."""

    rich = "RichString"

    def plain(self, value: Any) -> str:
        """See Parameter."""
        if not isinstance(value, str):
            raise self._wrong(value, "a text")
        return value

    def describe(self) -> str:
        """See Parameter."""
        return f"str = {self.default!r}"


@dataclass(frozen=True)
class Choice(Parameter):
    """One of a few words, or its number among them, as in pymeshlab."""

    words: tuple[str, ...] = ()
    rich = "RichEnum"

    def plain(self, value: Any) -> str:
        """See Parameter."""
        if isinstance(value, int | np.integer) and not isinstance(value, bool) and 0 <= value < len(self.words):
            return self.words[value]
        if value not in self.words:
            raise self._wrong(value, "one of " + "; ".join(map(repr, self.words)))
        return str(value)

    def attributes(self, plain: Any) -> Mapping[str, str]:
        """See Parameter."""
        words = {f"enum_val{number}": word for number, word in enumerate(self.words)}
        return {"value": str(self.words.index(plain)), "enum_cardinality": str(len(self.words)), **words}

    def describe(self) -> str:
        """See Parameter."""
        return f"str = {self.default!r} [{'; '.join(map(repr, self.words))}]"


@dataclass(frozen=True)
class Vector(Parameter):
    """Three finite numbers."""

    rich = "RichDirection"

    def plain(self, value: Any) -> tuple[float, ...]:
        """See Parameter."""
        try:
            vector = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            vector = np.zeros(0)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise self._wrong(value, "three finite numbers")
        return tuple(vector.tolist())

    def attributes(self, plain: Any) -> Mapping[str, str]:
        """See Parameter."""
        return {axis: repr(number) for axis, number in zip("xyz", plain, strict=True)}

    def describe(self) -> str:
        """See Parameter."""
        return f"numpy.ndarray[numpy.float64[3]] = [{', '.join(f'{number:g}' for number in self.default)}]"


@dataclass(frozen=True)
class ColorValue(Parameter):
    """Red, green, blue and alpha, whole numbers 0..255; alpha may be left out."""

    rich = "RichColor"

    def plain(self, value: Any) -> tuple[int, ...]:
        """See Parameter."""
        color = value if isinstance(value, tuple | list | np.ndarray) else _channels(value)
        if len(color) not in (3, 4) or not all(_is_byte(each) for each in color):
            raise self._wrong(value, "three or four whole numbers 0..255")
        return tuple(int(each) for each in color) + (255,) * (4 - len(color))

    def attributes(self, plain: Any) -> Mapping[str, str]:
        """See Parameter."""
        return {channel: str(number) for channel, number in zip("rgba", plain, strict=True)}

    def describe(self) -> str:
        """See Parameter."""
        return f"Color = [{'; '.join(map(str, self.default))}]"


@dataclass(frozen=True)
class Length(Parameter):
    """A length >= 0: a PercentageValue (or "5%") of the bounding box's diagonal, or a PureValue (or a number)."""

    above: bool = False
    """Whether 0 is not a length."""
    rich = "RichAbsPerc"

    def plain(self, value: Any) -> float | str:
        """See Parameter."""
        length = _length(value)
        number = _percent(length)
        number = length if number is None else number
        is_number = isinstance(number, int | float | np.number) and not isinstance(number, bool)
        if not is_number or not math.isfinite(number) or number < 0 or (self.above and number == 0):
            raise self._wrong(value, f'a length {">" if self.above else ">="} 0, or a percentage as "5%"')
        return _percentage(number) if isinstance(length, str) else float(number)

    def on(self, plain: Any, diagonal: float) -> float:
        """The length itself."""
        percent = _percent(plain)
        return float(plain) if percent is None else percent / 100.0 * diagonal

    def attributes(self, plain: Any) -> Mapping[str, str]:
        """See Parameter."""
        return {"value": plain if isinstance(plain, str) else repr(plain)}

    def describe(self) -> str:
        """See Parameter."""
        return f"PercentageValue = {self.default}"


def _percentage(number: Any) -> str:
    """5.0 -> "5%", with all digits that a number has."""
    return repr(float(number)).removesuffix(".0") + "%"


def _percent(value: Any) -> float | None:
    """The number of a text such as "5%"."""
    match = PERCENTAGE.fullmatch(value) if isinstance(value, str) else None
    return None if match is None else float(match[1])


def _length(value: Any) -> Any:
    """pymeshlab's PercentageValue and PureValue as plain data."""
    kind = type(value).__name__
    if kind == "PercentageValue":
        return _percentage(value.value())
    return value.value() if kind == "PureValue" else value


def _channels(value: Any) -> tuple[Any, ...]:
    """The channels of a pymeshlab.Color."""
    readers = [getattr(value, channel, None) for channel in ("red", "green", "blue", "alpha")]
    return tuple(reader() for reader in readers if callable(reader))


def _is_byte(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(0 <= value <= 255)


def _bounded(kind: str, default: Any, low: float, high: float) -> str:
    """As pymeshlab prints numbers: bounds only where there are any."""
    if (low, high) == (-math.inf, math.inf):
        return f"{kind} = {default:g}"
    return f"{kind} (bounded) = {default:g} [min: {low:g}; max: {high:g}]"
