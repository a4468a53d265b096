"""Linear constraints against a dense KKT solve, and what they say where they contradict each other."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from scipy.sparse import coo_array
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from oneform_warp.arrays import read_rows
from oneform_warp.constraint_kinds import constraint_of_kind
from oneform_warp.constraints import (
    Constraint,
    centroid,
    edge_angle,
    edge_direction,
    edge_length,
    face_normal,
    linear,
    planar,
    position,
    relative_position,
)
from oneform_warp.equations import constraint_notes, equations, misfits
from oneform_warp.rest import Rest
from oneform_warp.solvers import CG, Multigrid, Solver, Status, SuperLU
from oneform_warp.solvers.constrained import Constrained, ConstrainedSolution
from references import RandomGraph, components, random_graph

CASES = 300

TOLERANCE = 1e-8
"""Of the size of the positions: what the issue asks for; rounding times the condition number is far below."""

EXACT = 1e-9
"""Of the mesh's size: how far a hard row may be off."""


def solved(
    graph: ow.Graph,
    x: np.ndarray,
    v: np.ndarray,
    constraints: list[Constraint],
    *,
    fixed: np.ndarray | None = None,
    solver: Solver | None = None,
) -> tuple[np.ndarray, ConstrainedSolution, dict[str, float]]:
    """Positions per vertex from the constraints on rest positions x, which are the start and hold `fixed`."""
    rest = Rest(read_rows(x, len(x), "x"), graph)
    made = equations(constraints, rest)
    pinned = np.zeros(graph.node_count, dtype=bool)
    pinned[graph.node_of[np.zeros(0, dtype=int) if fixed is None else fixed]] = True
    constrained = Constrained(SuperLU() if solver is None else solver, made, rest.x)
    state = constrained.prepare(graph, pinned)
    assert not state.floating.any()
    form = wp.array(read_rows(v, len(v), "v").data / rest.scale, dtype=wp.vec3d, device=graph.device)
    solution = constrained.solve(state, form, rest.x)
    assert isinstance(solution, ConstrainedSolution)
    return rest.outside(solution.x), solution, misfits(made, solution, rest)


