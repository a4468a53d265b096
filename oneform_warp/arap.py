"""ARAP refinement: rotations from positions and positions from rotations, in turn, with one hierarchy.

    R_i      the rotation that fits the edges of its cells best      local step
    L p = r  r = codiff(v(R) - dx), what the rotations ask for        global step, a few iterations suffice
    x <- x + p, corrected by what the last step taught about the energy's curvature

The plain step x + p never raises the energy. The corrected one, a quasi-Newton step of one memory whose first Hessian
is L, gets there in a third of the steps; where it raises the energy after all, the plain one is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arap_energy import CellEnergy, Fit
from oneform_warp.cells import Cells, edge_cells, face_cells
from oneform_warp.errors import InputError
from oneform_warp.graph import Graph
from oneform_warp.rotations import exponential_map
from oneform_warp.segments import launch_chunks
from oneform_warp.solvers.refinement import State, corrected

__all__ = ["Arap", "Ending", "Refined", "alternate", "field_rotations", "nearest_vectors"]

REDUCTION = 0.5
"""What a global step reduces its residual to; down to 1e-4 saves no step (spheres of 41k, elephant of 20k)."""

EXACT = 1.0e-14
"""Of sum mu |s|^2: the energy is a difference, and what rounding leaves of it is some 1e-16."""

NO_AXIS = 1.0e-9
"""Radians, below which the axis of a rotation matrix is rounding."""

INNER_ITERATIONS = 50
"""Of one global step at most; a hierarchy needs 2 to 4."""

SPOKES = "spokes"
RIMS = "spokes_and_rims"
CELLS: dict[str, Callable[[Graph, wp.array[wp.vec3d]], Cells]] = {
    RIMS: face_cells,
    SPOKES: lambda graph, rest: edge_cells(graph),
}


@dataclass(frozen=True)
class Arap:
    """min over x of the sum over cells of mu |d - R_i s|^2, alternating, from the integrated 1-form.

    steps: at most. tol: ends when a step lowers the energy by less than this part of it. cells: "spokes_and_rims", or
    "spokes". smooth: alpha of the term alpha A sum mu |R_i - R_j|^2 (A: area), 0 for none.
    Sources: Sorkine, Alexa 2007; Chao et al. 2010 (rims); Levi, Gotsman 2015 (smooth); Liu et al. 2017 (quasi-Newton).
    """

    steps: int = 10
    tol: float = 0.0
    cells: str = RIMS
    smooth: float = 0.0

    def __post_init__(self) -> None:
        steps: Any = self.steps
        if not isinstance(steps, int | np.integer) or steps < 0:
            raise InputError(f"steps is {self.steps!r}", where="refine", fix="give a whole number >= 0")
        for name, value in (("tol", self.tol), ("smooth", self.smooth)):
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} is {value!r}", where="refine", fix="give a number >= 0")
        if self.cells not in CELLS:
            raise InputError(f"there are no cells {self.cells!r}", where="refine", fix=f"use {' or '.join(CELLS)}")

    @classmethod
    def of(cls, refine: int | Arap) -> Arap:
        """The one place that reads `refine`: a number of steps, or all options."""
        return refine if isinstance(refine, Arap) else cls(refine)

    def cells_of(self, graph: Graph, rest: wp.array[wp.vec3d]) -> Cells:
        """The cells on a graph with rest positions (n,)."""
        return CELLS[self.cells](graph, rest)


class Ending(Enum):
    """How a refinement ended."""

    STEPS = "steps: all steps were made"
    CONVERGED = "converged: a step lowered the energy by less than tol"
    RESTING = "resting: the energy falls no further in float64"


@dataclass(frozen=True, eq=False)
class Refined:
    """What came of a refinement: the last fit, the energy after each step, and how it ended."""

    fit: Fit
    v: wp.array[wp.vec3d]
    """The 1-form of its rotations, (m,)."""
    energies: tuple[float, ...]
    ending: Ending

    @property
    def x(self) -> wp.array[wp.vec3d]:
        """Per node, (n,)."""
        return self.fit.x


@wp.kernel(enable_backward=False)
def _field_rotations(
    # In:
    omega: wp.array[wp.vec3d],
    # Out:
    rotation_out: wp.array[wp.mat33d],
):
    i = wp.tid()
    rotation_out[i] = exponential_map(omega[i])


def field_rotations(omega: wp.array[wp.vec3d]) -> wp.array[wp.mat33d]:
    """R(omega) per node."""
    rotation: wp.array[wp.mat33d] = wp.empty(omega.shape[0], dtype=wp.mat33d, device=omega.device)
    wp.launch(_field_rotations, dim=omega.shape[0], inputs=[omega], outputs=[rotation], device=omega.device)
    return rotation


def nearest_vectors(rotation: NDArray[np.float64], omega: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of all rotation vectors of matrices (k, 3, 3) those nearest to omega (k, 3): whole turns are kept."""
    from scipy.spatial.transform import Rotation

    vector = Rotation.from_matrix(rotation).as_rotvec()
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    turn = np.linalg.norm(omega, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        # A matrix near the identity has no axis of its own, and turns about that of omega.
        along = np.where(angle > NO_AXIS, vector / angle, np.where(turn > 0.0, omega / turn, 0.0))
    whole = np.round((np.einsum("ij,ij->i", along, omega)[:, None] - angle) / (2.0 * np.pi))
    nearest: NDArray[np.float64] = vector + whole * 2.0 * np.pi * along
    return nearest


def alternate(
    energy: CellEnergy,
    state: State,
    x: wp.array[wp.vec3d],
    v: wp.array[wp.vec3d],
    rotation: wp.array[wp.mat33d],
    arap: Arap,
) -> Refined:
    """The energy falls in every step, or it ends.

    x, rotation: (n,), with the pinned values; v: the 1-form (m,) that x integrates.
    """
    fit, memory = energy.fit(x, rotation), None
    if fit.energy <= EXACT * energy.size:
        # Nothing is bent that the energy could tell, and rounding is not to move it.
        return Refined(replace(fit, rotation=rotation), v, (fit.energy,), Ending.RESTING)
    energies, ending = [fit.energy], Ending.STEPS
    for _ in range(arap.steps):
        plain = _global_step(energy, state, fit)
        following = _following(energy, fit, plain, memory)
        if following is None:
            ending = Ending.RESTING
            break
        memory, before, fit = (fit, plain), fit.energy, following
        energies.append(fit.energy)
        if before - fit.energy <= arap.tol * before:
            ending = Ending.CONVERGED if arap.tol > 0.0 else Ending.RESTING
            break
    return Refined(fit, energy.form(fit), tuple(energies), ending)


Memory = tuple[Fit, Any]
"""The last fit, and the plain step from it."""


def _following(energy: CellEnergy, fit: Fit, plain: wp.array[wp.vec3d], memory: Memory | None) -> Fit | None:
    """The corrected step where it lowers the energy, else the plain one, else None; NaN is not lower."""
    ahead = None if memory is None else _quasi_newton(energy, fit, plain, memory)
    for x in (ahead, plain):
        trial = None if x is None else energy.fit(x, fit.rotation)
        if trial is not None and trial.energy <= fit.energy:
            return trial
    return None


def _global_step(energy: CellEnergy, state: State, fit: Fit) -> wp.array[wp.vec3d]:
    """x + p with L p = r to the part REDUCTION of r: any iterate of CG from p = 0 lowers the energy."""
    goals = state.system.goals
    goals.set([energy.square, energy.square, energy.none], REDUCTION)
    goals.take_aim(state.inner.floor)
    x = corrected(state.system.graph, fit.x, state.inner.correct(fit.r, INNER_ITERATIONS, None))
    # The energy does not see a translation, so a component's only pin stays where it is by moving the rest.
    state.system.anchors.restore(x, fit.x)
    return state.held(x)


@wp.kernel(enable_backward=False)
def _products(
    chunk_offsets: wp.array[wp.int32],
    # In:
    x: wp.array[wp.vec3d],
    x_old: wp.array[wp.vec3d],
    r: wp.array[wp.vec3d],
    r_old: wp.array[wp.vec3d],
    plain: wp.array[wp.vec3d],
    plain_old: wp.array[wp.vec3d],
    # Out:
    first_out: wp.array[wp.vec3d],
    second_out: wp.array[wp.vec3d],
):
    chunk, lane = wp.tid()
    first = wp.vec3d()
    second = wp.vec3d()
    for i in range(chunk_offsets[chunk] + lane, chunk_offsets[chunk + 1], wp.block_dim()):
        s = x[i] - x_old[i]
        y = r_old[i] - r[i]
        p = plain[i] - x[i]
        p_old = plain_old[i] - x_old[i]
        first += wp.vec3d(wp.dot(s, r[i]), wp.dot(s, y), wp.dot(y, p))
        second += wp.vec3d(wp.dot(y, p_old - p), wp.dot(r[i], p), wp.float64(0.0))
    wp.tile_store(first_out, wp.tile_sum(wp.tile(first, preserve_type=True)), offset=chunk)
    wp.tile_store(second_out, wp.tile_sum(wp.tile(second, preserve_type=True)), offset=chunk)


@wp.kernel(enable_backward=False)
def _ahead(
    # In:
    x: wp.array[wp.vec3d],
    x_old: wp.array[wp.vec3d],
    plain: wp.array[wp.vec3d],
    plain_old: wp.array[wp.vec3d],
    a: wp.float64,
    b: wp.float64,
    # Out:
    x_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    p = plain[i] - x[i]
    x_out[i] = x[i] + p - a * (plain_old[i] - x_old[i] - p) + b * (x[i] - x_old[i])


def _quasi_newton(energy: CellEnergy, fit: Fit, plain: wp.array[wp.vec3d], memory: Memory) -> wp.array[wp.vec3d] | None:
    """x + p - a L^-1 y + (a - b) s, the BFGS step from L^-1 and the last s = x - x', y = r' - r; None if s y <= 0.

    a = s r / s y and b = y (p - a L^-1 y) / s y; L^-1 y = p' - p is known from the two plain steps.
    """
    old, plain_old = memory
    segments = energy.cells.graph.segments
    sums = [segments.partials(), segments.partials()]
    launch_chunks(_products, segments, [fit.x, old.x, fit.r, old.r, plain, plain_old], sums)
    (sr, sy, yp), (ypy, rp, _) = (part.numpy().sum(axis=0) for part in sums)
    if not sy > 0.0:
        return None
    a = sr / sy
    b = (yp - a * ypy) / sy
    # r (p - a L^-1 y + (a - b) s), with r L^-1 y = y p as L is symmetric: a step that does not go downhill is none.
    if not rp - a * yp + (a - b) * sr > 0.0:
        return None
    x = wp.empty_like(plain)
    inputs: list[Any] = [fit.x, old.x, plain, plain_old, a, a - b]
    wp.launch(_ahead, dim=x.shape[0], inputs=inputs, outputs=[x], device=x.device)
    return x
