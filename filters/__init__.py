"""Mesh files in and out of the deformer, and filters in pymeshlab's style: what needs MeshLab or trimesh."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from oneform_warp.filters.meshfile import MeshFile, read_mesh

if TYPE_CHECKING:
    from oneform_warp.filters.chain import Chain, ChainReport
    from oneform_warp.filters.filter import Filter
    from oneform_warp.filters.listing import filter_list, print_filter_list, print_filter_parameter_list
    from oneform_warp.filters.meshset import MeshSet
    from oneform_warp.filters.step import Step

_HOME = {
    "chain": ["Chain", "ChainReport"],
    "filter": ["Filter"],
    "listing": ["filter_list", "print_filter_list", "print_filter_parameter_list"],
    "meshset": ["MeshSet"],
    "step": ["Step"],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Chain",
    "ChainReport",
    "Filter",
    "MeshFile",
    "MeshSet",
    "Step",
    "filter_list",
    "print_filter_list",
    "print_filter_parameter_list",
    "read_mesh",
]


def __getattr__(name: str) -> Any:
    # Reading a file should not wait for Warp.
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"oneform_warp.filters.{_MODULE_OF[name]}"), name)
