"""Generated meshes: counts, orientation, topology, exact volumes and areas, rates of convergence."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from oneform_warp import shapes
from oneform_warp.errors import InputError

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]

CLOSED: dict[str, tuple[Callable[[], Mesh], int, int, int]] = {  # the mesh, V, F and V - E + F
    "bar": (shapes.bar, 794, 1584, 2),
    "bar of quads": (lambda: shapes.bar(quads=True), 794, 792, 2),
    "bar of one cell": (lambda: shapes.bar(segments=1, sides=1, quads=True), 8, 6, 2),
    "icosahedron": (lambda: shapes.sphere(0), 12, 20, 2),
    "sphere": (lambda: shapes.sphere(3), 642, 1280, 2),
    "starfish": (lambda: shapes.starfish(level=4), 2562, 5120, 2),
    "cylinder": (lambda: shapes.cylinder(7, 5), 42, 80, 2),
    "torus": (lambda: shapes.torus(8, 6), 48, 96, 0),
    "torus of quads": (lambda: shapes.torus(8, 6, quads=True), 48, 48, 0),
}
OPEN: dict[str, tuple[Callable[[], Mesh], int, int, int]] = {
    "grid": (lambda: shapes.grid(3, 5), 24, 30, 1),
    "grid of quads": (lambda: shapes.grid(3, 5, quads=True), 24, 15, 1),
    "bumpy plane": (lambda: shapes.bumpy_plane(8, 9), 90, 144, 1),
    "open cylinder": (lambda: shapes.cylinder(7, 5, closed=False), 40, 70, 0),
    "open cylinder of quads": (lambda: shapes.cylinder(7, 5, closed=False, quads=True), 40, 35, 0),
}


def directed_edges(faces: NDArray[np.int32]) -> NDArray[np.int64]:
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2).astype(np.int64)


def undirected_edges(faces: NDArray[np.int32]) -> NDArray[np.int64]:
    return np.unique(np.sort(directed_edges(faces), axis=1), axis=0)


def triangles(x: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    fan = [faces[:, [0, k, k + 1]] for k in range(1, faces.shape[1] - 1)]
    return x[np.concatenate(fan)]


def area(mesh: Mesh) -> float:
    a, b, c = triangles(*mesh).transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def volume(mesh: Mesh) -> float:
    return float(np.linalg.det(triangles(*mesh)).sum() / 6)


def polygon_area(sides: int, radius: float) -> float:
    return sides / 2 * np.sin(2 * np.pi / sides) * radius**2


@pytest.mark.parametrize(
    ("make", "vertices", "faces", "euler"), [*CLOSED.values(), *OPEN.values()], ids=[*CLOSED, *OPEN]
)
def test_counts_types_and_euler_characteristic(make: Callable[[], Mesh], vertices: int, faces: int, euler: int) -> None:
    x, f = make()
    assert x.dtype == np.float64
    assert f.dtype == np.int32
    assert x.shape == (vertices, 3)
    assert len(f) == faces
    assert np.array_equal(np.unique(f), np.arange(vertices))
    assert vertices - len(undirected_edges(f)) + faces == euler
    assert len(np.unique(x.round(9), axis=0)) == vertices


@pytest.mark.parametrize("make", [row[0] for row in CLOSED.values()], ids=[*CLOSED])
def test_closed_meshes_are_watertight_and_oriented_outward(make: Callable[[], Mesh]) -> None:
    x, faces = make()
    edges = directed_edges(faces)
    there = np.unique(edges, axis=0)
    assert len(there) == len(edges), "two faces run through an edge in the same direction"
    assert np.array_equal(there, np.unique(edges[:, ::-1], axis=0)), "an edge has a face on one side only"
    assert volume((x, faces)) > 0


@pytest.mark.parametrize("make", [row[0] for row in OPEN.values()], ids=[*OPEN])
def test_open_meshes_are_oriented(make: Callable[[], Mesh]) -> None:
    edges = directed_edges(make()[1])
    assert len(np.unique(edges, axis=0)) == len(edges)


def test_flat_meshes_face_up() -> None:
    for x, faces in (shapes.grid(3, 4), shapes.bumpy_plane(30, 30)):
        a, b, c = triangles(x, faces).transpose(1, 0, 2)
        assert np.all(np.cross(b - a, c - a)[:, 2] > 0)


@pytest.mark.parametrize("quads", [False, True])
def test_bar_has_the_volume_and_area_of_a_box(quads: bool) -> None:
    mesh = shapes.bar(2.0, 0.3, segments=7, sides=3, quads=quads)
    assert volume(mesh) == pytest.approx(2.0 * 0.3**2)
    assert area(mesh) == pytest.approx(4 * 2.0 * 0.3 + 2 * 0.3**2)


def test_bar_stands_on_the_origin_ring_by_ring() -> None:
    x, _ = shapes.bar()
    assert np.allclose(x.min(axis=0), [-0.1, -0.1, 0.0])
    assert np.allclose(x.max(axis=0), [0.1, 0.1, 1.0])
    assert np.allclose(x[: 31 * 24, 2].reshape(31, 24), np.linspace(0, 1, 31)[:, None])


def test_all_edges_of_the_quad_bar_have_one_length() -> None:
    x, faces = shapes.bar(quads=True)
    a, b = x[undirected_edges(faces)].transpose(1, 0, 2)
    assert np.allclose(np.linalg.norm(b - a, axis=1), 1 / 30)


def test_sphere_vertices_are_on_the_sphere_and_kept_by_the_next_level() -> None:
    x, _ = shapes.sphere(2, radius=3.0)
    assert np.allclose(np.linalg.norm(x, axis=1), 3.0)
    assert np.allclose(shapes.sphere(3, radius=3.0)[0][: len(x)], x)


def test_icosahedron_has_its_volume_and_equal_edges() -> None:
    x, faces = shapes.sphere(0)
    a, b = x[undirected_edges(faces)].transpose(1, 0, 2)
    edge = np.linalg.norm(b - a, axis=1)
    assert np.allclose(edge, 1 / np.sin(2 * np.pi / 5))
    assert volume((x, faces)) == pytest.approx(5 / 12 * (3 + np.sqrt(5)) * edge[0] ** 3)


@pytest.mark.parametrize(("measure", "exact"), [(volume, 4 / 3 * np.pi), (area, 4 * np.pi)])
def test_sphere_converges_at_second_order(measure: Callable[[Mesh], float], exact: float) -> None:
    error = np.array([exact - measure(shapes.sphere(level)) for level in range(2, 6)])
    assert np.all(error > 0)
    assert np.allclose(np.log2(error[:-1] / error[1:]), 2, atol=0.05)


def test_cylinder_has_the_volume_and_area_of_a_prism() -> None:
    sides, radius, length = 7, 0.5, 3.0
    end, wall = polygon_area(sides, radius), 2 * sides * np.sin(np.pi / sides) * radius * length
    closed = shapes.cylinder(4, sides, radius=radius, length=length)
    assert volume(closed) == pytest.approx(end * length)
    assert area(closed) == pytest.approx(wall + 2 * end)
    assert area(shapes.cylinder(4, sides, closed=False, radius=radius, length=length)) == pytest.approx(wall)


@pytest.mark.parametrize("quads", [False, True])
def test_torus_has_the_volume_of_a_turned_polygon(quads: bool) -> None:
    mesh = shapes.torus(9, 7, major=2.0, minor=0.5, quads=quads)
    assert volume(mesh) == pytest.approx(9 * np.sin(2 * np.pi / 9) * 2.0 * polygon_area(7, 0.5))


def test_grid_has_the_area_and_the_numbering_of_a_rectangle() -> None:
    x, faces = shapes.grid(3, 4, width=1.5, depth=2.0)
    assert area((x, faces)) == pytest.approx(1.5 * 2.0)
    assert np.allclose(x[2 * 5 + 3], [1.0, 1.5, 0.0])


def test_bumpy_plane_has_the_mean_height_of_its_formula_and_a_flat_border() -> None:
    x, _ = shapes.bumpy_plane(80, 40, bumps=2, height=0.4)
    z = x[:, 2].reshape(81, 41)
    assert z[:-1, :-1].mean() == pytest.approx(0.4 / 4)
    assert z.max() == pytest.approx(0.4)
    assert np.allclose([*z[0], *z[-1], *z[:, 0], *z[:, -1]], 0)


@pytest.mark.parametrize("arms", [3, 5, 8])
def test_starfish_has_equal_arms(arms: int) -> None:
    x, _ = shapes.starfish(arms, level=6)
    distance = np.linalg.norm(x, axis=1)
    turn = np.angle(x[:, 0] + 1j * x[:, 1]) * arms / (2 * np.pi)
    arm, from_axis = np.round(turn).astype(int) % arms, np.abs(turn - np.round(turn))
    tips = [distance[arm == k].max() for k in range(arms)]
    assert np.allclose(tips, 1, atol=0.01)
    assert distance[from_axis > 0.45].max() < 0.35


def test_starfish_volume_converges_at_second_order() -> None:
    v = [volume(shapes.starfish(level=level)) for level in (4, 5, 6, 7)]
    change = np.diff(v)
    assert np.allclose(np.log2(change[:-1] / change[1:]), 2, atol=0.1)


@pytest.mark.parametrize(
    "call",
    [
        lambda: shapes.bar(segments=0),
        lambda: shapes.sphere(-1),
        lambda: shapes.starfish(arms=1),
        lambda: shapes.grid(0, 4),
        lambda: shapes.torus(segments=2),
        lambda: shapes.cylinder(sides=2),
        lambda: shapes.cylinder(quads=True),
    ],
)
def test_counts_too_small_are_refused(call: Callable[[], Mesh]) -> None:
    with pytest.raises(InputError, match="pass"):
        call()