def dense_rows(constraints: list[Constraint], count: int, dimension: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """C (rows, V * D), d and the weights, inf for hard rows, from what a constraint says of itself."""
    blocks, d, weights = [np.zeros((0, count * dimension))], [np.zeros(0)], [np.zeros(0)]
    for c in constraints:
        block = np.zeros((len(c.d), count * dimension))
        inside = c.axis < dimension
        np.add.at(block, (c.row[inside], c.vertex[inside] * dimension + c.axis[inside]), c.value[inside])
        blocks.append(block)
        d.append(c.d)
        weights.append(np.broadcast_to(np.inf if c.weight is None else c.weight, c.d.shape))
    return np.concatenate(blocks), np.concatenate(d), np.concatenate(weights)


def dense_kkt(problem: RandomGraph, constraints: list[Constraint]) -> np.ndarray:
    """[A C^T; C 0] by NumPy's lstsq; what is open afterwards, translations, moves the centroids least."""
    count, dimension = problem.start.shape
    i, j = problem.edges.T
    d = np.zeros((len(problem.edges), count))
    np.add.at(d, (np.arange(len(d)), j), 1.0)
    np.add.at(d, (np.arange(len(d)), i), -1.0)
    one = np.eye(dimension)
    laplacian = np.kron(d.T @ (problem.weights[:, None] * d), one)
    load = (d.T @ (problem.weights[:, None] * problem.v)).ravel()
    rows, right, weight = dense_rows(constraints, count, dimension)
    soft, hard = np.isfinite(weight), ~np.isfinite(weight)
    a = laplacian + rows[soft].T @ (weight[soft, None] * rows[soft])
    b = load + rows[soft].T @ (weight[soft] * right[soft])
    held = np.repeat(np.isin(np.arange(count), problem.fixed), dimension)
    x = problem.start.ravel().copy()
    free = ~held
    c = rows[hard][:, free]
    matrix = np.block([[a[np.ix_(free, free)], c.T], [c, np.zeros((len(c), len(c)))]])
    vector = np.concatenate([b[free] - a[np.ix_(free, held)] @ x[held], right[hard] - rows[hard][:, held] @ x[held]])
    x[free] = np.linalg.lstsq(matrix, vector, rcond=1e-13)[0][: free.sum()]
    assert np.abs(rows[hard] @ x - right[hard]).max(initial=0.0) < 1e-9
    return _with_centroids(x.reshape(count, dimension), problem, np.concatenate([a, rows[hard]]))


def _with_centroids(x: np.ndarray, problem: RandomGraph, rows: np.ndarray) -> np.ndarray:
    """The minimiser whose components without pins are, as wholes, nearest to where they start; rows: A and C."""
    count, dimension = x.shape
    groups = [g for g in components(count, problem.edges) if not np.isin(g, problem.fixed).any()]
    member = np.stack([np.isin(np.arange(count), group) for group in groups] or [np.zeros(count)]).T.astype(float)
    moves = np.kron(member, np.eye(dimension))
    _, size, back = np.linalg.svd(rows @ moves)
    moves = moves @ back[np.sum(size > 1e-10 * max(size.max(initial=0.0), 1.0)) :].T
    about = np.kron(member / np.sqrt(np.maximum(member.sum(axis=0), 1.0)), np.eye(dimension)).T
    missing = about @ (problem.start - x).ravel()
    return x + (moves @ np.linalg.lstsq(about @ moves, missing, rcond=1e-12)[0]).reshape(x.shape)


def random_constraints(problem: RandomGraph, seed: int) -> list[Constraint]:
    """Hard ones, soft ones, ones that couple coordinates, redundant ones: feasible, since a shape satisfies them."""
    rng = np.random.default_rng(seed + 10_000)
    count, dimension = problem.start.shape
    shape = rng.normal(size=(count, dimension))
    shape[problem.fixed] = problem.start[problem.fixed]
    found: list[Constraint] = []
    for number in range(int(rng.integers(1, 7))):
        some = rng.permutation(count)[: int(rng.integers(1, min(count, 5) + 1))]
        name, weight = f"{number}", [None, None, float(np.exp(rng.uniform(-3, 3)))][int(rng.integers(3))]
        at = shape if weight is None else rng.normal(size=shape.shape)
        kind = int(rng.integers(6))
        if kind == 0:
            found.append(position(some, at[some], weight=weight, name=name))
        elif kind == 1:
            found.append(centroid(some, at[some].mean(axis=0), weight=weight, name=name))
        elif kind == 2 and len(some) > 1:
            a, b = some[:2]
            found.append(relative_position(a, b, at[b] - at[a], weight=weight, name=name))
        elif kind == 3 and len(some) > 1 and dimension > 1:
            found.append(edge_direction(*some[:2], at[some[1]] - at[some[0]], weight=weight, name=name))
        elif kind == 4 and len(found):
            rows, _, _ = dense_rows(found, count, dimension)
            mix = rng.normal(size=(2, len(rows)))
            found.append(
                linear(mix @ rows, mix @ (rows @ shape.ravel()), dimension=dimension, weight=weight, name=name)
            )
        else:
            rows = rng.normal(size=(2, count * dimension)) * (rng.random((2, count * dimension)) < 0.3)
            found.append(linear(rows, rows @ at.ravel(), dimension=dimension, weight=weight, name=name))
    return found


SOLVERS = [SuperLU(tol=1e-11), CG(tol=1e-11, dtype="float64"), CG(tol=1e-10), Multigrid(tol=1e-11)]


def test_random_cases_against_a_dense_kkt_solve(device: str) -> None:
    dropped = coupled = soft = 0
    for seed in range(CASES):
        problem = random_graph(seed, mu=(0.1, 10.0))
        constraints = random_constraints(problem, seed)
        graph = ow.Graph.from_edges(problem.vertex_count, problem.edges, weights=problem.weights, device=device)
        solver = SOLVERS[seed % len(SOLVERS)]
        form = graph.merge(problem.v)
        x, solution, _ = solved(graph, problem.start, form, constraints, fixed=problem.fixed, solver=solver)
        reference = dense_kkt(problem, constraints)
        assert solution.converged, (seed, solution.status)
        assert np.abs(x - reference).max() <= TOLERANCE * max(np.abs(reference).max(), 1.0), seed
        assert (x[problem.fixed] == problem.start[problem.fixed]).all(), seed
        dropped += len(solution.dropped) > 0
        soft += any(c.weight is not None for c in constraints)
        coupled += any(len(np.unique(c.axis[c.row == 0])) > 1 for c in constraints)
    assert min(dropped, coupled, soft) > CASES // 10, (dropped, coupled, soft)


def test_the_multipliers_are_the_gradient(device: str) -> None:
    for seed in range(40):
        problem = random_graph(seed, mu=(0.1, 10.0), dimension=3)
        constraints = random_constraints(problem, seed)
        graph = ow.Graph.from_edges(problem.vertex_count, problem.edges, weights=problem.weights, device=device)
        form = graph.merge(problem.v)
        x, solution, _ = solved(graph, problem.start, form, constraints, fixed=problem.fixed)
        scale = Rest(read_rows(problem.start, len(x), "x"), graph).scale
        rows, _, _ = dense_rows(constraints, *x.shape)
        gradient = ow.codifferential(graph, ow.differential(graph, x) - form) if graph.edge_count else 0.0 * x
        free = np.setdiff1d(np.arange(len(x)), problem.fixed)
        forces = (rows.T @ (solution.multipliers * scale)).reshape(x.shape)
        # The solver's default tolerance, per component.
        assert np.abs(gradient + forces)[free].max(initial=0.0) <= 1e-5 * max(np.abs(gradient).max(), 1.0), seed


def plane(device: str, count: int = 12) -> tuple[ow.Graph, np.ndarray, np.ndarray]:
    """A bumpy plane, and the 1-form that bends it."""
    x, faces = ow.shapes.bumpy_plane(count, count)
    graph = ow.Graph.from_faces(x, faces, device=device)
    omega = np.outer(x[:, 0], [0.0, 1.0, 0.5])
    return graph, x, ow.transform(graph, ow.differential(graph, x), omega, None)


def turn(axis: str, degrees: float) -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def test_every_builder_holds_what_it_says(device: str) -> None:
    graph, x, v = plane(device)
    i, j, k, a, b, c = 5, 17, 40, 70, 90, 110
    to = x[[a, b]] + [0.1, 0.2, 0.3]
    normal = np.array([0.2, 0.1, 1.0])
    y, solution, misfit = solved(
        graph,
        x,
        v,
        [
            position([a, b], to),
            centroid([c, c + 1, c + 2], [0.5, 0.5, 0.5]),
            relative_position(i, 30, [0.0, 0.1, 0.2]),
            edge_direction(50, 51, [1.0, 1.0, 0.0]),
            edge_length(60, 61, 0.5, direction=[3.0, 0.0, 4.0]),
            edge_angle(i, j, k, axis="z", angle=90, ratio=0.5),
            face_normal([80, 81, 93], normal),
            planar([100, 101, 102, 103], [0.0, 1.0, 1.0], height=0.25, name="deck"),
        ],
        fixed=np.array([0]),
    )
    assert solution.converged
    assert not len(solution.dropped)
    assert max(misfit.values()) <= EXACT
    assert misfit.keys() >= {"deck", "position of 70 90", "angle of edges 17 5 and 17 40"}
    close = pytest.approx
    assert y[[a, b]] == close(to, abs=EXACT)
    assert y[[c, c + 1, c + 2]].mean(axis=0) == close(0.5, abs=EXACT)
    assert y[30] - y[i] == close(np.array([0.0, 0.1, 0.2]), abs=EXACT)
    assert np.cross(y[51] - y[50], [1.0, 1.0, 0.0]) == close(np.zeros(3), abs=EXACT)
    assert (y[61] - y[60]) @ [0.6, 0.0, 0.8] == close(0.5, abs=EXACT)
    assert y[k] - y[j] == close(0.5 * turn("z", 90) @ (y[i] - y[j]), abs=EXACT)
    assert (y[[81, 93]] - y[80]) @ normal == close(np.zeros(2), abs=EXACT)
    assert y[[100, 101, 102, 103]] @ [0.0, 1.0, 1.0] / np.sqrt(2.0) == close(np.full(4, 0.25), abs=EXACT)


def test_a_plane_is_fitted_to_positions(device: str) -> None:
    graph, x, v = plane(device)
    some = [3, 40, 77, 100]
    tilted = x.copy()
    tilted[some, 2] = x[some] @ [0.3, 0.2, 0.0]
    y, _, _ = solved(graph, x, v, [planar(some, x=tilted)], fixed=np.array([0]))
    spans = (y[some[1:]] - y[some[0]]) @ [-0.3, -0.2, 1.0]
    assert np.abs(spans).max() <= EXACT


def test_a_length_follows_the_deformed_direction(device: str) -> None:
    graph, x, v = plane(device)
    a, b = (int(end) for end in graph.edges[100])
    fixed = np.array([0, 5])
    before = ow.solve(graph, v, start=x, fixed=fixed, solver=SuperLU()).x
    direction = (before[b] - before[a]) / np.linalg.norm(before[b] - before[a])
    y, solution, _ = solved(graph, x, v, [edge_length(a, b, 0.2)], fixed=fixed)
    assert solution.converged
    assert (y[b] - y[a]) @ direction == pytest.approx(0.2, abs=EXACT)
    # The edge turns little, so that this is its length to second order.
    assert np.linalg.norm(y[b] - y[a]) == pytest.approx(0.2, rel=0.02)
    same, _, _ = solved(graph, x, v, [edge_length(a, b, 0.2, direction=direction)], fixed=fixed)
    assert y == pytest.approx(same, abs=EXACT)


def test_soft_ones_become_hard_with_their_weight(device: str) -> None:
    graph, x, v = plane(device)
    to = x[70] + [0.0, 0.0, 0.5]
    hard, _, _ = solved(graph, x, v, [position(70, to)], fixed=np.array([0]))
    away = []
    for weight in (1.0, 1e3, 1e6, 1e9):
        y, solution, misfit = solved(graph, x, v, [position(70, to, weight=weight)], fixed=np.array([0]))
        assert solution.converged
        away.append(misfit["position of 70"])
        assert np.abs(y - hard).max() <= 2.0 * away[-1] + 1e-6
    # The misfit is lambda / w.
    assert np.diff(np.log10(away[1:])) == pytest.approx([-3.0, -3.0], abs=0.01)


def test_soft_ones_may_disagree(device: str) -> None:
    graph, x, v = plane(device)
    low, high = x[70] - [0.0, 0.0, 0.5], x[70] + [0.0, 0.0, 0.5]
    y, solution, _ = solved(
        graph, x, v, [position(70, low, weight=1e6), position(70, high, weight=3e6)], fixed=np.array([0])
    )
    assert solution.converged
    assert y[70] == pytest.approx((low + 3.0 * high) / 4.0, abs=1e-5)


def test_contradictory_ones_are_named() -> None:
    graph, x, v = plane("cpu")
    one, two = x[5] + 0.1, x[5] + 0.2
    cases = [
        (["'one'", "'two'"], [position(5, one, name="one"), position(5, two, name="two")]),
        (
            ["'left'", "'right'", "'span'"],
            [
                position(5, one, name="left"),
                position(9, two, name="right"),
                relative_position(5, 9, [9.0, 9.0, 9.0], name="span"),
                centroid([20, 21], one, name="bystander"),
            ],
        ),
        (["'pin'", "the held vertices"], [position(0, x[0] + 0.1, name="pin")]),
        (["'mean'", "the held vertices", "'one'"], [position(1, x[1] + 0.1, name="one"), centroid([0, 1], x[0], name="mean")]),
        (["'nothing'"], [linear(np.zeros((1, x.size)), [1.0], name="nothing")]),
        (["'a (1)'", "'a (2)'"], [edge_length(5, 6, 0.1, name="a"), edge_length(5, 6, 0.2, name="a")]),
    ]  # fmt: skip
    for names, constraints in cases:
        with pytest.raises(ow.InputError) as caught:
            solved(graph, x, v, constraints, fixed=np.array([0]))
        assert all(name in str(caught.value) for name in names), str(caught.value)
        assert "bystander" not in str(caught.value)
        assert "contradict" in str(caught.value)


def test_redundant_ones_are_left_out_and_named(device: str) -> None:
    graph, x, v = plane(device)
    ends = [position(5, x[5] + 0.1, name="left"), position(9, x[9] + 0.2, name="right")]
    span = relative_position(5, 9, x[9] - x[5] + 0.1, name="span")
    y, solution, _ = solved(graph, x, v, [*ends, span], fixed=np.array([0]))
    rest = Rest(read_rows(x, len(x), "x"), graph)
    assert solution.dropped.tolist() == [6, 7, 8]
    notes = constraint_notes(equations([*ends, span], rest), solution)
    assert notes == ("constraint 'span': 3 of 3 rows follow from earlier ones and were left out",)
    assert (y == solved(graph, x, v, ends, fixed=np.array([0]))[0]).all()
    # What single precision makes of the same offset is no contradiction.
    rounded = relative_position(5, 9, (x[9] - x[5] + 0.1).astype(np.float32), name="span")
    assert solved(graph, x, v, [*ends, rounded], fixed=np.array([0]))[1].converged


def test_what_floats_is_held_by_constraints_alone(device: str) -> None:
    graph, x, v = plane(device)
    free, _, _ = solved(graph, x, v, [])
    assert free == pytest.approx(ow.solve(graph, v, start=x, solver=SuperLU()).x, abs=1e-12)
    # A point only translates it.
    moved, _, _ = solved(graph, x, v, [position(30, [1.0, 2.0, 3.0])])
    assert moved - moved[30] == pytest.approx(free - free[30], abs=1e-9)
    assert moved[30] == pytest.approx(np.array([1.0, 2.0, 3.0]), abs=EXACT)
    # A direction says nothing about where it is: the centroid stays.
    turned, _, _ = solved(graph, x, v, [edge_direction(30, 31, [1.0, 0.0, 0.0])])
    assert turned.mean(axis=0) == pytest.approx(x.mean(axis=0), abs=1e-12)
    # The centroid of everything holds it, and needs no force.
    centred, solution, _ = solved(graph, x, v, [centroid(np.arange(len(x)), [1.0, 0.0, 0.0])])
    assert centred - [1.0, 0.0, 0.0] == pytest.approx(free - x.mean(axis=0), abs=1e-9)
    assert np.abs(solution.multipliers).max() < 1e-9


def test_two_meshes_are_joined_by_a_relative_position(device: str) -> None:
    x, faces = ow.shapes.sphere(1)
    count = len(x)
    both, all_faces = np.concatenate([x, x + [3.0, 0.0, 0.0]]), np.concatenate([faces, faces + count])
    graph = ow.Graph.from_faces(both, all_faces, device=device)
    v = ow.differential(graph, both)
    y, _, _ = solved(graph, both, v, [relative_position(0, count, [1.0, 0.0, 0.0])])
    # Both are rigid, and move by the same.
    assert y[:count] - x == pytest.approx(np.tile([1.0, 0.0, 0.0], (count, 1)), abs=1e-9)
    assert y[count:] - both[count:] == pytest.approx(np.tile([-1.0, 0.0, 0.0], (count, 1)), abs=1e-9)


def test_what_no_constraint_touches_keeps_every_bit(device: str) -> None:
    x, faces = ow.shapes.sphere(1)
    count = len(x)
    both, all_faces = np.concatenate([x, 1.7 * x + 3.0]), np.concatenate([faces, faces + count])
    graph = ow.Graph.from_faces(both, all_faces, device=device)
    y, _, _ = solved(graph, both, ow.differential(graph, both), [position(0, [0.0, 0.0, 2.0])], fixed=np.array([5]))
    assert (y[count:] == both[count:]).all()
    assert (y[5] == both[5]).all()
    assert (y[1] != both[1]).any()


@pytest.mark.parametrize("solver", [SuperLU(), CG(), Multigrid()])
def test_a_state_serves_any_form_and_repeats_every_bit(solver: Solver, device: str) -> None:
    graph, x, v = plane(device, 20)
    rest = Rest(read_rows(x, len(x), "x"), graph)
    made = equations([position(70, x[70] + 0.2), edge_length(90, 91, 0.1), centroid([3, 4], x[3], weight=2.0)], rest)
    constrained = Constrained(solver, made, rest.x)
    pinned = np.zeros(graph.node_count, dtype=bool)
    pinned[0] = True
    state = constrained.prepare(graph, pinned)
    forms = [wp.array(form / rest.scale, dtype=wp.vec3d, device=device) for form in (v, 1.5 * v, v)]
    first, other, again = (constrained.solve(state, form, rest.x) for form in forms)
    assert first.converged
    assert other.converged
    assert (first.x.numpy() == again.x.numpy()).all()
    assert (first.x.numpy() != other.x.numpy()).any()


def test_attached_nodes_are_pulled_as_well(device: str) -> None:
    graph, x, v = plane(device)
    rest = Rest(read_rows(x, len(x), "x"), graph)
    to = x[70] + [0.0, 0.0, 0.5]
    pull = np.zeros(graph.node_count)
    pull[graph.node_of[20]] = 2.5
    pinned = np.zeros(graph.node_count, dtype=bool)
    pinned[graph.node_of[0]] = True
    made = equations([position(70, to)], rest)
    constrained = Constrained(SuperLU(tol=1e-11), made, rest.x)
    form = wp.array(v / rest.scale, dtype=wp.vec3d, device=device)
    state = constrained.prepare(graph, pinned, pull)
    y = rest.outside(constrained.solve(state, form, rest.x, target=rest.x).x)
    same, _, _ = solved(graph, x, v, [position(70, to), position(20, x[20], weight=2.5)], fixed=np.array([0]))
    assert y == pytest.approx(same, abs=1e-7)


def test_a_shape_is_held_without_its_form(device: str) -> None:
    graph, x, v = plane(device)
    rest = Rest(read_rows(x, len(x), "x"), graph)
    weight, low = 2.5, x[40] - 0.2
    made = equations([position(70, x[70] + 0.2), position(40, low, weight=weight)], rest)
    constrained = Constrained(SuperLU(tol=1e-11), made, rest.x)
    pinned = np.zeros(graph.node_count, dtype=bool)
    pinned[graph.node_of[0]] = True
    state = constrained.prepare(graph, pinned)
    form = wp.array(v / rest.scale, dtype=wp.vec3d, device=device)
    free = SuperLU(tol=1e-11).solve(state.base, form, rest.x).x
    solution = constrained.solve(state, form, rest.x)
    assert state.held(free).numpy() == pytest.approx(solution.x.numpy(), abs=1e-9)
    away = (rest.outside(solution.x)[40] - low) / rest.scale
    assert state.soft_energy(solution.x) == pytest.approx(weight * away @ away, rel=1e-9)
    pull = wp.zeros_like(rest.x)
    state.add_soft_pull(solution.x, pull)
    expected = np.zeros((graph.node_count, 3))
    expected[graph.node_of[40]] = -weight * away
    assert pull.numpy() == pytest.approx(expected, abs=1e-9)


def test_welded_vertices_move_together(device: str) -> None:
    x = np.array(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1e-3, 0.0], [2.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.5, 1.0, 0.0]]
    )
    graph = ow.Graph.from_faces(x, [[0, 1, 4], [2, 3, 5]], weld=0.01, device=device)
    y, _, _ = solved(graph, x, ow.differential(graph, x), [position(2, [1.0, 0.0, 0.5])], fixed=np.array([0, 3]))
    assert y[2] == pytest.approx(np.array([1.0, 0.0, 0.5]), abs=EXACT)
    assert y[1] == pytest.approx(np.array([1.0, -1e-3, 0.5]), abs=EXACT)
    with pytest.raises(ow.InputError, match="'stuck' contradicts"):
        solved(graph, x, ow.differential(graph, x), [relative_position(1, 2, [0.0, 0.0, 0.5], name="stuck")])


