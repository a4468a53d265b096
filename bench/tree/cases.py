"""What is solved: a mesh, weights, a deformation, and the part of the mesh that is held."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

import oneform_warp as ow
from bench.options import vertex_count
from bench.problem import mesh as flat_or_round
from oneform_warp.forms import node_differential, node_energy, node_transform
from oneform_warp.solvers.refinement import State

MESHES = Path(os.environ.get("ONEFORM_MESHES", Path(__file__).resolve().parents[3] / "shared" / "meshes"))
"""The folder of real meshes, which are not part of this project."""

FRAMES = 24
"""Frames of a sequence: the previous one has 23/24 of the deformation."""

ENDS = 0.1
"""Of the longest side: what is held at one end and turned at the other."""


@dataclass(frozen=True)
class Case:
    """One line of the study, by name."""

    mesh: str
    """"bar:10k", "sphere:5", "delaunay:10k", "grid:10k", or a file of the folder of real meshes."""
    kind: str
    """bend, twist: by `amount` degrees; stretch: by the factor `amount`; noise: of a twist by 90 degrees that is exact,
    `amount` times the edge's length per coordinate; arm: 90 degrees, Fig. 7 of the paper."""
    amount: float
    weights: str = "cotangent"

    def __str__(self) -> str:
        return f"{self.mesh}, {self.kind} {self.amount:g}, {self.weights}"

    @property
    def facts(self) -> dict[str, Any]:
        """As columns of a row."""
        return asdict(self)


def mesh(name: str) -> tuple[NDArray[np.float64], Any]:
    """Positions (V, 3) and faces. FileNotFoundError where the folder of real meshes is missing."""
    kind, _, size = name.partition(":")
    if kind == "bar":
        sides = max(round((vertex_count(size) / 22.0) ** 0.5), 1)
        return ow.shapes.bar(segments=5 * sides, sides=sides)
    if size:
        return flat_or_round(name)
    path = MESHES / name
    if not path.exists():
        raise FileNotFoundError(path)
    from oneform_warp.filters import read_mesh

    loaded = read_mesh(path)
    return np.asarray(loaded.positions, dtype=np.float64), loaded.faces


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh with its weights, and the harmonic field from its held end, 0, to its turned end, 1. All per node."""

    x: NDArray[np.float64]
    graph: ow.Graph
    field: NDArray[np.float64]
    pinned: NDArray[np.bool_]
    axis: int
    """The longest side."""

    @classmethod
    def of(cls, name: str, weights: str, device: Any, *, arm: bool = False) -> Shape:
        x, faces = mesh(name)
        graph = ow.Graph.from_faces(x, faces, weights=weights, device=device)
        axis = int(np.argmax(np.ptp(x, axis=0)))
        if arm:
            held, turned = _arm(graph, x)
        else:
            t = (x[:, axis] - x[:, axis].min()) / np.ptp(x[:, axis])
            held, turned = t < ENDS, t > 1.0 - ENDS
        handles = [ow.Handle(held, held=True), ow.Handle(turned, rotation=(1.0, 0.0, 0.0))]
        solver = ow.Multigrid(tol=1.0e-8)
        field = ow.smooth_fields(graph, handles, solver=solver).omega[:, 0]
        pinned = np.zeros(graph.node_count, dtype=bool)
        pinned[graph.node_of[held]] = True
        at = graph.vertex_at
        return cls(np.asarray(x, dtype=np.float64)[at], graph, field[at], pinned, axis)

    @cached_property
    def rest(self) -> wp.array[wp.vec3d]:
        return wp.array(self.x, dtype=wp.vec3d, device=self.graph.device)

    @cached_property
    def diagonal(self) -> float:
        """Of the box, the unit of all position errors."""
        return float(np.linalg.norm(np.ptp(self.x, axis=0)))


def _arm(graph: ow.Graph, x: NDArray[np.float64]) -> tuple[Any, Any]:
    """The body and the arm of the armadillo, by the number of edges times their mean length from the hand."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    low, size = x.min(axis=0), np.ptp(x, axis=0)
    hand = int(np.argmin(np.linalg.norm(x - (low + np.array([0.0, 0.83, 0.78]) * size), axis=1)))
    i, j = graph.edges.T
    table = csr_matrix((np.linalg.norm(x[i] - x[j], axis=1), (i, j)), (len(x), len(x)))
    away = dijkstra(table, directed=False, indices=hand) / np.linalg.norm(size)
    return away > 0.33, away < 0.2


