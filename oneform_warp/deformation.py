"""What a Deformer returns: the positions and everything on the way to them, fetched from the device when asked for."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arap import Refined, nearest_vectors
from oneform_warp.fields import Fields, NodeFields
from oneform_warp.forms import node_energy
from oneform_warp.graph import Graph
from oneform_warp.grip import Grip
from oneform_warp.notes import bare_notes, field_notes, is_misfit, misfit_notes, place_notes, turn_notes
from oneform_warp.places import Places
from oneform_warp.rest import Rest
from oneform_warp.solvers import Solution, Status

if TYPE_CHECKING:
    from oneform_warp.solvers.constrained import Equations

__all__ = ["Deformation", "Stages"]


class Stages:
    """When each stage ended: on a GPU by events in its queue, so that nobody waits for the clock."""

    def __init__(self, device: Any) -> None:
        self.device = device
        self._names: list[str] = []
        self._ends = [self._now()]

    def stop(self, stage: str) -> None:
        """The stage ends here, and the next one begins."""
        self._names.append(stage)
        self._ends.append(self._now())

    @cached_property
    def seconds(self) -> dict[str, float]:
        """The time from each end to the next; waits for the device."""
        spans = zip(self._ends[:-1], self._ends[1:], strict=True)
        return {name: self._between(*span) for name, span in zip(self._names, spans, strict=True)}

    def _now(self) -> Any:
        if not self.device.is_cuda:
            return time.perf_counter()
        return wp.record_event(wp.Event(self.device, enable_timing=True))

    def _between(self, begin: Any, end: Any) -> float:
        if not self.device.is_cuda:
            return float(end - begin)
        return 1.0e-3 * float(wp.get_event_elapsed_time(begin, end))


@dataclass(frozen=True, eq=False)
class Deformation:
    """A deformed mesh: `x` are the new positions, in the shape, dtype and kind of array of the rest positions.

    Residual, history and iterations are those of the positions; `status` is that of the fields where those did not
    converge. What is large, or takes a pass over the edges, is there when it is first asked for.
    """

    solution: Solution
    """Of the positions, per node, centred and scaled."""
    _grip: Grip | None
    """None where painted fields take the place of handles."""
    _places: Places | None
    _equations: Equations | None
    _predict: Callable[[], tuple[wp.array[wp.vec3d], NDArray[np.bool_]]]
    _nodes: NodeFields
    _form: wp.array[wp.vec3d]
    refined: Refined | None
    """The ARAP steps: energies, rotations per node, how they ended; None where there were none."""
    _begin: wp.array[wp.vec3d]
    _rest: Rest
    _stages: Stages

    @cached_property
    def x(self) -> Any:
        """The new positions."""
        x = self._rest.outside(self.solution.x)
        return x if self._places is None else self._places.correct(x)

    @property
    def graph(self) -> Graph:
        """What it was solved on."""
        return self._rest.graph

    @property
    def solutions(self) -> tuple[Solution, ...]:
        """Of the fields, where they needed solving, and of the positions."""
        return (*self._nodes.solutions, self.solution)

    @property
    def status(self) -> Status:
        """How the solve ended."""
        # Positions that fit unfinished fields have not arrived either.
        return next((s.status for s in self.solutions if not s.converged), self.solution.status)

    @property
    def converged(self) -> bool:
        """Whether the float64 residuals of fields and positions are small enough everywhere."""
        return self.status is Status.CONVERGED

    @property
    def iterations(self) -> int:
        """Iterations for the positions, over all restarts."""
        return self.solution.iterations

    @property
    def restarts(self) -> int:
        """Corrections after the first one."""
        return self.solution.restarts

    @property
    def residual(self) -> NDArray[np.float64]:
        """|codiff(v - dx)| over the free nodes, (components with edges, D columns), in the unit of x times mu."""
        return self.solution.residual[:, : self._rest.dimension] * self._rest.scale

    @property
    def goal(self) -> NDArray[np.float64]:
        """The residual at which a component's column is converged, same shape."""
        return self.solution.goal[:, : self._rest.dimension] * self._rest.scale

    @property
    def history(self) -> tuple[tuple[int, float], ...]:
        """(iterations so far, largest residual / goal) at every restart; on CPU, or watched, also between."""
        return self.solution.history

    @property
    def seconds(self) -> dict[str, float]:
        """The time of each stage."""
        return self._stages.seconds

    @cached_property
    def _energy(self) -> tuple[float, float]:
        return node_energy(self._rest.graph, self.solution.x, self._form)

    @property
    def energy(self) -> float:
        """phi(x) = sum mu_ij |x_j - x_i - v_ij|^2, in squared units of x."""
        return self._energy[0] * self._rest.scale**2

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What the user should look at."""
        notes = field_notes(self._rest.graph, self._nodes)
        if self._grip is not None:
            notes += bare_notes(self._grip)
        asked = self.refined is None and self._places is not None  # refining asks the targets for the rotations
        if asked and self._grip is not None and is_misfit(*self._energy):
            notes += place_notes(self._grip, self.misses, self._rest.diagonal)
        if self._equations is not None:
            from oneform_warp.equations import constraint_notes

            notes += constraint_notes(self._equations, self.solution)
        if self.refined is not None and self._grip is not None:
            notes += turn_notes(self._grip)
        return (*notes, *misfit_notes(*self._energy))

    @property
    def misfits(self) -> dict[str, float]:
        """The largest |C x - d| of each constraint, by name, in the unit of x."""
        if self._equations is None:
            return {}
        from oneform_warp.equations import misfits

        return misfits(self._equations, self.solution, self._rest)

    @cached_property
    def misses(self) -> dict[int, float]:
        """How far each moved handle is from where its rotations alone would bring it, by number, in the unit of x.

        The mean over its vertices, relative to what is held, or to the first handle. Takes another solve.
        """
        if self._places is None:
            return {}
        predicted, given = self._predict()
        return self._places.misses(predicted, given, self._rest)

    @cached_property
    def fields(self) -> Fields:
        """omega and sigma per vertex; after a refinement omega is that of the rotations that came of it."""
        fields = self._nodes.per_vertex(self._rest.graph, self._rest.dimension)
        if self.refined is None:
            return fields
        omega = self._rest.graph.vertices_from(self._nodes.omega)
        turns = nearest_vectors(self.refined.fit.rotation.numpy()[self._rest.graph.node_of], omega)
        return replace(fields, omega=turns[:, 2] if self._rest.dimension == 2 else turns)

    @property
    def omega(self) -> Any:
        """The rotation vectors in radians, (V, 3); D = 2: angles (V,); D = 1: None."""
        return self.fields.omega

    @property
    def sigma(self) -> Any:
        """The stretches, (V,); of those with directions the geometric mean of the factors."""
        return self.fields.sigma

    @property
    def stretch(self) -> Any:
        """The stretches as tensors S with v = R(omega) S dx, (V, D, D); None where no handle has three factors."""
        return self.fields.stretch

    @cached_property
    def v(self) -> NDArray[np.float64]:
        """The 1-form, (m, D) on `graph.edges`, in the unit of x."""
        form: NDArray[np.float64] = self._form.numpy()[:, : self._rest.dimension] * self._rest.scale
        return form

    @cached_property
    def estimate(self) -> Any:
        """The start that the solver improved, like x; with start="maximal" the paper's tree estimate."""
        return self._rest.outside(self._begin)