def test_a_plane_of_numbers_has_no_third_axis(device: str) -> None:
    x, faces = ow.shapes.grid(5, 5)
    flat = np.ascontiguousarray(x[:, :2])
    graph = ow.Graph.from_faces(flat, faces, device=device)
    v = ow.differential(graph, flat)
    y, solution, _ = solved(
        graph, flat, v, [edge_angle(1, 7, 13, angle=90), edge_length(20, 21, 0.4)], fixed=np.array([0])
    )
    assert solution.converged
    assert len(solution.multipliers) == 3
    assert y[13] - y[7] == pytest.approx(turn("z", 90)[:2, :2] @ (y[1] - y[7]), abs=EXACT)
    for wrong in (position(3, [0.0, 0.0, 1.0]), edge_angle(1, 7, 13, axis="x", angle=90)):
        with pytest.raises(ow.InputError, match=r"D = \d|third axis"):
            solved(graph, flat, v, [wrong])


def test_input_that_cannot_be_used_is_named() -> None:
    graph, x, v = plane("cpu", 5)
    for make, words in [
        (lambda: position(0, [0.0, np.nan, 0.0]), "not finite"),
        (lambda: position([0, 1], x[:1]), "give one for each"),
        (lambda: position(x[:, 0] > 0, x), "for 30 vertices"),
        (lambda: position(0, x[0], weight=0.0), "> 0"),
        (lambda: position(0, "there"), "no numbers"),
        (lambda: relative_position(1, 1, x[0]), "twice"),
        (lambda: edge_direction(0, 1, [0.0, 0.0, 0.0]), "not all 0"),
        (lambda: edge_length(0, 1, -1.0), "length >= 0"),
        (lambda: edge_angle(0, 1, 2, axis="z", angle=30, ratio=0.0), "ratio > 0"),
        (lambda: planar([0, 1, 2]), "give normal"),
        (lambda: planar([0], [0.0, 0.0, 1.0]), "more of them"),
        (lambda: linear(np.ones((1, 7)), [0.0]), "V \\* D"),
        (lambda: linear(np.ones((1, 6)), [0.0, 1.0]), "one for each row"),
    ]:
        with pytest.raises(ow.InputError, match=words):
            make()
    for constraint, words in [
        (position(999, x[0]), "does not exist"),
        (position(0, [0.0, 0.0]), "D = 2"),
        (linear(coo_array((1, 3000)), [0.0]), "1000 vertices"),
    ]:
        with pytest.raises(ow.InputError, match=words):
            solved(graph, x, v, [constraint])


