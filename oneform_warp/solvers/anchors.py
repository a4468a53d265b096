"""A component with one pinned node: solved as if nothing were pinned, then moved to where the pin is.

One pin only chooses the constant. As a constraint it would leave the matrix nearly singular, and the rounding of a
float32 residual would drift into that constant: 1e-5 of the box at 100k vertices, where the shift is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.segments import launch_chunks

__all__ = ["Anchors"]


@wp.kernel(enable_backward=False)
def _shifts(
    # In:
    anchor: wp.array[wp.int32],
    x: wp.array[wp.vec3d],
    given: wp.array[wp.vec3d],
    # Out:
    shift_out: wp.array[wp.vec3d],
):
    c = wp.tid()
    i = anchor[c]
    shift = wp.vec3d()
    if i >= 0:
        shift = given[i] - x[i]
    shift_out[c] = shift


@wp.kernel(enable_backward=False)
def _move(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    # In:
    anchor: wp.array[wp.int32],
    shift: wp.array[wp.vec3d],
    given: wp.array[wp.vec3d],
    # Out:
    x_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    c = chunk_component[k]
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        x = x_out[i] + shift[c]
        if i == anchor[c]:
            x = given[i]
        x_out[i] = x


@dataclass(frozen=True, eq=False)
class Anchors:
    """The pinned node of each component with edges that has exactly one, -1 for the others."""

    graph: Graph
    node: wp.array[wp.int32]
    """(components with edges,), on the device."""
    nodes: NDArray[np.int64]
    """The anchors alone, on the host."""

    @classmethod
    def among(cls, graph: Graph, pinned: NDArray[np.bool_]) -> Anchors:
        """pinned: (n,) mask of nodes."""
        nodes = np.flatnonzero(pinned)
        component = graph.node_component[nodes]
        count = np.bincount(component, minlength=graph.component_count)
        alone = (count[component] == 1) & (component < graph.solved_components)
        node = np.full(graph.solved_components, -1, dtype=np.int32)
        node[component[alone]] = nodes[alone]
        return cls(graph, wp.array(node, dtype=wp.int32, device=graph.device), nodes[alone])

    def restore(self, x: wp.array[wp.vec3d], given: wp.array[wp.vec3d]) -> None:
        """Moves each anchored component of x, in place, so that its anchor is where it is in `given`, bit for bit."""
        if not len(self.nodes):
            return
        segments = self.graph.segments
        shift = segments.zeros()
        wp.launch(_shifts, dim=segments.component_count, inputs=[self.node, x, given], outputs=[shift], device=x.device)
        launch_chunks(_move, segments, [segments.chunk_component, self.node, shift, given], [x])
