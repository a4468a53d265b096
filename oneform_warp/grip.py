"""Where handles take hold of a graph: found once for their vertices, and used for any rotations and stretches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.graph import Graph
from oneform_warp.handle_values import FRAME_ERROR
from oneform_warp.handles import Handle, check_dimension
from oneform_warp.stretches import log_tensor, six_numbers

__all__ = ["Grip", "Pins"]


@wp.kernel(enable_backward=False)
def _given(
    # Graph:
    component: wp.array[wp.int32],
    # In:
    owner: wp.array[wp.int32],
    value: wp.array[wp.vec3d],
    elsewhere: wp.array[wp.vec3d],
    # Out:
    value_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    h = owner[i]
    if h >= 0:
        value_out[i] = value[h]
    else:
        value_out[i] = elsewhere[component[i]]


@dataclass(frozen=True, eq=False)
class Pins:
    """Nodes whose value is set, and the handle that sets it."""

    graph: Graph
    mask: NDArray[np.bool_]
    """(n,)"""
    owner: wp.array[wp.int32]
    """The number of the handle, -1 where none sets a value, (n,) on the device."""
    overlaps: tuple[tuple[int, int, int], ...]
    """Two handles that meet, and the first vertex where they do."""
    shares: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]
    """Component, handle, and how many nodes of the one the other sets."""

    @classmethod
    def of(cls, graph: Graph, members: dict[int, NDArray[np.int64]]) -> Pins:
        """members: the vertices of each handle that sets a value."""
        owner = np.full(graph.node_count, -1, dtype=np.int32)
        overlaps = []
        for number, vertices in members.items():
            nodes = graph.node_of[vertices]
            met, first = np.unique(owner[nodes], return_index=True)
            overlaps += [(int(a), number, int(vertices[k])) for a, k in zip(met, first, strict=True) if a >= 0]
            owner[nodes] = number
        mask = owner >= 0
        handles = max(members, default=0) + 1
        pair, count = np.unique(graph.node_component[mask].astype(np.int64) * handles + owner[mask], return_counts=True)
        on_device: wp.array[wp.int32] = wp.array(owner, dtype=wp.int32, device=graph.device)
        return cls(graph, mask, on_device, tuple(overlaps), (pair // handles, pair % handles, count))

    def check(self, values: NDArray[np.float64], handles: Sequence[Handle], kind: str) -> None:
        """InputError where two handles meet that give different values (handles, 3)."""
        for a, b, vertex in self.overlaps:
            if (values[a] != values[b]).any():
                raise InputError(
                    f"{handles[a].label(a)} and {handles[b].label(b)} give different {kind}",
                    where=f"vertex {vertex}",
                    fix="let handles overlap only where they agree (welded vertices count as one)",
                )

    def extremes(self, values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The least and greatest value that each component is given, (components, 3); 0 where none is."""
        component, handle, _ = self.shares
        low, high = np.full((self.graph.component_count, 3), np.inf), np.full((self.graph.component_count, 3), -np.inf)
        np.minimum.at(low, component, values[handle])
        np.maximum.at(high, component, values[handle])
        return np.where(np.isfinite(low), low, 0.0), np.where(np.isfinite(high), high, 0.0)

    def means(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The mean value over the pinned nodes of each component, (components, 3); 0 where none is given."""
        component, handle, count = self.shares
        total = np.maximum(np.bincount(component, count, self.graph.component_count), 1.0)[:, None]
        sums = np.stack([np.bincount(component, count * c, len(total)) for c in values[handle].T], axis=1)
        # A mean of equal values may differ from them by rounding; take the value itself.
        low, high = self.extremes(values)
        return np.where(low == high, low, sums / total)

    def spread_out(self, values: NDArray[np.float64], elsewhere: NDArray[np.float64]) -> wp.array[wp.vec3d]:
        """The handles' values (handles, 3) at their nodes, elsewhere (components, 3) at the others, on the device."""
        graph = self.graph
        result = wp.empty(graph.node_count, dtype=wp.vec3d, device=graph.device)
        tables = [wp.array(np.atleast_2d(a), dtype=wp.vec3d, device=graph.device) for a in (values, elsewhere)]
        inputs = [graph.component_of_node, self.owner, *tables]
        wp.launch(_given, dim=graph.node_count, inputs=inputs, outputs=[result], device=graph.device)
        return result


@dataclass(frozen=True, eq=False)
class Grip:
    """The nodes that a set of handles turns, stretches, and holds or puts in places."""

    graph: Graph
    handles: tuple[Handle, ...]
    turned: Pins
    stretched: Pins
    pinned: NDArray[np.bool_]
    """The nodes that are exactly where their handles put or hold them, (n,)."""
    attachment: NDArray[np.float64] | None
    """How strongly nodes are pulled to where soft handles want them, (n,), in units of mu; None where none is."""
    touched: NDArray[np.bool_]
    """The components that any handle touches, (components,)."""

    @classmethod
    def of(cls, graph: Graph, handles: Sequence[Handle]) -> Grip:
        """InputError for a handle without vertices, or with some that the graph does not have."""
        members = {number: handle.members(graph.vertex_count, number) for number, handle in enumerate(handles)}

        def pins(sets_value: Callable[[Handle], bool]) -> Pins:
            return Pins.of(graph, {number: members[number] for number, h in enumerate(handles) if sets_value(h)})

        pinned = np.zeros(graph.node_count, dtype=bool)
        touched = np.zeros(graph.component_count, dtype=bool)
        for number, handle in enumerate(handles):
            nodes = graph.node_of[members[number]]
            pinned[nodes] |= handle.placed and not handle.soft
            touched[graph.node_component[nodes]] = True
        turned = stretched = pins(lambda h: h.rotation is not None)
        # Where the same handles turn and stretch, what is solved for one serves both.
        if any((h.rotation is None) != (h.stretch is None) for h in handles):
            stretched = pins(lambda h: h.stretch is not None)
        attachment = _attachment(graph, handles, members, pinned)
        return cls(graph, tuple(handle.alone() for handle in handles), turned, stretched, pinned, attachment, touched)

    def serves(self, handles: Sequence[Handle]) -> bool:
        """Whether these handles differ from the ones it was made for in their values at most."""
        return len(handles) == len(self.handles) and all(
            a.holds_like(b) for a, b in zip(self.handles, handles, strict=True)
        )

    @cached_property
    def fixed_on_device(self) -> wp.array[wp.int32]:
        """1 at pinned nodes and at those without an edge, (n,)."""
        graph = self.graph
        fixed = self.pinned.astype(np.int32)
        fixed[graph.component_offsets[graph.solved_components] :] = 1
        on_device: wp.array[wp.int32] = wp.array(fixed, dtype=wp.int32, device=graph.device)
        return on_device

    @cached_property
    def turned_alone(self) -> wp.array[wp.int32]:
        """1 at the nodes of handles that are turned and not placed: nothing but their rotation keeps them so, (n,)."""
        graph = self.graph
        alone = np.zeros(graph.node_count, dtype=np.int32)
        for number, handle in enumerate(self.handles):
            if handle.rotation is not None and not handle.placed:
                alone[graph.node_of[handle.members(graph.vertex_count, number)]] = 1
        on_device: wp.array[wp.int32] = wp.array(alone, dtype=wp.int32, device=graph.device)
        return on_device

    def rotations(self, handles: Sequence[Handle], dimension: int) -> NDArray[np.float64]:
        """The rotation vectors, (handles, 3); InputError where two handles disagree, or D has no such turn."""
        for number, handle in enumerate(handles):
            check_dimension(handle, number, dimension)
        values = np.array([[0.0] * 3 if h.rotation is None else h.rotation for h in handles]).reshape(-1, 3)
        self.turned.check(values, handles, "rotations")
        return values

    def log_stretches(self, handles: Sequence[Handle]) -> NDArray[np.float64]:
        """Log sigma in the first column, (handles, 3); InputError where two handles disagree."""
        values = np.zeros((len(handles), 3))
        values[:, 0] = [0.0 if h.stretch is None else np.log(np.ravel(h.stretch)[0]) for h in handles]
        self.stretched.check(values, handles, "stretches")
        return values

    def log_tensors(
        self, handles: Sequence[Handle], dimension: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Log S as xx yy zz and yz zx xy, (handles, 3) each; None where every handle stretches alike everywhere.

        InputError where two handles disagree, or stretch out of what D has.
        """
        if all(h.stretch is None or np.all(np.asarray(h.stretch) == np.ravel(h.stretch)[0]) for h in handles):
            return None
        diagonal, beside = six_numbers(np.array([log_tensor(h.stretch, h.frame) for h in handles]))
        for number, handle in enumerate(handles):
            if dimension < 3 and np.abs(beside[number, : 3 if dimension == 1 else 2]).max() > FRAME_ERROR:
                fix = "turn the frame about z alone" if dimension == 2 else "leave the frame out"
                raise InputError(f"the stretch leaves D = {dimension}", where=handle.label(number), fix=fix)
        for values in (diagonal, beside):
            self.stretched.check(values, handles, "stretches")
        return diagonal, beside


def _attachment(
    graph: Graph, handles: Sequence[Handle], members: dict[int, NDArray[np.int64]], pinned: NDArray[np.bool_]
) -> NDArray[np.float64] | None:
    """The weights of soft handles, each times the sum of mu at its node: of several on one node the largest."""
    soft = {number: handle for number, handle in enumerate(handles) if handle.soft}
    if not soft:
        return None
    mu, ends = graph.mu.numpy(), (graph.tail.numpy(), graph.head.numpy())
    strength = sum(np.bincount(end, mu, graph.node_count) for end in ends)
    pull = np.zeros(graph.node_count)
    for number, handle in soft.items():
        weights = np.broadcast_to(handle.pull(graph.vertex_count, number), len(members[number]))
        np.maximum.at(pull, graph.node_of[members[number]], weights)
    pull[pinned] = 0.0
    attachment: NDArray[np.float64] = pull * strength
    return attachment
