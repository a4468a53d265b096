"""pymeshlab's lists of filters, with those of this package and of others."""

from __future__ import annotations

import pymeshlab

from oneform_warp.filters.registry import own_filters

__all__ = ["filter_list", "print_filter_list", "print_filter_parameter_list"]


def filter_list() -> list[str]:
    """The names of all filters, MeshLab's and ours."""
    return sorted({*pymeshlab.filter_list(), *own_filters()})


def print_filter_list() -> None:
    """Prints the names of all filters."""
    print("\n".join(filter_list()))


def print_filter_parameter_list(name: str) -> None:
    """Prints a filter's help and parameters with types, defaults and bounds."""
    own = own_filters().get(name)
    if own is None:
        pymeshlab.print_filter_parameter_list(name)
    else:
        print(own.describe())
