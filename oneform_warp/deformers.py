"""Several meshes at once: one graph of separate components keeps a GPU busy where each alone would not."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import Rows, read_rows
from oneform_warp.deformation import Deformation
from oneform_warp.deformer import Deformer
from oneform_warp.errors import InputError, NotConverged, OneFormWarning
from oneform_warp.fields import JUMP_LIMIT, fast_edges
from oneform_warp.graph import Graph
from oneform_warp.handles import Handle
from oneform_warp.notes import misfit_notes
from oneform_warp.polygons import Faces, Polygons, as_polygons
from oneform_warp.rest import Rest, box_of
from oneform_warp.solvers import Progress, Solver
from oneform_warp.starts import Start
from oneform_warp.weights import Weights

__all__ = ["Deformations", "Deformers"]


@dataclass(frozen=True, eq=False)
class _Piece:
    """One of the meshes, and where it lies among the vertices of all."""

    rows: Rows
    polygons: Polygons
    centre: NDArray[np.float64]
    scale: float
    begin: int

    @property
    def vertices(self) -> slice:
        return slice(self.begin, self.begin + len(self.rows.data))

    @property
    def inside(self) -> NDArray[np.float64]:
        """Centred and scaled to about the unit box, by a power of two."""
        inside: NDArray[np.float64] = (self.rows.data - self.centre) / self.scale
        return inside

    def outside(self, moved: NDArray[np.float64]) -> Any:
        """Displacements of all vertices, scaled -> this mesh's new positions; what did not move keeps every bit."""
        by = moved[self.vertices] * self.scale
        return self.rows.like(np.where(by == 0.0, self.rows.data, self.rows.data + by))


class _OwnBoxes(Rest):
    """The meshes' own rest poses side by side, each centred and scaled already."""

    def __init__(self, rows: Rows, graph: Graph) -> None:
        super().__init__(rows, graph)
        self.centre, self.scale = np.zeros(3), 1.0
        self.x = graph.nodes_from(rows.data)

    def displacement(self, x: wp.array[wp.vec3d]) -> NDArray[np.float64]:
        """Positions per node -> how far each vertex has moved, (V, 3)."""
        moved: NDArray[np.float64] = (x.numpy() - self.x.numpy())[self.graph.node_of]
        return moved


class _SideBySide(Deformer):
    """A deformer of meshes that are centred and scaled each by itself: then nothing depends on the others."""

    boxes: _OwnBoxes

    def _rest_on(self, rows: Rows) -> None:
        super()._rest_on(rows)
        self._rest = self.boxes = _OwnBoxes(rows, self.graph)


