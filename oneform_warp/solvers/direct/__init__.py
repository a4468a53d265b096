"""Direct solvers: one factorisation per graph and set of pins, then a back-substitution per right-hand side."""

from oneform_warp.solvers.direct.cholmod import Cholmod
from oneform_warp.solvers.direct.cudss import CuDSS
from oneform_warp.solvers.direct.superlu import SuperLU

__all__ = ["Cholmod", "CuDSS", "SuperLU"]
