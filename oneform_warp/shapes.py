"""Generated meshes: vertex positions x, shape (V, 3) float64, and faces, shape (F, 3) or (F, 4) int32.

The vertices of a face stand counter-clockwise as seen from outside (for the open shapes: from above, +z), so
that a closed shape has a positive volume.  Lengths have the unit of the arguments.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError

__all__ = ["bar", "bumpy_plane", "cylinder", "grid", "sphere", "starfish", "torus"]

Positions: TypeAlias = NDArray[np.float64]
Faces: TypeAlias = NDArray[np.int32]
Mesh: TypeAlias = tuple[Positions, Faces]


def bar(length: float = 1.0, width: float = 0.2, *, segments: int = 30, sides: int = 6, quads: bool = False) -> Mesh:
    """Return the closed surface of a bar that stands on the plane z = 0, its axis the z-axis.

    The section is a square of side `width`, its edges cut into `sides`; the length is cut into `segments`.
    Vertices: 4 sides (segments + 1) + 2 (sides - 1)^2.
    Quads: 4 sides segments + 2 sides^2; triangles: twice as many.
    The default has 794 vertices and 1,584 triangles.  The first 4 sides vertices are the rim of the lower
    end, counter-clockwise from its corner of least x and y, then the next ring up, and so on.
    """
    _at_least(1, segments=segments, sides=sides)
    ring = 4 * sides
    step = np.arange(sides)
    here, low, high = step, np.zeros(sides, int), np.full(sides, sides)
    i = np.concatenate([here, high, sides - here, low])
    j = np.concatenate([low, here, high, sides - here])
    rings = np.column_stack(
        [np.tile(i, segments + 1), np.tile(j, segments + 1), np.repeat(np.arange(segments + 1), ring)]
    )
    inner = np.stack(np.meshgrid(step[1:], step[1:], indexing="ij"), axis=-1).reshape(-1, 2)
    ends = [np.column_stack([inner, np.full(len(inner), k)]) for k in (0, segments)]
    scale = np.array([width / sides, width / sides, length / segments])
    x = np.concatenate([rings, *ends]) * scale - [width / 2, width / 2, 0.0]

    cap = np.empty((2, sides + 1, sides + 1), int)  # vertices of the two ends, by i and j
    cap[:, i, j] = np.arange(ring) + [[0], [segments * ring]]
    cap[:, 1:-1, 1:-1] = len(rings) + np.arange(2 * len(inner)).reshape(2, sides - 1, sides - 1)
    wall = _lattice(np.arange(len(rings)).reshape(segments + 1, ring).T, wrap_first=True)
    return x, _faces(np.concatenate([wall, _lattice(cap[0])[:, ::-1], _lattice(cap[1])]), quads)


def sphere(level: int = 4, *, radius: float = 1.0) -> Mesh:
    """Return an icosphere: the icosahedron, its triangles cut into four `level` times, on the sphere.

    Vertices: 10 4^level + 2.  Triangles: 20 4^level.  Level 8 has 655,362 vertices.  Two vertices are the
    poles on the z-axis, about which the mesh has five-fold symmetry.  The next level starts with the
    vertices of this one.
    """
    _at_least(0, level=level)
    x, faces = _icosahedron()
    for _ in range(level):
        x, faces = _subdivide(x, faces)
        x /= np.linalg.norm(x, axis=1, keepdims=True)
    return radius * x, faces.astype(np.int32)


def starfish(arms: int = 5, level: int = 5, *, core: float = 0.3) -> Mesh:
    """Return a closed surface with tapering arms of length 1 in the xy plane: a sphere, moved radially.

    In the unit direction (x, y, z) it has the radius core + (1 - core) w, where
    w = (x^2 + y^2)^4 ((1 + Re (x + iy)^arms) / 2)^2; the first arm lies on the x-axis.
    Vertices: 10 4^level + 2.  Triangles: 20 4^level.
    """
    _at_least(2, arms=arms)
    x, faces = sphere(level)
    across = x[:, 0] + 1j * x[:, 1]
    weight = np.abs(across) ** 8 * ((1 + (across**arms).real) / 2) ** 2
    return x * (core + (1 - core) * weight)[:, None], faces


def grid(nx: int = 20, ny: int = 20, *, width: float = 1.0, depth: float = 1.0, quads: bool = False) -> Mesh:
    """Return the rectangle [0, width] x [0, depth] of the xy plane, cut into nx times ny cells.

    Vertices: (nx + 1) (ny + 1), the vertex of column i and row j is i (ny + 1) + j.
    Quads: nx ny; triangles: twice as many.
    """
    _at_least(1, nx=nx, ny=ny)
    across, along = np.meshgrid(np.linspace(0, width, nx + 1), np.linspace(0, depth, ny + 1), indexing="ij")
    x = np.stack([across, along, np.zeros_like(across)], axis=-1).reshape(-1, 3)
    return x, _faces(_lattice(np.arange(len(x)).reshape(nx + 1, ny + 1)), quads)


def bumpy_plane(nx: int = 80, ny: int = 80, *, bumps: int = 4, height: float = 0.1, quads: bool = False) -> Mesh:
    """Return the unit square with bumps times bumps round bumps of a height, flat at the border.

    z = height sin(pi bumps x)^2 sin(pi bumps y)^2.  Vertices and faces: as in `grid(nx, ny)`.
    """
    x, faces = grid(nx, ny, quads=quads)
    x[:, 2] = height * np.prod(np.sin(np.pi * bumps * x[:, :2]) ** 2, axis=1)
    return x, faces


def cylinder(
    segments: int = 40,
    sides: int = 24,
    *,
    closed: bool = True,
    length: float = 1.0,
    radius: float = 0.2,
    quads: bool = False,
) -> Mesh:
    """Return a cylinder about the z-axis, from z = 0 to z = length: `segments` along, `sides` around.

    Open: (segments + 1) sides vertices, ring by ring; segments sides quads, or twice as many triangles.
    Closed: two vertices more, the middles of the ends, and 2 sides more triangles; only with quads=False.
    """
    _at_least(1, segments=segments)
    _at_least(3, sides=sides)
    if closed and quads:
        raise InputError("a closed cylinder has triangles at its ends", fix="pass closed=False or quads=False")
    z = np.repeat(np.linspace(0, length, segments + 1), sides)
    x = np.column_stack([np.tile(_circle(sides, radius), (segments + 1, 1)), z])
    ring = np.arange(len(x)).reshape(segments + 1, sides)
    faces = _faces(_lattice(ring.T, wrap_first=True), quads)
    if not closed:
        return x, faces
    ends = [np.column_stack([r, np.roll(r, -1), np.full(sides, len(x) + k)]) for k, r in enumerate(ring[[0, -1]])]
    x = np.concatenate([x, [[0, 0, 0], [0, 0, length]]])
    return x, np.concatenate([faces, ends[0][:, ::-1], ends[1]]).astype(np.int32)


def torus(segments: int = 48, sides: int = 24, *, major: float = 1.0, minor: float = 0.3, quads: bool = False) -> Mesh:
    """Return a torus about the z-axis: `segments` around the axis, `sides` around the tube.

    `major` is the radius of the tube's centre line, `minor` that of the tube.
    Vertices: segments sides.  Quads: segments sides; triangles: twice as many.
    """
    _at_least(3, segments=segments, sides=sides)
    section, axis = _circle(sides, minor), _circle(segments, 1.0)
    across = axis[:, None, :] * (major + section[None, :, :1])
    z = np.broadcast_to(section[:, 1:], (segments, sides, 1))
    x = np.concatenate([across, z], axis=-1).reshape(-1, 3)
    quad = _lattice(np.arange(len(x)).reshape(segments, sides), wrap_first=True, wrap_second=True)
    return x, _faces(quad, quads)


def _at_least(least: int, **counts: int) -> None:
    for name, count in counts.items():
        if count < least:
            raise InputError(f"{name} is {count}", fix=f"pass {least} or more")


def _circle(sides: int, radius: float) -> Positions:
    angle = 2 * np.pi * np.arange(sides) / sides
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _lattice(vertex: NDArray[np.int64], *, wrap_first: bool = False, wrap_second: bool = False) -> NDArray[np.int64]:
    """Return the quads of a table of vertices, counter-clockwise: first axis to the right, second up."""
    if wrap_first:
        vertex = np.concatenate([vertex, vertex[:1]])
    if wrap_second:
        vertex = np.concatenate([vertex, vertex[:, :1]], axis=1)
    corners = [vertex[:-1, :-1], vertex[1:, :-1], vertex[1:, 1:], vertex[:-1, 1:]]
    return np.stack(corners, axis=-1).reshape(-1, 4)


def _faces(quad: NDArray[np.int64], quads: bool) -> Faces:
    """Return quads as they are, or each cut into two triangles by the diagonal from its first vertex."""
    faces = quad if quads else quad[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    return faces.astype(np.int32)


def _icosahedron() -> tuple[Positions, NDArray[np.int64]]:
    """Return the icosahedron in the unit sphere: a pole, two rings of five, the other pole."""
    upper = np.column_stack([2 * _circle(10, 1.0), np.ones(10)]) / np.sqrt(5)
    lower = upper * [1, 1, -1]
    x = np.concatenate([[[0, 0, 1]], upper[::2], lower[1::2], [[0, 0, -1]]])
    a = np.arange(1, 6)
    b = np.roll(a, -1)
    cap, base = np.zeros(5, int), np.full(5, 11)
    rows = [[cap, a, b], [a, a + 5, b], [b, a + 5, b + 5], [base, b + 5, a + 5]]
    return x, np.concatenate([np.stack(row, axis=1) for row in rows])


def _subdivide(x: Positions, faces: NDArray[np.int64]) -> tuple[Positions, NDArray[np.int64]]:
    """Return the triangles cut into four at the middles of their edges; old vertices keep their numbers."""
    ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=-1).reshape(-1, 2)
    key, middle = np.unique(ends[:, 0] * len(x) + ends[:, 1], return_inverse=True)
    middles = (x[key // len(x)] + x[key % len(x)]) / 2
    a, b, c = faces.T
    ab, bc, ca = (len(x) + middle.reshape(-1, 3)).T
    corners = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=-1)
    return np.concatenate([x, middles]), corners.reshape(-1, 3)