@dataclass(frozen=True, eq=False)
class Deformations:
    """Several deformed meshes: everything is there per mesh, in the order in which they were given."""

    whole: Deformation
    """Of all meshes as one, each centred and scaled to about the unit box."""
    _pieces: tuple[_Piece, ...]
    _handles: tuple[Handle, ...]
    """On the vertices of all meshes."""
    _rest: _OwnBoxes

    @cached_property
    def x(self) -> list[Any]:
        """The new positions of each mesh, in the shape, dtype and kind of array of its rest positions."""
        moved, columns = np.zeros((self.whole.graph.vertex_count, 3)), self._rest.dimension
        if any(handle.moves or handle.soft for handle in self._handles):
            moved[:, :columns] = self.whole.x - self._rest.rows.data[:, :columns]
        else:  # the nodes know it without the rounding of a sum
            moved[:, :columns] = self._rest.displacement(self.whole.solution.x)[:, :columns]
        return [piece.outside(moved) for piece in self._pieces]

    @cached_property
    def omega(self) -> list[Any]:
        """The rotation vectors of each mesh, as `Deformation.omega`."""
        every = self.whole.omega
        return [None if every is None else every[piece.vertices] for piece in self._pieces]

    @cached_property
    def converged(self) -> NDArray[np.bool_]:
        """Whether the float64 residuals of each mesh are small enough everywhere, (meshes,)."""
        return self.residual <= 1.0

    @cached_property
    def residual(self) -> NDArray[np.float64]:
        """The largest residual of each mesh over the one to reach, of fields and positions, (meshes,)."""
        ratio = np.zeros(self.whole.graph.component_count)
        for each in self.whole.solutions:
            nothing = np.where(each.residual > 0.0, np.inf, 0.0)  # over a goal of 0
            part = np.divide(each.residual, each.goal, out=nothing, where=each.goal > 0.0)
            ratio[: len(part)] = np.maximum(ratio[: len(part)], part.max(axis=1, initial=0.0))
        return self._over_vertices(np.maximum, ratio[self.whole.graph.components])

    @cached_property
    def energy(self) -> NDArray[np.float64]:
        """phi of each mesh, (meshes,), in squared units of its x."""
        return self._sums[:, 0] * np.array([piece.scale for piece in self._pieces]) ** 2

    @cached_property
    def noted(self) -> NDArray[np.bool_]:
        """Whether there is something to look at in a mesh, (meshes,); deformed alone, it says what."""
        graph = self.whole.graph
        touched = np.zeros(graph.component_count, dtype=bool)
        for number, handle in enumerate(self._handles):
            touched[graph.components[handle.members(graph.vertex_count, number)]] = True
        noted = ~self.converged | self._over_vertices(np.logical_or, ~touched[graph.components])
        noted |= np.array([bool(misfit_notes(phi, asked)) for phi, asked in self._sums])
        if fast_edges(graph, self.whole._nodes.omega, JUMP_LIMIT)[0]:
            first, second = graph.edges.T
            omega = graph.vertices_from(self.whole._nodes.omega)
            fast = np.linalg.norm(omega[second] - omega[first], axis=1) > JUMP_LIMIT
            noted[np.unique(self._mesh_of[first[fast]])] = True
        return noted

    @cached_property
    def _sums(self) -> NDArray[np.float64]:
        """Phi and sum mu |v|^2 of each mesh, scaled, (meshes, 2)."""
        graph = self.whole.graph
        tail, head, mu = graph.tail.numpy(), graph.head.numpy(), graph.mu.numpy()
        x, v = self.whole.solution.x.numpy(), self.whole._form.numpy()
        mesh = self._mesh_of[graph.vertex_at[tail]]
        sums = [mu * np.einsum("ij,ij->i", each, each) for each in (x[head] - x[tail] - v, v)]
        return np.stack([np.bincount(mesh, each, len(self._pieces)) for each in sums], axis=1)

    @cached_property
    def _mesh_of(self) -> NDArray[np.int64]:
        """The mesh of each vertex, (V,)."""
        return np.repeat(np.arange(len(self._pieces)), [len(piece.rows.data) for piece in self._pieces])

    def _over_vertices(self, operation: np.ufunc, values: NDArray[Any]) -> NDArray[Any]:
        """A ufunc over the vertices of each mesh, (meshes,); 0 for a mesh without any."""
        parts = [values[piece.vertices] for piece in self._pieces]
        return np.array([operation.reduce(part) if len(part) else values.dtype.type(0) for part in parts])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should look at."""
        return self.whole.warnings


class Deformers:
    """Meshes at rest, ready to be deformed together again and again; several poses of one mesh are several meshes.

    meshes: pairs (x, faces), each as for `Deformer`. weights, solver, device: as there, the same for all; the mean
    length of "inverse_length" is that of all meshes, each scaled to its box. weld: 0.0 or None, within each mesh.
    Every component stops for itself; the solve ends with the last. With `CG()` and other weights than inverse lengths,
    each mesh comes out to the last bit as by a Deformer of its own, up to about a million vertices in all; other
    solvers agree to their tolerance. Raises InputError, naming the mesh by its number.
    """

    def __init__(
        self,
        meshes: Sequence[tuple[Any, Faces]],
        *,
        weights: Weights = "cotangent",
        weld: float | None = 0.0,
        solver: Solver | None = None,
        device: Any = None,
    ) -> None:
        if not len(meshes):
            raise InputError("there are no meshes", where="meshes", fix="give at least one pair (x, faces)")
        if weld not in (0.0, None):
            raise InputError(f"weld is {weld}", where="weld", fix="use 0.0 or None: meshes are scaled to their boxes")
        pieces: list[_Piece] = []
        for number, (x, faces) in enumerate(meshes):
            with _naming(number):
                pieces.append(_piece(x, faces, pieces[-1].vertices.stop if pieces else 0))
        dimensions = {piece.rows.dimension for piece in pieces}
        if len(dimensions) > 1:
            raise InputError(f"meshes of D = {sorted(dimensions)}", where="meshes", fix="give all the same D")
        self._pieces = tuple(pieces)
        inside = np.concatenate([piece.inside for piece in pieces])
        # Each mesh gets the weights and the order that it has alone; only lengths have to be comparable.
        given = inside if weights == "inverse_length" else np.concatenate([piece.rows.data for piece in pieces])
        sizes = [len(piece.rows.data) for piece in pieces]
        graph = Graph.from_faces(
            given,
            _joined(pieces),
            weights=weights,
            weld=weld,
            mesh_of=np.repeat(np.arange(len(pieces)), sizes),
            device=device,
        )
        self._deformer = _SideBySide(inside[:, : dimensions.pop()], graph, solver=solver)

    @property
    def graph(self) -> Graph:
        """All meshes, as separate components; vertices in the order of the meshes."""
        return self._deformer.graph

    def deform(self, handles: Sequence[Sequence[Handle]], **options: Any) -> list[Any]:
        """The new positions of each mesh, in the shape, dtype and kind of array that its x has; options as for `solve`.

        Warns OneFormWarning for what the user should look at, NotConverged where the solver gave up.
        """
        found = self.solve(handles, **options)
        for text in found.warnings:
            warnings.warn(text, OneFormWarning, stacklevel=2)
        if not found.converged.all():
            numbers = np.flatnonzero(~found.converged).tolist()
            warnings.warn(f"meshes {numbers}: {found.whole.status}", NotConverged, stacklevel=2)
        return found.x

    def solve(
        self,
        handles: Sequence[Sequence[Handle]],
        *,
        sweeps: int | None = None,
        start: Start = "auto",
        progress: Progress | None = None,
    ) -> Deformations:
        """Handles: a sequence for each mesh, its vertices numbered by themselves. Others: as for `Deformer.solve`."""
        if len(handles) != len(self._pieces):
            raise InputError(
                f"handles for {len(handles)} meshes, there are {len(self._pieces)}",
                where="handles",
                fix="give a sequence of handles for each mesh, [] for none",
            )
        moved: list[Handle] = []
        for number, (piece, some) in enumerate(zip(self._pieces, handles, strict=True)):
            with _naming(number):
                moved += [_shifted(handle, piece, number, k) for k, handle in enumerate(some)]
        whole = self._deformer.solve(moved, sweeps=sweeps, start=start, progress=progress)
        return Deformations(whole, self._pieces, tuple(moved), self._deformer.boxes)


def _piece(x: Any, faces: Faces, begin: int) -> _Piece:
    rows = read_rows(x, None, "x")
    return _Piece(rows, as_polygons(faces, len(rows.data)), *box_of(rows.data), begin)


def _joined(pieces: Sequence[_Piece]) -> Polygons:
    """The polygons of all meshes, vertices numbered through."""
    corners = np.cumsum([0, *(len(piece.polygons.indices) for piece in pieces)])
    offsets = [piece.polygons.offsets[1:] + at for piece, at in zip(pieces, corners, strict=False)]
    return Polygons(
        np.concatenate([piece.polygons.indices + piece.begin for piece in pieces]),
        np.concatenate([np.zeros(1, dtype=np.int64), *offsets]),
    )


def _shifted(handle: Handle, piece: _Piece, mesh: int, number: int) -> Handle:
    """The handle on the vertices of all meshes."""
    own = handle.members(len(piece.rows.data), number)
    if handle.to is not None:
        handle = handle.onto(handle.rows(len(piece.rows.data), number, handle.to, "to"))
    inside = handle.within(piece.centre, piece.scale)
    return inside.on(own + piece.begin, f"{handle.name or number} of mesh {mesh}")


@contextmanager
def _naming(mesh: int) -> Iterator[None]:
    """Errors inside name the mesh."""
    try:
        yield
    except InputError as error:
        raise InputError(error.what, where=f"mesh {mesh}, {error.where}", fix=error.fix) from None
