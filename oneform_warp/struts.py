"""Struts: edges through the inside of a closed surface, which keep its volume where it is twisted or bent.

A surface alone takes a twist by getting thinner. A strut from a vertex to the one that faces it along the inward normal
gets the same 1-form as the surface's edges and keeps the two apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.intake import faces_on, positions_on
from oneform_warp.polygons import Faces
from oneform_warp.surface import Surface, surface
from oneform_warp.weld import weld as weld_positions

__all__ = ["FIRMNESS", "Struts", "extra_edges", "struts"]

Floats = NDArray[np.float64]

FIRMNESS = 60.0
"""mu of a strut of strength 1 in units of min(a_i, a_j) / |dx_ij|^2: by this, one strength serves bars of any mesh."""

TILT = np.radians(30.0)
"""How far the four rays beside the normal lean."""

REACH = 1.2
"""How much longer than the rays beside it a strut may be: along a limb instead of across it they are much shorter."""

FACING = np.cos(np.radians(30.0))
"""How nearly opposite the normals of both ends are: a strut from a rim to a wall would tie turns that differ."""

ASKEW = 1.0e-3
"""How far the ray along the normal leans, so that on symmetric meshes it does not slip out between two faces."""

HITS = 64
"""Faces that a ray passes on its way, of its own vertex and of other components, before it gives up."""


@dataclass(frozen=True, eq=False)
class Struts:
    """Pairs of vertices that face each other through the inside, and mu of a strut between them."""

    pairs: NDArray[np.int64]
    """(k, 2), each pair once, ascending."""
    weights: Floats
    """mu_ij = 60 min(a_i, a_j) / |dx_ij|^2 and at most 60, (k,), no unit: of every mesh of a body they sum up alike."""
    hollow: int
    """Components without an inside (open, not oriented, or flat), which have no struts."""

    def beside(self, strength: float, edges: Any = None, weight: Any = 1.0) -> tuple[NDArray[np.int64], Floats]:
        """These edges with their weights times a strength, after other extra edges (k, 2), one weight or (k,)."""
        if not (np.isfinite(strength) and strength > 0.0):
            raise InputError(f"the strength is {strength}", where="struts", fix="give a number > 0, or None for none")
        others = np.zeros((0, 2), dtype=np.int64) if edges is None else np.asarray(edges).reshape(-1, 2)
        weights = np.broadcast_to(np.asarray(weight, dtype=np.float64), len(others))
        return np.concatenate([others, self.pairs]), np.concatenate([weights, strength * self.weights])


@wp.func
def _chord(
    mesh: wp.uint64,
    component: wp.array[wp.int32],
    outward: wp.float32,
    i: int,
    direction: wp.vec3,
    step: wp.float32,
):
    """How far from vertex i through the inside to its own component's other side, and the face there; -1 for none."""
    solid = wp.mesh_get(mesh)
    length = wp.float32(step)  # a variable of the loop, not another name of the argument
    for _hit in range(wp.static(HITS)):
        hit = wp.mesh_query_ray(mesh, solid.points[i] + length * direction, direction, wp.float32(1.0e6))
        if not hit.result:
            return wp.float32(0.0), int(-1)
        a = solid.indices[3 * hit.face]
        b = solid.indices[3 * hit.face + 1]
        c = solid.indices[3 * hit.face + 2]
        # Its own faces, and what else lies inside, are passed.
        if component[a] == component[i] and a != i and b != i and c != i:
            if outward * wp.dot(hit.normal, direction) > 0.0:
                return length + hit.t, int(hit.face)
            return wp.float32(0.0), int(-1)  # it came in here: it started outside
        length += hit.t + step
    return wp.float32(0.0), int(-1)


@wp.kernel(enable_backward=False)
def _facing(
    # Graph:
    mesh: wp.uint64,
    component: wp.array[wp.int32],
    outward: wp.array[wp.float32],
    # In:
    inward: wp.array[wp.vec3],
    ray: wp.array[wp.vec3],
    beside: wp.array2d[wp.vec3],
    step: wp.array[wp.float32],
    # Out:
    facing_out: wp.array[wp.int32],
):
    i = wp.tid()
    facing_out[i] = -1
    side = outward[component[i]]
    if side == 0.0 or step[i] == 0.0:
        return
    across, face = _chord(mesh, component, side, i, ray[i], step[i])
    if face < 0:
        return
    other = _nearest_corner(mesh, face, wp.mesh_get(mesh).points[i] + across * ray[i])
    if wp.dot(inward[i], inward[other]) > wp.static(-FACING):
        return
    longest = wp.float32(0.0)
    second = wp.float32(0.0)
    for k in range(beside.shape[1]):
        length, _face = _chord(mesh, component, side, i, beside[i, k], step[i])
        second = wp.max(second, wp.min(length, longest))
        longest = wp.max(longest, length)
    if across <= wp.static(REACH) * second:
        facing_out[i] = other


