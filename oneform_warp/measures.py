"""How good a deformation is: what it does to edges, triangles, angles and volume, as numbers."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import as_numpy, read_rows, to_device, vertex_numbers
from oneform_warp.intersections import intersection_counts
from oneform_warp.polygons import Faces, Polygons, as_polygons
from oneform_warp.rigidity import half_cotangents, rims_energy, spokes_energy
from oneform_warp.strain import Sides, dihedral_changes, doubled_areas, flat_triangles, singular_values, volume
from oneform_warp.surface import fan, surface
from oneform_warp.weld import weld

__all__ = ["Measures", "measures"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
QUANTILES = (0.05, 0.5, 0.95)

FLAT_VOLUME = 1.0e-12
"""Of the cube of the box's diagonal: below it a closed surface is a sheet with two sides."""


@dataclass(frozen=True)
class Measures:
    """Numbers of one deformation x -> y; None where one has no meaning or was not asked for.

    Polygons count by their own edges and normals; where triangles are needed they are cut into fans. Triangles that
    are flat at rest are left out where their shape counts.
    """

    edge_rms: float
    """Of |y_e| / |x_e| - 1: 0.01 is one per cent."""
    edge_max: float
    """The largest | |y_e| / |x_e| - 1 |."""
    arap: float
    """E = 1/3 sum over i, over triangles t around i, over edges e of t, of cot_te / 2 |y_e - R_i x_e|^2.

    Spokes and rims with the best rotations and cotangents as they are: a third of what libigl minimises, in squared
    units of x.
    """
    arap_spokes: float
    """E = 1/2 sum over i, over edges e at i, of mu_e |y_e - R_i x_e|^2, mu the sum of cot / 2: spokes."""
    symmetric_dirichlet: float
    """The mean over the area at rest of s1^2 + s2^2 + 1/s1^2 + 1/s2^2: 4 where nothing stretches, inf if collapsed."""
    singular_min: float
    """Of the factors s1 >= s2 by which triangles stretch."""
    singular_05: float
    """5 % of them are smaller."""
    singular_50: float
    singular_95: float
    singular_max: float
    area: float
    """After / before."""
    volume: float | None
    """After / before; None unless the surface is closed and oriented."""
    dihedral_rms: float
    """Change of the angle between neighbouring faces' normals, degrees."""
    dihedral_max: float
    self_intersections: int | None
    """Pairs of triangles that properly intersect in y; see `intersection_counts`. None in the plane."""
    flat: int
    """Triangles without area at rest."""
    collapsed: int
    """Triangles with area at rest and none in y."""
    handle_rms: float | None = None
    """Distance of handles from their targets, over the diagonal of the rest pose's box."""
    handle_max: float | None = None
    normal_rms: float | None = None
    """Angle between y's normals and R_i n_i, degrees."""
    normal_max: float | None = None

    def known(self) -> dict[str, float]:
        """The numbers that there are, by name."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        return {name: value for name, value in values.items() if value is not None}


def measures(
    x: Any,
    y: Any,
    faces: Faces,
    *,
    targets: tuple[Any, Any] | None = None,
    omega: Any = None,
    normals: Any = None,
    intersections: bool = True,
    device: Any = None,
) -> Measures:
    """What the deformation x -> y does to a mesh.

    x, y: (V, D), D = 2 or 3, any unit; faces: as for `Deformer`. targets: vertices (k,), by number, and where they
    should be (k, D). omega: rotation vectors (V, 3) in radians, D = 2 angles (V,); normals: y's stored ones (V, 3), by
    default computed. intersections: whether to look for them; device: where. Vertices at equal positions at rest are
    one. Raises InputError for shapes that do not fit and for what is not finite.
    """
    rest = read_rows(x, None, "x")
    now = read_rows(y, len(rest.data), "y")
    mesh = _Mesh.of(rest.data, now.data, as_polygons(faces, len(rest.data)))
    return Measures(
        **_of_edges(mesh),
        **_of_rigidity(mesh),
        **_of_triangles(mesh),
        **_of_angles(mesh),
        volume=_of_volume(mesh),
        self_intersections=_intersections(mesh, device) if rest.dimension == 3 and intersections else None,
        **({} if targets is None else _of_handles(mesh, *targets)),
        **({} if omega is None else _of_normals(mesh, omega, normals)),
    )


@dataclass(frozen=True, eq=False)
class _Mesh:
    """The rest pose and the deformed one, with what both have in common."""

    x: Floats
    y: Floats
    polygons: Polygons
    groups: Integers
    """The node of each vertex, (V,)."""
    first: Integers
    """A vertex of each node, (n,)."""
    triangles: Integers
    """Of vertices, (T, 3), with area at rest."""
    flat: int
    sides: Sides

    @classmethod
    def of(cls, x: Floats, y: Floats, polygons: Polygons) -> _Mesh:
        groups = weld(to_device(x, "cpu"))
        node, first = (each.numpy().astype(np.int64) for each in (groups.of_vertex, groups.first))
        triangles = fan(*_short(polygons))
        sound = ~flat_triangles(x, triangles)
        return cls(x, y, polygons, node, first, triangles[sound], int((~sound).sum()), Sides.of(polygons, node))


def _short(polygons: Polygons) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    return polygons.indices.astype(np.int32), polygons.offsets.astype(np.int32)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _largest(values: Floats) -> float:
    return float(np.abs(values).max(initial=0.0))


def _lengths(x: Floats, edges: Integers) -> Floats:
    return np.asarray(np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1))


def _of_edges(mesh: _Mesh) -> dict[str, Any]:
    edges = mesh.sides.edges[mesh.sides.first]
    change = _lengths(mesh.y, edges) / _lengths(mesh.x, edges) - 1.0
    return {"edge_rms": _rms(change), "edge_max": _largest(change)}


def _of_rigidity(mesh: _Mesh) -> dict[str, Any]:
    x, y, triangles, node = mesh.x, mesh.y, mesh.triangles, mesh.groups
    weight = half_cotangents(x, triangles)
    sides = Sides.of(Polygons(triangles.ravel(), np.arange(0, triangles.size + 1, 3)), node)
    mu = np.asarray(np.bincount(sides.number, weight.ravel()), dtype=np.float64)
    return {
        "arap": rims_energy(x, y, triangles, node, weight),
        "arap_spokes": spokes_energy(x, y, sides.edges[sides.first], node, mu),
    }


def _of_triangles(mesh: _Mesh) -> dict[str, Any]:
    before, after = (doubled_areas(z, mesh.triangles) for z in (mesh.x, mesh.y))
    larger, smaller = singular_values(mesh.x, mesh.y, mesh.triangles).T
    low, middle, high = np.quantile([larger, smaller], QUANTILES) if larger.size else (1.0, 1.0, 1.0)
    with np.errstate(divide="ignore"):
        dirichlet = larger**2 + smaller**2 + larger**-2.0 + smaller**-2.0
    total = before.sum()
    return {
        "symmetric_dirichlet": float((before / (total or 1.0)) @ dirichlet) if total else 4.0,
        "singular_min": float(smaller.min(initial=np.inf)) if smaller.size else 1.0,
        "singular_05": float(low),
        "singular_50": float(middle),
        "singular_95": float(high),
        "singular_max": float(larger.max(initial=0.0)) if larger.size else 1.0,
        "area": float(after.sum() / total) if total else 1.0,
        "flat": mesh.flat,
        "collapsed": int(flat_triangles(mesh.y, mesh.triangles).sum()),
    }


def _of_angles(mesh: _Mesh) -> dict[str, Any]:
    change = np.degrees(dihedral_changes(mesh.x, mesh.y, mesh.polygons, mesh.sides))
    return {"dihedral_rms": _rms(change), "dihedral_max": _largest(change)}


def _of_volume(mesh: _Mesh) -> float | None:
    if not mesh.sides.closed:
        return None
    before, after = (volume(z, mesh.triangles) for z in (mesh.x, mesh.y))
    return after / before if abs(before) > FLAT_VOLUME * _diagonal(mesh.x) ** 3 else None


def _intersections(mesh: _Mesh, device: Any) -> int:
    counts = intersection_counts(mesh.y[mesh.first], mesh.groups[mesh.triangles], device=device)
    return int(counts.sum()) // 2


def _diagonal(x: Floats) -> float:
    return float(np.linalg.norm(np.ptp(x, axis=0))) if len(x) else 0.0


def _of_handles(mesh: _Mesh, vertices: Any, positions: Any) -> dict[str, Any]:
    chosen = np.atleast_1d(as_numpy(vertices))
    vertex_numbers(chosen, len(mesh.x), "targets")  # for its checks
    goal = read_rows(positions, int(chosen.sum()) if chosen.dtype == bool else len(chosen), "targets").data
    distance = np.linalg.norm(mesh.y[chosen] - goal, axis=1) / (_diagonal(mesh.x) or 1.0)
    return {"handle_rms": _rms(distance), "handle_max": _largest(distance)}


def _of_normals(mesh: _Mesh, omega: Any, normals: Any) -> dict[str, Any]:
    """Between the normals of y and R_i n_i, where both have a length."""
    from scipy.spatial.transform import Rotation

    turn = as_numpy(omega).astype(np.float64)
    turn = np.stack([0.0 * turn, 0.0 * turn, turn], axis=1) if turn.ndim == 1 else turn
    turn = read_rows(turn, len(mesh.x), "omega").data
    wanted = Rotation.from_rotvec(turn).apply(_normals(mesh, mesh.x))
    found = _normals(mesh, mesh.y) if normals is None else read_rows(normals, len(mesh.x), "normals").data
    sizes = np.linalg.norm(wanted, axis=1) * np.linalg.norm(found, axis=1)
    across = np.linalg.norm(np.cross(wanted, found), axis=1)
    angle = np.degrees(np.arctan2(across, np.einsum("ij,ij->i", wanted, found)))[sizes > 0.0]
    return {"normal_rms": _rms(angle), "normal_max": _largest(angle)}


def _normals(mesh: _Mesh, z: Floats) -> Floats:
    """Unit normals of vertices (V, 3); those of welded vertices are one."""
    return np.asarray(surface(z[mesh.first], *_short(mesh.polygons), mesh.groups.astype(np.int32)).normal[mesh.groups])
