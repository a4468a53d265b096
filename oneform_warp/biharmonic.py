"""The smoothest 0-form with given values in the next sense: min sum over nodes of |(L u)_i|^2 / a_i.

Its matrix A = L a^-1 L is never made. CG is preconditioned by P = L_ff a_f^-1 L_ff of the free nodes f: two solves with
the graph Laplacian, by the solver that is there anyway. P differs from A where free nodes meet given ones only, and as
P <= A, what is left of r P^-1 r bounds the error in the energy.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.segments import launch_chunks, sum_chunks
from oneform_warp.solvers import Solution, Status
from oneform_warp.solvers.refinement import State, corrected

__all__ = ["biharmonic"]

Vectors = wp.array[wp.vec3d]

TOLERANCE = 1.0e-7
"""Of the error in the energy's norm, relative to that of the start."""

INNER = 1.0e-4
"""What a solve in the preconditioner reduces its residual to."""

INNER_ITERATIONS = 100
MAX_ITERATIONS = 300

LEAST_AREA = 1.0e-6
"""Of the mean."""


@wp.kernel(enable_backward=False)
def _laplacian(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    factor: wp.array[wp.float64],
    x: wp.array[wp.vec3d],
    # Out:
    y_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    y = wp.vec3d()
    # Differences first: of what is constant, nothing is left.
    for h in range(offsets[i], offsets[i + 1]):
        y += mu[wp.max(incident[h], ~incident[h])] * (x[i] - x[neighbours[h]])
    y_out[i] = factor[i] * y


@wp.kernel(enable_backward=False)
def _scale(
    # In:
    factor: wp.array[wp.float64],
    x: wp.array[wp.vec3d],
    # Out:
    y_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    y_out[i] = factor[i] * x[i]


@wp.kernel(enable_backward=False)
def _products(
    chunk_offsets: wp.array[wp.int32],
    # In:
    a: wp.array[wp.vec3d],
    b: wp.array[wp.vec3d],
    # Out:
    product_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    product = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        product += wp.cw_mul(a[i], b[i])
    wp.tile_store(product_out, wp.tile_sum(wp.tile(product, preserve_type=True)), offset=k)


@wp.kernel(enable_backward=False)
def _combine(
    # Graph:
    component: wp.array[wp.int32],
    # In:
    x: wp.array[wp.vec3d],
    y: wp.array[wp.vec3d],
    factor: wp.array[wp.vec3d],
    # Out:
    z_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    c = component[i]
    z = x[i]
    # Components without an edge have no factor.
    if c < factor.shape[0]:
        z += wp.cw_mul(factor[c], y[i])
    z_out[i] = z


class _Bilaplacian:
    """A, P and inner products on one graph with given nodes; no array is changed that somebody else has."""

    def __init__(self, state: State, pinned: NDArray[np.bool_], areas: NDArray[np.float64]) -> None:
        self.state, self.graph = state, state.system.graph
        # A node without area would weigh infinitely much.
        least = LEAST_AREA * float(areas.mean()) if len(areas) else 0.0
        areas = np.maximum(areas, least or 1.0)
        self.free, self.area, self.inverse_area = (
            wp.array(each, dtype=wp.float64, device=self.graph.device)
            for each in (np.where(pinned, 0.0, 1.0), areas, 1.0 / areas)
        )

    def product(self, x: Vectors) -> Vectors:
        """A x at the free nodes, 0 at the given ones."""
        return self._laplacian(self._laplacian(x, self.inverse_area), self.free)

    def precondition(self, r: Vectors) -> Vectors:
        """P^-1 r, roughly."""
        return self._integral(self._scaled(self.area, self._integral(r)))

    def inner(self, a: Vectors, b: Vectors) -> NDArray[np.float64]:
        """a b of each component and column, (components with edges, 3)."""
        return np.asarray(sum_chunks(self.graph.segments, self._partials(a, b), self.graph.segments.zeros()).numpy())

    def combine(self, x: Vectors, factor: NDArray[np.float64], y: Vectors) -> Vectors:
        """x + factor y; factor as `inner` returns."""
        result = wp.empty_like(x)
        on_device = wp.array(np.ascontiguousarray(factor), dtype=wp.vec3d, device=x.device)
        inputs = [self.graph.component_of_node, x, y, on_device]
        wp.launch(_combine, dim=x.shape[0], inputs=inputs, outputs=[result], device=x.device)
        return result

    def _laplacian(self, x: Vectors, factor: wp.array[wp.float64]) -> Vectors:
        graph, result = self.graph, wp.empty_like(x)
        inputs = [graph.offsets, graph.neighbours, graph.incident, graph.mu, factor, x]
        wp.launch(_laplacian, dim=x.shape[0], inputs=inputs, outputs=[result], device=x.device)
        return result

    def _integral(self, r: Vectors) -> Vectors:
        """e with L_ff e = r to the part INNER of r, 0 at the given nodes."""
        goals, square = self.state.system.goals, self._partials(r, r)
        goals.set([square, square, self.graph.segments.partials()], INNER)
        goals.take_aim(self.state.inner.floor)
        correction = self.state.inner.correct(r, INNER_ITERATIONS, None)
        return self._scaled(self.free, corrected(self.graph, wp.zeros_like(r), correction))

    def _scaled(self, factor: wp.array[wp.float64], x: Vectors) -> Vectors:
        result = wp.empty_like(x)
        wp.launch(_scale, dim=x.shape[0], inputs=[factor, x], outputs=[result], device=x.device)
        return result

    def _partials(self, a: Vectors, b: Vectors) -> Vectors:
        partial = self.graph.segments.partials()
        launch_chunks(_products, self.graph.segments, [a, b], [partial])
        return partial


def biharmonic(state: State, pinned: NDArray[np.bool_], areas: NDArray[np.float64], start: Vectors) -> Solution:
    """The u with min sum |(L u)_i|^2 / a_i that has the values of `start` (n,) at the pinned nodes.

    state: of a solver for these pins; areas: a_i of each node, (n,). Residual and goal are norms of the error that the
    energy may still have, as (r P^-1 r)^(1/2). Values between given ones may overshoot them.
    """
    problem = _Bilaplacian(state, pinned, areas)
    x = start
    r = problem.combine(wp.zeros_like(x), -np.ones((problem.graph.segments.component_count, 3)), problem.product(x))
    z = p = problem.precondition(r)
    rz = problem.inner(r, z)
    goal, history = TOLERANCE * np.sqrt(np.maximum(rz, 0.0)), []
    for iteration in range(MAX_ITERATIONS + 1):
        residual = np.sqrt(np.maximum(rz, 0.0))
        waiting = residual > goal
        history.append((iteration, float(np.divide(residual, goal, out=np.zeros_like(goal), where=waiting).max())))
        if not waiting.any() or iteration == MAX_ITERATIONS:
            break
        q = problem.product(p)
        alpha = _ratio(rz, problem.inner(p, q), waiting)
        x, before = problem.combine(x, alpha, p), r
        r = problem.combine(r, -alpha, q)
        z = problem.precondition(r)
        # The preconditioner differs from step to step: what the old residual has in common with z is no progress.
        rz, old = problem.inner(r, z), rz
        p = problem.combine(z, _ratio(rz - problem.inner(before, z), old, waiting), p)
    status = Status.MAX_ITERATIONS if waiting.any() else Status.CONVERGED
    return Solution(x, status, iteration, 0, residual, goal, tuple(history))


def _ratio(a: NDArray[np.float64], b: NDArray[np.float64], where: NDArray[np.bool_]) -> NDArray[np.float64]:
    """a / b where that is wanted and b > 0, elsewhere 0."""
    ratio: NDArray[np.float64] = np.divide(a, b, out=np.zeros_like(a), where=where & (b > 0.0))
    return ratio
