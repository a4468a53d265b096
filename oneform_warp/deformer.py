"""The whole way: rest positions, faces and handles -> deformed positions."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arap import Arap
from oneform_warp.arrays import Rows, read_rows
from oneform_warp.centroids import keep_centroids
from oneform_warp.constraints import Constraint
from oneform_warp.deformation import Deformation, Stages
from oneform_warp.errors import InputError, NotConverged, OneFormWarning
from oneform_warp.falloff import Falloff, read_falloff
from oneform_warp.fields import Fields, NodeFields, node_fields
from oneform_warp.graph import Graph
from oneform_warp.grip import Grip
from oneform_warp.handles import Handle
from oneform_warp.places import Places, fitted, placed, reference_nodes
from oneform_warp.refiner import Refiner
from oneform_warp.rest import Rest
from oneform_warp.solvers import Progress, Solver, States, default_solver
from oneform_warp.starts import Problem, Start, read_start, worthwhile
from oneform_warp.struts import struts as inner_edges
from oneform_warp.weights import Weights

if TYPE_CHECKING:
    from oneform_warp.solvers.constrained import Equations

__all__ = ["Deformer", "deform"]


class Deformer:
    """A mesh or graph at rest, ready to be deformed again and again.

    Graph and weights are made once; a new set of handle vertices prepares the solver, new rotations prepare nothing.

    x: rest positions (V, D), any unit, NumPy or Warp. faces: (F, k) array, list of polygons, (indices, offsets), or a
    Graph. weights, weld, extra_edges, device: see `Graph.from_faces`. struts: strength of edges through the inside of
    closed parts, which keep their volume, 1.0 to begin with; None for none. solver: default by size, see
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
        extra_weight: Any = 1.0,
        struts: float | None = None,
        solver: Solver | None = None,
        device: Any = None,
    ) -> None:
        rows = read_rows(x, None, "x")
        where = rows.device if device is None and rows.device is not None else device
        # A graph comes with its own weights, which another rest pose then keeps.
        self.weights: Weights = None if isinstance(faces, Graph) else weights
        if isinstance(faces, Graph):
            if struts is not None:
                raise InputError(
                    "a graph has its edges", where="struts", fix="give faces, or make the graph with struts(x, faces)"
                )
            self.graph = faces
        else:
            if struts is not None:
                inside = inner_edges(rows.data, faces, weld=weld, device=where)
                extra_edges, extra_weight = inside.beside(struts, extra_edges, extra_weight)
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

    @property
    def rest(self) -> Rest:
        """The rest pose."""
        return self._rest

    def rest_on(self, x: Any) -> None:
        """Takes another rest pose of the same mesh: the weld and the edges stay, weights by kind are measured anew."""
        rows = read_rows(x, self.graph.vertex_count, "x")
        if self.graph.faces is not None and isinstance(self.weights, str):
            self.graph = self.graph.with_weights(self.weights, rows.data)
        self._rest_on(rows)

    def _rest_on(self, rows: Rows) -> None:
        self._rest = Rest(rows, self.graph)
        self._previous: wp.array[wp.vec3d] | None = None
        self._grip: Grip | None = None
        self._held: tuple[tuple[Constraint, ...], Equations, States] | None = None
        self._refiner = Refiner(self._rest)
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
        falloff: Falloff | None = None,
        constraints: Sequence[Constraint] = (),
        refine: int | Arap = 0,
        start: Start = "auto",
        progress: Progress | None = None,
    ) -> Deformation:
        """Fields from handles, v_ij = sigma_ij R(omega_ij) dx_ij, and min sum mu_ij |x_j - x_i - v_ij|^2.

        fields: painted omega and sigma per vertex; handles then only hold. sweeps, length: how far handles reach,
        see `Smoothing`; default the harmonic limit. falloff: another one, as Biharmonic() or Geodesic(radius). start:
        "auto" chooses between "rest" and "rings" by the solver and v; or "previous" (the last solution of this
        Deformer), "min_depth", "maximal", "minimal", "zero", or positions (V, D). constraints: linear ones, see
        `constraints`. refine: ARAP steps after the solve, or an `Arap`.
        A component with nothing held keeps its centroid. Raises InputError before anything is solved.
        """
        graph, rest = self.graph, self._rest
        stages = Stages(graph.device)
        handles = fitted(handles, rest)
        arap = Arap.of(refine)
        grip = self._grip_of(handles)
        places = Places.of(grip, handles, rest)
        make_start = read_start(start, graph, rest.dimension, rest.inside)
        nodes = self._fields(grip, handles, fields, read_falloff(falloff, sweeps, length))
        stages.stop("fields")
        v = nodes.form(graph, rest.x)
        stages.stop("1-form")
        begin = self._begin(make_start, grip, places, v, constrained=bool(constraints))
        stages.stop("start")
        states = self._states_under(constraints)
        state = states.of(grip.pinned, grip.attachment)
        stages.stop("prepare")
        target = begin if grip.attachment is None else placed(rest.x, grip, places, rest)
        solution = states.solver.solve(state, v, begin, target=target, progress=progress)
        stages.stop("solve")
        refined = None
        if arap.steps:
            refined = self._refiner.refined(arap, grip, state, solution.x, v, nodes, target)
            solution = states.solver.solve(state, refined.v, refined.x, target=target, progress=progress)
            stages.stop("refine")
        keep_centroids(graph, state.floating, solution.x, rest.x)
        self._previous = solution.x
        return Deformation(
            solution=solution,
            _grip=grip if fields is None else None,
            _places=places,
            _equations=self._held[1] if self._held is not None and constraints else None,
            _predict=lambda: self._predicted(grip, v, begin),
            _nodes=nodes,
            _form=v if refined is None else refined.v,
            refined=refined,
            _begin=begin,
            _rest=rest,
            _stages=stages,
        )

    def _begin(
        self,
        make_start: Callable[[Problem], wp.array[wp.vec3d]],
        grip: Grip,
        places: Places | None,
        v: wp.array[wp.vec3d],
        *,
        constrained: bool,
    ) -> wp.array[wp.vec3d]:
        """The start (n,) for a 1-form v (m,), with pinned nodes where they are to be."""
        rest = self._rest
        problem = Problem(
            self.graph,
            rest.x,
            v,
            self._previous,
            pinned=grip.pinned if grip.attachment is None else None,
            placed=placed(rest.x, grip, places, rest),
            gain=0.0 if constrained else worthwhile(self._solver, self.graph.device),
        )
        return placed(make_start(problem), grip, places, rest)

    def _predicted(
        self, grip: Grip, v: wp.array[wp.vec3d], begin: wp.array[wp.vec3d]
    ) -> tuple[wp.array[wp.vec3d], NDArray[np.bool_]]:
        """Where nodes (n,) would be if the targets of moved handles were left out, and which of them were given."""
        given = reference_nodes(grip)
        state = self._solver.prepare(self.graph, given)
        return self._solver.solve(state, v, begin).x, given

    def _states_under(self, constraints: Sequence[Constraint]) -> States:
        """What is prepared under these constraints; the same rows again, even with another d, find it prepared."""
        if not constraints:
            return self._states
        # Imported only when used: constraints bring half of SciPy along.
        from oneform_warp.equations import equations
        from oneform_warp.solvers.constrained import Constrained

        # A Constraint is compared by identity.
        if self._held is None or self._held[0] != tuple(constraints):
            made = equations(constraints, self._rest)
            solver, before = Constrained(self._solver, made, self._rest.x), self._held
            states = States(solver, self.graph)
            if before is not None and made.has_the_rows_of(before[1]):
                states = before[2].changed(solver, lambda state: state.asking(made))
            self._held = tuple(constraints), made, states
        return self._held[2]

    def check(self, handles: Sequence[Handle]) -> None:
        """InputError for handles that are empty, contradict each other or do what D cannot; nothing is solved."""
        handles = fitted(handles, self._rest)
        grip = self._grip_of(handles)
        Places.of(grip, handles, self._rest)
        grip.rotations(handles, self._rest.dimension)
        grip.log_stretches(handles)
        grip.log_tensors(handles, self._rest.dimension)

    def _grip_of(self, handles: Sequence[Handle]) -> Grip:
        """Made anew only where handles take hold of other vertices than the last time."""
        if self._grip is None or not self._grip.serves(handles):
            self._grip = Grip.of(self.graph, handles)
        return self._grip

    def _fields(self, grip: Grip, handles: Sequence[Handle], fields: Fields | None, falloff: Falloff) -> NodeFields:
        if fields is None:
            return node_fields(
                grip,
                handles,
                dimension=self._rest.dimension,
                falloff=falloff.scaled(self._rest.scale),
                x=self._rest.x,
                states=self._states,
            )
        for number, handle in enumerate(handles):
            if not handle.placed:
                raise InputError(
                    "fields are given, so handles can only hold or place",
                    where=handle.label(number),
                    fix="set held=True, to, move or pivot, or drop fields",
                )
        return NodeFields.of(self.graph, fields, self._rest.dimension)


def deform(
    x: Any,
    faces: Any,
    handles: Sequence[Handle],
    *,
    weights: Weights = "cotangent",
    weld: float | None = 0.0,
    extra_edges: Any = None,
    extra_weight: Any = 1.0,
    struts: float | None = None,
    solver: Solver | None = None,
    device: Any = None,
    **options: Any,
) -> Any:
    """The new positions of x under handles: Deformer(x, faces, ...).deform(handles, ...), once.

    x: (V, D); faces: as for `Deformer`; options: fields, sweeps, length, start, ... as for `Deformer.solve`.
    -> shape, dtype and kind of array of x. See Also: Deformer, for many deformations of one mesh.
    """
    deformer = Deformer(
        x,
        faces,
        weights=weights,
        weld=weld,
        extra_edges=extra_edges,
        extra_weight=extra_weight,
        struts=struts,
        solver=solver,
        device=device,
    )
    return deformer.deform(handles, **options)
