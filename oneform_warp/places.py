"""Where handles put their vertices: target positions, by rows or by a rigid motion about a pivot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows
from oneform_warp.errors import InputError
from oneform_warp.graph import Graph
from oneform_warp.grip import Grip
from oneform_warp.handles import Handle
from oneform_warp.rest import Rest

__all__ = ["Places", "fitted", "placed", "reference_nodes", "targets_of"]

Floats = NDArray[np.float64]

SAME_PLACE = 1.0e-9
"""Of the mesh's size: by how much two handles' targets for one vertex may differ."""


def fitted(handles: Sequence[Handle], rest: Rest) -> list[Handle]:
    """The handles, with the rotation of those that fit it found from their targets."""
    return [_fit(handle, number, rest) if handle.fitted else handle for number, handle in enumerate(handles)]


def _fit(handle: Handle, number: int, rest: Rest) -> Handle:
    """The rotation R with the least sum |R (x - mean x) - (t - mean t)|^2, below 180 degrees. Source: Kabsch 1976."""
    from scipy.spatial.transform import Rotation

    x = rest.rows.data[handle.members(len(rest.rows.data), number)]
    t = targets_of(handle, number, rest)
    a, b = t - t.mean(axis=0), x - x.mean(axis=0)
    if not (a.any() and b.any()):  # a single vertex has no direction
        return handle.turned(np.zeros(3))
    u, _, v = np.linalg.svd(a.T @ b)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    return handle.turned(Rotation.from_matrix(u @ flip @ v).as_rotvec())


def targets_of(handle: Handle, number: int, rest: Rest) -> Floats:
    """Where a placed handle puts its vertices, (k, 3) in the order of `members`, in the unit of x."""
    members = handle.members(len(rest.rows.data), number)
    x = rest.rows.data[members]
    if handle.to is not None:
        rows = read_rows(handle.to, None, f"{handle.label(number)}: to")
        _check_columns(rows.dimension, handle, number, rest)
        return np.asarray(handle.rows(len(rest.rows.data), number, rows.data, "to"))
    if handle.held:
        return x
    for word, point in (("move", handle.move), ("pivot", handle.pivot)):
        if isinstance(point, np.ndarray) and point[rest.dimension :].any():
            raise InputError(
                f"{word} leaves D = {rest.dimension}", where=handle.label(number), fix=f"give {rest.dimension} numbers"
            )
    centre = x.mean(axis=0) if handle.pivot is None or isinstance(handle.pivot, str) else handle.pivot
    moved = _turned(handle, x - centre)
    # Without a pivot a turned handle turns about its own centroid; one that only moves has no use for either.
    by = np.zeros(3) if handle.move is None else handle.move
    # What is neither turned nor stretched gets its translation without the rounding of a detour.
    return x + by if moved is None else centre + moved + by


def _turned(handle: Handle, x: Floats) -> Floats | None:
    """R S x, None for the identity."""
    from scipy.spatial.transform import Rotation

    turned = handle.rotation is not None and bool(handle.rotation.any())
    factors = 1.0 if handle.stretch is None else handle.stretch
    if not turned and np.all(np.asarray(factors) == 1.0):
        return None
    frame = np.eye(3) if handle.frame is None else handle.frame
    stretched = ((x @ frame) * factors) @ frame.T
    if not turned:
        return stretched
    rotated: Floats = Rotation.from_rotvec(handle.rotation).apply(stretched)
    return rotated


def _check_columns(dimension: int, handle: Handle, number: int, rest: Rest) -> None:
    if dimension != rest.dimension:
        raise InputError(
            f"targets of {dimension} numbers where x has {rest.dimension}",
            where=handle.label(number),
            fix="give rows as those of x",
        )


def reference_nodes(grip: Grip) -> NDArray[np.bool_]:
    """The nodes that others are compared with, (n,): held ones, in components without those of the first handle."""
    graph = grip.graph
    chosen = np.zeros(graph.node_count, dtype=bool)
    # Handles that hold come first, whatever their number.
    for number, handle in sorted(enumerate(grip.handles), key=lambda each: not each[1].held):
        if handle.placed:
            nodes = graph.node_of[handle.members(graph.vertex_count, number)]
            taken = np.zeros(graph.component_count, dtype=bool)
            taken[graph.node_component[chosen]] = not handle.held
            chosen[nodes[~taken[graph.node_component[nodes]]]] = True
    return chosen


@dataclass(frozen=True, eq=False)
class Places:
    """The targets of all handles that put their vertices somewhere else than in the rest pose."""

    graph: Graph
    vertices: NDArray[np.int64]
    targets: Floats
    """(k, 3), in the unit of x."""
    exact: NDArray[np.bool_]
    """Which of them end exactly there, (k,)."""
    owner: NDArray[np.int64]
    """The number of the handle, (k,)."""

    @classmethod
    def of(cls, grip: Grip, handles: Sequence[Handle], rest: Rest) -> Places | None:
        """None where nothing is moved. InputError where two handles want one vertex in different places."""
        if not any(handle.moves or handle.soft for handle in handles):
            return None
        rows: list[tuple[Any, ...]] = []
        for number, handle in enumerate(handles):
            if handle.placed:
                members = handle.members(grip.graph.vertex_count, number)
                targets = targets_of(handle, number, rest)
                exact = np.full(len(members), handle.snap or not handle.soft)
                rows.append((members, targets, exact, np.full(len(members), number)))
        places = cls(grip.graph, *(np.concatenate(column) for column in zip(*rows, strict=True)))
        places._check(handles, rest)
        return places

    def _check(self, handles: Sequence[Handle], rest: Rest) -> None:
        nodes = self.graph.node_of[self.vertices]
        order = np.argsort(nodes, kind="stable")
        a, b = order[:-1], order[1:]
        shared = nodes[a] == nodes[b]
        a, b = a[shared], b[shared]
        apart = np.abs(self.targets[a] - self.targets[b]).max(axis=1, initial=0.0)
        # Vertices that are welded within a distance keep it, up to any stretch.
        x = rest.rows.data[self.vertices]
        welded = np.abs(x[a] - x[b]).max(axis=1, initial=0.0)
        wrong = apart > SAME_PLACE * rest.scale + 4.0 * welded
        if wrong.any():
            k = int(np.argmax(wrong))
            first, second = int(self.owner[a[k]]), int(self.owner[b[k]])
            who = " and ".join(dict.fromkeys(handles[number].label(number) for number in (first, second)))
            raise InputError(
                f"{who} {'give' if first != second else 'gives'} different places",
                where=f"vertex {self.vertices[b[k]]}",
                fix="let handles overlap only where they agree (welded vertices count as one)",
            )

    def misses(self, predicted: wp.array[wp.vec3d], given: NDArray[np.bool_], rest: Rest) -> dict[int, float]:
        """How far the mean of each handle's vertices is from their mean target in a prediction, in the unit of x.

        predicted: (n,), centred and scaled; given: the nodes that the prediction was given, whose handles are left out.
        """
        nodes = self.graph.node_of[self.vertices]
        apart = predicted.numpy()[nodes] * rest.scale + rest.centre - self.targets
        counted = ~given[nodes]
        handles = np.unique(self.owner[counted])
        means = (apart[counted & (self.owner == handle)].mean(axis=0) for handle in handles)
        return {int(handle): float(np.linalg.norm(mean)) for handle, mean in zip(handles, means, strict=True)}

    def put(self, x: wp.array[wp.vec3d], rest: Rest) -> None:
        """Puts the nodes of the targets there, in place; x per node, centred and scaled."""
        nodes, first = np.unique(self.graph.node_of[self.vertices], return_index=True)
        where: wp.array[wp.int32] = wp.array(nodes, dtype=wp.int32, device=x.device)
        inside = wp.array(rest.inside(self.targets[first]), dtype=wp.vec3d, device=x.device)
        wp.launch(_put, dim=len(nodes), inputs=[where, inside], outputs=[x], device=x.device)

    def correct(self, x: Any) -> Any:
        """The caller's rows with exact targets to the last bit; a copy."""
        rows = np.array(x.numpy() if isinstance(x, wp.array) else x)
        flat = rows.reshape(len(rows), -1)
        flat[self.vertices[self.exact]] = self.targets[self.exact][:, : flat.shape[1]]
        return wp.array(rows, dtype=x.dtype, device=x.device) if isinstance(x, wp.array) else rows


@wp.kernel(enable_backward=False)
def _keep_fixed(
    # In:
    fixed: wp.array[wp.int32],
    rest: wp.array[wp.vec3d],
    # Out:
    x_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    if fixed[i] != 0:
        x_out[i] = rest[i]


def placed(begin: wp.array[wp.vec3d], grip: Grip, places: Places | None, rest: Rest) -> wp.array[wp.vec3d]:
    """A start (n,) with what must not move at rest, pinned nodes and those without an edge, and the others put."""
    if begin is rest.x and places is None:
        return begin
    x = wp.clone(begin)
    wp.launch(_keep_fixed, dim=x.shape[0], inputs=[grip.fixed_on_device, rest.x], outputs=[x], device=x.device)
    if places is not None:
        places.put(x, rest)
    return x


@wp.kernel(enable_backward=False)
def _put(
    # In:
    node: wp.array[wp.int32],
    target: wp.array[wp.vec3d],
    # Out:
    x_out: wp.array[wp.vec3d],
):
    k = wp.tid()
    x_out[node[k]] = target[k]
