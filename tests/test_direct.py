"""Direct solvers against dense least squares, against Multigrid, and what they say where they cannot run."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
import warp as wp

import oneform_warp as ow
from oneform_warp.errors import InputError
from oneform_warp.solvers import Solver, State, Status
from oneform_warp.solvers.direct import Cholmod, CuDSS, SuperLU
from oneform_warp.solvers.direct.cudss import gather_columns, scatter_columns
from oneform_warp.solvers.direct.free_matrix import FreeMatrix
from oneform_warp.solvers.system import System
from references import RandomGraph, dense_solution, random_graph, residual_norms

GRAPHS = 400

wp.init()
CUDA = [d.alias for d in wp.get_cuda_devices()[:1]]
CUDSS_MISSING = [name for name in ("nvmath", "cupy") if find_spec(name) is None]

# (solver class, device) that can run together, each skipped with its reason where it cannot.
CASES = [
    pytest.param(SuperLU, "cpu", id="SuperLU-cpu"),
    pytest.param(
        Cholmod,
        "cpu",
        id="Cholmod-cpu",
        marks=pytest.mark.skipif(find_spec("cholespy") is None, reason="cholespy is not installed"),
    ),
    *(pytest.param(SuperLU, device, id=f"SuperLU-{device}") for device in CUDA),
    pytest.param(
        CuDSS,
        CUDA[0] if CUDA else "no device",
        id="CuDSS",
        marks=[
            pytest.mark.skipif(not CUDA, reason="no CUDA device"),
            pytest.mark.skipif(bool(CUDSS_MISSING), reason=f"not installed: {', '.join(CUDSS_MISSING)}"),
        ],
    ),
]
on_each = pytest.mark.parametrize(("kind", "place"), CASES)


def solve(problem: RandomGraph, solver: Solver, device: str) -> ow.Solution:
    graph = ow.Graph.from_edges(problem.vertex_count, problem.edges, weights=problem.weights, device=device)
    return ow.solve(graph, graph.merge(problem.v), start=problem.start, fixed=problem.fixed, solver=solver)


@on_each
def test_random_graphs_against_dense_least_squares(kind: type, place: str) -> None:
    corrections = []
    for seed in range(GRAPHS if place == "cpu" else GRAPHS // 10):
        problem = random_graph(seed, mu=(1e-3, 1e3))
        solution = solve(problem, kind(tol=1e-11), place)
        reference = dense_solution(problem)
        assert solution.converged, (seed, solution.status)
        # Rounding of float64 times the condition number of 40 vertices and six decades.
        assert np.abs(solution.x - reference).max() <= 1e-7 * max(np.ptp(reference), 1e-300), seed
        assert (solution.x[problem.fixed] == problem.start[problem.fixed]).all()
        corrections.append(solution.iterations)
    assert np.median(corrections) == 1
    assert max(corrections) <= 2


@on_each
def test_converged_means_a_small_float64_residual(kind: type, place: str) -> None:
    for seed in range(50):
        problem = random_graph(seed, mu=(0.01, 100.0), parallel=False)
        solution = solve(problem, kind(tol=1e-9), place)
        residual, size = residual_norms(problem, solution.x)
        assert solution.converged
        assert (residual <= 1e-9 * size + 1e-13).all(), seed


def twisted(device: str) -> tuple[ow.Graph, np.ndarray, np.ndarray]:
    x, faces = ow.shapes.sphere(5)
    x = x * [1.0, 2.0, 5.0]
    graph = ow.Graph.from_faces(x, faces, device=device)
    return graph, x, ow.transform(graph, ow.differential(graph, x), np.outer(x[:, 2], [0.2, 0.4, 1.0]), None)


@on_each
@pytest.mark.parametrize("share", [0.0, 0.1])
def test_a_sphere_comes_out_as_by_multigrid(kind: type, place: str, share: float) -> None:
    graph, x, v = twisted(place)
    fixed = np.random.default_rng(0).random(len(x)) < share
    reference = ow.solve(graph, v, start=x, fixed=fixed, solver=ow.Multigrid(tol=1e-12, dtype="float64")).x
    solution = ow.solve(graph, v, start=x, fixed=fixed, solver=kind())
    assert solution.converged
    assert solution.iterations == 1
    assert np.linalg.norm(solution.x - reference) < 1e-9 * np.linalg.norm(reference - reference.mean(axis=0))
    assert (solution.x[fixed] == x[fixed]).all()


def nodes(graph: ow.Graph, values: np.ndarray) -> wp.array:
    return wp.array(values, dtype=wp.vec3d, device=graph.device)


def attached(graph: ow.Graph, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Attachments to a third of the nodes, targets, and a 1-form."""
    rng = np.random.default_rng(seed)
    weight = rng.random(graph.node_count) * (rng.random(graph.node_count) < 0.3)
    return weight, rng.normal(size=(graph.node_count, 3)), rng.normal(size=(graph.edge_count, 3))


