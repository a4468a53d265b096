"""Rotations that pay for differing from their neighbours': the term of smooth-rotation ARAP."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from oneform_warp.forms import form_size
from oneform_warp.graph import Graph
from oneform_warp.segments import launch_chunks

__all__ = ["Smoothness", "among_neighbours"]


@wp.func
def among_neighbours(
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    scale: wp.float64,
    rotation: wp.array[wp.mat33d],
    b: wp.mat33d,
    i: int,
) -> wp.mat33d:
    """B + scale sum_j mu_ij (R_j + c R_i), which the best rotation of node i among fixed neighbours is nearest to.

    Neighbours turn at once. With c = 1 the term is the tangent of a concave function, and the energy still falls; where
    B is the stronger it does so without, in fewer steps: c is the neighbours' part of both.
    """
    total = wp.mat33d()
    strength = wp.float64(0.0)
    for h in range(offsets[i], offsets[i + 1]):
        w = scale * mu[wp.max(incident[h], ~incident[h])]
        total += w * rotation[neighbours[h]]
        strength += w
    size = wp.sqrt(wp.ddot(b, b)) + strength
    if size > wp.float64(0.0):
        total += strength * (strength / size) * rotation[i]
    return b + total


@wp.kernel(enable_backward=False)
def _roughness(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    rotation: wp.array[wp.mat33d],
    # Out:
    energy_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    energy = wp.float64(0.0)
    for e in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        change = rotation[head[e]] - rotation[tail[e]]
        energy += mu[e] * wp.ddot(change, change)
    wp.tile_store(energy_out, wp.tile_sum(wp.tile(wp.vec3d(energy), preserve_type=True)), offset=k)


@dataclass(frozen=True, eq=False)
class Smoothness:
    """scale sum_ij mu_ij |R_i - R_j|^2, which rotations of neighbours pay for differing. Source: Levi, Gotsman 2015."""

    graph: Graph
    scale: float

    @classmethod
    def of(cls, graph: Graph, form: wp.array[wp.vec3d], alpha: float) -> Smoothness:
        """alpha times the area 1/2 sum mu |s|^2 of the rest edges s (m,): so that scale is no matter."""
        return cls(graph, alpha * form_size(graph, form) / 2.0)

    def energy(self, rotation: wp.array[wp.mat33d]) -> float:
        """Its value at these rotations (n,)."""
        graph = self.graph
        partial = graph.edge_segments.partials()
        launch_chunks(_roughness, graph.edge_segments, [graph.tail, graph.head, graph.mu, rotation], [partial])
        return self.scale * float(partial.numpy()[:, 0].sum())
