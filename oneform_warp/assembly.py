"""From listed pairs of vertices to the arrays of a graph, on the device: everything but the weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.incidence import UniqueEdges, incidence, sorted_edges, unique_edges
from oneform_warp.intake import Corners
from oneform_warp.order import solving_order
from oneform_warp.segments import Segments
from oneform_warp.weights import Listing, NodeFaces
from oneform_warp.weld import Groups

__all__ = ["Assembly", "Pairs", "assemble", "gather", "listed_edges", "on_corners"]


@dataclass(frozen=True, eq=False, repr=False)
class Assembly:
    """Nodes, edges between them, and where both came from."""

    vertex_count: int
    node_of_vertex: wp.array[wp.int32]
    """The node of each vertex, (V,)."""
    first_vertex: wp.array[wp.int32]
    """The first vertex of each node, (n,)."""
    component_of_node: wp.array[wp.int32]
    """The component of each node, (n,), non-decreasing; components without an edge come last."""
    component_offsets: NDArray[np.int64]
    """Component c has the nodes component_offsets[c] to component_offsets[c + 1]."""
    solved_components: int
    """How many components have edges; the others are single nodes."""
    tail: wp.array[wp.int32]
    """The node where each edge starts, (m,)."""
    head: wp.array[wp.int32]
    offsets: wp.array[wp.int32]
    """Node i has the half-edges offsets[i] to offsets[i + 1], (n + 1,)."""
    neighbours: wp.array[wp.int32]
    """The other node of each half-edge, (2 m,)."""
    incident: wp.array[wp.int32]
    """The edge e of each half-edge that runs along it, ~e of one that runs against it, (2 m,)."""
    segments: Segments
    listing: Listing
    faces: NodeFaces | None
    device: Any

    @property
    def node_count(self) -> int:
        """Vertices after welding."""
        return int(self.first_vertex.shape[0])

    @property
    def edge_count(self) -> int:
        """Unique undirected edges, m."""
        return int(self.tail.shape[0])

    @property
    def component_count(self) -> int:
        """Connected components, isolated vertices included."""
        return len(self.component_offsets) - 1

    @cached_property
    def node_of(self) -> NDArray[np.int32]:
        """The node of each vertex, on the host."""
        return self.node_of_vertex.numpy()

    @cached_property
    def vertex_at(self) -> NDArray[np.int32]:
        """The first vertex of each node, on the host."""
        return self.first_vertex.numpy()

    @cached_property
    def node_component(self) -> NDArray[np.int32]:
        """The component of each node, on the host."""
        return self.component_of_node.numpy()


class Pairs(NamedTuple):
    """Listed pairs of groups, polygon corners first."""

    first: wp.array[wp.int32]
    second: wp.array[wp.int32]
    corner_count: int
    face_offsets: wp.array[wp.int32] | None


@wp.kernel(enable_backward=False)
def _corners(
    # In:
    indices: wp.array[wp.int32],
    face_offsets: wp.array[wp.int32],
    group: wp.array[wp.int32],
    # Out:
    first_out: wp.array[wp.int32],
    second_out: wp.array[wp.int32],
):
    f = wp.tid()
    begin = face_offsets[f]
    end = face_offsets[f + 1]
    for c in range(begin, end):
        first_out[c] = group[indices[c]]
        second_out[c] = group[indices[wp.where(c + 1 == end, begin, c + 1)]]


@wp.kernel(enable_backward=False)
def _extra(
    # In:
    pairs: wp.array[wp.vec2i],
    group: wp.array[wp.int32],
    begin: int,
    # Out:
    first_out: wp.array[wp.int32],
    second_out: wp.array[wp.int32],
):
    k = wp.tid()
    first_out[begin + k] = group[pairs[k][0]]
    second_out[begin + k] = group[pairs[k][1]]


def on_corners(polygons: Corners | None, extra: NDArray[np.int64], groups: Groups, device: Any) -> Pairs:
    """The polygons' own edges, one per corner, and then the extra pairs (k, 2) of vertices, in groups."""
    corner_count = 0 if polygons is None else polygons.indices.shape[0]
    total = corner_count + len(extra)
    first, second = (wp.empty(total, dtype=wp.int32, device=device) for _ in range(2))
    offsets = None
    if polygons is not None:
        indices, offsets = polygons
        inputs = [indices, offsets, groups.of_vertex]
        outputs = [first, second]
        wp.launch(_corners, dim=polygons.offsets.shape[0] - 1, inputs=inputs, outputs=outputs, device=device)
    if len(extra):
        pairs = wp.array(extra.astype(np.int32), dtype=wp.vec2i, device=device)
        wp.launch(
            _extra,
            dim=len(extra),
            inputs=[pairs, groups.of_vertex, corner_count],
            outputs=[first, second],
            device=device,
        )
    return Pairs(first, second, corner_count, offsets)


