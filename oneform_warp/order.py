"""Components, and the order of nodes that keeps components together and neighbours close; on the device."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.incidence import UniqueEdges
from oneform_warp.sorting import iota, scan, sort_by_key

__all__ = ["Boxes", "Order", "along_a_curve", "as_numbered", "by_breadth", "solving_order"]


class Order(NamedTuple):
    """Nodes in solving order: components together, those with edges first, each in the order of its first group."""

    group_at: wp.array[wp.int32]
    """The group that stands at each node, (n,)."""
    node: wp.array[wp.int32]
    """The node of each group, (n,)."""
    component: wp.array[wp.int32]
    """The component of each node, (n,), non-decreasing from 0."""
    component_offsets: NDArray[np.int64]
    """Component c has the nodes component_offsets[c] to component_offsets[c + 1], (C + 1,)."""
    solved_components: int
    """How many components have edges."""


@wp.kernel(enable_backward=False)
def _hook(
    # In:
    low: wp.array[wp.int32],
    high: wp.array[wp.int32],
    # Out:
    label_out: wp.array[wp.int32],
    changed_out: wp.array[wp.int32],
):
    e = wp.tid()
    a = label_out[low[e]]
    b = label_out[high[e]]
    if a != b:
        # The smaller label wins in whatever order this runs: the end result is the smallest of the component.
        wp.atomic_min(label_out, wp.max(a, b), wp.min(a, b))
        changed_out[0] = 1


@wp.kernel(enable_backward=False)
def _shorten(
    # Out:
    label_out: wp.array[wp.int32],
):
    i = wp.tid()
    label = label_out[i]
    while label_out[label] != label:
        label = label_out[label]
    label_out[i] = label


def component_labels(edges: UniqueEdges, count: int) -> wp.array[wp.int32]:
    """The smallest group of each group's component, (n,): hook to smaller labels and shorten until nothing changes."""
    device = edges.low.device
    label = iota(count, device)
    changed = wp.ones(1, dtype=wp.int32, device=device)
    while changed.numpy()[0]:
        changed.zero_()
        inputs = [edges.low, edges.high]
        wp.launch(_hook, dim=edges.low.shape[0], inputs=inputs, outputs=[label, changed], device=device)
        wp.launch(_shorten, dim=count, outputs=[label], device=device)
    return label


@wp.kernel(enable_backward=False)
def _mark_ends(
    # In:
    low: wp.array[wp.int32],
    high: wp.array[wp.int32],
    # Out:
    joined_out: wp.array[wp.int32],
):
    e = wp.tid()
    joined_out[low[e]] = 1
    joined_out[high[e]] = 1


@wp.kernel(enable_backward=False)
def _component_keys(
    # In:
    label: wp.array[wp.int32],
    joined: wp.array[wp.int32],
    closeness: wp.array[wp.int32],
    # Out:
    key_out: wp.array[wp.int64],
):
    k = wp.tid()
    i = closeness[k]
    alone = wp.where(joined[i] == 0, wp.int64(1) << wp.int64(32), wp.int64(0))
    key_out[k] = alone | wp.int64(label[i])


@wp.kernel(enable_backward=False)
def _placed(
    # In:
    closeness: wp.array[wp.int32],
    place: wp.array[wp.int32],
    key: wp.array[wp.int64],
    # Out:
    group_out: wp.array[wp.int32],
    node_out: wp.array[wp.int32],
    start_out: wp.array[wp.int32],
):
    k = wp.tid()
    group = closeness[place[k]]
    group_out[k] = group
    node_out[group] = k
    start = int(1)
    if k > 0 and key[k] == key[k - 1]:
        start = 0
    start_out[k] = start


@wp.kernel(enable_backward=False)
def _numbered(
    # In:
    start: wp.array[wp.int32],
    offset: wp.array[wp.int32],
    key: wp.array[wp.int64],
    # Out:
    component_out: wp.array[wp.int32],
    first_out: wp.array[wp.int32],
    solved_out: wp.array[wp.int32],
):
    k = wp.tid()
    c = offset[k] + start[k] - 1
    component_out[k] = c
    if start[k] == 1:
        first_out[c] = k
        if key[k] < (wp.int64(1) << wp.int64(32)):
            wp.atomic_add(solved_out, 0, 1)


def solving_order(edges: UniqueEdges, closeness: wp.array[wp.int32]) -> Order:
    """The order of nodes; closeness: all groups, in an order in which neighbours are close, (n,)."""
    count, device = closeness.shape[0], closeness.device
    label, joined = component_labels(edges, count), wp.zeros(count, dtype=wp.int32, device=device)
    wp.launch(_mark_ends, dim=edges.low.shape[0], inputs=[edges.low, edges.high], outputs=[joined], device=device)
    key = wp.empty(count, dtype=wp.int64, device=device)
    wp.launch(_component_keys, dim=count, inputs=[label, joined, closeness], outputs=[key], device=device)
    key, place = sort_by_key(key)
    group, node, component = (wp.empty(count, dtype=wp.int32, device=device) for _ in range(3))
    start = wp.zeros(count + 1, dtype=wp.int32, device=device)
    wp.launch(_placed, dim=count, inputs=[closeness, place, key], outputs=[group, node, start], device=device)
    offset, total = scan(start)
    first, solved = wp.empty(total, dtype=wp.int32, device=device), wp.zeros(1, dtype=wp.int32, device=device)
    wp.launch(_numbered, dim=count, inputs=[start, offset, key], outputs=[component, first, solved], device=device)
    offsets = np.append(first.numpy().astype(np.int64), count)
    return Order(group, node, component, offsets, int(solved.numpy()[0]))