@dataclass(frozen=True, eq=False)
class Problem:
    """A case ready to be solved: rows per node on the device of its graph."""

    case: Case
    shape: Shape
    v: wp.array[wp.vec3d]
    solver: ow.Multigrid
    state: State

    @classmethod
    def of(cls, case: Case, shape: Shape, known: State | None = None) -> Problem:
        """known: the reference's state of another case on this shape."""
        solver = ow.Multigrid(tol=1.0e-12, dtype="float64")
        state = solver.prepare(shape.graph, shape.pinned) if known is None else known
        return cls(case, shape, _form(case, shape), solver, state)

    @property
    def graph(self) -> ow.Graph:
        return self.shape.graph

    @property
    def rest(self) -> wp.array[wp.vec3d]:
        return self.shape.rest

    @property
    def integrand(self) -> wp.array[wp.vec3d]:
        """The 1-form that trees integrate."""
        return self.v

    @cached_property
    def roots(self) -> NDArray[np.int64]:
        """What is held, as vertices."""
        return self.graph.vertex_at[np.flatnonzero(self.shape.pinned)].astype(np.int64)

    @cached_property
    def reference(self) -> wp.array[wp.vec3d]:
        """The minimiser, iterated in float64 to a relative residual of 1e-12 or as far as rounding lets it."""
        return self.solver.solve(self.state, self.v, self.rest).x

    @cached_property
    def previous(self) -> wp.array[wp.vec3d]:
        """The minimiser of the frame before."""
        v = _form(self.case, self.shape, part=1.0 - 1.0 / FRAMES)
        return self.solver.solve(self.state, v, self.rest).x

    @cached_property
    def least(self) -> float:
        """The least energy, sum mu |h|^2 of the non-exact part h."""
        return node_energy(self.graph, self.reference, self.v)[0]

    @cached_property
    def exactness(self) -> float:
        """|h| / |v - dx|: what of the change no positions have; 0 is exact, 1 has nothing to be integrated."""
        return float(np.sqrt(self.least / max(node_energy(self.graph, self.rest, self.v)[0], 1e-300)))

    @cached_property
    def non_exact(self) -> NDArray[np.float64]:
        """h = v - dx of the minimiser, (m, 3)."""
        h: NDArray[np.float64] = self.v.numpy() - node_differential(self.graph, self.reference).numpy()
        return h

    def held(self, x: wp.array[wp.vec3d] | NDArray[np.float64]) -> wp.array[wp.vec3d]:
        """Positions with the held nodes where they are at rest."""
        rows = np.array(x if isinstance(x, np.ndarray) else x.numpy())
        rows[self.shape.pinned] = self.shape.x[self.shape.pinned]
        return wp.array(rows, dtype=wp.vec3d, device=self.graph.device)

    def errors(self, x: wp.array[wp.vec3d]) -> tuple[float, float]:
        """(largest, root mean square) distance from the minimiser, in parts of the box's diagonal."""
        away = np.linalg.norm(x.numpy() - self.reference.numpy(), axis=1) / self.shape.diagonal
        return float(away.max()), float(np.sqrt(np.mean(away**2)))


def _form(case: Case, shape: Shape, part: float = 1.0) -> wp.array[wp.vec3d]:
    """v of a case, or of a part of its deformation."""
    graph, count = shape.graph, shape.graph.node_count
    along, across = np.eye(3)[shape.axis], np.eye(3)[(shape.axis + 1) % 3]
    if case.kind == "noise":
        return _noisy(case, shape, part)
    axis = {"bend": across, "twist": along, "arm": np.eye(3)[2]}.get(case.kind, np.zeros(3))
    omega = part * np.radians(case.amount if case.kind != "stretch" else 0.0) * shape.field[:, None] * axis
    factor = case.amount if case.kind == "stretch" else 1.0
    sigma = np.exp(part * np.log(factor) * shape.field)
    return node_transform(
        graph,
        node_differential(graph, shape.rest),
        wp.array(omega.reshape(count, 3), dtype=wp.vec3d, device=graph.device),
        wp.array(sigma, dtype=wp.float64, device=graph.device),
    )


def _noisy(case: Case, shape: Shape, part: float) -> wp.array[wp.vec3d]:
    """The differential of positions that are twisted by 90 degrees about the middle line, and noise."""
    from scipy.spatial.transform import Rotation

    along = np.eye(3)[shape.axis]
    middle = shape.x.mean(axis=0)
    turn = Rotation.from_rotvec(part * np.pi / 2.0 * shape.field[:, None] * along)
    y = turn.apply(shape.x - middle) + middle
    tail, head = shape.graph.tail.numpy(), shape.graph.head.numpy()
    length = np.linalg.norm(shape.x[head] - shape.x[tail], axis=1)
    noise = np.random.default_rng(0).normal(size=(len(tail), 3))
    v = y[head] - y[tail] + case.amount * length[:, None] * noise
    return wp.array(v, dtype=wp.vec3d, device=shape.graph.device)


ANGLES = (1.0, 10.0, 45.0, 90.0, 180.0, 360.0, 720.0)
NOISE = (0.0, 1e-4, 1e-3, 3e-3, 1e-2, 1e-1)
STRETCHES = (1.01, 1.5, 3.0)


def deformations(level: str) -> Iterator[tuple[str, float]]:
    """Of the kinds and amounts all, some or few."""
    angles = {"all": ANGLES, "some": (10.0, 90.0, 720.0), "few": (90.0,)}[level]
    noise = {"all": NOISE, "some": (1e-4, 1e-2), "few": (1e-3,)}[level]
    yield from (("twist", angle) for angle in angles)
    yield from (("bend", angle) for angle in angles if level != "few")
    yield from (("stretch", factor) for factor in (STRETCHES if level == "all" else (1.5,)) if level != "few")
    yield from (("noise", amount) for amount in noise)