@on_each
def test_attachments_pull_to_their_targets(kind: type, place: str) -> None:
    for seed in range(60):
        problem = random_graph(seed, mu=(0.1, 10.0))
        graph = ow.Graph.from_edges(problem.vertex_count, problem.edges, weights=problem.weights, device=place)
        weight, target, v = attached(graph, seed)
        # Where nothing holds a component, any constant solves: leave those to the other tests.
        weight[graph.component_offsets[: graph.solved_components]] = 0.7
        d = np.zeros((graph.edge_count, graph.node_count))
        e = np.arange(graph.edge_count)
        d[e, graph.head.numpy()], d[e, graph.tail.numpy()] = 1.0, -1.0
        some = np.arange(graph.node_count) < graph.component_offsets[graph.solved_components]
        pinned = some & (np.random.default_rng(seed).random(graph.node_count) < 0.1)
        free = some & ~pinned
        mu = graph.mu.numpy()[:, None]
        expected = target.copy()
        right = d.T @ (mu * (v - d[:, pinned] @ target[pinned])) + weight[:, None] * target
        left = d.T @ (mu * d) + np.diag(weight)
        expected[free] = np.linalg.solve(left[np.ix_(free, free)], right[free])
        solver = kind(tol=1e-11)
        state = solver.prepare(graph, pinned, weight)
        start = np.where(pinned[:, None], target, 0.0)
        solution = solver.solve(state, nodes(graph, v), nodes(graph, start), target=nodes(graph, target))
        assert solution.converged
        assert np.abs(solution.x.numpy()[free] - expected[free]).max(initial=0.0) < 1e-9, seed
        assert (solution.x.numpy()[~free] == start[~free]).all()


@on_each
@pytest.mark.parametrize("node", [0, 7, 100, 1000, 5000])
def test_an_attachment_below_rounding_does_not_make_the_matrix_singular(kind: type, place: str, node: int) -> None:
    graph, x, v = twisted(place)
    weight = np.zeros(graph.node_count)
    weight[node] = 1e-25
    solver = kind()
    state = solver.prepare(graph, np.zeros(graph.node_count, dtype=bool), weight)
    solution = solver.solve(state, nodes(graph, v), graph.nodes_from(x))
    assert solution.converged
    assert np.abs(solution.x.numpy()).max() < 100.0


@on_each
def test_one_state_serves_any_form_and_start(kind: type, place: str) -> None:
    graph, x, v = twisted(place)
    solver = kind(tol=1e-10)
    pinned = np.zeros(graph.node_count, dtype=bool)
    pinned[:9] = True
    state = solver.prepare(graph, pinned)
    begin = graph.nodes_from(x).numpy()
    rng = np.random.default_rng(3)
    other = np.where(pinned[:, None], begin + 1.0, rng.normal(size=begin.shape))
    seen = []
    for form, start in ((v, begin), (0.5 * v, begin), (v, other), (v, begin)):
        begun = nodes(graph, start)
        again = solver.solve(state, nodes(graph, form), begun)
        fresh = solver.solve(solver.prepare(graph, pinned), nodes(graph, form), nodes(graph, start))
        assert again.converged
        assert np.abs(again.x.numpy() - fresh.x.numpy()).max() < 1e-9
        assert (again.x.numpy()[pinned] == start[pinned]).all()
        assert (begun.numpy() == start).all()
        seen.append(again.x.numpy())
    # Pins moved by one in each direction, so everything moves by one.
    assert np.abs(seen[2] - seen[0] - 1.0).max() < 1e-8
    assert np.abs(seen[1] - seen[0]).max() > 0.1
    # The first solve again is the first, bit by bit; cuDSS sums in no fixed order.
    assert (seen[3] == seen[0]).all() or isinstance(solver, ow.CuDSS)
    assert np.abs(seen[3] - seen[0]).max() < 1e-12


@on_each
def test_the_deformer_takes_it(kind: type, place: str) -> None:
    x, faces = ow.shapes.bar()
    handles = [ow.Handle(x[:, 2] < 0.01), ow.Handle(x[:, 2] > x[:, 2].max() - 0.01, axis="z", angle=90.0)]
    one, two = (ow.Deformer(x, faces, solver=s, device=place).solve(handles) for s in (kind(), ow.Multigrid(tol=1e-9)))
    assert one.converged
    assert np.abs(one.x - two.x).max() < 1e-4


@on_each
def test_progress_can_cancel_before_the_solve(kind: type, place: str) -> None:
    graph, x, v = twisted(place)
    calls: list[tuple[int, float]] = []
    solution = ow.solve(graph, v, start=x, solver=kind(), progress=lambda *call: calls.append(call) or True)
    assert solution.status is Status.CANCELLED
    assert (solution.x == x).all()
    assert calls[0][0] == 0
    assert calls[0][1] > 1.0


@on_each
@pytest.mark.parametrize("case", ["no edges", "all pinned", "one free"])
def test_small_systems(kind: type, place: str, case: str) -> None:
    edges = [] if case == "no edges" else [[0, 1], [1, 2]]
    graph = ow.Graph.from_edges(4, np.array(edges, dtype=int).reshape(-1, 2), device=place)
    start = np.arange(12.0).reshape(4, 3)
    fixed = {"no edges": [], "all pinned": [0, 1, 2], "one free": [0, 1]}[case]
    v = np.ones((graph.edge_count, 3))
    solution = ow.solve(graph, v, start=start, fixed=fixed, solver=kind())
    assert solution.converged
    still = [0, 1, 2, 3] if case != "one free" else [0, 1, 3]
    assert (solution.x[still] == start[still]).all()
    if case == "one free":
        assert np.abs(solution.x[2] - start[1] - np.sign(graph.edges[-1] @ [-1, 1])).max() < 1e-12


