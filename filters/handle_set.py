"""The handles of one mesh, the rest pose that they were set on, and what they made of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp import solvers
from oneform_warp.arap import Arap
from oneform_warp.arrays import vertex_mask
from oneform_warp.between import constraint_at, fields_at
from oneform_warp.constraints import Constraint
from oneform_warp.deformation import Deformation
from oneform_warp.deformer import Deformer
from oneform_warp.errors import InputError
from oneform_warp.falloff import Falloff, Smoothing
from oneform_warp.fields import Fields, smooth_fields
from oneform_warp.graph import Graph
from oneform_warp.handles import FIT, Handle
from oneform_warp.sequences import Keyframes
from oneform_warp.struts import extra_edges

__all__ = ["SOLVERS", "HandleSet", "PlacedHandle", "Settings", "StaleHandles"]

HARMONIC = Smoothing()
SOLVERS = (solvers.AUTO, *solvers.SOLVERS)


class StaleHandles(InputError):
    """The vertices that the handles were set on are not those of the mesh any more."""


@dataclass(frozen=True)
class Settings:
    """How to deform; None stands for the library's own default."""

    weights: str = "cotangent"
    weld: float | None = 0.0
    falloff: Falloff = HARMONIC
    start: str = "auto"
    t: float = 1.0
    """The part of the way from the rest pose."""
    refine: int | Arap = 0
    struts: float | None = None
    solver: str = "auto"
    tol: float | None = None
    max_iterations: int | None = None
    dtype: str | None = None
    device: str | None = None

    def solver_on(self, graph: Graph) -> Any:
        """The named solver, or the one that the library takes for this graph, with the options that are given."""
        return solvers.solver_named(self.solver, graph, self.solver_options)

    @property
    def solver_options(self) -> dict[str, Any]:
        """The options that are given."""
        options = {"tol": self.tol, "max_iterations": self.max_iterations, "dtype": self.dtype}
        return {name: value for name, value in options.items() if value is not None}

    def of_the_deformer(self) -> Settings:
        """What has to be equal for a deformer to be used again."""
        return replace(self, falloff=HARMONIC, start="auto", t=1.0, refine=0)


@dataclass(frozen=True, eq=False)
class PlacedHandle:
    """Vertices of a mesh, by mask or by painted weights, with what is asked of them."""

    name: str
    weights: NDArray[np.bool_] | NDArray[np.float64]
    """(V,): a mask, whose rotation spreads smoothly, or weights in 0..1, by which the rotation is scaled as painted."""
    rotation: tuple[float, ...] | str | None
    """Rotation vector in radians; FIT for the one that fits the targets; None where it is free."""
    stretch: float | tuple[float, ...] | None
    held: bool
    frame: tuple[float, ...] | NDArray[np.float64] | None = None
    """For three factors: their directions (3, 3), or the rotation vector that turns x, y, z to them."""
    place: Mapping[str, Any] = field(default_factory=dict)
    """What `Handle` takes about its place: to, move, pivot, weight, snap."""

    @classmethod
    def of(cls, handle: Handle, vertex_count: int) -> PlacedHandle:
        """A handle with a name, on a mesh of so many vertices."""
        place = {word: getattr(handle, word) for word in ("to", "move", "pivot", "weight", "snap")}
        return cls(
            name=str(handle.name),
            weights=vertex_mask(handle.vertices, vertex_count),
            rotation=FIT if handle.fitted else None if handle.rotation is None else tuple(handle.rotation.tolist()),
            stretch=tuple(handle.stretch.tolist()) if isinstance(handle.stretch, np.ndarray) else handle.stretch,
            held=handle.held,
            frame=handle.frame,
            place={word: value for word, value in place.items() if value is not None and value is not False},
        )

    @property
    def painted(self) -> bool:
        """Whether the weights are the falloff."""
        return self.weights.dtype != np.bool_

    @property
    def mask(self) -> NDArray[np.bool_]:
        """The vertices that the handle touches, (V,)."""
        return np.asarray(self.weights > 0)

    def hard(self) -> Handle:
        """The handle as the deformer knows it."""
        return Handle(
            self.mask,
            rotation=self.rotation,
            stretch=self.stretch,
            frame=self.frame,
            held=self.held,
            name=self.name,
            **self.place,
        )

    def check(self) -> None:
        """InputError for requests that contradict each other."""
        if not self.painted:
            self.hard()
        elif self.place or self.rotation == FIT or isinstance(self.stretch, tuple):
            fix = "select the vertices instead of painting them"
            raise InputError("painted weights scale a rotation and a factor only", where=repr(self.name), fix=fix)

    def describe(self, positions: NDArray[np.float64]) -> str:
        """One line: name, number of vertices, box (V, 3 positions), and what the handle does."""
        points = positions[self.mask]
        low, high = points.min(axis=0), points.max(axis=0)
        box = ", ".join(f"{axis} {a:.4g}..{b:.4g}" for axis, a, b in zip("xyz", low, high, strict=True))
        words = [self.hard().describe(), *(["painted"] if self.painted else [])]
        return f"{self.name}: {len(points):,} vertices ({box}), {', '.join(words)}"


