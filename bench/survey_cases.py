"""The standard cases of surface deformation: meshes, handles and the positions that every method gets."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from oneform_warp.filters import read_mesh
from oneform_warp.filters.survey_files import read_survey_handles

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

MESHES = Path(os.environ.get("ONEFORM_MESHES", Path(__file__).resolve().parents[2] / "shared" / "meshes"))
"""The folder of real meshes, which are not part of this project."""


@dataclass(frozen=True, eq=False)
class SurveyCase:
    """One mesh with a fixed handle, and one that moves as a rigid body."""

    name: str
    degrees: float
    x: Floats
    """(V, 3)."""
    faces: NDArray[np.int64]
    """Triangles (F, 3)."""
    fixed: NDArray[np.int64]
    moved: NDArray[np.int64]
    rotation: Floats
    """Rotation vector (3,) of the moved handle."""
    goal: Floats
    """Where its vertices go, (k, 3)."""
    free: bool = False
    """Whether ours is to find the rotation itself: the place contradicts it, as the package warns."""

    @property
    def pins(self) -> NDArray[np.int64]:
        return np.concatenate([self.fixed, self.moved])

    @property
    def targets(self) -> Floats:
        """Where the pins go, (pins, 3)."""
        return np.concatenate([self.x[self.fixed], self.goal])

    @property
    def handles(self) -> list[ow.Handle]:
        rotation = None if self.free else self.rotation
        return [ow.Handle(self.fixed, held=True), ow.Handle(self.moved, rotation=rotation, to=self.goal)]


@dataclass(frozen=True)
class _Files:
    """A case in files: a mesh, and a .sel/.def pair beside the others of the survey."""

    name: str
    mesh: str
    status: str
    free: bool = False
    long: bool = False

    def load(self) -> SurveyCase:
        x, faces = _triangles(self.mesh)
        status = MESHES / "survey" / self.status
        fixed, moved = read_survey_handles(status, status.with_suffix(".def"))
        # Its pivot is zero.
        goal = Rotation.from_rotvec(moved.rotation).apply(x[moved.vertices]) + moved.move
        degrees = float(np.degrees(np.linalg.norm(moved.rotation)))
        return SurveyCase(self.name, degrees, x, faces, fixed.vertices, moved.vertices, moved.rotation, goal, self.free)


@dataclass(frozen=True)
class _Arc:
    """A case by two planes: the part between them is bent to an arc of a circle, as a beam would be."""

    name: str
    mesh: str
    along: Vector
    """From the fixed end to the moved one."""
    parts: tuple[float, float]
    """Of the height along it: where the fixed end stops and the moved one begins."""
    about: Vector
    """The axis of the bend, across `along`."""
    degrees: float
    long: bool = True

    def load(self) -> SurveyCase:
        x, faces = _triangles(self.mesh)
        return bent(self.name, x, faces, self.along, self.parts, self.about, self.degrees)


def bent(
    name: str, x: Floats, faces: Any, along: Vector, parts: tuple[float, float], about: Vector, degrees: float
) -> SurveyCase:
    """What lies between two planes across `along`, at parts of the height, becomes an arc of a circle."""
    u, axis, angle = np.array(along), np.array(about), np.radians(degrees)
    height = x @ u
    low, high = height.min() + np.array(parts) * np.ptp(height)
    fixed, moved = np.flatnonzero(height <= low), np.flatnonzero(height >= high)
    foot = x.mean(axis=0) + (low - x.mean(axis=0) @ u) * u
    head = foot + (high - low) * u
    tip = foot + (high - low) / angle * (np.sin(angle) * u + (1.0 - np.cos(angle)) * np.cross(axis, u))
    goal = Rotation.from_rotvec(angle * axis).apply(x[moved] - head) + tip
    return SurveyCase(name, degrees, x, np.asarray(faces, dtype=np.int64), fixed, moved, angle * axis, goal)


UP, RIGHT = (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)
CASES: tuple[_Files | _Arc, ...] = (
    _Files("bumpy plane, moved", "arap_demo/square_21_spikes.off", "made_by_us/spikes_translate.sel"),
    _Files("cactus, bent by 70", "survey/cactus.off", "made_by_us/cactus_arcbend70.sel"),
    _Files("cactus, CGAL's 70", "survey/cactus.off", "cactus.sel", free=True),
    _Files("cylinder, bent by 120", "arap_demo/cylinder_small.off", "made_by_us/cylinder_bend120.sel"),
    _Files("bar, twisted by 135", "arap_demo/bar1.off", "made_by_us/bar1_twist135.sel"),
    _Files("bar, twisted by 180", "arap_demo/bar1.off", "made_by_us/bar1_twist180.sel"),
    _Files("bar, twisted by 270", "arap_demo/bar1.off", "made_by_us/bar1_twist270.sel"),
    _Files("bar, twisted by 720", "arap_demo/bar1.off", "made_by_us/bar1_twist720.sel"),
    _Arc("armadillo 26k, bent by 90", "paper/cgal_armadillo.off", UP, (0.25, 0.6), RIGHT, 90.0),
    _Arc("armadillo 26k, bent by 60", "paper/cgal_armadillo.off", UP, (0.25, 0.6), RIGHT, 60.0),
    _Arc("horse 48k, bent by 90", "paper/horse.ply", UP, (0.45, 0.8), RIGHT, 90.0),
    _Arc("horse 48k, bent by 60", "paper/horse.ply", UP, (0.45, 0.8), RIGHT, 60.0),
)


def cases(*, full: bool, words: tuple[str, ...] = ()) -> Iterator[SurveyCase]:
    """The cases whose name has one of the words, or the short ones, or all."""
    for case in CASES:
        wanted = any(word in case.name for word in words) if words else full or not case.long
        if wanted:
            yield case.load()


def _triangles(name: str) -> tuple[Floats, NDArray[np.int64]]:
    mesh = read_mesh(MESHES / name)
    faces: Any = mesh.faces
    return np.asarray(mesh.positions, dtype=np.float64), np.asarray(faces, dtype=np.int64)
