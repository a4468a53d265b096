"""Falloffs: how what a handle sets spreads to the nodes that no handle has."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Any, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.biharmonic import biharmonic
from oneform_warp.errors import InputError
from oneform_warp.forms import vertex_areas
from oneform_warp.geodesics import Distances
from oneform_warp.grip import Pins
from oneform_warp.influence import influence
from oneform_warp.overlap import COLUMNS, Overlap
from oneform_warp.profiles import profile_at, profile_number
from oneform_warp.solvers import Jacobi, Solution, States

__all__ = ["Biharmonic", "Falloff", "Geodesic", "Painted", "Smoothing", "read_falloff"]

Spread = tuple[wp.array[wp.vec3d], tuple[Solution, ...]]
"""A 0-form per node, and the solves that made it."""


class Falloff(Protocol):
    """A way to spread by value: lengths in its fields are in the unit of x."""

    @property
    def measures(self) -> bool:
        """Whether it needs rest positions."""

    def scaled(self, scale: float) -> Falloff:
        """The same where positions are divided by scale."""

    def spread(self, pins: Pins, values: NDArray[np.float64], x: wp.array[wp.vec3d], states: States) -> Spread:
        """The 0-form with the values (handles, 3) at the pinned nodes; x: rest positions (n,)."""


@dataclass(frozen=True)
class Smoothing:
    """How far handles reach: to the harmonic limit, for a number of sweeps, or over a screening length.

    sweeps: damped Jacobi sweeps from zero, as strokes of a brush blur. length: in the unit of x; fields decay to the
    identity over it: (L + a / length^2) omega = 0 with the area a_i = 1/4 sum_j mu_ij |dx_ij|^2 of each vertex.
    """

    sweeps: int | None = None
    length: float | None = None

    def __post_init__(self) -> None:
        if self.sweeps is not None and self.length is not None:
            raise InputError("sweeps and length are both given", where="smoothing", fix="give one, or none")
        if self.sweeps is not None and (self.sweeps != int(self.sweeps) or self.sweeps < 0):
            raise InputError(f"sweeps is {self.sweeps!r}", where="smoothing", fix="give a whole number >= 0")
        if self.length is not None and not (np.isfinite(self.length) and self.length > 0.0):
            raise InputError(f"length is {self.length}", where="smoothing", fix="give a length > 0")

    @property
    def measures(self) -> bool:
        """See `Falloff`."""
        return self.length is not None

    def scaled(self, scale: float) -> Smoothing:
        """See `Falloff`."""
        return self if self.length is None else replace(self, length=self.length / scale)

    def spread(self, pins: Pins, values: NDArray[np.float64], x: wp.array[wp.vec3d], states: States) -> Spread:
        """min sum mu_ij |omega_j - omega_i|^2; components without pins get 0."""
        graph = pins.graph
        no_form = wp.zeros(0, dtype=wp.vec3d, device=graph.device)
        nowhere = np.zeros((graph.component_count, 3))
        if self.sweeps is not None:
            sweeper = Jacobi(tol=0.0, max_iterations=int(self.sweeps))
            state = sweeper.prepare(graph, pins.mask)
            return sweeper.solve(state, no_form, pins.spread_out(values, nowhere)).x, ()
        if self.length is not None:
            state = states.of(pins.mask, vertex_areas(graph, x) / self.length**2)
            target = wp.zeros(graph.node_count, dtype=wp.vec3d, device=graph.device)
            solution = states.solver.solve(state, no_form, pins.spread_out(values, nowhere), target=target)
            return solution.x, (solution,)

        def harmonic(start: wp.array[wp.vec3d]) -> Solution:
            return states.solver.solve(states.of(pins.mask), no_form, start)

        return _linear(pins, values, Smoothing(), harmonic)


def _linear(pins: Pins, values: NDArray[np.float64], kind: Hashable, solve: Any) -> Spread:
    """What `solve` makes of a start with the values; from the influence of each handle where they are few."""
    start = pins.spread_out(values, pins.means(values))
    if np.array_equal(*pins.extremes(values)):
        # Constant data spread exactly: the mean is already the answer.
        return start, ()
    known = influence(pins, kind, solve)
    if known is not None:
        return known.blend(pins, values), (known.solution,)
    solution = solve(start)
    return solution.x, (solution,)


@dataclass(frozen=True)
class Biharmonic:
    """min sum |(L omega)_i|^2 / a_i: fields that leave the handles without a bend, and overshoot a little between."""

    @property
    def measures(self) -> bool:
        """See `Falloff`."""
        return True

    def scaled(self, scale: float) -> Biharmonic:
        """See `Falloff`."""
        return self

    def spread(self, pins: Pins, values: NDArray[np.float64], x: wp.array[wp.vec3d], states: States) -> Spread:
        """See `Falloff`; components without pins get 0."""

        def smoothest(start: wp.array[wp.vec3d]) -> Solution:
            return biharmonic(states.of(pins.mask), pins.mask, vertex_areas(pins.graph, x), start)

        return _linear(pins, values, self, smoothest)


@wp.kernel(enable_backward=False)
def _weights(
    # Graph:
    vertex: wp.array[wp.int32],
    # In:
    distance: wp.array[wp.vec3d],
    radius: wp.float64,
    profile: int,
    # Out:
    weight_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    weight = wp.vec3d()
    for c in range(3):
        weight[c] = profile_at(profile, wp.float64(1.0) - distance[i][c] / radius, vertex[i])
    weight_out[i] = weight


@dataclass(frozen=True)
class Geodesic:
    """Weights that fall with the distance d along the surface: profile(1 - d / radius), and 0 beyond the radius.

    radius: in the unit of x. profile: "smooth", "sphere", "root", "inverse_square", "sharp", "linear", "constant" or
    "random", as in Blender's proportional editing. Where handles overlap see `overlap.Overlap`.
    """

    radius: float
    profile: str = "smooth"

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radius) and self.radius > 0.0):
            raise InputError(f"radius is {self.radius}", where="falloff", fix="give a length > 0")
        profile_number(self.profile)

    @property
    def measures(self) -> bool:
        """See `Falloff`."""
        return True

    def scaled(self, scale: float) -> Geodesic:
        """See `Falloff`."""
        return replace(self, radius=self.radius / scale)

    def spread(self, pins: Pins, values: NDArray[np.float64], x: wp.array[wp.vec3d], states: States) -> Spread:
        """See `Falloff`; what no handle reaches gets 0."""
        kept = _KNOWN.setdefault(pins, {})
        if self not in kept:
            kept[self] = self._overlap(pins, x, states)
        overlap, solutions = kept[self]
        return overlap.blend(pins, values), solutions

    def _overlap(self, pins: Pins, x: wp.array[wp.vec3d], states: States) -> tuple[Overlap, tuple[Solution, ...]]:
        graph, handles = pins.graph, np.unique(pins.shares[1])
        owner, distances = pins.owner.numpy(), Distances(graph, x, states)
        vertex = wp.array(graph.vertex_at, dtype=wp.int32, device=graph.device)
        weights, solutions = [], []
        for begin in range(0, len(handles), COLUMNS):
            sources = [np.flatnonzero(owner == handle) for handle in handles[begin : begin + COLUMNS]]
            distance, solution = distances.of(sources, self.radius)
            weight: wp.array[wp.vec3d] = wp.empty(graph.node_count, dtype=wp.vec3d, device=graph.device)
            on_device = wp.array(distance, dtype=wp.vec3d, device=graph.device)
            inputs = [vertex, on_device, self.radius, profile_number(self.profile)]
            wp.launch(_weights, dim=graph.node_count, inputs=inputs, outputs=[weight], device=graph.device)
            weights.append(weight)
            solutions.append(solution)
        return Overlap(handles, weights), tuple(solutions)


_KNOWN: WeakKeyDictionary[Pins, dict[Geodesic, tuple[Overlap, tuple[Solution, ...]]]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Painted:
    """Weights in 0..1 as somebody painted them: a row (V,) for each handle, in their order; nothing is smoothed.

    weights: (handles, V), or (V,) for one. A handle's own vertices have it wholly, whatever its row says there; held
    handles have a row as well, zeros if they are not to reach further.
    """

    weights: Any

    def __post_init__(self) -> None:
        rows = np.atleast_2d(np.asarray(self.weights, dtype=np.float64))
        if rows.ndim != 2 or not ((rows >= 0.0) & (rows <= 1.0)).all():
            raise InputError("painted weights are no rows of numbers in 0..1", where="falloff", fix="give (handles, V)")
        object.__setattr__(self, "weights", rows)

    @property
    def measures(self) -> bool:
        """See `Falloff`."""
        return False

    def scaled(self, scale: float) -> Painted:
        """See `Falloff`."""
        return self

    def spread(self, pins: Pins, values: NDArray[np.float64], x: wp.array[wp.vec3d], states: States) -> Spread:
        """See `Falloff`; what has no weight gets 0."""
        graph = pins.graph
        expected = (len(values), graph.vertex_count)
        if self.weights.shape != expected:
            what = f"painted weights of shape {self.weights.shape} for {expected[0]} handles on {expected[1]} vertices"
            raise InputError(what, where="falloff", fix=f"give {expected}, a row for each handle")
        handles = np.unique(pins.shares[1])
        weights = []
        for begin in range(0, len(handles), COLUMNS):
            rows = self.weights[handles[begin : begin + COLUMNS]].T
            columns = np.zeros((graph.vertex_count, COLUMNS))
            columns[:, : rows.shape[1]] = rows
            weights.append(graph.nodes_from(columns))
        return Overlap(handles, weights).blend(pins, values), ()


def read_falloff(falloff: Falloff | None, sweeps: int | None = None, length: float | None = None) -> Falloff:
    """The one place that reads the three: a falloff, or sweeps or length as short for Smoothing; default harmonic."""
    smoothing = Smoothing(sweeps, length)
    if falloff is None:
        return smoothing
    if smoothing != Smoothing():
        given = "sweeps" if length is None else "length"
        raise InputError(f"falloff and {given} are both given", where="falloff", fix="give one of them")
    if not hasattr(falloff, "spread"):
        fix = "give Smoothing(...), Biharmonic(), Geodesic(radius) or Painted(weights)"
        raise InputError(f"{falloff!r} is no falloff", where="falloff", fix=fix)
    return falloff
