"""Fields spread from handles: harmonic, swept, screened; and what handles refuse."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from references import components, random_graph

SEEDS = st.integers(0, 10**6)
FIELD_ERROR = 1e-4  # tol 1e-6 times the condition number of the graphs here


def laplacian(graph: ow.Graph) -> np.ndarray:
    i, j = graph.edges.T
    mu = graph.mu.numpy()
    matrix = np.zeros((graph.vertex_count, graph.vertex_count))
    np.add.at(matrix, (i, j), -mu)
    np.add.at(matrix, (j, i), -mu)
    return matrix - np.diag(matrix.sum(axis=1))


@settings(max_examples=60)
@given(seed=SEEDS)
def test_fields_are_harmonic_between_the_handles(seed: int) -> None:
    problem = random_graph(seed, mu=(0.1, 10.0))
    graph, rng = problem.graph(), np.random.default_rng(seed)
    count = problem.vertex_count
    chosen = rng.permutation(count)[: max(1, count // 4)]
    handles = [ow.Handle([i], rotation=rng.normal(size=3) * 5, stretch=float(np.exp(rng.normal()))) for i in chosen]
    fields = ow.smooth_fields(graph, handles)
    values = np.column_stack([fields.omega, np.log(fields.sigma)])
    pinned = np.zeros((count, 4))
    pinned[chosen] = [[*h.rotation, np.log(h.stretch)] for h in handles]
    matrix, expected = laplacian(graph), pinned.copy()
    for group in components(count, problem.edges):
        inside, free = np.intersect1d(group, chosen), np.setdiff1d(group, chosen)
        if len(inside) and len(free):
            expected[free] = np.linalg.solve(matrix[np.ix_(free, free)], -matrix[np.ix_(free, inside)] @ pinned[inside])
    assert np.abs(values - expected).max() <= FIELD_ERROR * max(np.ptp(pinned), 1.0)
    assert values[chosen] == pytest.approx(pinned[chosen], abs=1e-14)
    assert (fields.sigma > 0.0).all()


def test_equal_handles_spread_without_rounding() -> None:
    x, faces = ow.shapes.bar()
    graph = ow.Graph.from_faces(x, faces)
    third = (0.1, 0.2, 1.0 / 3.0)
    handles = [ow.Handle(x[:, 2] < 0.1, rotation=third), ow.Handle(x[:, 2] > 0.9, rotation=third)]
    assert (ow.smooth_fields(graph, handles).omega == np.array(third)).all()


@pytest.mark.parametrize("turns", [1, 2, 7])
def test_whole_turns_are_kept(turns: int) -> None:
    count = 101
    graph = ow.Graph.from_polyline(count)
    fields = ow.smooth_fields(graph, [ow.Handle([0]), ow.Handle([count - 1], axis="x", angle=360.0 * turns)])
    expected = np.outer(np.linspace(0.0, turns * 2.0 * np.pi, count), [1.0, 0.0, 0.0])
    assert np.abs(fields.omega - expected).max() < FIELD_ERROR


def test_sweeps_are_damped_jacobi_sweeps() -> None:
    x, faces = ow.shapes.grid(9, 9)
    graph = ow.Graph.from_faces(x, faces, weights="uniform")
    matrix = laplacian(graph)
    expected = np.zeros((len(x), 3))
    for sweeps in range(6):
        fields = ow.smooth_fields(graph, [ow.Handle([40], rotation=(0.0, 0.0, 2.0))], sweeps=sweeps)
        expected[40] = (0.0, 0.0, 2.0)
        assert fields.omega == pytest.approx(expected, abs=1e-5)
        expected = expected - 2.0 / 3.0 * (matrix @ expected) / np.diag(matrix)[:, None]


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_a_screening_length_is_a_length(unit: float) -> None:
    count, length = 2001, 0.05
    x = np.column_stack([np.linspace(0.0, 1.0, count), np.zeros(count), np.zeros(count)]) * unit
    graph = ow.Graph.from_polyline(count).with_weights("inverse_length", x)
    fields = ow.smooth_fields(graph, [ow.Handle([0], rotation=(1.0, 0.0, 0.0))], x=x, length=length * unit)
    # On a line a_i is half of what a surface has there: the decay is sqrt(2) slower.
    assert fields.omega[:, 0] == pytest.approx(np.exp(-x[:, 0] / (np.sqrt(2.0) * length * unit)), abs=1e-3)


def test_free_rotation_and_free_stretch_pin_nothing() -> None:
    graph = ow.Graph.from_polyline(11)
    handles = [
        ow.Handle([0], stretch=None),
        ow.Handle([5], rotation=None, stretch=None),
        ow.Handle([10], axis="z", angle=90),
    ]
    fields = ow.smooth_fields(graph, handles)
    assert fields.omega[5, 2] == pytest.approx(np.pi / 4, abs=FIELD_ERROR)
    assert (fields.sigma == 1.0).all()
    assert (ow.smooth_fields(graph, [ow.Handle([3], rotation=None)]).omega == 0.0).all()


def test_a_component_without_a_handle_gets_the_identity() -> None:
    graph = ow.Graph.from_edges(5, [[0, 1], [2, 3]])
    fields = ow.smooth_fields(graph, [ow.Handle([0], axis="z", angle=90, stretch=2.0)])
    assert (fields.omega[[2, 3, 4]] == 0.0).all()
    assert (fields.sigma[[2, 3, 4]] == 1.0).all()
    assert fields.sigma[1] == pytest.approx(2.0)


def test_axis_and_angle_spell_the_rotation_vector() -> None:
    assert ow.Handle([0], axis="z", angle=720).rotation == pytest.approx([0.0, 0.0, 4.0 * np.pi])
    assert ow.Handle([0], axis="-x", angle=90).rotation == pytest.approx([-np.pi / 2, 0.0, 0.0])
    assert ow.Handle([0], axis=(0, 3, 4), angle=180).rotation == pytest.approx([0.0, 0.6 * np.pi, 0.8 * np.pi])
    assert ow.Handle([0], rotation=(1.0, 2.0, 3.0)).rotation == pytest.approx([1.0, 2.0, 3.0])


def polyline(count: int = 5) -> ow.Graph:
    return ow.Graph.from_polyline(count)


REFUSED = [
    (
        lambda: ow.Handle([0], rotation=np.eye(3)),
        r"handle: an array of shape \(3, 3\).*from_matrix\(M\)\.as_rotvec\(\)",
    ),
    (lambda: ow.Handle([0], rotation=(0, 0, 0, 1)), r"shape \(4,\) is a matrix or quaternion"),
    (lambda: ow.Handle([0], rotation=Rotation.identity()), r"lost its whole turns; pass rotation=R\.as_rotvec\(\)"),
    (lambda: ow.Handle([0], rotation=(0, np.nan, 0)), "give three finite radians"),
    (lambda: ow.Handle([0], rotation=(1, 2)), "give three finite radians"),
    (lambda: ow.Handle([0], axis="w", angle=1), "there is no axis 'w'; use 'x', 'y', 'z' or three numbers"),
    (lambda: ow.Handle([0], axis=(0, 0, 0), angle=1), "not all 0"),
    (lambda: ow.Handle([0], axis="z"), "the angle is None; give the angle in degrees"),
    (lambda: ow.Handle([0], axis="z", angle=np.inf), "the angle is inf"),
    (lambda: ow.Handle([0], rotation=(1, 0, 0), axis="z", angle=1), "both a rotation and an axis or angle"),
    (lambda: ow.Handle([0], stretch=0.0), "stretch is 0.0; give a factor > 0"),
    (lambda: ow.Handle([0], stretch=-1.0, name="tip"), "tip: stretch is -1.0"),
    (lambda: ow.Handle([0], stretch=np.nan), "stretch is nan"),
    (lambda: ow.Handle([0], axis="z", angle=5, held=True), "a held handle stays where it is and cannot be rotated"),
    (lambda: ow.Handle([0], stretch=2.0, held=True), "a held handle stays where it is"),
    (lambda: ow.smooth_fields(polyline(), [ow.Handle([])]), "handle 0: no vertex is selected"),
    (lambda: ow.smooth_fields(polyline(), [ow.Handle(np.zeros(5, bool), name="arm")]), "handle 'arm': no vertex is"),
    (lambda: ow.smooth_fields(polyline(), [ow.Handle([7])]), "handle 0: vertex number 7 does not exist, there are 5"),
    (lambda: ow.smooth_fields(polyline(), [ow.Handle(np.ones(4, bool))]), r"a mask of shape \(4,\) for 5 vertices"),
    (
        lambda: ow.smooth_fields(polyline(), [ow.Handle([0.5])]),
        "names no vertices; give vertex numbers or a boolean mask",
    ),
    (
        lambda: ow.smooth_fields(polyline(), [ow.Handle([0, 1]), ow.Handle([1], axis="z", angle=9, name="tip")]),
        "vertex 1: handle 0 and handle 'tip' give different rotations; let handles overlap only where they agree",
    ),
    (
        lambda: ow.smooth_fields(polyline(), [ow.Handle([0, 1], stretch=2), ow.Handle([1], stretch=3)]),
        "vertex 1: handle 0 and handle 1 give different stretches",
    ),
    (lambda: ow.smooth_fields(polyline(), [ow.Handle([0], angle=90)]), "an angle alone turns nothing in D = 3"),
    (
        lambda: ow.smooth_fields(polyline(), [ow.Handle([0], axis="x", angle=90)], dimension=2),
        "in D = 2 there is only one",
    ),
    (
        lambda: ow.smooth_fields(polyline(), [ow.Handle([0], angle=90)], dimension=1),
        "a line has no rotations; use stretch",
    ),
    (lambda: ow.smooth_fields(polyline(), [], sweeps=-1), "sweeps is -1; give a whole number"),
    (lambda: ow.smooth_fields(polyline(), [], length=0.0), "length is 0.0; give a length > 0"),
    (lambda: ow.smooth_fields(polyline(), [], length=1.0), "a screening length needs positions; pass x"),
    (lambda: ow.smooth_fields(polyline(), [], length=1.0, sweeps=2), "sweeps and length are both given"),
    (lambda: ow.transform(polyline(), np.zeros((4, 3)), np.zeros((5, 3)), -np.ones(5)), "sigma is -1.0 at vertex 0"),
    (lambda: ow.transform(polyline(), np.zeros((4, 3)), np.zeros(5), None), r"give rotation vectors \(V, 3\)"),
    (lambda: ow.transform(polyline(), np.zeros((4, 2)), np.zeros((5, 3)), None), r"give angles \(V,\)"),
]


@pytest.mark.parametrize(("make", "message"), REFUSED)
def test_what_is_refused_and_how(make: object, message: str) -> None:
    with pytest.raises(ow.InputError, match=message):
        make()  # type: ignore[operator]


@dataclass(frozen=True)
class Counting:
    """A solver that counts its solves."""

    inner: ow.CG = field(default_factory=lambda: ow.CG(tol=1e-9, dtype="float64"))
    count: list[int] = field(default_factory=lambda: [0])

    def prepare(self, *arguments: object) -> object:
        return self.inner.prepare(*arguments)  # type: ignore[arg-type]

    def solve(self, *arguments: object, **options: object) -> object:
        self.count[0] += 1
        return self.inner.solve(*arguments, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(("handles", "first", "later"), [(2, 2, 1), (3, 2, 1), (4, 3, 3)])
def test_a_changed_rotation_of_few_handles_solves_for_the_positions_alone(handles: int, first: int, later: int) -> None:
    x, faces = ow.shapes.bar()
    places = np.linspace(0.0, 1.0, handles)

    def posed(angle: float) -> list[ow.Handle]:
        near = [np.abs(x[:, 2] - place) < 0.04 for place in places]
        return [
            ow.Handle(some, axis="z", angle=angle * k, stretch=1.0 + 0.1 * k, held=k == 0)
            for k, some in enumerate(near)
        ]

    solver = Counting()
    deformer = ow.Deformer(x, faces, solver=solver)  # type: ignore[arg-type]
    deformer.solve(posed(30.0))
    assert solver.count == [first]
    again = deformer.solve(posed(200.0))
    assert solver.count == [first + later]
    # The same by a direct solver, which knows no influences of the handles that came before.
    graph = deformer.graph
    tight = ow.SuperLU(tol=1e-12)
    field_alone = ow.smooth_fields(graph, posed(200.0), solver=tight)
    assert np.abs(again.omega - field_alone.omega).max() < 1e-7 * np.abs(field_alone.omega).max()
    assert np.abs(again.sigma - field_alone.sigma).max() < 1e-7
