"""The whole way: rest positions, faces and handles -> deformed positions."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import Rows, read_rows
from oneform_warp.centroids import keep_centroids
from oneform_warp.errors import InputError, NotConverged, OneFormWarning
from oneform_warp.fields import Fields, NodeFields, Smoothing, node_fields
from oneform_warp.forms import node_differential, node_energy, node_transform
from oneform_warp.graph import Graph
from oneform_warp.handles import Handle, held_nodes
from oneform_warp.notes import bare_notes, field_notes, misfit_notes
from oneform_warp.rest import Rest
from oneform_warp.solvers import Progress, Solution, Solver, States, default_solver
from oneform_warp.starts import Problem, Start, read_start
from oneform_warp.weights import Weights

__all__ = ["Deformation", "Deformer", "deform"]


@dataclass(frozen=True, eq=False)
class Deformation(Solution):
    """A Solution for a mesh, with everything on the way to it; `x` are the new positions, in x's shape and dtype.

    `status` is that of the positions, or of the fields where those did not converge; iterations, residual and history
    are of the positions. What is large comes from the device when it is first asked for.
    """

    energy: float
    """phi(x) = sum mu_ij |x_j - x_i - v_ij|^2, in squared units of x."""
    warnings: tuple[str, ...]
    seconds: dict[str, float]
    """Wall time of each stage."""
    _nodes: NodeFields
    _form: wp.array[wp.vec3d]
    _begin: wp.array[wp.vec3d]
    _rest: Rest

    @cached_property
    def fields(self) -> Fields:
        """omega and sigma per vertex."""
        return self._nodes.per_vertex(self._rest.graph, self._rest.dimension)

    @property
    def omega(self) -> Any:
        """The rotation vectors in radians, (V, 3); D = 2: angles (V,); D = 1: None."""
        return self.fields.omega

    @property
    def sigma(self) -> Any:
        """The stretches, (V,)."""
        return self.fields.sigma

    @cached_property
    def v(self) -> NDArray[np.float64]:
        """The 1-form, (m, D) on `graph.edges`, in the unit of x."""
        form: NDArray[np.float64] = self._form.numpy()[:, : self._rest.dimension] * self._rest.scale
        return form

    @cached_property
    def estimate(self) -> Any:
        """The start that the solver improved, like x; with start="maximal" the paper's tree estimate."""
        return self._rest.outside(self._begin)


