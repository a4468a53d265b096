"""Where a surface passes through itself: pairs of triangles of which an edge of one runs through the other."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

__all__ = ["intersection_counts"]


@wp.func
def volume(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d) -> wp.float64:
    """Six times the signed volume of a tetrahedron."""
    return wp.dot(wp.cross(b - a, c - a), d - a)


@wp.func
def pierces(p: wp.vec3d, q: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> bool:
    """Whether the inside of the segment pq runs through the inside of the triangle abc."""
    zero = wp.float64(0.0)
    before = volume(a, b, c, p)
    behind = volume(a, b, c, q)
    if not ((before > zero and behind < zero) or (before < zero and behind > zero)):
        return False
    u = volume(p, q, a, b)
    v = volume(p, q, b, c)
    w = volume(p, q, c, a)
    return (u > zero and v > zero and w > zero) or (u < zero and v < zero and w < zero)


@wp.func
def edge_pierces(x: wp.array[wp.vec3d], f: wp.vec3i, g: wp.vec3i, shared: int) -> bool:
    """Whether an edge of f without the node `shared`, -1 for none, runs through g."""
    # An edge at the shared node only touches g there, but for rounding.
    found = bool(False)
    for k in range(3):
        i = f[k]
        j = f[(k + 1) % 3]
        if i != shared and j != shared:
            found = found or pierces(x[i], x[j], x[g[0]], x[g[1]], x[g[2]])
    return found


@wp.kernel(enable_backward=False)
def _counts(
    # Mesh:
    bvh: wp.uint64,
    triangles: wp.array[wp.vec3i],
    low: wp.array[wp.vec3],
    high: wp.array[wp.vec3],
    # In:
    x: wp.array[wp.vec3d],
    # Out:
    count_out: wp.array[wp.int32],
):
    t = wp.tid()
    query = wp.bvh_query_aabb(bvh, low[t], high[t])
    other = wp.int32(0)
    count = int(0)
    while wp.bvh_query_next(query, other):
        # In the same order from both sides, so that rounding tells both the same.
        f = triangles[wp.where(t < other, t, other)]
        g = triangles[wp.where(t < other, other, t)]
        shared = int(-1)
        common = int(0)
        for i in range(3):
            for j in range(3):
                if f[i] == g[j]:
                    shared = f[i]
                    common += 1
        if common < 2 and (edge_pierces(x, f, g, shared) or edge_pierces(x, g, f, shared)):
            count += 1
    count_out[t] = count


def intersection_counts(x: Any, triangles: Any, *, device: Any = None) -> NDArray[np.int64]:
    """How many other triangles each triangle properly intersects, (T,): half the sum is the number of pairs.

    x: positions (n, 3) of nodes, in any unit; triangles: (T, 3) node numbers, neighbours share nodes. Proper: an edge
    of one runs through the inside of the other, in float64. Touching, overlaps within a plane, and neighbours over an
    edge that fold onto each other do not count. Candidates are found by their boxes in a wp.Bvh on the device.
    """
    rows = np.asarray(x, dtype=np.float64)
    faces = np.asarray(triangles, dtype=np.int32).reshape(-1, 3)
    if not len(faces):
        return np.zeros(0, dtype=np.int64)
    # Around zero the boxes in float32 are tightest.
    rows = rows - 0.5 * (rows.min(axis=0) + rows.max(axis=0))
    corners = rows[faces]
    low, high = _rounded(corners.min(axis=1), -np.inf), _rounded(corners.max(axis=1), np.inf)
    boxes = [wp.array(side, dtype=wp.vec3, device=device) for side in (low, high)]
    bvh = wp.Bvh(*boxes)
    count: wp.array[wp.int32] = wp.zeros(len(faces), dtype=wp.int32, device=boxes[0].device)
    inputs = [
        bvh.id,
        wp.array(faces, dtype=wp.vec3i, device=device),
        *boxes,
        wp.array(rows, dtype=wp.vec3d, device=device),
    ]
    wp.launch(_counts, dim=len(faces), inputs=inputs, outputs=[count], device=count.device)
    return np.asarray(count.numpy(), dtype=np.int64)


def _rounded(values: NDArray[np.float64], towards: float) -> NDArray[np.float32]:
    """To float32, never inwards."""
    return np.nextafter(values.astype(np.float32), np.float32(towards))
