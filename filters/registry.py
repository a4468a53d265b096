"""The filters that are known beside MeshLab's: this package's, and those that other packages offer."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points

from oneform_warp.errors import OneFormWarning
from oneform_warp.filters.constraint_filters import CLEAR_CONSTRAINTS, SET_CONSTRAINT
from oneform_warp.filters.deformation import DEFORMATION, INTEGRATION, RESET
from oneform_warp.filters.filter import Filter
from oneform_warp.filters.handle_filters import CLEAR_HANDLES, PRINT_HANDLES, SET_HANDLE
from oneform_warp.filters.measures import MEASURES
from oneform_warp.filters.native import native_filters
from oneform_warp.filters.presets import PRESET_FILTERS
from oneform_warp.filters.scalar_field import SCALAR_FIELD
from oneform_warp.filters.survey_files import SURVEY_HANDLES

__all__ = ["GROUP", "own_filters"]

GROUP = "oneform_warp.filters"
"""The entry-point group: each entry is a Filter, or an iterable of filters."""

BUILT_IN = (
    *(SET_HANDLE, SURVEY_HANDLES, CLEAR_HANDLES, PRINT_HANDLES, SET_CONSTRAINT, CLEAR_CONSTRAINTS),
    *(DEFORMATION, INTEGRATION, *PRESET_FILTERS, RESET),
    *(SCALAR_FIELD, MEASURES),
)


@cache
def own_filters() -> Mapping[str, Filter]:
    """All filters that are not pymeshlab's, by name; warns OneFormWarning of entries that cannot be used."""
    found = {each.name: each for each in BUILT_IN}
    for entry in entry_points(group=GROUP):
        for each in _offered(entry):
            if each.name in found or each.name in native_filters():
                _warn(entry, f"there is already a filter {each.name!r}")
            else:
                found[each.name] = each
    return found


def _offered(entry: EntryPoint) -> Iterator[Filter]:
    """The filters of one entry point; another package's mistake must not keep this one from working."""
    try:
        loaded = entry.load()
        offered = [loaded] if isinstance(loaded, Filter) else list(loaded)
    except Exception as error:  # noqa: BLE001 - whatever another package raises
        _warn(entry, str(error) or type(error).__name__)
        return
    for each in offered:
        if isinstance(each, Filter):
            yield each
        else:
            _warn(entry, f"{each!r} is not a Filter")


def _warn(entry: EntryPoint, reason: str) -> None:
    warnings.warn(f"filters of {entry.value!r} are left out: {reason}", OneFormWarning, stacklevel=4)
