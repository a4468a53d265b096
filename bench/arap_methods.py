"""ARAP by libigl and Open3D, and ours, all from arrays to positions with the same pins."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import oneform_warp as ow
from bench.survey_cases import SurveyCase

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ArapMethod:
    """One way to deform a case; `run` is timed, from arrays to positions (V, 3)."""

    name: str
    run: Callable[[SurveyCase], Floats]
    """ImportError where the package is missing."""


def libigl(steps: int) -> ArapMethod:
    """libigl's spokes-and-rims ARAP from the rest pose: a factor of L, and `steps` times rotations and a solve."""

    def run(case: SurveyCase) -> Floats:
        import igl

        data = igl.ARAPData()
        data.energy, data.max_iter = igl.ARAP_ENERGY_TYPE_SPOKES_AND_RIMS, steps
        igl.arap_precomputation(case.x, case.faces, 3, case.pins.astype(np.int32), data)
        return np.asarray(igl.arap_solve(case.targets, data, case.x.copy()))

    return ArapMethod(f"libigl, {steps} steps", run)


def open3d(steps: int) -> ArapMethod:
    """Open3D's ARAP with spokes, its default."""

    def run(case: SurveyCase) -> Floats:
        import open3d as o3d

        mesh = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(case.x), o3d.utility.Vector3iVector(case.faces.astype(np.int32))
        )
        pins, targets = o3d.utility.IntVector(case.pins.tolist()), o3d.utility.Vector3dVector(case.targets)
        with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
            return np.asarray(mesh.deform_as_rigid_as_possible(pins, targets, max_iter=steps).vertices)

    return ArapMethod(f"Open3D, {steps} steps", run)


SMOOTH = 1.5e-4
"""Times the steps: how much rotations of neighbours pay for differing in `paced`."""


def ours(steps: int, device: Any = None) -> ArapMethod:
    """The fields of the handles, one solve, and `steps` of refinement, with the defaults that a user gets."""
    plain = "ours, one solve" if steps == 0 else f"ours, solve + {steps} steps"
    return _refining(steps, plain, device)


def paced(steps: int, device: Any = None) -> ArapMethod:
    """The same with smooth = SMOOTH / steps: of steps that end before the minimum, those that leave fewer bends."""
    return _refining(ow.Arap(steps, smooth=SMOOTH / max(steps, 1)), f"ours, {steps} paced steps", device)


def _refining(refine: int | ow.Arap, name: str, device: Any) -> ArapMethod:
    def run(case: SurveyCase) -> Floats:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return np.asarray(ow.Deformer(case.x, case.faces, device=device).solve(case.handles, refine=refine).x)

    return ArapMethod(name, run)
