"""ARAP on a rest pose: the cells are made once, and serve every refinement."""

from __future__ import annotations

from typing import Any

import warp as wp

from oneform_warp.arap import Arap, Refined, alternate, field_rotations
from oneform_warp.arap_energy import CellEnergy
from oneform_warp.cells import Cells
from oneform_warp.errors import InputError
from oneform_warp.fields import NodeFields
from oneform_warp.grip import Grip
from oneform_warp.rest import Rest
from oneform_warp.smoothness import Smoothness
from oneform_warp.solvers import State

__all__ = ["Refiner"]


class Refiner:
    """Refines deformations of one rest pose."""

    def __init__(self, rest: Rest) -> None:
        self.rest = rest
        self._cells: dict[str, Cells] = {}

    def refined(
        self, arap: Arap, grip: Grip, state: State, x: Any, v: wp.array[wp.vec3d], nodes: NodeFields, target: Any
    ) -> Refined:
        """ARAP from positions x (n,) that integrate the 1-form v (m,) of the fields; target: (n,), of attached nodes.

        Raises InputError for a line.
        """
        graph, rest = grip.graph, self.rest
        if rest.dimension == 1:
            raise InputError("a line has no rotations to refine", where="refine", fix="use refine=0")
        if arap.cells not in self._cells:
            self._cells[arap.cells] = arap.cells_of(graph, rest.x)
        form = nodes.unturned().form(graph, rest.x)
        smoothness = Smoothness.of(graph, form, arap.smooth) if arap.smooth else None
        energy = CellEnergy(
            self._cells[arap.cells],
            form,
            state,
            target,
            grip.turned_alone,
            planar=rest.dimension == 2,
            smoothness=smoothness,
        )
        return alternate(energy, state, x, v, field_rotations(nodes.omega), arap)
