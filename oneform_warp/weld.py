"""Welding: coincident positions become one node, so that soups and UV seams deform as one piece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.sorting import iota, scan, sort_by_key

__all__ = ["Groups", "weld"]


@dataclass(frozen=True, eq=False)
class Groups:
    """Vertices that are to be one node."""

    of_vertex: wp.array[wp.int32]
    """The group of each vertex, (V,)."""
    first: wp.array[wp.int32]
    """The first vertex of each group, (G,)."""


def weld(x: wp.array[wp.vec3d], tolerance: float | None = 0.0, mesh_of: wp.array[wp.int32] | None = None) -> Groups:
    """The group of each vertex, on the device of x.

    x: positions, (V,). tolerance: 0.0 joins exactly equal positions; > 0 joins, transitively, positions closer than
    this length; None joins nothing. mesh_of: vertices of different meshes, (V,) numbers, are never joined.
    """
    if tolerance is None:
        return Groups(iota(x.shape[0], x.device), iota(x.shape[0], x.device))
    if not np.isfinite(tolerance) or tolerance < 0.0:
        raise InputError(
            f"the weld tolerance is {tolerance}", where="weld", fix="give a length >= 0, or None to weld nothing"
        )
    if tolerance > 0.0:
        return _from_labels(_by_distance(x.numpy(), tolerance, mesh_of), x.device)
    return _by_equality(x, wp.zeros(0, dtype=wp.int32, device=x.device) if mesh_of is None else mesh_of)


@wp.func
def _mixed(h: wp.uint64, value: wp.float64) -> wp.uint64:
    # Adding zero makes one place of 0.0 and -0.0.
    bits = wp.cast(value + wp.float64(0.0), wp.uint64)
    h = (h ^ bits) * wp.uint64(0x9E3779B97F4A7C15)
    return h ^ (h >> wp.uint64(29))


@wp.kernel(enable_backward=False)
def _hashes(
    # In:
    x: wp.array[wp.vec3d],
    # Out:
    key_out: wp.array[wp.int64],
):
    i = wp.tid()
    h = _mixed(_mixed(_mixed(wp.uint64(1), x[i][0]), x[i][1]), x[i][2])
    key_out[i] = wp.int64(h >> wp.uint64(1))


@wp.kernel(enable_backward=False)
def _distinct(
    # In:
    x: wp.array[wp.vec3d],
    mesh_of: wp.array[wp.int32],
    key: wp.array[wp.int64],
    place: wp.array[wp.int32],
    # Out:
    start_out: wp.array[wp.int32],
    collision_out: wp.array[wp.int32],
):
    k = wp.tid()
    start = int(1)
    if k > 0:
        if x[place[k]] == x[place[k - 1]]:
            # Meshes follow each other in vertices, and so in places as well.
            start = 0
            if mesh_of.shape[0] > 0 and mesh_of[place[k]] != mesh_of[place[k - 1]]:
                start = 1
        elif key[k] == key[k - 1]:
            collision_out[0] = 1
    start_out[k] = start


@wp.kernel(enable_backward=False)
def _spread(
    # In:
    place: wp.array[wp.int32],
    start: wp.array[wp.int32],
    offset: wp.array[wp.int32],
    # Out:
    group_out: wp.array[wp.int32],
    first_out: wp.array[wp.int32],
):
    k = wp.tid()
    group = offset[k] + start[k] - 1
    group_out[place[k]] = group
    if start[k] == 1:
        first_out[group] = place[k]


def _by_equality(x: wp.array[wp.vec3d], mesh_of: wp.array[wp.int32]) -> Groups:
    """Sort by a hash and compare neighbours; where hashes collide, which no mesh has, sort by the coordinates."""
    count, device = x.shape[0], x.device
    key = wp.empty(count, dtype=wp.int64, device=device)
    # Without the mesh: then the groups of each stand in the order that they have alone.
    wp.launch(_hashes, dim=count, inputs=[x], outputs=[key], device=device)
    key, place = sort_by_key(key)
    start = wp.zeros(count + 1, dtype=wp.int32, device=device)
    collision = wp.zeros(1, dtype=wp.int32, device=device)
    wp.launch(_distinct, dim=count, inputs=[x, mesh_of, key, place], outputs=[start, collision], device=device)
    if collision.numpy()[0]:
        rows = _with_mesh(x.numpy() + 0.0, mesh_of if mesh_of.shape[0] else None, 1.0)
        return _from_labels(np.unique(rows, axis=0, return_inverse=True)[1].ravel(), device)
    return _grouped(place, start)


def _grouped(place: wp.array[wp.int32], start: wp.array[wp.int32]) -> Groups:
    """Groups from vertices in an order where equal ones stand together, and where each group starts."""
    count, device = place.shape[0], place.device
    offset, total = scan(start)
    group, first = wp.empty(count, dtype=wp.int32, device=device), wp.empty(total, dtype=wp.int32, device=device)
    wp.launch(_spread, dim=count, inputs=[place, start, offset], outputs=[group, first], device=device)
    return Groups(group, first)


def _with_mesh(x: NDArray[np.float64], mesh_of: wp.array[wp.int32] | None, distance: float) -> NDArray[np.float64]:
    """Positions with one more coordinate, which keeps the meshes this far apart."""
    return x if mesh_of is None else np.column_stack([x, distance * mesh_of.numpy()])


def _by_distance(x: NDArray[np.float64], tolerance: float, mesh_of: wp.array[wp.int32] | None) -> NDArray[np.int64]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(_with_mesh(x, mesh_of, 2.0 * tolerance)).query_pairs(tolerance, output_type="ndarray")
    near = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(x), len(x)))
    labels: NDArray[np.int64] = connected_components(near, directed=False)[1].astype(np.int64)
    return labels


def _from_labels(labels: NDArray[np.int64], device: wp.Device) -> Groups:
    first = np.unique(labels, return_index=True)[1]
    return Groups(
        wp.array(labels.astype(np.int32), dtype=wp.int32, device=device),
        wp.array(first.astype(np.int32), dtype=wp.int32, device=device),
    )
