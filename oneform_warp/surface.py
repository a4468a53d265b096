"""The surface that faces make: triangles, normals and areas around its nodes, and which side of it is inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Surface", "fan", "surface"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FLAT = 1.0e-9
"""A volume below this part of the cube of the box is none: both sides of a sheet, or rounding."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles on nodes (welded vertices), and what is known of each node and component."""

    x: Floats
    """Positions, (n, 3)."""
    triangles: Integers
    """(T, 3), none with two equal corners."""
    component: Integers
    """(n,)."""
    outward: Floats
    """1 where a component's faces look outward, -1 where they look inward, 0 where it has no inside, (components,)."""
    normal: Floats
    """Sum of the faces' normals by angle, of length 1 or 0, (n, 3)."""
    area: Floats
    """A third of the area of the triangles around, (n,)."""
    along: Floats
    """The direction of one edge at each node, of length 1 or 0, (n, 3)."""

    @property
    def hollow(self) -> int:
        """How many components have faces but no inside."""
        return int((self.outward[np.unique(self.component[self.triangles[:, 0]])] == 0.0).sum())


def fan(indices: NDArray[np.int32], offsets: NDArray[np.int32]) -> Integers:
    """The triangles of polygons, each cut into the fan around its first corner, (T, 3)."""
    sizes = np.diff(offsets)
    begin = np.repeat(offsets[:-1], sizes)
    end = np.repeat(offsets[1:], sizes)
    corner = np.arange(len(indices))
    middle = corner[(corner > begin) & (corner < end - 1)]
    return indices[np.stack([begin[middle], middle, middle + 1], axis=1)].astype(np.int64)


def surface(x: Floats, indices: NDArray[np.int32], offsets: NDArray[np.int32], node_of: NDArray[np.int32]) -> Surface:
    """x: positions of nodes (n, 3); polygons as vertex indices and offsets; node_of: the node of each vertex (V,)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    triangles = node_of[fan(indices, offsets)].astype(np.int64)
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    a, b, c = triangles.T
    ends = np.concatenate([a, b, c]), np.concatenate([b, c, a])
    joined = coo_array((np.ones(len(ends[0]), dtype=bool), ends), shape=(len(x), len(x)))
    component = connected_components(joined, directed=False)[1].astype(np.int64)
    corners = x[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(cross, axis=1)
    area: Floats = np.bincount(triangles.ravel(), np.repeat(twice / 6.0, 3), len(x)).astype(np.float64)
    normal = _normals(corners, cross / np.maximum(twice, np.finfo(float).tiny)[:, None], triangles, len(x))
    along = np.zeros_like(x)
    along[ends[0]] = _unit(x[ends[1]] - x[ends[0]])
    return Surface(x, triangles, component, _outward(x, triangles, component, ends), normal, area, along)


def _unit(rows: Floats) -> Floats:
    return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.finfo(float).tiny))


def _normals(corners: Floats, face_normal: Floats, triangles: Integers, count: int) -> Floats:
    """The faces' normals summed at their corners, each by its angle there."""
    total = np.zeros((count, 3))
    for k in range(3):
        first = corners[:, (k + 1) % 3] - corners[:, k]
        second = corners[:, (k + 2) % 3] - corners[:, k]
        size = np.linalg.norm(np.cross(first, second), axis=1)
        angle = np.arctan2(size, np.einsum("ij,ij->i", first, second))
        total += np.stack([np.bincount(triangles[:, k], angle * n, count) for n in face_normal.T], axis=1)
    return _unit(total)


def _outward(x: Floats, triangles: Integers, component: Integers, ends: tuple[Integers, Integers]) -> Floats:
    """The sign of each component's volume where its boundary vanishes: every edge as often there as back."""
    count = int(component.max(initial=-1)) + 1
    first, second = ends
    low, high = np.minimum(first, second), np.maximum(first, second)
    edges, edge = np.unique(low * len(x) + high, return_inverse=True)
    unpaired = np.bincount(edge.ravel(), np.where(first < second, 1.0, -1.0), len(edges)) != 0.0
    is_open = np.zeros(count, dtype=bool)
    is_open[component[edges[unpaired] // len(x)]] = True
    inside = component[triangles[:, 0]]
    # From its own first node, so that far away from the origin nothing is lost to rounding.
    origin = np.zeros((count, 3))
    origin[component[::-1]] = x[::-1]
    p, q, r = np.moveaxis(x[triangles] - origin[inside][:, None], 1, 0)
    volume = np.bincount(inside, np.einsum("ij,ij->i", np.cross(p, q), r) / 6.0, count)
    size = np.zeros(count)
    np.maximum.at(size, component, np.abs(x - origin[component]).max(axis=1))
    return np.where(is_open | (np.abs(volume) <= FLAT * size**3), 0.0, np.sign(volume))
