"""Linear constraints C x = d on the deformed positions, and builders for the common ones, by their geometry.

Hard by default; `weight` w > 0 makes one soft: it adds w |C x - d|^2 to the energy, with w in the unit of mu.
Positions, offsets and lengths are in the unit and the coordinates of x.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import as_numpy
from oneform_warp.errors import InputError
from oneform_warp.handles import Handle

__all__ = [
    "Constraint",
    "centroid",
    "edge_angle",
    "edge_direction",
    "edge_length",
    "face_normal",
    "linear",
    "planar",
    "position",
    "relative_position",
]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Constraint:
    """Rows of C x = d: row r says that the sum of value * x[vertex, axis] over its entries is d[r].

    row, vertex, axis, value: (entries,). d: (rows,). weight: None for hard, one number > 0 or one for each row.
    dimension, vertex_count: the D and V that it is made for, None for any that has its axes and vertices. along: the
    two vertices of an edge where values are still to be multiplied with its deformed direction, which the solve finds.
    """

    name: str
    row: Integers
    vertex: Integers
    axis: Integers
    value: Floats
    d: Floats
    weight: Any = None
    dimension: int | None = None
    vertex_count: int | None = None
    along: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        weight = None if self.weight is None else np.asarray(self.weight, dtype=np.float64)
        if weight is not None:
            if weight.shape not in ((), self.d.shape) or not (np.isfinite(weight).all() and (weight > 0.0).all()):
                raise InputError(
                    f"weight is {self.weight!r}", where=self.name, fix="give a number > 0, or None for a hard one"
                )
            object.__setattr__(self, "weight", weight)
        if not (np.isfinite(self.value).all() and np.isfinite(self.d).all()):
            raise InputError("a number is not finite", where=self.name, fix="remove NaN and infinity")


def linear(matrix: Any, d: Any, *, dimension: int = 3, weight: Any = None, name: str = "linear") -> Constraint:
    """C x = d for any C: (rows, V * D), sparse or dense; column D i + a is coordinate a of vertex i. d: (rows,)."""
    from scipy.sparse import coo_array

    rows = coo_array(matrix)
    right = np.atleast_1d(np.asarray(d, dtype=np.float64))
    if right.shape != (rows.shape[0],):
        raise InputError(f"d has shape {right.shape} for {rows.shape[0]} rows", where=name, fix="give one for each row")
    if dimension not in (1, 2, 3) or rows.shape[1] % dimension:
        raise InputError(
            f"{rows.shape[1]} columns for dimension {dimension}", where=name, fix="give V * D columns, D = 1, 2 or 3"
        )
    row, column = (np.asarray(at, dtype=np.int64) for at in rows.coords)
    vertex, axis = np.divmod(column, dimension)
    values, count = np.asarray(rows.data, dtype=np.float64), rows.shape[1] // dimension
    return Constraint(name, row, vertex, axis, values, right, weight, dimension, count)


def position(vertices: Any, to: Any, *, weight: Any = None, name: str | None = None) -> Constraint:
    """x_i = to_i: one vertex and (D,), or (k,) vertices and (k, D)."""
    which = _vertices(vertices, name or "position")
    name = name or _named("position of", which)
    targets = np.atleast_2d(_numbers(to, name))
    if len(targets) != len(which):
        raise InputError(f"{len(targets)} places for {len(which)} vertices", where=name, fix="give one for each")
    dimension = _dimension(targets, name)
    count = targets.size
    vertex, axis = np.divmod(np.arange(count), dimension)
    ones = np.ones(count)
    return Constraint(name, np.arange(count), which[vertex], axis, ones, targets.ravel(), weight, dimension)


def centroid(vertices: Any, to: Any, *, weight: Any = None, name: str | None = None) -> Constraint:
    """(x_1 + ... + x_k) / k = to, (D,)."""
    which = _vertices(vertices, name or "centroid")
    name = name or _named("centroid of", which)
    return _combination(name, {int(i): 1.0 / len(which) for i in which}, _point(to, name), weight)


def relative_position(a: int, b: int, offset: Any, *, weight: Any = None, name: str | None = None) -> Constraint:
    """x_b - x_a = offset, (D,)."""
    name = name or f"position of vertex {b} relative to {a}"
    _check_apart((a, b), name)
    return _combination(name, {a: -1.0, b: 1.0}, _point(offset, name), weight)


def edge_direction(a: int, b: int, direction: Any, *, weight: Any = None, name: str | None = None) -> Constraint:
    """(x_b - x_a) x direction = 0: D - 1 rows that leave length and sign free. direction: (D,), of any length."""
    name = name or f"direction of edge {a} {b}"
    _check_apart((a, b), name)
    across = np.linalg.svd(_direction(direction, name)[None, :])[2][1:]
    return _projections(name, [(a, b, normal, 0.0) for normal in across], weight)


def edge_length(
    a: int, b: int, length: float, *, direction: Any = None, weight: Any = None, name: str | None = None
) -> Constraint:
    """direction . (x_b - x_a) = length: the length of an edge along its deformed direction.

    direction: (D,), any length. None takes the direction that the edge has in the solution without constraints, which
    is its own wherever the constraints turn it little.
    """
    name = name or f"length of edge {a} {b}"
    _check_apart((a, b), name)
    if not length >= 0.0:
        raise InputError(f"the length is {length}", where=name, fix="give a length >= 0")
    if direction is not None:
        return _projections(name, [(a, b, _direction(direction, name), float(length))], weight)
    row, axis = np.zeros(6, dtype=np.int64), np.tile(np.arange(3), 2)
    vertex, value = np.repeat([int(a), int(b)], 3), np.repeat([-1.0, 1.0], 3)
    return Constraint(name, row, vertex, axis, value, np.array([float(length)]), weight, along=(int(a), int(b)))


def edge_angle(
    i: int,
    j: int,
    k: int,
    *,
    rotation: Any = (0.0, 0.0, 0.0),
    axis: Any = None,
    angle: float | None = None,
    ratio: float = 1.0,
    weight: Any = None,
    name: str | None = None,
) -> Constraint:
    """x_k - x_j = ratio Q (x_i - x_j): the edge from j to k is the one from j to i, turned by Q, `ratio` times as long.

    Q: as for a Handle, a rotation vector in radians, or axis and angle in degrees (D = 2: angle alone).
    """
    from scipy.spatial.transform import Rotation

    name = name or f"angle of edges {j} {i} and {j} {k}"
    _check_apart((i, j, k), name)
    # A handle reads all the ways to say a rotation.
    turn = Handle([j], rotation=rotation, axis=axis, angle=angle, name=name)
    if turn.rotation is None or not np.isfinite(ratio) or ratio <= 0.0:
        raise InputError(f"the ratio is {ratio}", where=name, fix="give a rotation, and a ratio > 0")
    turned = ratio * Rotation.from_rotvec(turn.rotation).as_matrix()
    blocks = np.stack([-turned, turned - np.eye(3), np.eye(3)])
    block, row, along = (part.ravel() for part in np.indices(blocks.shape))
    vertex = np.array([i, j, k], dtype=np.int64)[block]
    dimension = 2 if turn.planar else None
    return Constraint(name, row, vertex, along, blocks.ravel(), np.zeros(3), weight, dimension)


def planar(
    vertices: Any, normal: Any = None, *, x: Any = None, height: Any = None, weight: Any = None, name: str | None = None
) -> Constraint:
    """normal . (x_i - x_1) = 0 for all i > 1 of a set: a plane of a given direction, at any height.

    normal: (D,), any length; None takes that of the plane that fits the positions x (V, D) best. height: normal . x_i
    for a normal of length 1, which then is given for all.
    """
    which = _vertices(vertices, name or "plane")
    name = name or _named("plane of", which)
    if (normal is None) == (x is None):
        raise InputError("a plane needs its direction", where=name, fix="give normal, or positions x to fit one to")
    if normal is None:
        normal = _fitted_normal(_numbers(x, name), which, name)
    unit = _direction(normal, name)
    if height is None and len(which) < 2:
        raise InputError("one vertex is in every plane", where=name, fix="give more of them, or a height")
    if height is None:
        return _projections(name, [(int(which[0]), int(i), unit, 0.0) for i in which[1:]], weight)
    count, dimension = len(which), len(unit)
    row, axis = np.divmod(np.arange(count * dimension), dimension)
    d = np.full(count, float(height))
    return Constraint(name, row, which[row], axis, np.tile(unit, count), d, weight, dimension)


def face_normal(corners: Any, normal: Any, *, weight: Any = None, name: str | None = None) -> Constraint:
    """normal . (x_i - x_1) = 0 for the corners of a face: all its edges are perpendicular to the normal (D,)."""
    which = _vertices(corners, name or "face")
    return planar(which, normal, weight=weight, name=name or _named("normal of face", which))


def _fitted_normal(x: Floats, which: Integers, name: str) -> Floats:
    if _dimension(x, name) < 2 or which.max() >= len(x):
        raise InputError(f"positions of shape {x.shape}", where=name, fix="give all vertices, (V, D) with D = 2 or 3")
    normal: Floats = np.linalg.svd(x[which] - x[which].mean(axis=0))[2][-1]
    return normal


def _combination(name: str, share: dict[int, float], d: Floats, weight: Any) -> Constraint:
    """sum share_i x_i = d, (D,)."""
    vertices, shares = np.array(list(share), dtype=np.int64), np.array(list(share.values()))
    row = np.repeat(np.arange(len(d)), len(share))
    each = np.tile(vertices, len(d)), row, np.tile(shares, len(d))
    return Constraint(name, row, *each, d, weight, len(d))


def _projections(name: str, rows: Sequence[tuple[int, int, Floats, float]], weight: Any) -> Constraint:
    """direction . (x_b - x_a) = d for rows (a, b, direction, d)."""
    dimension = len(rows[0][2]) if rows else None
    vertex = [end for a, b, direction, _ in rows for end in (a, b) for _ in direction]
    value = [sign * direction for _, _, direction, _ in rows for sign in (-1.0, 1.0)]
    return Constraint(
        name,
        np.repeat(np.arange(len(rows)), 2 * (dimension or 0)),
        np.array(vertex, dtype=np.int64),
        np.tile(np.arange(dimension or 0), 2 * len(rows)),
        np.concatenate([np.zeros(0), *value]),
        np.array([d for *_, d in rows]),
        weight,
        dimension,
    )


def _named(what: str, vertices: Integers) -> str:
    few = " ".join(str(vertex) for vertex in vertices[:4])
    return f"{what} {few}" if len(vertices) <= 4 else f"{what} {few} and {len(vertices) - 4} more"


def _vertices(vertices: Any, name: str) -> Integers:
    """Vertices by number, or by a mask (V,), as numbers."""
    array = np.atleast_1d(as_numpy(vertices))
    if array.dtype == bool and array.ndim == 1:
        array = np.flatnonzero(array)
    if array.ndim != 1 or not len(array) or array.dtype.kind not in "iu" or (array < 0).any():
        raise InputError(
            f"a {array.dtype} array of shape {array.shape} names no vertices",
            where=name,
            fix="give one or more vertex numbers >= 0, or a mask",
        )
    if len(np.unique(array)) < len(array):
        raise InputError("a vertex is listed twice", where=name, fix="list each once")
    return array.astype(np.int64)


def _check_apart(vertices: tuple[int, ...], name: str) -> None:
    _vertices(np.array(vertices), name)


def _numbers(values: Any, name: str) -> Floats:
    try:
        return np.asarray(as_numpy(values), dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{values!r} are no numbers", where=name, fix="give D numbers") from None


def _dimension(rows: Floats, name: str) -> int:
    if rows.ndim != 2 or not 1 <= rows.shape[1] <= 3:
        raise InputError(f"an array of shape {rows.shape} has no rows of D numbers", where=name, fix="D is 1, 2 or 3")
    return int(rows.shape[1])


def _point(value: Any, name: str) -> Floats:
    point = np.atleast_1d(_numbers(value, name))
    if point.ndim != 1 or not 1 <= len(point) <= 3:
        raise InputError(f"{value!r} is no point or direction", where=name, fix="give D numbers, D = 1, 2 or 3")
    return point


def _direction(value: Any, name: str) -> Floats:
    direction = _point(value, name)
    length = float(np.linalg.norm(direction))
    if not np.isfinite(length) or length == 0.0:
        raise InputError(f"the direction is {value!r}", where=name, fix="give D finite numbers, not all 0")
    unit: Floats = direction / length
    return unit
