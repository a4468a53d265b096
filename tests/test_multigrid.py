"""The hierarchy: aggregates, prolongation and Galerkin products against their definitions; iterations that do not grow."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sparse
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import splu

import oneform_warp as ow
from oneform_warp.filters import read_mesh
from oneform_warp.solvers import Solver
from oneform_warp.solvers.multigrid import hierarchy, structure
from oneform_warp.solvers.multigrid.aggregates import aggregate, strong_edges
from oneform_warp.solvers.multigrid.hierarchy import COARSEST
from oneform_warp.solvers.multigrid.prolongation import Prolongation
from oneform_warp.solvers.precision import FLOAT32
from oneform_warp.solvers.rows import LaplacianRows
from oneform_warp.solvers.system import System
from references import random_graph
from test_meshes import FORMATS

FLOAT32_SUM = 1e-5  # float32 sums of up to a few hundred terms of order one
SEEDS = st.integers(0, 10**6)


def matrix(rows: LaplacianRows) -> sparse.csr_array:
    """A level as a scipy matrix, diagonal included; rows and columns that do not move are zero."""
    count = rows.inverse_diagonal.shape[0]
    off = sparse.csr_array(
        (rows.weight.numpy().astype(float), rows.neighbours.numpy(), rows.offsets.numpy()), (count, count)
    )
    attached = rows.attachment.numpy() if rows.attachment.shape[0] else np.zeros(count)
    moves = sparse.diags_array((rows.inverse_diagonal.numpy() > 0).astype(float))
    return (moves @ (sparse.diags_array(off.sum(axis=1) + attached) - off) @ moves).tocsr()


def p_matrix(p: Prolongation) -> sparse.csr_array:
    offsets = p.rows.offsets.numpy()
    return sparse.csr_array(
        (p.values.numpy().astype(float), p.rows.columns.numpy(), offsets), (len(offsets) - 1, p.coarse_count)
    )


def irregular(count: int = 3000, seed: int = 0) -> ow.Graph:
    """Nearest neighbours of random points, with weights over two decades: no symmetry to hide behind."""
    rng = np.random.default_rng(seed)
    graph = ow.Graph.from_points(rng.random((count, 2)), neighbours=6)
    return graph.with_weights(np.exp(rng.normal(size=graph.edge_count)))


def unpinned(graph: ow.Graph) -> LaplacianRows:
    return LaplacianRows.of(System.of(graph, np.zeros(graph.node_count, dtype=bool)), FLOAT32)


@settings(max_examples=40)
@given(seed=SEEDS, threshold=st.sampled_from([0.0, 0.08, 0.3]))
def test_roots_are_apart_and_every_node_is_near_one(seed: int, threshold: float) -> None:
    rows = unpinned(random_graph(seed, mu=(0.01, 100.0)).graph())
    strong = strong_edges(rows, threshold)
    numbers, count = aggregate(rows, strong)
    of = numbers.numpy()
    connected = rows.inverse_diagonal.numpy() > 0
    assert ((of >= 0) == connected).all()
    assert set(of[connected]) == set(range(count))
    size = len(of)
    near = sparse.csr_array((strong.numpy().astype(int), rows.neighbours.numpy(), rows.offsets.numpy()), (size, size))
    near = ((near + near.T) > 0).astype(int)
    # Each aggregate is one piece of radius at most two: some member reaches all others in two strong steps.
    reach = (near + sparse.eye_array(size, dtype=int)).toarray()
    reach = (reach @ reach) > 0
    for c in range(count):
        members = np.flatnonzero(of == c)
        assert reach[np.ix_(members, members)].all(axis=1).any()


def test_prolongation_is_one_damped_jacobi_step_on_the_aggregates() -> None:
    graph = irregular()
    rows = unpinned(graph)
    strong = strong_edges(rows, 0.08)
    numbers, _ = aggregate(rows, strong)
    p = p_matrix(structure(graph).prolongations[0])
    filtered = sparse.csr_array(
        (rows.weight.numpy() * strong.numpy(), rows.neighbours.numpy(), rows.offsets.numpy()), (graph.node_count,) * 2
    )
    total = filtered.sum(axis=1)
    tentative = sparse.csr_array((np.ones(graph.node_count), (np.arange(graph.node_count), numbers.numpy())), p.shape)
    inverse = sparse.diags_array(np.divide(1.0, total, out=np.zeros_like(total), where=total > 0))
    jacobi = tentative - 0.85 * (inverse @ (sparse.diags_array(total) - filtered) @ tentative)
    assert abs(p - jacobi).max() < FLOAT32_SUM
    assert p.sum(axis=1) == pytest.approx(np.ones(graph.node_count), abs=FLOAT32_SUM)


@pytest.mark.parametrize("pinned_share", [0.0, 0.001, 0.3, 1.0])
def test_coarse_matrices_are_galerkin_products_with_masked_rows(pinned_share: float) -> None:
    graph = irregular()
    pinned = np.random.default_rng(1).random(graph.node_count) < pinned_share
    attachment = np.random.default_rng(2).random(graph.node_count) if pinned_share == 0.3 else None
    levels = hierarchy(System.of(graph, pinned, attachment))
    assert len(levels.levels) >= 2
    for fine, coarse, p in zip(levels.levels, levels.levels[1:], levels.structure.prolongations, strict=False):
        mask = sparse.diags_array((fine.inverse_diagonal.numpy() > 0).astype(float))
        expected = (mask @ p_matrix(p)).T @ matrix(fine) @ (mask @ p_matrix(p))
        scale = max(abs(matrix(fine)).max(), 1.0)
        assert abs(matrix(coarse) - expected).max() < FLOAT32_SUM * scale
        if pinned_share == 0.0:
            assert not coarse.attachment.numpy().any()


def test_the_cycle_is_symmetric_and_positive() -> None:
    from oneform_warp.solvers.multigrid.cycle import Cycle

    graph = irregular(1500)
    pinned = np.zeros(graph.node_count, dtype=bool)
    pinned[::50] = True
    cycle = Cycle(hierarchy(System.of(graph, pinned)))
    rng = np.random.default_rng(0)
    a, b = (rng.normal(size=(graph.node_count, 3)) * ~pinned[:, None] for _ in range(2))

    def apply(r: np.ndarray) -> np.ndarray:
        cycle.r[0].assign(r.astype(np.float32))
        cycle.run()
        return cycle.x[0].numpy().astype(float)

    left, right = (a * apply(b)).sum(), (apply(a) * b).sum()
    assert left == pytest.approx(right, rel=1e-4)
    assert (a * apply(a)).sum() > 0.0
    assert not apply(a)[pinned].any()


def reference(graph: ow.Graph, v: np.ndarray, x: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    i, j = graph.edges.T
    e, one = np.arange(graph.edge_count), np.ones(graph.edge_count)
    d = sparse.coo_array((np.r_[one, -one], (np.r_[e, e], np.r_[j, i])), shape=(len(e), len(x))).tocsc()
    mu = sparse.diags_array(graph.mu.numpy())
    laplacian = (d.T @ mu @ d).tocsc()
    free = np.flatnonzero(~fixed)
    right = (d.T @ (mu @ v))[free] - laplacian[free][:, np.flatnonzero(fixed)] @ x[fixed]
    y = x.copy()
    y[free] = splu(laplacian[free][:, free].tocsc()).solve(right)
    return y


@pytest.mark.parametrize("weights", ["cotangent", "uniform", "inverse_length"])
@pytest.mark.parametrize("share", [0.0, 0.1])
def test_positions_are_those_of_a_direct_solver(weights: str, share: float, device: str) -> None:
    x, faces = ow.shapes.sphere(5)
    x = x * [1.0, 2.0, 5.0]
    graph = ow.Graph.from_faces(x, faces, weights=weights, device=device)
    v = ow.transform(graph, ow.differential(graph, x), np.outer(x[:, 2], [0.2, 0.4, 1.0]), None)
    fixed = np.random.default_rng(0).random(len(x)) < share
    fixed[0] = True
    expected = reference(graph, v, x, fixed)
    for solver, error in ((ow.Multigrid(), 1e-6), (ow.Multigrid(tol=1e-10, dtype="float64"), 1e-10)):
        solution = ow.solve(graph, v, start=x, fixed=fixed, solver=solver)
        assert solution.converged
        assert np.linalg.norm(solution.x - expected) < error * np.linalg.norm(expected - expected.mean(axis=0))


@pytest.mark.parametrize("solver", [ow.Multigrid(), ow.CG(), ow.Jacobi(max_iterations=50, tol=0.0)])
def test_one_pin_costs_no_accuracy_and_stays_to_the_bit(solver: Solver) -> None:
    # A needle of a mesh: as a constraint, one pin would turn rounding into a drift of 1e-5 and more.
    x, faces = ow.shapes.grid(400, 25)
    x = x + np.random.default_rng(0).uniform(-0.3, 0.3, x.shape) * [1 / 400, 1 / 25, 0.0]
    graph = ow.Graph.from_faces(x, faces)
    v = ow.transform(graph, ow.differential(graph, x), np.outer(x[:, 0], [1.0, 2.0, 3.0]), None)
    pinned = ow.solve(graph, v, start=x, fixed=[7], solver=solver)
    assert (pinned.x[7] == x[7]).all()
    if not isinstance(solver, ow.Jacobi):
        expected = reference(graph, v, x, np.arange(len(x)) == 7)
        assert np.abs(pinned.x - expected).max() < 1e-6 * np.ptp(expected)


def iterations(x: np.ndarray, faces: object, weights: str) -> int:
    graph = ow.Graph.from_faces(x, faces, weights=weights)
    t = x[:, int(np.argmax(np.ptp(x, axis=0)))] / np.ptp(x, axis=0).max()
    v = ow.transform(graph, ow.differential(graph, x), np.outer(t, [1.0, 2.0, 3.0]), None)
    solution = ow.solve(graph, v, start=x, solver=ow.Multigrid())
    assert solution.converged
    return solution.iterations


def test_iterations_hardly_grow_with_size() -> None:
    counts = [iterations(*ow.shapes.sphere(level), "cotangent") for level in (4, 5, 6, 7)]
    assert max(counts) - min(counts) <= 6
    assert max(counts) <= 16


@pytest.mark.parametrize("weights", ["cotangent", "uniform", "inverse_length"])
def test_few_iterations_on_every_real_mesh(weights: str, meshes: Path) -> None:
    pytest.importorskip("pymeshlab", reason="reads the files")
    worst: dict[str, int] = {}
    for path in sorted(p for p in meshes.rglob("*") if p.suffix.lower() in FORMATS):
        mesh = read_mesh(path)
        if len(mesh.positions) > COARSEST and len(mesh.faces):
            worst[path.name] = iterations(mesh.positions, mesh.faces, weights)
    assert max(worst.values()) <= 30, sorted(worst.items(), key=lambda item: -item[1])[:5]


def test_the_structure_is_made_once_per_graph() -> None:
    graph = irregular(1000)
    assert structure(graph) is structure(graph)
    assert structure(graph.with_weights("uniform")) is not structure(graph)
    assert "2 levels" in repr(structure(graph))
    assert "operator complexity" in repr(hierarchy(System.of(graph, np.zeros(1000, dtype=bool))))