def test_the_matrix_is_the_laplacian_without_what_is_given() -> None:
    # A triangle with a pin, a path that nothing holds, an isolated vertex.
    graph = ow.Graph.from_edges(6, [[0, 1], [1, 2], [2, 0], [3, 4]], weights=[3.0, 5.0, 7.0, 2.0])
    pinned = np.zeros(graph.node_count, dtype=bool)
    pinned[graph.node_of[0]] = True
    matrix = FreeMatrix.of(System.of(graph, pinned))
    dense = (matrix.upper + matrix.upper.T).toarray() / matrix.scale
    dense -= np.diag(np.diag(dense)) / 2.0
    vertices = graph.vertex_at[matrix.nodes]
    assert set(vertices[:2]) == {1, 2}
    assert vertices[2] in (3, 4)
    assert len(vertices) == 3
    order = np.argsort(vertices[:2])
    assert (dense[:2, :2][np.ix_(order, order)] == [[8.0, -5.0], [-5.0, 12.0]]).all()
    assert (dense[2] == [0.0, 0.0, 2.0]).all()


def test_columns_go_to_cudss_one_after_the_other_and_come_back() -> None:
    r = np.random.default_rng(0).normal(size=(5, 3))
    chosen = np.array([0, 3, 4], dtype=np.int32)
    where = wp.array(chosen, dtype=wp.int32, device="cpu")
    columns, e = wp.zeros((3, 3), dtype=wp.float64, device="cpu"), wp.zeros(5, dtype=wp.vec3d, device="cpu")
    source = wp.array(r, dtype=wp.vec3d, device="cpu")
    wp.launch(gather_columns, dim=3, inputs=[where, source], outputs=[columns], device="cpu")
    assert (columns.numpy() == r[chosen].T).all()
    wp.launch(scatter_columns, dim=3, inputs=[where, columns], outputs=[e], device="cpu")
    assert (e.numpy()[chosen] == r[chosen]).all()
    assert not e.numpy()[[1, 2]].any()


@pytest.mark.parametrize(
    ("kind", "package", "extra"),
    [(Cholmod, "cholespy", "cholmod"), (CuDSS, "nvmath", "cudss"), (CuDSS, "cupy", "cudss")],
)
def test_a_missing_package_is_named_with_the_extra_to_install(
    kind: type, package: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in {"nvmath", "cupy", "cholespy"} - {package}:
        pretend(name, monkeypatch)
    monkeypatch.setitem(sys.modules, package, None)
    # Before anything else: even a wrong tolerance is not looked at.
    with pytest.raises(InputError, match=rf"{kind.__name__} needs {package}, .*pip install 'oneform-warp\[{extra}\]'"):
        kind(tol=-1.0)


def pretend(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module = type(sys)(name)
    module.__spec__ = type("Spec", (), {"name": name})()
    monkeypatch.setitem(sys.modules, name, module)


def test_cudss_wants_a_cuda_device(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("nvmath", "cupy"):
        pretend(name, monkeypatch)
    graph = ow.Graph.from_edges(2, [[0, 1]], device="cpu")
    with pytest.raises(InputError, match="CuDSS cannot solve on cpu; make the graph with device='cuda'"):
        CuDSS().prepare(graph, np.zeros(2, dtype=bool))


@pytest.mark.parametrize("kind", [case for case in (SuperLU, Cholmod) if case is SuperLU or find_spec("cholespy")])
def test_weights_beyond_float64_are_named(kind: type) -> None:
    # 1 + 1e-20 is 1: the two nodes that hold each other so tightly are not held by anything else.
    graph = ow.Graph.from_edges(3, [[0, 1], [1, 2]], weights=[1e-20, 1.0], device="cpu")
    pinned = np.zeros(3, dtype=bool)
    pinned[graph.node_of[0]] = True
    with pytest.raises(InputError, match=r"finds no factors .* use Multigrid\(\)"):
        kind().prepare(graph, pinned)


@pytest.mark.parametrize("kind", [SuperLU, *([Cholmod] if find_spec("cholespy") else [])])
def test_options_are_checked_and_solvers_are_values(kind: type) -> None:
    with pytest.raises(InputError, match="tol is -1"):
        kind(tol=-1.0)
    assert kind(tol=1e-8) == kind(tol=1e-8) != kind()
    assert isinstance(kind().prepare(ow.Graph.from_edges(2, [[0, 1]]), np.zeros(2, dtype=bool)), State)


def test_what_is_not_used_is_not_imported() -> None:
    code = (
        "import sys, oneform_warp.solvers.direct\n"
        "print(sorted({'cholespy', 'cupy', 'nvmath', 'scipy.sparse.linalg'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == "[]"
