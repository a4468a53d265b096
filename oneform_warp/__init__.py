"""Deform meshes by integrating vector-valued 1-forms, on NVIDIA Warp.

    import oneform_warp as ow

    x, faces = ow.shapes.bar()
    z = x[:, 2]
    handles = [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, axis="z", angle=180)]
    y = ow.deform(x, faces, handles)

Names load on first use, so importing the package initialises nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oneform_warp import constraints as constraints
    from oneform_warp import filters as filters
    from oneform_warp import presets as presets
    from oneform_warp import shapes as shapes
    from oneform_warp.arap import Arap
    from oneform_warp.deformation import Deformation
    from oneform_warp.deformer import Deformer, deform
    from oneform_warp.deformers import Deformations, Deformers
    from oneform_warp.errors import FileError, InputError, NotConverged, OneFormWarning
    from oneform_warp.exactness import cycle_residual, is_exact, path_integral
    from oneform_warp.falloff import Biharmonic, Geodesic, Painted, Smoothing
    from oneform_warp.fields import Fields, smooth_fields
    from oneform_warp.forms import codifferential, differential, edge_energy, energy, transform
    from oneform_warp.geodesics import geodesic_distance
    from oneform_warp.graph import Graph
    from oneform_warp.handles import Handle
    from oneform_warp.sequences import Keyframes
    from oneform_warp.solvers import CG, Cholmod, CuDSS, Jacobi, Multigrid, Solution, Status, SuperLU, solve
    from oneform_warp.symmetry import mirror
    from oneform_warp.tree import SpanningTree, integrate_tree, spanning_tree

__version__ = "0.1.0"

_HOME = {
    "arap": ["Arap"],
    "deformation": ["Deformation"],
    "deformer": ["Deformer", "deform"],
    "deformers": ["Deformations", "Deformers"],
    "errors": ["FileError", "InputError", "NotConverged", "OneFormWarning"],
    "exactness": ["cycle_residual", "is_exact", "path_integral"],
    "falloff": ["Biharmonic", "Geodesic", "Painted", "Smoothing"],
    "fields": ["Fields", "smooth_fields"],
    "forms": ["codifferential", "differential", "edge_energy", "energy", "transform"],
    "geodesics": ["geodesic_distance"],
    "graph": ["Graph"],
    "handles": ["Handle"],
    "sequences": ["Keyframes"],
    "solvers": ["CG", "Cholmod", "CuDSS", "Jacobi", "Multigrid", "Solution", "Status", "SuperLU", "solve"],
    "symmetry": ["mirror"],
    "tree": ["SpanningTree", "integrate_tree", "spanning_tree"],
}
_MODULES = ("constraints", "presets", "shapes")
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "CG",
    "Arap",
    "Biharmonic",
    "Cholmod",
    "CuDSS",
    "Deformation",
    "Deformations",
    "Deformer",
    "Deformers",
    "Fields",
    "FileError",
    "Geodesic",
    "Graph",
    "Handle",
    "InputError",
    "Jacobi",
    "Keyframes",
    "Multigrid",
    "NotConverged",
    "OneFormWarning",
    "Painted",
    "Smoothing",
    "Solution",
    "SpanningTree",
    "Status",
    "SuperLU",
    "codifferential",
    "constraints",
    "cycle_residual",
    "deform",
    "differential",
    "edge_energy",
    "energy",
    "geodesic_distance",
    "integrate_tree",
    "is_exact",
    "mirror",
    "path_integral",
    "presets",
    "shapes",
    "smooth_fields",
    "solve",
    "spanning_tree",
    "transform",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"oneform_warp.{name}")
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"oneform_warp.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__", "filters"]
