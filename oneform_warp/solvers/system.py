"""The least squares problem on the 1-form, in float64 and by differences: what `converged` is judged by."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.segments import launch_chunks
from oneform_warp.solvers.anchors import Anchors
from oneform_warp.solvers.goals import Goals

__all__ = ["System", "residual_at"]


@wp.func
def residual_at(
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    x: wp.array[wp.vec3d],
    v: wp.array[wp.vec3d],
    i: int,
) -> wp.vec3d:
    """r_i = sum_j mu_ij ((x_j - x_i) - v_ij), which is codiff(v - dx); an empty v stands for zero."""
    r = wp.vec3d()
    x_i = x[i]
    for h in range(offsets[i], offsets[i + 1]):
        e = wp.max(incident[h], ~incident[h])
        d = x[neighbours[h]] - x_i
        if v.shape[0] > 0:
            d -= wp.where(incident[h] < 0, -v[e], v[e])
        r += mu[e] * d
    return r


@wp.kernel(enable_backward=False)
def _residual(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    pinned: wp.array[wp.int32],
    attachment: wp.array[wp.float64],
    target: wp.array[wp.vec3d],
    x: wp.array[wp.vec3d],
    v: wp.array[wp.vec3d],
    # Out:
    r_out: wp.array[wp.vec3d],
    square_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    square = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        r = wp.vec3d()
        if pinned[i] == 0:
            r = residual_at(offsets, neighbours, incident, mu, x, v, i)
            if attachment.shape[0] > 0:
                r += attachment[i] * (target[i] - x[i])
        r_out[i] = r
        square += wp.cw_mul(r, r)
    wp.tile_store(square_out, wp.tile_sum(wp.tile(square, preserve_type=True)), offset=k)


@wp.kernel(enable_backward=False)
def _open(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    pinned: wp.array[wp.int32],
    attachment: wp.array[wp.float64],
    target: wp.array[wp.vec3d],
    x: wp.array[wp.vec3d],
    v: wp.array[wp.vec3d],
    # Out:
    r_out: wp.array[wp.vec3d],
    square_out: wp.array[wp.vec3d],
    reference_out: wp.array[wp.vec3d],
    rounding_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    square = wp.vec3d()
    reference = wp.vec3d()
    rounding = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        x_i = x[i]
        b = wp.vec3d()
        stretch = wp.vec3d()
        size = wp.vec3d()
        for h in range(offsets[i], offsets[i + 1]):
            e = wp.max(incident[h], ~incident[h])
            x_j = x[neighbours[h]]
            w = mu[e]
            stretch += w * (x_j - x_i)
            size += w * (wp.abs(x_i) + wp.abs(x_j))
            if v.shape[0] > 0:
                outgoing = wp.where(incident[h] < 0, -v[e], v[e])
                b -= w * outgoing
                size += w * wp.abs(outgoing)
        r = wp.vec3d()
        if pinned[i] == 0:
            r = stretch + b
            if attachment.shape[0] > 0:
                r += attachment[i] * (target[i] - x_i)
        r_out[i] = r
        square += wp.cw_mul(r, r)
        reference += wp.cw_mul(b, b)
        rounding += wp.cw_mul(size, size)
    wp.tile_store(square_out, wp.tile_sum(wp.tile(square, preserve_type=True)), offset=k)
    wp.tile_store(reference_out, wp.tile_sum(wp.tile(reference, preserve_type=True)), offset=k)
    wp.tile_store(rounding_out, wp.tile_sum(wp.tile(rounding, preserve_type=True)), offset=k)


@dataclass(frozen=True, eq=False)
class System:
    """min over x of sum mu_ij |x_j - x_i - v_ij|^2 + sum w_i |x_i - t_i|^2, with x given at pinned nodes.

    Everything is per node, on the graph's device.
    """

    graph: Graph
    pinned: wp.array[wp.int32]
    """1 where x is given, (n,); a component's only pin is an anchor instead."""
    attachment: wp.array[wp.float64]
    """w_i >= 0, (n,), or empty for none."""

    floating: NDArray[np.bool_]
    """Components with edges that nothing pins or attaches: their minimiser is unique up to a constant."""
    anchors: Anchors

    @classmethod
    def of(
        cls,
        graph: Graph,
        pinned: NDArray[np.bool_],
        attachment: NDArray[np.float64] | None = None,
        *,
        anchored: bool = False,
    ) -> System:
        """pinned: (n,) mask of nodes; attachment: (n,) w_i >= 0 or None; anchored: a single pin becomes an anchor."""
        weights = np.zeros(0) if attachment is None else attachment
        held = pinned if attachment is None else pinned | (attachment > 0.0)
        floating = np.ones(graph.component_count, dtype=bool)
        floating[graph.node_component[held]] = False
        # An attachment pulls the constant as well: then the pin stays a pin.
        single = pinned if anchored and attachment is None else np.zeros_like(pinned)
        anchors = Anchors.among(graph, single)
        fixed = pinned.astype(np.int32)
        fixed[anchors.nodes] = 0
        return cls(
            graph,
            wp.array(fixed, dtype=wp.int32, device=graph.device),
            wp.array(weights, dtype=wp.float64, device=graph.device),
            floating[: graph.solved_components],
            anchors,
        )

    def open(
        self,
        x: wp.array[wp.vec3d],
        v: wp.array[wp.vec3d],
        target: wp.array[wp.vec3d],
        tol: float,
        r_out: wp.array[wp.vec3d],
    ) -> None:
        """The residual of a start, as below, and the goals that v and the rounding errors of x and v set."""
        launch_chunks(_open, self.graph.segments, self._inputs(x, v, target), [r_out, *self._partials])
        self.goals.set(self._partials, tol)

    def residual(
        self,
        x: wp.array[wp.vec3d],
        v: wp.array[wp.vec3d],
        target: wp.array[wp.vec3d],
        r_out: wp.array[wp.vec3d],
    ) -> None:
        """R = codiff(v - dx) + w (t - x) at the free nodes, zero at pinned ones; `goals` get its norms."""
        launch_chunks(_residual, self.graph.segments, self._inputs(x, v, target), [r_out, self._partials[0]])
        self.goals.measure(self._partials[0])

    @cached_property
    def goals(self) -> Goals:
        """Of the solve that is going on."""
        return Goals(self.graph.segments)

    @cached_property
    def _partials(self) -> list[wp.array[wp.vec3d]]:
        return [self.graph.segments.partials() for _ in range(3)]

    def _inputs(self, x: wp.array[wp.vec3d], v: wp.array[wp.vec3d], target: wp.array[wp.vec3d]) -> list[Any]:
        graph = self.graph
        rows = [graph.offsets, graph.neighbours, graph.incident, graph.mu]
        return [*rows, self.pinned, self.attachment, target, x, v]