@wp.func
def _nearest_corner(mesh: wp.uint64, face: int, point: wp.vec3) -> int:
    solid = wp.mesh_get(mesh)
    nearest = solid.indices[3 * face]
    for k in range(1, 3):
        corner = solid.indices[3 * face + k]
        if wp.length_sq(solid.points[corner] - point) < wp.length_sq(solid.points[nearest] - point):
            nearest = corner
    return nearest


def struts(x: Any, faces: Faces, *, weld: float | None = 0.0, device: Any = None) -> Struts:
    """Pairs of vertices that face each other along the inward normal, each with mu = 60 min(a_i, a_j) / |dx_ij|^2.

    x: (V, 3), any unit; faces: as for `Graph.from_faces`, polygons cut into fans; a: the area around a vertex. A ray
    that is more than 1.2 times as long as rays 30 degrees beside it (the second longest of four) runs along the body
    and makes no strut. Each component has its own inside, whichever way its faces are turned, and what else
    lies in it is passed. Raises InputError where no component is closed; components that are not have none.
    """
    device = wp.get_device(device)
    positions = positions_on(x, device).x
    groups = weld_positions(positions, weld)
    first = groups.first.numpy()
    indices, offsets = (array.numpy() for array in faces_on(faces, positions.shape[0], device))
    made = surface(positions.numpy()[first], indices, offsets, groups.of_vertex.numpy())
    if not made.outward.any():
        raise InputError(
            "no part of the mesh is closed, so there is no inside for struts",
            where="struts",
            fix="close its holes, weld its seams, or leave struts out",
        )
    facing = _faced(made, device)
    one = np.flatnonzero(facing >= 0)
    return _merged(made, one, facing[one], first)


def extra_edges(
    x: Any, faces: Faces, strength: float | None, *, weld: float | None = 0.0, device: Any = None
) -> dict[str, Any]:
    """What `Graph.from_faces` takes for struts of a strength: extra_edges and extra_weight; None for none."""
    if strength is None:
        return {}
    pairs, weights = struts(x, faces, weld=weld, device=device).beside(strength)
    return {"extra_edges": pairs, "extra_weight": weights}


def _merged(made: Surface, one: NDArray[np.int64], other: NDArray[np.int64], first: NDArray[np.int32]) -> Struts:
    """Rays from one node to another as struts, each pair once; two rays that meet count twice."""
    nodes, back = np.unique(np.sort(np.stack([one, other], axis=1), axis=1), axis=0, return_inverse=True)
    area = np.minimum(made.area[one], made.area[other])
    along = made.x[nodes[:, 1]] - made.x[nodes[:, 0]]
    ratio = np.bincount(back.ravel(), area, len(nodes)) / np.maximum(
        np.einsum("ij,ij->i", along, along), np.finfo(float).tiny
    )
    some = ratio > 0.0
    pairs = np.sort(first[nodes[some]].astype(np.int64), axis=1)
    order = np.lexsort(pairs.T[::-1])
    weights = FIRMNESS * np.minimum(ratio[some], 1.0)
    return Struts(pairs[order], weights[order], made.hollow)


def _faced(made: Surface, device: Any) -> NDArray[np.int64]:
    """The node that each node faces, -1 for none, (n,)."""
    low, high = made.x.min(axis=0), made.x.max(axis=0)
    scale = float((high - low).max()) / 2.0 or 1.0
    # Rays are float32. A start well inside its own faces, far above rounding and far below the edges.
    step = np.where(made.area > 0.0, np.maximum(1.0e-3 * np.sqrt(made.area) / scale, 1.0e-6), 0.0)
    inward = -made.normal * made.outward[made.component][:, None]
    points: Any = wp.array((made.x - (low + high) / 2.0) / scale, dtype=wp.vec3, device=device)
    indices: Any = wp.array(made.triangles.astype(np.int32).ravel(), dtype=wp.int32, device=device)
    solid = wp.Mesh(points=points, indices=indices)
    beside = _beside(inward, made.along)
    directions = inward, inward + ASKEW * (beside[:, 0] + beside[:, 1] / 2.0), beside
    inputs = [
        solid.id,
        wp.array(made.component.astype(np.int32), dtype=wp.int32, device=device),
        wp.array(made.outward, dtype=wp.float32, device=device),
        *(wp.array(each, dtype=wp.vec3, device=device) for each in directions),
        wp.array(step, dtype=wp.float32, device=device),
    ]
    facing = wp.empty(len(made.x), dtype=wp.int32, device=device)
    wp.launch(_facing, dim=len(made.x), inputs=inputs, outputs=[facing], device=device)
    return np.asarray(facing.numpy(), dtype=np.int64)


def _beside(direction: Floats, along: Floats) -> Floats:
    """Four directions that lean from each direction, the first one towards an edge, (n, 4, 3)."""
    first = along - np.einsum("ij,ij->i", along, direction)[:, None] * direction
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), np.finfo(float).tiny)
    second = np.cross(direction, first)
    leaning = np.stack([first, second, -first, -second], axis=1)
    return np.cos(TILT) * direction[:, None] + np.sin(TILT) * leaning