def test_kinds_and_options_as_people_type_them() -> None:
    made = constraint_of_kind("edge_angle", {"i": 0, "j": 1, "k": 2, "axis": "z", "angle": 90.0, "name": "knee"})
    same = edge_angle(0, 1, 2, axis="z", angle=90.0, name="knee")
    assert made.name == "knee"
    assert (made.value == same.value).all()
    for kind, options, words in [
        ("positon", {}, "did you mean 'position'"),
        ("position", {"vertices": [0], "two": [0.0]}, "did you mean 'to'"),
        ("centroid", {"vertices": [0], "name": "middle"}, "'middle': centroid needs to"),
    ]:
        with pytest.raises(ow.InputError, match=words):
            constraint_of_kind(kind, options)


def test_a_cancelled_solve_says_so() -> None:
    graph, x, v = plane("cpu", 30)
    rest = Rest(read_rows(x, len(x), "x"), graph)
    constrained = Constrained(CG(), equations([position(70, x[70] + 0.2)], rest), rest.x)
    state = constrained.prepare(graph, np.zeros(graph.node_count, dtype=bool))
    form = wp.array(v / rest.scale, dtype=wp.vec3d, device="cpu")
    solution = constrained.solve(state, form, rest.x, progress=lambda done, ratio: True)
    assert solution.status is Status.CANCELLED
    assert isinstance(solution, ConstrainedSolution)