class Deformer:
    """A mesh or graph at rest, ready to be deformed again and again.

    Graph and weights are made once; a new set of handle vertices prepares the solver, new rotations prepare nothing.

    x: rest positions (V, D), any unit, NumPy or Warp. faces: (F, k) array, list of polygons, (indices, offsets), or a
    Graph. weights, weld, extra_edges, device: see `Graph.from_faces`. solver: default by size, see
    `solvers.default_solver`.
    """

    def __init__(
        self,
        x: Any,
        faces: Any,
        *,
        weights: Weights = "cotangent",
        weld: float | None = 0.0,
        extra_edges: Any = None,
        extra_weight: float = 1.0,
        solver: Solver | None = None,
        device: Any = None,
    ) -> None:
        rows = read_rows(x, None, "x")
        where = rows.device if device is None and rows.device is not None else device
        # A graph comes with its own weights, which another rest pose then keeps.
        self.weights: Weights = None if isinstance(faces, Graph) else weights
        if isinstance(faces, Graph):
            self.graph = faces
        else:
            self.graph = Graph.from_faces(
                rows.data,
                faces,
                weights=weights,
                weld=weld,
                extra_edges=extra_edges,
                extra_weight=extra_weight,
                device=where,
            )
        self._solver: Solver = default_solver(self.graph) if solver is None else solver
        self._rest_on(rows)

    @property
    def solver(self) -> Solver:
        """What solves for the fields and the positions."""
        return self._solver

    def rest_on(self, x: Any) -> None:
        """Takes another rest pose of the same mesh: the weld and the edges stay, weights by kind are measured anew."""
        rows = read_rows(x, self.graph.vertex_count, "x")
        if self.graph.faces is not None and isinstance(self.weights, str):
            self.graph = self.graph.with_weights(self.weights, rows.data)
        self._rest_on(rows)

    def _rest_on(self, rows: Rows) -> None:
        self._rest = Rest(rows, self.graph)
        self._previous: wp.array[wp.vec3d] | None = None
        self._states = States(self._solver, self.graph)

    def deform(self, handles: Sequence[Handle] = (), **options: Any) -> Any:
        """The new positions, in the shape, dtype and kind of array of x; options as for `solve`.

        Warns OneFormWarning for what the user should look at, NotConverged where the solver gave up.
        """
        solution = self.solve(handles, **options)
        for text in solution.warnings:
            warnings.warn(text, OneFormWarning, stacklevel=2)
        if not solution.converged:
            warnings.warn(str(solution.status), NotConverged, stacklevel=2)
        return solution.x

    def solve(
        self,
        handles: Sequence[Handle] = (),
        *,
        fields: Fields | None = None,
        sweeps: int | None = None,
        length: float | None = None,
        start: Start = "rest",
        progress: Progress | None = None,
    ) -> Deformation:
        """Fields from handles, v_ij = sigma_ij R(omega_ij) dx_ij, and min sum mu_ij |x_j - x_i - v_ij|^2.

        fields: painted omega and sigma per vertex; handles then only hold. sweeps, length: how far handles reach,
        see `Smoothing`; default the harmonic limit. start: "rest", "previous", "min_depth", "maximal", "minimal",
        "zero", or positions (V, D); "previous" is the last solution of this Deformer.
        A component with nothing held keeps its centroid. Raises InputError before anything is solved.
        """
        graph, rest = self.graph, self._rest
        clock = _Clock(graph.device)
        handles = list(handles)
        held = held_nodes(graph, handles)
        make_start = read_start(start, graph, rest.dimension, rest.inside)
        nodes = self._fields(handles, fields, Smoothing(sweeps, length))
        clock.stop("fields")
        v = node_transform(graph, node_differential(graph, rest.x), nodes.omega, nodes.sigma)
        clock.stop("1-form")
        begin = self._pinned(make_start(Problem(graph, rest.x, v, self._previous)), held)
        clock.stop("start")
        state = self._states.of(held)
        clock.stop("prepare")
        solution = self._solver.solve(state, v, begin, progress=progress)
        keep_centroids(graph, state.system.floating, solution.x, rest.x)
        self._previous = solution.x
        clock.stop("solve")
        notes = [*field_notes(graph, nodes), *([] if fields is not None else bare_notes(graph, handles))]
        phi, asked = node_energy(graph, solution.x, v)
        notes += misfit_notes(phi, asked)
        return Deformation(
            x=rest.outside(solution.x),
            # Positions that fit unfinished fields have not arrived either.
            status=next((s.status for s in (*nodes.solutions, solution) if not s.converged), solution.status),
            iterations=solution.iterations,
            restarts=solution.restarts,
            residual=solution.residual[:, : rest.dimension] * rest.scale,
            goal=solution.goal[:, : rest.dimension] * rest.scale,
            history=solution.history,
            energy=phi * rest.scale**2,
            warnings=tuple(notes),
            seconds=clock.seconds,
            _nodes=nodes,
            _form=v,
            _begin=begin,
            _rest=rest,
        )

    def _fields(self, handles: list[Handle], fields: Fields | None, smoothing: Smoothing) -> NodeFields:
        if fields is None:
            scaled = smoothing
            if smoothing.length is not None:
                scaled = Smoothing(length=smoothing.length / self._rest.scale)
            return node_fields(
                self.graph,
                handles,
                dimension=self._rest.dimension,
                smoothing=scaled,
                x=self._rest.x,
                states=self._states,
            )
        for number, handle in enumerate(handles):
            if not handle.held:
                raise InputError(
                    "fields are given, so handles can only hold",
                    where=handle.label(number),
                    fix="set held=True, or drop fields",
                )
        return NodeFields.of(self.graph, fields, self._rest.dimension)

    def _pinned(self, begin: wp.array[wp.vec3d], held: NDArray[np.bool_]) -> wp.array[wp.vec3d]:
        """The start with what must not move at rest: held nodes, and those without an edge."""
        if begin is self._rest.x:
            return begin
        values, rest = begin.numpy().copy(), self._rest.x.numpy()
        fixed = held.copy()
        fixed[self.graph.component_offsets[self.graph.solved_components] :] = True
        values[fixed] = rest[fixed]
        return wp.array(values, dtype=wp.vec3d, device=self.graph.device)


def deform(
    x: Any,
    faces: Any,
    handles: Sequence[Handle],
    *,
    weights: Weights = "cotangent",
    weld: float | None = 0.0,
    extra_edges: Any = None,
    extra_weight: float = 1.0,
    solver: Solver | None = None,
    device: Any = None,
    **options: Any,
) -> Any:
    """The new positions of x under handles: Deformer(x, faces, ...).deform(handles, ...), once.

    x: (V, D); faces: as for `Deformer`; options: fields, sweeps, length, start, progress as for `Deformer.solve`.
    -> shape, dtype and kind of array of x. See Also: Deformer, for many deformations of one mesh.
    """
    deformer = Deformer(
        x,
        faces,
        weights=weights,
        weld=weld,
        extra_edges=extra_edges,
        extra_weight=extra_weight,
        solver=solver,
        device=device,
    )
    return deformer.deform(handles, **options)


class _Clock:
    """Wall time of each stage, with the device's queue empty at every stop."""

    def __init__(self, device: Any) -> None:
        self.device, self.seconds = device, dict[str, float]()
        self.last = time.perf_counter()

    def stop(self, stage: str) -> None:
        wp.synchronize_device(self.device)
        now = time.perf_counter()
        self.seconds[stage], self.last = now - self.last, now
