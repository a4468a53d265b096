"""Rotations that pay for differing from their neighbours': the term of smooth-rotation ARAP."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from oneform_warp.forms import form_size
from oneform_warp.graph import Graph
from oneform_warp.segments import launch_chunks

__all__ = ["Smoothness"]


@wp.kernel(enable_backward=False)
def _bias(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    scale: wp.float64,
    rotation: wp.array[wp.mat33d],
    # Out:
    bias_out: wp.array[wp.mat33d],
):
    i = wp.tid()
    total = wp.mat33d()
    for h in range(offsets[i], offsets[i + 1]):
        w = mu[wp.max(incident[h], ~incident[h])]
        total += w * (rotation[i] + rotation[neighbours[h]])
    bias_out[i] = scale * total


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

    def bias(self, rotation: wp.array[wp.mat33d]) -> wp.array[wp.mat33d]:
        """scale sum_j mu_ij (R_i + R_j), added to the covariances.

        With R_i beside R_j the term is the tangent of a concave function, so that all nodes may turn at once and the
        energy still falls.
        """
        graph, result = self.graph, wp.empty_like(rotation)
        inputs = [graph.offsets, graph.neighbours, graph.incident, graph.mu, self.scale, rotation]
        wp.launch(_bias, dim=graph.node_count, inputs=inputs, outputs=[result], device=rotation.device)
        return result

    def energy(self, rotation: wp.array[wp.mat33d]) -> float:
        """Its value at these rotations (n,)."""
        graph = self.graph
        partial = graph.edge_segments.partials()
        launch_chunks(_roughness, graph.edge_segments, [graph.tail, graph.head, graph.mu, rotation], [partial])
        return self.scale * float(partial.numpy()[:, 0].sum())
