"""The deformations of several small meshes found at once, each to the bits that it has alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.deformer import Deformer
from oneform_warp.deformers import Deformations, Deformers
from oneform_warp.errors import InputError
from oneform_warp.filters.handle_set import HandleSet, PlacedHandle, Result, Settings
from oneform_warp.influence import COLUMNS
from oneform_warp.segments import CROWDED
from oneform_warp.solvers import CG, Status
from oneform_warp.solvers.choice import AUTO, MULTIGRID_FROM

__all__ = ["foresee"]

BY_CG = "cg"
"""The name of the solver that sees no difference between a mesh alone and one of many."""

WEIGHTS = ("cotangent", "uniform")
"""Weights that depend on nothing but the mesh itself."""


def foresee(sets: Sequence[HandleSet], settings: Settings) -> int:
    """Finds what `deform(settings)` of each set is going to give, all at once; -> for how many sets.

    Only of sets that would take conjugate gradients alone: small meshes on a GPU, or where that solver is named. A set
    that cannot be served, or in which there is something to look at, is left to `deform`, and so are all where
    anything fails: each then finds out for itself what is wrong with it.
    """
    together = [placed for placed in sets if _joins(placed, settings)]
    if len(together) < 2:
        return 0
    try:
        found = _deformed(together, settings)
        if found is None:
            return 0
        good = np.flatnonzero(~found.noted).tolist()
        for number in good:
            together[number].foreseen = settings, _Foreseen(found, number, _alone(together[number], settings))
    except (InputError, RuntimeError, MemoryError):
        return 0
    return len(good)


def _joins(placed: HandleSet, settings: Settings) -> bool:
    """Whether a set is deformed in the way that all together take."""
    plain = replace(settings, weights=WEIGHTS[0], weld=0.0, solver=AUTO, tol=None, max_iterations=None, dtype=None)
    if replace(plain, device=None, refine=Settings.refine) != Settings() or _steps(settings.refine):
        return False
    small = wp.get_device(settings.device).is_cuda and len(placed.rest) < MULTIGRID_FROM
    by_cg = settings.solver == BY_CG or (settings.solver == AUTO and small)
    few = 0 < len(placed.handles) <= COLUMNS and bool(len(placed.faces)) and not placed.constraints
    known = settings.weights in WEIGHTS and settings.weld in (0.0, None)
    return by_cg and few and known and all(map(_is_plain, placed.handles.values()))


def _steps(refine: Any) -> int:
    return int(getattr(refine, "steps", refine))


def _is_plain(handle: PlacedHandle) -> bool:
    """Whether it turns, stretches by one factor, or holds."""
    vectors = not isinstance(handle.rotation, str) and not isinstance(handle.stretch, tuple)
    return vectors and not handle.painted and not handle.place


def _deformed(together: Sequence[HandleSet], settings: Settings) -> Deformations | None:
    """None where there are so many that sums would run in another order than alone."""
    deformers = Deformers(
        [(placed.rest, placed.faces) for placed in together],
        weights=settings.weights,
        weld=settings.weld,
        solver=CG(**settings.solver_options),
        device=settings.device,
    )
    if deformers.graph.segments.chunk_count >= CROWDED:
        return None
    return deformers.solve([[handle.hard() for handle in placed.handles.values()] for placed in together])


def _alone(placed: HandleSet, settings: Settings) -> Callable[[], Result]:
    """The same by itself, done when it is called, and once."""
    again = HandleSet(placed.rest, placed.faces)
    again.handles = dict(placed.handles)
    return cache(lambda: again.deform(settings))


class _Foreseen(Result):
    """Fields, 1-form and graph of it are found by deforming alone, where somebody asks for them."""

    def __init__(self, found: Deformations, number: int, alone: Callable[[], Result]) -> None:
        positions = np.ascontiguousarray(found.x[number], dtype=np.float64)
        vars(self).update(solution=_Account(found, number, alone), positions=positions, _alone=alone)

    @cached_property
    def deformer(self) -> Deformer:
        alone: Callable[[], Result] = vars(self)["_alone"]
        return alone().deformer


class _Account:
    """What a chain reports of a deformation, without a warning; the rest of a `Deformation` is found alone."""

    converged, status, warnings = True, Status.CONVERGED, ()

    def __init__(self, found: Deformations, number: int, alone: Callable[[], Result]) -> None:
        self.energy, self.iterations = float(found.energy[number]), found.whole.iterations
        self.history = ((self.iterations, float(found.residual[number])),)
        self.omega: NDArray[np.float64] = found.omega[number]
        self._alone = alone

    def __getattr__(self, name: str) -> Any:
        return getattr(self._alone().solution, name)
