"""What happens to triangles, to the angles between faces and to the volume on the way from x to y."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from oneform_warp.polygons import Polygons

__all__ = ["Sides", "dihedral_changes", "doubled_areas", "flat_triangles", "ring_edges", "singular_values", "volume"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]

FLAT = 1.0e-10
"""Twice the area over the square of the longest edge, below which a triangle has neither normal nor cotangents."""


def flat_triangles(x: Floats, triangles: Integers) -> Mask:
    """Which triangles have no area to speak of, (T,)."""
    corners = x[triangles]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    return np.asarray(doubled_areas(x, triangles) <= FLAT * sides.max(axis=1, initial=0.0) ** 2)


def doubled_areas(x: Floats, triangles: Integers) -> Floats:
    """Twice the area of each triangle, (T,)."""
    a, b, c = np.moveaxis(x[triangles], 1, 0)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1))


def singular_values(x: Floats, y: Floats, triangles: Integers) -> Floats:
    """The larger and the smaller factor by which each triangle is stretched, (T, 2); none may be flat in x."""
    a, b_along, b_across = _in_plane(x[triangles])
    p, q_along, q_across = _in_plane(y[triangles])
    # The gradient [[f, g], [0, h]] maps (a, 0) to (p, 0) and b to q.
    f = p / a
    g, h = (q_along - f * b_along) / b_across, q_across / b_across
    # Sums and differences of the two, which lose no digits where they are equal.
    half_sum = 0.5 * np.hypot(f + h, g)
    half_difference = 0.5 * np.hypot(f - h, g)
    return np.stack([half_sum + half_difference, np.abs(half_sum - half_difference)], axis=1)


def _in_plane(corners: Floats) -> tuple[Floats, Floats, Floats]:
    """The first edge's length, and the second edge along and across it, (T,) each."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = np.linalg.norm(first, axis=1)
    gone = length == 0.0  # then any direction will do: that of the second
    safe = np.where(gone, 1.0, length)
    along = np.where(gone, np.linalg.norm(second, axis=1), np.einsum("ij,ij->i", first, second) / safe)
    return length, along, np.linalg.norm(np.cross(first, second), axis=1) / safe


@dataclass(frozen=True, eq=False)
class Sides:
    """Edges of polygons as their faces list them: each from one corner to the next."""

    edges: Integers
    """Vertices (s, 2)."""
    face: Integers
    """(s,)"""
    number: Integers
    """The number of the edge that joins the same two nodes, in either direction, (s,)."""
    forward: Mask
    """Whether a side runs from the smaller node to the larger, (s,)."""

    @classmethod
    def of(cls, polygons: Polygons, node: Integers) -> Sides:
        """Without sides that join a node to itself. node: of each vertex, (V,)."""
        edges, face = ring_edges(polygons)
        tail, head = node[edges].T
        proper = tail != head
        edges, face, tail, head = edges[proper], face[proper], tail[proper], head[proper]
        keys = np.minimum(tail, head) * (int(node.max(initial=0)) + 1) + np.maximum(tail, head)
        number = np.unique(keys, return_inverse=True)[1].ravel()
        return cls(edges, face, number, tail < head)

    @cached_property
    def closed(self) -> bool:
        """Whether every edge is run once in each direction: the surface has an inside."""
        uses = np.bincount(self.number, minlength=1)
        turns = np.bincount(self.number, np.where(self.forward, 1.0, -1.0), minlength=1)
        return bool((uses == 2).all() and (turns == 0.0).all())

    @cached_property
    def first(self) -> Integers:
        """One side of each edge, (edges,)."""
        return np.asarray(np.unique(self.number, return_index=True)[1], dtype=np.int64)

    @cached_property
    def pairs(self) -> Integers:
        """The two sides of each edge that has exactly two, (k, 2)."""
        order = np.argsort(self.number, kind="stable")
        uses = np.bincount(self.number, minlength=1)
        begins = (np.cumsum(uses) - uses)[uses == 2]
        return np.stack([order[begins], order[begins + 1]], axis=1)


def ring_edges(polygons: Polygons) -> tuple[Integers, Integers]:
    """From each corner to the next around its face -> vertices (C, 2), faces (C,)."""
    sizes = np.diff(polygons.offsets)
    following = np.arange(1, len(polygons.indices) + 1)
    following[polygons.offsets[1:][sizes > 0] - 1] = polygons.offsets[:-1][sizes > 0]
    edges = np.stack([polygons.indices, polygons.indices[following]], axis=1)
    return edges, np.repeat(np.arange(len(sizes)), sizes)


def dihedral_changes(x: Floats, y: Floats, polygons: Polygons, sides: Sides) -> Floats:
    """By how much the angle between the normals of two faces changes, radians in -pi..pi, (k,).

    Of edges with two faces; those with a face or an edge that has no size, before or after, are left out.
    """
    (before, sound), (after, still_sound) = (_dihedrals(z, polygons, sides) for z in (x, y))
    change = (after - before)[sound & still_sound]
    return np.asarray(np.arctan2(np.sin(change), np.cos(change)))


def _dihedrals(x: Floats, polygons: Polygons, sides: Sides) -> tuple[Floats, Mask]:
    """Signed angles, and which of them exist."""
    normal, has_normal = _face_normals(x, polygons)
    first, second = sides.pairs.T
    edge = x[sides.edges[first, 1]] - x[sides.edges[first, 0]]
    length = np.linalg.norm(edge, axis=1)
    along = edge / np.where(length > 0.0, length, 1.0)[:, None]
    # A normal that looks to the other side turns both angles by 180 degrees, before and after.
    m, n = normal[sides.face[first]], normal[sides.face[second]]
    angle = np.arctan2(np.einsum("ij,ij->i", np.cross(m, n), along), np.einsum("ij,ij->i", m, n))
    return angle, has_normal[sides.face[first]] & has_normal[sides.face[second]] & (length > 0.0)


def _face_normals(x: Floats, polygons: Polygons) -> tuple[Floats, Mask]:
    """Unit normals of polygons, by the vector area, and which have one."""
    edges, face = ring_edges(polygons)
    count = len(polygons.offsets) - 1
    centre = x[edges[:, 0]] - _first_corner(x, polygons, face)
    cross = np.cross(centre, x[edges[:, 1]] - x[edges[:, 0]])
    area = np.stack([np.bincount(face, column, count) for column in cross.T], axis=1)
    longest = np.zeros(count)
    np.maximum.at(longest, face, np.einsum("ij,ij->i", centre, centre))
    size = np.linalg.norm(area, axis=1)
    sound = size > FLAT * longest
    return area / np.where(sound, size, 1.0)[:, None], sound


def _first_corner(x: Floats, polygons: Polygons, face: Integers) -> Floats:
    """The first corner of each side's face: near it, products of positions lose no digits."""
    begins = np.minimum(polygons.offsets[:-1], max(len(polygons.indices) - 1, 0))
    return np.asarray(x[polygons.indices[begins]][face])


def volume(x: Floats, triangles: Integers) -> float:
    """The volume inside a closed surface, in cubed units of x, > 0 where its faces look outward."""
    p, q, r = np.moveaxis(x[triangles] - x.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", np.cross(p, q), r) / 6.0)