@wp.kernel(enable_backward=False)
def _looked_up(
    # In:
    table: wp.array[wp.int32],
    at: wp.array[wp.int32],
    # Out:
    value_out: wp.array[wp.int32],
):
    k = wp.tid()
    value_out[k] = table[at[k]]


def _look_up(table: wp.array[wp.int32], at: wp.array[wp.int32]) -> wp.array[wp.int32]:
    """table[at]."""
    values = wp.empty(at.shape[0], dtype=wp.int32, device=at.device)
    wp.launch(_looked_up, dim=at.shape[0], inputs=[table, at], outputs=[values], device=at.device)
    return values


@wp.kernel(enable_backward=False)
def _gathered(
    # In:
    rows: wp.array[wp.vec3d],
    at: wp.array[wp.int32],
    # Out:
    row_out: wp.array[wp.vec3d],
):
    k = wp.tid()
    row_out[k] = rows[at[k]]


def gather(rows: wp.array[wp.vec3d], at: wp.array[wp.int32]) -> wp.array[wp.vec3d]:
    """rows[at], on their device."""
    values = wp.empty(at.shape[0], dtype=wp.vec3d, device=at.device)
    wp.launch(_gathered, dim=at.shape[0], inputs=[rows, at], outputs=[values], device=at.device)
    return values


def assemble(groups: Groups, pairs: Pairs, closeness: Callable[[UniqueEdges, int], wp.array[wp.int32]]) -> Assembly:
    """The arrays of a graph. closeness(edges, count): all groups, in an order in which neighbours are close."""
    count, device = int(groups.first.shape[0]), groups.first.device
    unique = unique_edges(pairs.first, pairs.second, count)
    order = solving_order(unique, closeness(unique, count))
    tail, head, unique_of = sorted_edges(unique, order.node)
    table = incidence(tail, head, count)
    first = _look_up(order.node, pairs.first)
    corners = pairs.corner_count
    faces = None
    if pairs.face_offsets is not None:
        # Warp slices no empty arrays.
        on_faces = first[:corners] if corners else wp.zeros(0, dtype=wp.int32, device=device)
        faces = NodeFaces(on_faces, pairs.face_offsets)
    return Assembly(
        vertex_count=int(groups.of_vertex.shape[0]),
        node_of_vertex=_look_up(order.node, groups.of_vertex),
        first_vertex=_look_up(groups.first, order.group_at),
        component_of_node=order.component,
        component_offsets=order.component_offsets,
        solved_components=order.solved_components,
        tail=tail,
        head=head,
        offsets=table.offsets,
        neighbours=table.neighbours,
        incident=table.incident,
        segments=Segments.from_offsets(order.component_offsets[: order.solved_components + 1], device),
        listing=Listing(first, unique.listed, unique.offsets, unique_of),
        faces=faces,
        device=device,
    )


def listed_edges(graph: Assembly) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The edge of each listed pair, -1 for a loop, and +1 where the pair runs along it, -1 against it; on the host."""
    listing = graph.listing
    order, offsets, unique_of = (a.numpy() for a in (listing.order, listing.offsets, listing.unique_of))
    edge_of_unique = np.empty(graph.edge_count, dtype=np.int64)
    edge_of_unique[unique_of] = np.arange(graph.edge_count)
    edge = np.full(len(order), -1, dtype=np.int64)
    proper = order[: offsets[-1]]
    edge[proper] = np.repeat(edge_of_unique, np.diff(offsets))
    sign = np.ones(len(order))
    if graph.edge_count:
        sign[listing.first.numpy() != graph.tail.numpy()[edge]] = -1.0
    return edge, sign
