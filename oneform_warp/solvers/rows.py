"""The system as the inner iterations see it: rows of the graph Laplacian, scaled, in their precision."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from oneform_warp.segments import Segments, launch_chunks
from oneform_warp.solvers.precision import Precision, in_both_precisions
from oneform_warp.solvers.system import System

__all__ = ["LaplacianRows", "power_of_two", "scaled_right_hand_side"]

Scalar = wp.float32
Vector = wp.vec3


@in_both_precisions
def _half_edge_weights(
    # Graph:
    offsets: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    pinned: wp.array[wp.int32],
    attachment: wp.array[wp.float64],
    scale: wp.float64,
    # Out:
    weight_out: wp.array[Scalar],
    attachment_out: wp.array[Scalar],
    inverse_diagonal_out: wp.array[Scalar],
):
    i = wp.tid()
    diagonal = wp.float64(0.0)
    for h in range(offsets[i], offsets[i + 1]):
        w = scale * mu[wp.max(incident[h], ~incident[h])]
        weight_out[h] = Scalar(w)
        diagonal += w
    if attachment.shape[0] > 0:
        attachment_out[i] = Scalar(scale * attachment[i])
        diagonal += scale * attachment[i]
    inverse = Scalar(0.0)
    if pinned[i] == 0 and diagonal > wp.float64(0.0):
        inverse = Scalar(wp.float64(1.0) / diagonal)
    inverse_diagonal_out[i] = inverse


@dataclass(frozen=True, eq=False)
class LaplacianRows:
    """L scaled by a power of two so that the largest weight is near 1; rows of pinned nodes are masked."""

    offsets: wp.array[wp.int32]
    neighbours: wp.array[wp.int32]
    weight: wp.array[Any]
    """Per half-edge, (2 m,)."""
    attachment: wp.array[Any]
    """(n,), or empty for none."""
    inverse_diagonal: wp.array[Any]
    """1 / L_ii, (n,), or less where weights are negative; zero marks the nodes that do not move."""
    scale: float
    segments: Segments
    precision: Precision

    @classmethod
    def of(cls, system: System, precision: Precision) -> LaplacianRows:
        """The rows of `system`, made on its device."""
        graph, scalar = system.graph, precision.scalar
        count, device = graph.node_count, graph.device
        scale = 1.0 / power_of_two(graph.largest_weight)
        weight = wp.empty(2 * graph.edge_count, dtype=scalar, device=device)
        attachment = wp.empty(system.attachment.shape[0], dtype=scalar, device=device)
        inverse = wp.empty(count, dtype=scalar, device=device)
        wp.launch(
            _half_edge_weights(precision),
            dim=count,
            inputs=[graph.offsets, graph.incident, graph.mu, system.pinned, system.attachment, scale],
            outputs=[weight, attachment, inverse],
            device=device,
        )
        return cls(graph.offsets, graph.neighbours, weight, attachment, inverse, scale, graph.segments, precision)

    def arguments(self) -> list[Any]:
        """The arguments of a kernel that multiplies with these rows, after the chunk offsets."""
        return [self.offsets, self.neighbours, self.weight, self.attachment, self.inverse_diagonal]

    def vectors(self) -> wp.array[Any]:
        """One zero vector per node, in this precision."""
        count = self.inverse_diagonal.shape[0]
        return wp.zeros(count, dtype=self.precision.vector, device=self.segments.device)


@in_both_precisions
def _scaled(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    # In:
    r: wp.array[wp.vec3d],
    unit: wp.array[wp.vec3d],
    # Out:
    r_out: wp.array[Vector],
):
    k, lane = wp.tid()
    u = unit[chunk_component[k]]
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        r_out[i] = Vector(wp.cw_div(r[i], u))


def scaled_right_hand_side(
    rows: LaplacianRows, r: wp.array[wp.vec3d], unit: wp.array[wp.vec3d], r_out: wp.array[Any]
) -> None:
    """R in units that bring its norms near 1, in the rows' precision.

    The displacement e that solves (scale L) e = r_out is in units of scale * unit.
    """
    segments = rows.segments
    launch_chunks(_scaled(rows.precision), segments, [segments.chunk_component, r, unit], [r_out])


def power_of_two(size: float) -> float:
    """The power of two at or below size, exact to multiply with; 1 for zero."""
    if size <= 0.0 or not np.isfinite(size):
        return 1.0
    return float(2.0 ** np.clip(np.floor(np.log2(size)), -1000, 1000))
