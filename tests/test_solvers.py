"""Every solver against dense least squares, and what `converged` promises."""

from __future__ import annotations

import threading

import numpy as np
import pytest
import warp as wp

import oneform_warp as ow
from oneform_warp.solvers import Solver, Status
from references import dense_solution, random_graph, residual_norms

GRAPHS = 2000
BATCHES = 20

# name -> solver, range of mu, largest error: of a coordinate over the range of x, in the energy norm over |v|_mu.
CASES = {
    # tol 1e-12 times six decades of mu; CG gets below since it looks every eight iterations only.
    "float64, multigrid": (ow.Multigrid(tol=1e-12, dtype="float64"), (1e-3, 1e3), 1e-6, 1e-8),
    "float32, multigrid": (ow.Multigrid(tol=1e-7), (0.1, 10.0), 1e-4, 1e-4),
    # Rounding of float64 times the condition number of 40 vertices.
    "float64": (ow.CG(tol=1e-12, dtype="float64"), (1e-3, 1e3), 1e-8, 1e-8),
    # tol 1e-7 times the condition number for mu within a factor of 100.
    "float32": (ow.CG(tol=1e-7), (0.1, 10.0), 1e-4, 1e-4),
    # Six decades of mu: weak edges are seen in the energy norm only.
    "float32, six decades": (ow.CG(tol=1e-6), (1e-3, 1e3), np.inf, 1e-3),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("batch", range(BATCHES))
def test_random_graphs_against_dense_least_squares(case: str, batch: int, device: str) -> None:
    solver, mu, error_limit, energy_limit = CASES[case]
    each = GRAPHS // BATCHES // (1 if device == "cpu" else 10)
    for seed in range(batch * each, (batch + 1) * each):
        problem = random_graph(seed, mu=mu)
        graph = ow.Graph.from_edges(problem.vertex_count, problem.edges, weights=problem.weights, device=device)
        solution = ow.solve(graph, graph.merge(problem.v), start=problem.start, fixed=problem.fixed, solver=solver)
        reference = dense_solution(problem)
        error = solution.x - reference
        i, j = problem.edges.T
        root = np.sqrt(problem.weights)[:, None]
        size = np.linalg.norm(root * problem.v * (i != j)[:, None])
        assert solution.converged, (seed, solution.status)
        assert np.abs(error).max() <= error_limit * max(np.ptp(reference), 1e-300), seed
        assert np.linalg.norm(root * (error[j] - error[i])) <= energy_limit * size, seed
        assert (solution.x[problem.fixed] == problem.start[problem.fixed]).all()


@pytest.mark.parametrize(
    "solver", [ow.CG(tol=1e-5), ow.Jacobi(tol=1e-3), ow.CG(tol=1e-9), ow.CG(max_iterations=3), ow.Multigrid()]
)
def test_converged_means_a_small_float64_residual(solver: Solver) -> None:
    seen = set()
    for seed in range(200):
        # Averaging parallel edges is not part of this: the residual on the list would count what they disagree on.
        problem = random_graph(seed, mu=(0.01, 100.0), parallel=False)
        graph = problem.graph()
        solution = ow.solve(graph, graph.merge(problem.v), start=problem.start, fixed=problem.fixed, solver=solver)
        residual, size = residual_norms(problem, solution.x)
        small = (residual <= solver.tol * size * (1 + 1e-9) + 1e-13).all()
        assert not (solution.converged and not small), seed
        seen.add(solution.converged)
    assert True in seen
    if solver.max_iterations == 3:
        assert False in seen


def test_energy_is_below_every_perturbation_and_every_start(device: str) -> None:
    x, faces = ow.shapes.bar()
    graph = ow.Graph.from_faces(x, faces, device=device)
    v = ow.transform(graph, ow.differential(graph, x), np.outer(x[:, 2], [0.3, 0.0, np.pi]), 1.0 + 0.5 * x[:, 2])
    solution = ow.solve(graph, v, start=x)
    least = ow.energy(graph, solution.x, v)
    rng = np.random.default_rng(0)
    for size in np.logspace(-4, 0, 100):
        assert ow.energy(graph, solution.x + size * rng.normal(size=x.shape), v) > least
    cost = ow.edge_energy(graph, x, v)
    for start in (
        x,
        np.zeros_like(x),
        *(ow.integrate_tree(ow.spanning_tree(graph, c), v) for c in (None, cost, -cost)),
    ):
        assert ow.energy(graph, start, v) > least


def test_undamped_jacobi_never_converges_on_a_bipartite_graph() -> None:
    graph = ow.Graph.from_grid((8, 8))
    checkerboard = np.indices((8, 8)).sum(axis=0).ravel() % 2.0
    zero = np.zeros(graph.edge_count)
    undamped = ow.solve(graph, zero, start=checkerboard, solver=ow.Jacobi(damping=1.0, max_iterations=2000))
    damped = ow.solve(graph, zero, start=checkerboard, solver=ow.Jacobi(max_iterations=2000))
    assert not undamped.converged
    assert np.ptp(undamped.x) > 0.9
    assert damped.converged
    assert np.ptp(damped.x) < 1e-4


def test_jacobi_and_cg_agree() -> None:
    x, faces = ow.shapes.bar(segments=10)
    graph = ow.Graph.from_faces(x, faces)
    v = ow.transform(graph, ow.differential(graph, x), np.outer(x[:, 2], [0.0, 0.0, 2.0]), None)
    fixed = x[:, 2] < 0.05
    one = ow.solve(graph, v, start=x, fixed=fixed, solver=ow.CG())
    two = ow.solve(graph, v, start=x, fixed=fixed, solver=ow.Jacobi(tol=1e-6))
    assert one.converged
    assert two.converged
    assert two.iterations > 5 * one.iterations
    assert np.abs(one.x - two.x).max() < 1e-4


@pytest.mark.parametrize(
    "solver", [ow.CG(), ow.Multigrid(), ow.Jacobi(max_iterations=64, tol=0.0), ow.CG(dtype="float64")]
)
def test_runs_repeat_bit_for_bit(solver: Solver, device: str) -> None:
    x, faces = ow.shapes.sphere(4)
    graph = ow.Graph.from_faces(x, faces, device=device)
    v = ow.transform(graph, ow.differential(graph, x), np.outer(x[:, 2], [1.0, 2.0, 3.0]), None)
    first = ow.solve(graph, v, start=x, solver=solver)
    for _ in range(3):
        again = ow.solve(graph, v, start=x, solver=solver)
        assert (again.x == first.x).all()
        assert again.iterations == first.iterations


def test_columns_and_components_do_not_disturb_each_other() -> None:
    problems = [random_graph(seed, mu=(0.1, 10.0), dimension=3) for seed in (1, 2, 3)]
    sizes = np.cumsum([0, *(p.vertex_count for p in problems)])
    edges = np.concatenate([p.edges + s for p, s in zip(problems, sizes, strict=False)])
    # One piece is a million times larger and one column a million times smaller.
    scale = [1.0, 1e6, 1.0]
    v = np.concatenate([p.v * s for p, s in zip(problems, scale, strict=True)]) * [1.0, 1e-6, 1.0]
    together = ow.Graph.from_edges(sizes[-1], edges, weights=np.concatenate([p.weights for p in problems]))
    solution = ow.solve(together, together.merge(v))
    assert solution.converged
    for problem, first, size in zip(problems, sizes, scale, strict=False):
        alone = dense_solution(type(problem)(**{**vars(problem), "start": np.zeros_like(problem.start), "fixed": []}))
        piece = solution.x[first : first + problem.vertex_count] / size / [1.0, 1e-6, 1.0]
        assert np.abs(piece - alone).max() < 1e-4 * np.ptp(alone)


def test_an_exact_start_is_left_alone_bit_for_bit() -> None:
    x, faces = ow.shapes.bar()
    graph = ow.Graph.from_faces(x, faces)
    solution = ow.solve(graph, ow.differential(graph, x), start=x)
    assert solution.converged
    assert solution.iterations == 0
    assert (solution.x == x).all()


def test_graphs_without_edges_or_vertices() -> None:
    alone = ow.solve(ow.Graph.from_edges(3, np.zeros((0, 2), dtype=int)), np.zeros((0, 3)), start=np.eye(3))
    assert alone.converged
    assert (alone.x == np.eye(3)).all()
    assert ow.solve(ow.Graph.from_edges(0, np.zeros((0, 2), dtype=int)), np.zeros((0, 3))).x.shape == (0, 3)


def twisted_sphere() -> tuple[ow.Graph, np.ndarray, np.ndarray]:
    x, faces = ow.shapes.sphere(4)
    graph = ow.Graph.from_faces(x, faces)
    return graph, x, ow.transform(graph, ow.differential(graph, x), np.outer(x[:, 2], [0.0, 0.0, 3.0]), None)


def test_statuses_that_are_not_converged() -> None:
    graph, x, v = twisted_sphere()
    assert ow.solve(graph, v, start=x, solver=ow.CG(max_iterations=5)).status is Status.MAX_ITERATIONS
    assert ow.solve(graph, v, start=x, solver=ow.CG(max_iterations=5)).iterations == 5
    huge = ow.solve(graph, v * 1e300, start=x, solver=ow.CG())
    assert huge.status is Status.NON_FINITE
    assert np.isfinite(huge.x).all()
    for status in Status:
        assert str(status).startswith(status.word + ": ")


def test_progress_is_called_and_can_cancel() -> None:
    graph, x, v = twisted_sphere()
    calls: list[tuple[int, float]] = []
    full = ow.solve(graph, v, start=x, solver=ow.CG(), progress=lambda n, ratio: calls.append((n, ratio)))
    assert full.converged
    assert [n for n, _ in calls] == sorted(n for n, _ in calls)
    assert calls[-1][1] < 1.0 < calls[0][1]
    assert [entry for entry in full.history if entry in calls] == calls
    stop = threading.Event()
    stop.set()
    cancelled = ow.solve(graph, v, start=x, solver=ow.CG(), progress=lambda n, ratio: stop.is_set())
    assert cancelled.status is Status.CANCELLED
    assert 0 < cancelled.iterations < full.iterations
    assert ow.energy(graph, cancelled.x, v) < ow.energy(graph, x, v)


def test_stagnation_is_reported_where_precision_ends() -> None:
    graph, x, v = twisted_sphere()
    # 1e7 box sizes away, float64 keeps about nine digits of the box: tol 1e-12 of |codiff v| cannot be met honestly.
    far = ow.solve(graph, v, start=x + 1e7, solver=ow.CG(tol=0.0))
    near = ow.solve(graph, v, start=x, solver=ow.CG(tol=1e-10))
    assert near.converged
    assert np.abs((far.x - 1e7) - near.x).max() < 1e-6
    assert far.status in (Status.CONVERGED, Status.STAGNATED)
    assert (far.residual <= far.goal).all() == far.converged


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ow.CG(tol=-1.0), "solver: tol is -1.0; give a number >= 0"),
        (lambda: ow.CG(tol=np.nan), "solver: tol is nan"),
        (lambda: ow.CG(max_iterations=-1), "max_iterations is -1; give a whole number"),
        (lambda: ow.Jacobi(max_iterations=1.5), "max_iterations is 1.5; give a whole number"),  # type: ignore[arg-type]
        (lambda: ow.CG(dtype="float16"), "iterations cannot run in 'float16'; use 'float32' or 'float64'"),
        (lambda: ow.Jacobi(damping=0.0), "damping is 0.0; give a number in"),
        (lambda: ow.Jacobi(damping=1.5), "damping is 1.5; give a number in"),
    ],
)
def test_bad_options_are_named(make: object, message: str) -> None:
    with pytest.raises(ow.InputError, match=message):
        make()  # type: ignore[operator]


def test_warp_arrays_stay_on_their_device(device: str) -> None:
    x, faces = ow.shapes.bar()
    graph = ow.Graph.from_faces(x, faces, device=device)
    dx = ow.differential(graph, wp.array(x, dtype=wp.vec3d, device=device))
    assert isinstance(dx, wp.array)
    assert dx.device == wp.get_device(device)
    solution = ow.solve(graph, dx, start=x)
    assert isinstance(solution.x, wp.array)
    assert solution.x.device == wp.get_device(device)
    assert solution.x.dtype is wp.vec3d
    assert np.abs(solution.x.numpy() - x).max() < 1e-6
