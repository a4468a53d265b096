"""Multigrid on the 1-form: smoothed aggregation, set up on the device."""

from oneform_warp.solvers.multigrid.hierarchy import Hierarchy, Structure, hierarchy, structure
from oneform_warp.solvers.multigrid.multigrid import Multigrid

__all__ = ["Hierarchy", "Multigrid", "Structure", "hierarchy", "structure"]