@dataclass(frozen=True, eq=False)
class Result:
    """The last deformation, and the positions (V, 3) as the mesh got them."""

    solution: Deformation
    positions: NDArray[np.float64]
    deformer: Deformer


class HandleSet:
    """Handles on the vertices of one mesh, in the order in which they were set."""

    def __init__(self, positions: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
        self.rest, self.faces = positions, faces
        self.handles: dict[str, PlacedHandle] = {}
        self.constraints: dict[str, Constraint] = {}
        self.result: Result | None = None
        self.changed_by: str | None = None
        """The native filter after which there were other vertices."""
        self.foreseen: tuple[Settings, Result] | None = None
        """What the next deformation with these settings gives, where it was found with those of other meshes."""
        self._deformer: tuple[Settings, Deformer] | None = None

    def place(self, handle: PlacedHandle) -> None:
        """Adds a handle; one of the same name is replaced."""
        self.handles[handle.name] = handle

    def free_name(self) -> str:
        """A name for a handle that the user gave none."""
        return next(name for n in range(1, len(self.handles) + 2) if (name := f"handle {n}") not in self.handles)

    def notice(self, filter_name: str, vertices: int) -> None:
        """Remembers which filter changed the number of vertices, for the message."""
        if vertices != len(self.rest) and self.changed_by is None:
            self.changed_by = filter_name

    def meet(self, positions: NDArray[np.float64], faces: NDArray[np.int32]) -> bool:
        """Compares the mesh as it is now with the one that the handles were set on; whether something moved it since.

        Before the first deformation the present positions are the rest pose; later the rest pose stays. A filter that
        flips edges keeps the vertices. Raises StaleHandles where the vertices are others.
        """
        kept = self.rest if self.result is None else self.result.positions
        same_faces = np.array_equal(faces, self.faces)
        same_positions = np.array_equal(positions, kept)
        if self.changed_by or positions.shape != kept.shape or not (same_faces or same_positions):
            blamed = f"{self.changed_by} changed" if self.changed_by else "a filter changed"
            raise StaleHandles(
                f"{blamed} the vertices after the handles were set ({len(self.rest)} then, {len(positions)} now)",
                where=", ".join(map(repr, self.handles)) or "rest pose",
                fix="apply clear_oneform_handles and set the handles again",
            )
        if not same_faces:
            self.faces, self._deformer, self.foreseen = faces, None, None
        if self.result is None and not same_positions:
            self.rest, self._deformer, self.foreseen = positions, None, None
        return not same_positions

    def deform(self, settings: Settings, fields: Fields | None = None) -> Result:
        """Deforms the rest pose; `fields` (per vertex) replace those of the handles, which then only hold."""
        known, self.foreseen = self.foreseen, None
        if known is not None and known[0] == settings and fields is None:
            self.result = known[1]
            return self.result
        deformer = self._deformer_for(settings)
        hard = [handle.hard() for handle in self.handles.values() if not handle.painted]
        if settings.t < 1.0:
            hard = Keyframes(deformer, hard).handles(settings.t)
            fields = None if fields is None else fields_at(fields, settings.t)
        painted = [handle for handle in self.handles.values() if handle.painted]
        if painted and fields is None:
            smooth = smooth_fields(deformer.graph, hard, x=self.rest, solver=deformer.solver, falloff=settings.falloff)
            fields = _with_paint(smooth, painted, settings.t)
        how: dict[str, Any] = {"start": settings.start, "refine": settings.refine}
        how["constraints"] = [constraint_at(each, settings.t, deformer.rest) for each in self.constraints.values()]
        if fields is not None:
            solution = deformer.solve([handle for handle in hard if handle.placed], fields=fields, **how)
        else:
            solution = deformer.solve(hard, falloff=settings.falloff, **how)
        self.result = Result(solution, np.ascontiguousarray(solution.x, dtype=np.float64), deformer)
        return self.result

    def _deformer_for(self, settings: Settings) -> Deformer:
        """The deformer of the rest pose; the same one again while nothing changes that it was made of."""
        key = settings.of_the_deformer()
        if self._deformer is None or self._deformer[0] != key:
            if not len(self.faces):
                raise InputError("there are only points, and a deformation needs edges", fix="give a mesh with faces")
            where: dict[str, Any] = {"weld": settings.weld, "device": settings.device}
            inner = extra_edges(self.rest, self.faces, settings.struts, **where)
            graph = Graph.from_faces(self.rest, self.faces, weights=settings.weights, **where, **inner)
            self._deformer = key, Deformer(self.rest, graph, solver=settings.solver_on(graph))
        return self._deformer[1]


def _with_paint(smooth: Fields, painted: list[PlacedHandle], t: float) -> Fields:
    """The smooth fields plus each painted handle's rotation and log stretch, times its weights and t."""
    omega, log_sigma = np.array(smooth.omega), np.zeros(len(smooth.sigma))
    for handle in painted:
        omega += t * handle.weights[:, None] * np.asarray(handle.rotation or (0.0, 0.0, 0.0))
        log_sigma += t * handle.weights * np.log(handle.stretch or 1.0)
    factor = np.exp(log_sigma)
    if smooth.stretch is not None:
        return Fields(omega, stretch=factor[:, None, None] * np.asarray(smooth.stretch))
    return Fields(omega, factor * np.asarray(smooth.sigma))