def test_hundreds_of_forms_are_few(device: str) -> None:
    x, faces = ow.shapes.sphere(3)
    rest = Rest(read_rows(x, len(x), "x"), ow.Graph.from_faces(x, faces, device=device))
    # A point takes one solve of a scalar for its three rows, and so do a centroid and every direction of an edge.
    for constraint, rows, forms in [
        (position(5, x[5]), 3, 1),
        (centroid(np.arange(len(x)), x[0]), 3, 1),
        (edge_direction(0, 1, [1.0, 2.0, 3.0]), 2, 1),
        (edge_length(0, 1, 1.0), 1, 1),
        (planar([0, 1, 2, 3], [1.0, 2.0, 3.0]), 3, 3),
        (edge_angle(0, 1, 2, axis=[1.0, 2.0, 3.0], angle=40), 3, 3),
    ]:
        made = equations([constraint, constraint], rest)
        assert made.count == 2 * rows
        assert made.scalar_columns.forms.shape[1] == forms


class Counting:
    """SuperLU that counts how often it prepares."""

    def __init__(self) -> None:
        self.solver, self.prepared = SuperLU(), 0
        self.tol, self.solve = self.solver.tol, self.solver.solve

    def prepare(self, graph: ow.Graph, pinned: np.ndarray, attachment: np.ndarray | None = None) -> ow.solvers.State:
        self.prepared += 1
        return self.solver.prepare(graph, pinned, attachment)


@pytest.mark.parametrize("weight", [None, 3.0], ids=["hard", "soft"])
def test_another_right_hand_side_prepares_nothing(weight: float | None) -> None:
    x, faces = ow.shapes.bar(segments=8, sides=4)
    foot, counting = ow.Handle(x[:, 2] < x[:, 2].min() + 0.1, held=True), Counting()
    deformer = ow.Deformer(x, faces, solver=counting)

    def asked(shift: float) -> list[Constraint]:
        """One complete row by row, one that follows the deformed shape."""
        return [
            position([len(x) - 1], x[-1:] + shift, weight=weight),
            edge_length(2, len(x) - 3, (1.0 + shift) * float(np.linalg.norm(x[2] - x[-3])), weight=weight),
        ]

    moved = [deformer.deform([foot], constraints=asked(shift)) for shift in (0.0, 0.1, 0.2)]
    assert counting.prepared == 1
    anew = ow.Deformer(x, faces, solver=SuperLU()).deform([foot], constraints=asked(0.2))
    np.testing.assert_array_equal(moved[-1], anew)
    assert np.abs(moved[-1] - moved[0]).max() > 0.1
    deformer.deform([foot], constraints=asked(0.2)[:1])
    assert counting.prepared == 2
