"""Linear constraints C x = d on the positions, over any solver: multipliers by the Schur complement C A^-1 C^T."""

from oneform_warp.solvers.constrained.constrained import Constrained, ConstrainedSolution
from oneform_warp.solvers.constrained.equations import Equations
from oneform_warp.solvers.constrained.state import ConstrainedState

__all__ = ["Constrained", "ConstrainedSolution", "ConstrainedState", "Equations"]