@wp.func
def _spaced(value: wp.uint64) -> wp.uint64:
    # 21 bits, two zeros between each and the next.
    v = value & wp.uint64(0x1FFFFF)
    v = (v | (v << wp.uint64(32))) & wp.uint64(0x1F00000000FFFF)
    v = (v | (v << wp.uint64(16))) & wp.uint64(0x1F0000FF0000FF)
    v = (v | (v << wp.uint64(8))) & wp.uint64(0x100F00F00F00F00F)
    v = (v | (v << wp.uint64(4))) & wp.uint64(0x10C30C30C30C30C3)
    return (v | (v << wp.uint64(2))) & wp.uint64(0x1249249249249249)


@wp.kernel(enable_backward=False)
def _morton(
    # In:
    x: wp.array[wp.vec3d],
    first: wp.array[wp.int32],
    mesh: wp.array[wp.int32],
    low: wp.array[wp.vec3d],
    per_unit: wp.array[wp.float64],
    # Out:
    code_out: wp.array[wp.int64],
):
    g = wp.tid()
    i = first[g]
    m = int(0)
    if mesh.shape[0] > 0:
        m = mesh[i]
    p = per_unit[m] * (x[i] - low[m])
    code = _spaced(wp.uint64(p[0])) | (_spaced(wp.uint64(p[1])) << wp.uint64(1))
    code_out[g] = wp.int64(code | (_spaced(wp.uint64(p[2])) << wp.uint64(2)))


class Boxes(NamedTuple):
    """The lowest and highest coordinates of each mesh, (k, 3), and each vertex's mesh, empty where there is one."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    mesh: wp.array[wp.int32]

    @classmethod
    def of(cls, x: NDArray[np.float64], mesh_of: NDArray[np.int32], device: Any) -> Boxes:
        """x: (V, 3); mesh_of: (V,)."""
        count = int(mesh_of.max(initial=-1)) + 1
        low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
        order = np.argsort(mesh_of, kind="stable")
        meshes, starts = np.unique(mesh_of[order], return_index=True)
        if len(meshes):
            low[meshes] = np.minimum.reduceat(x[order], starts)
            high[meshes] = np.maximum.reduceat(x[order], starts)
        return cls(low, high, wp.array(mesh_of, dtype=wp.int32, device=device))


def along_a_curve(x: wp.array[wp.vec3d], first: wp.array[wp.int32], boxes: Boxes) -> wp.array[wp.int32]:
    """Groups along Morton curves through their positions, each in its mesh's own box. first: a vertex of each group."""
    size = (boxes.high - boxes.low).max(axis=1, initial=0.0)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        per_unit = (2**21 - 1) / size
    per_unit[~np.isfinite(per_unit)] = 0.0
    low = np.where(np.isfinite(boxes.low), boxes.low, 0.0)
    code = wp.empty(first.shape[0], dtype=wp.int64, device=first.device)
    tables = [wp.array(low, dtype=wp.vec3d, device=x.device), wp.array(per_unit, dtype=wp.float64, device=x.device)]
    inputs = [x, first, boxes.mesh, *tables]
    wp.launch(_morton, dim=first.shape[0], inputs=inputs, outputs=[code], device=first.device)
    return sort_by_key(code)[1]


def as_numbered(edges: UniqueEdges, count: int) -> wp.array[wp.int32]:
    """Groups as they are numbered, for grids and lines."""
    return iota(count, edges.low.device)


def by_breadth(edges: UniqueEdges, count: int, mesh_of: NDArray[np.int32] | None = None) -> wp.array[wp.int32]:
    """Groups by reverse Cuthill-McKee, on the host: where nothing but the edges says who is close.

    mesh_of: the mesh of each group, (n,); each gets the order that it has alone.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    low, high = edges.low.numpy(), edges.high.numpy()
    if not len(low):
        return iota(count, edges.low.device)
    ones = np.ones(2 * len(low), dtype=np.int8)
    both = (np.concatenate([low, high]), np.concatenate([high, low]))
    matrix = coo_array((ones, both), shape=(count, count)).tocsr()
    groups = [np.arange(count)]
    if mesh_of is not None:
        by_mesh = np.argsort(mesh_of, kind="stable")
        groups = np.split(by_mesh, np.flatnonzero(np.diff(mesh_of[by_mesh])) + 1)
    parts = (matrix if len(each) == count else matrix[each][:, each] for each in groups)
    order = [each[reverse_cuthill_mckee(part, symmetric_mode=True)] for each, part in zip(groups, parts, strict=True)]
    return wp.array(np.concatenate(order).astype(np.int32), dtype=wp.int32, device=edges.low.device)
