"""What constraints need to be solved again and again: how the graph gives way to them, for one set of pins."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.assembly import gather
from oneform_warp.solvers.constrained.equations import Equations
from oneform_warp.solvers.constrained.plan import Plan
from oneform_warp.solvers.constrained.response import Response
from oneform_warp.solvers.constrained.schur import Constants, Schur
from oneform_warp.solvers.refinement import State

__all__ = ["ConstrainedState"]

Floats = NDArray[np.float64]


@wp.kernel(enable_backward=False)
def _moved(
    # Graph:
    component: wp.array[wp.int32],
    # In:
    x: wp.array[wp.vec3d],
    e: wp.array[wp.vec3d],
    shift: wp.array[wp.vec3d],
    # Out:
    x_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    x_out[i] = x[i] + e[i] + shift[component[i]]


@dataclass(frozen=True, eq=False)
class ConstrainedState(State):
    """The state of a solver without the constraints, and what they add to it.

    The scalar forms are solved for once; directions, right-hand sides and weights of rows only mix them.
    """

    base: State
    equations: Equations
    response: Response
    pinned: NDArray[np.bool_]
    """Of the touched nodes, (touched,)."""
    nodes: wp.array[wp.int32]
    """The touched nodes, on the device."""
    table: Floats
    """<form_p, L^-1 form_q> of the scalar forms, (k, k)."""
    loose: Constants
    known: tuple[Plan, Schur] | None
    """None where rows follow a direction of the deformed shape."""

    @classmethod
    def of(cls, base: State, equations: Equations, pinned: NDArray[np.bool_], tol: float) -> ConstrainedState:
        """pinned: (n,) mask of nodes. tol: of the response to each scalar form."""
        nodes, forms = equations.nodes, equations.scalar_columns.forms
        response = Response(base, tol)
        state = cls(
            system=base.system,
            inner=base.inner,
            base=base,
            equations=equations,
            response=response,
            pinned=pinned[nodes],
            nodes=wp.array(nodes, dtype=wp.int32, device=base.system.graph.device),
            table=response.to_forms(forms, nodes),
            loose=Constants.of(base.system, pinned, nodes, forms),
            known=None,
        )
        return state if equations.follows else replace(state, known=state._plan(np.ones((equations.count, 3))))

    def asking(self, equations: Equations) -> ConstrainedState:
        """The state for the same rows with another d: nothing is solved for."""
        known = None if self.known is None else (self.known[0].asking(equations), self.known[1])
        return replace(self, equations=equations, known=known)

    @property
    def floating(self) -> NDArray[np.bool_]:
        """None: what floats is dealt with together with the constraints."""
        return np.zeros_like(self.base.floating)

    def at(self, x: wp.array[wp.vec3d]) -> Floats:
        """The touched nodes' rows, on the host."""
        rows: Floats = gather(x, self.nodes).numpy()
        return rows

    def plan(self, x: wp.array[wp.vec3d]) -> tuple[Plan, Schur]:
        """The rows and their multipliers' system, directions taken from positions x (n,)."""
        return self.known or self._plan(self.equations.factors(self.at(x)))

    def _plan(self, factors: Floats) -> tuple[Plan, Schur]:
        plan = Plan.of(self.equations, factors, self.pinned)
        mixing = self.equations.scalar_columns.mixing * factors.reshape(-1, 1)
        return plan, plan.schur(mixing.tocsr(), self.table, self.loose)

    def held(self, x: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
        """X - L^-1 C^T lambda, the minimiser under the constraints where x (n,) is the one without them."""
        plan, schur = self.plan(x)
        multipliers, translations = schur.solve(plan.misfit(self.at(x)))
        return self.pushed(x, plan.load(multipliers), translations)

    def pushed(self, x: wp.array[wp.vec3d], load: Floats, translations: Floats) -> wp.array[wp.vec3d]:
        """X less what a load (touched, 3) does, and loose components (f, 3) translated."""
        graph = self.system.graph
        on_nodes: wp.array[wp.vec3d] = wp.zeros_like(x)
        self.response.add_load(on_nodes, self.nodes, -load)
        shift = np.zeros((graph.component_count, 3))
        shift[self.loose.components] = translations
        return self._moved(x, on_nodes, shift)

    def relaxed(self, x: wp.array[wp.vec3d], r: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
        """X + L^-1 r, for a residual r (n,)."""
        return self._moved(x, r, np.zeros((self.system.graph.component_count, 3)))

    def _moved(self, x: wp.array[wp.vec3d], load: wp.array[wp.vec3d], shift: Floats) -> wp.array[wp.vec3d]:
        moved = wp.empty_like(x)
        by = wp.array(shift, dtype=wp.vec3d, device=x.device)
        inputs = [self.system.graph.component_of_node, x, self.response.displacement(load), by]
        wp.launch(_moved, dim=x.shape[0], inputs=inputs, outputs=[moved], device=x.device)
        return moved

    @property
    def pulls(self) -> bool:
        """Whether some rows are soft."""
        return bool(self.equations.compliance.any())

    def soft_energy(self, x: wp.array[wp.vec3d]) -> float:
        """sum w (C x - d)^2 over the soft rows."""
        plan, _ = self.plan(x)
        return float(plan.pull(self.at(x)) @ plan.misfit(self.at(x)))

    def add_soft_pull(self, x: wp.array[wp.vec3d], r: wp.array[wp.vec3d]) -> None:
        """Adds -w C^T (C x - d), half of the downhill gradient of the same, to r (n,), in place."""
        plan, _ = self.plan(x)
        self.response.add_load(r, self.nodes, -plan.load(plan.pull(self.at(x))))
