"""The study of spanning trees: what it predicts and counts, against the package and closed forms."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from bench.tree import journal as journals
from bench.tree import page
from bench.tree.cases import Case, Problem, Shape
from bench.tree.low_stretch import akpw, shortest_paths
from bench.tree.others import flow, image_editing, laplacian_editing, poisson_editing
from bench.tree.seeds import BEST, SEEDS
from bench.tree.theory import predict
from bench.tree.trace import SOLVERS, TOLERANCES, trace
from bench.tree.transfer import Jumping
from bench.tree.used import line
from oneform_warp.forms import node_codifferential, node_energy
from oneform_warp.tree import integrate_nodes, spanning_tree

CPU = wp.get_device("cpu")
OF_BEST = ("rest", "rings", "held: min depth", "held: maximal", "held: resistance")
TREES = [seed for seed in SEEDS if seed.tree is not None and seed.name.startswith("held")]


@cache
def problem(kind: str = "twist", amount: float = 90.0) -> Problem:
    return Problem.of(Case("bar:500", kind, amount), Shape.of("bar:500", "cotangent", CPU))


@pytest.mark.parametrize("seed", TREES, ids=lambda seed: seed.name)
def test_all_energy_of_a_trees_estimate_is_on_the_edges_that_close_cycles(seed: object) -> None:
    at = problem()
    energy = node_energy(at.graph, seed.make(at), at.v)[0] / at.least
    assert predict(at, seed.tree(at)).exact == pytest.approx(energy, rel=1e-6)


def test_white_noise_has_the_energy_that_stretch_predicts() -> None:
    at = problem()
    graph, rng = at.graph, np.random.default_rng(0)
    tree = spanning_tree(graph, 1.0 / graph.mu.numpy(), roots=at.roots)
    ratios = []
    for _ in range(20):
        noise = rng.normal(size=(graph.edge_count, 3)) / np.sqrt(graph.mu.numpy())[:, None]
        v = wp.array(noise + differential_at_rest(at), dtype=wp.vec3d, device=CPU)
        drawn = Problem(at.case, at.shape, v, at.solver, at.state)
        estimate = drawn.held(integrate_nodes(tree, drawn.v, drawn.rest))
        ratios.append(node_energy(graph, estimate, v)[0] / drawn.least)
    assert np.mean(ratios) == pytest.approx(predict(at, tree).white, rel=0.1)


def differential_at_rest(at: Problem) -> np.ndarray:
    tail, head = at.graph.tail.numpy(), at.graph.head.numpy()
    dx: np.ndarray = at.shape.x[head] - at.shape.x[tail]
    return dx


@pytest.mark.parametrize("build", [shortest_paths, akpw])
def test_trees_by_resistance_span_and_stretch_less_than_random_ones(build: object) -> None:
    at = problem()
    tree = build(at.graph, 1.0 / at.graph.mu.numpy(), at.roots)
    assert len(tree.edges) == at.graph.node_count - len(tree.roots)
    random = next(seed for seed in TREES if "random" in seed.name)
    assert predict(at, tree).stretch < predict(at, random.tree(at)).stretch


def test_shortest_paths_are_dijkstras() -> None:
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    at = problem()
    graph, length = at.graph, 1.0 / at.graph.mu.numpy()
    tree = shortest_paths(graph, length, at.roots)
    table = csr_matrix((length, (graph.tail.numpy(), graph.head.numpy())), (graph.node_count,) * 2)
    expected = dijkstra(table, directed=False, indices=np.flatnonzero(at.shape.pinned)).min(axis=0)
    form = wp.array(np.zeros((graph.edge_count, 3)), dtype=wp.vec3d, device=CPU)
    assert integrate_nodes(tree, form, at.rest).shape == (graph.node_count,)
    parent, link = tree.parent.numpy(), tree.link.numpy()
    found = np.zeros(graph.node_count)
    for j in tree.order.numpy():
        if parent[j] >= 0:
            found[j] = found[parent[j]] + length[max(link[j], ~link[j])]
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", ["multigrid", "Jacobi CG"])
def test_counted_iterations_are_those_of_the_solver(name: str) -> None:
    at, counted = problem(), SOLVERS[name]
    found = trace(counted, counted.prepare(at), at, at.rest)
    assert 0 < found.residual[0] <= found.residual[1] <= found.residual[2]
    for tol, count in zip(TOLERANCES, found.residual, strict=True):
        # The solver aims at half of its tolerance, and looks after every batch of 8, or 1.
        solver = type(counted.solver)(tol=tol, dtype="float64")
        made = solver.solve(solver.prepare(at.graph, at.shape.pinned), at.v, at.rest).iterations
        assert count <= made <= count + (2 if name == "multigrid" else 24)


def test_an_exact_form_needs_no_iteration_from_a_tree_that_hangs() -> None:
    at = problem("noise", 0.0)
    counted = SOLVERS["multigrid"]
    seed = next(seed for seed in TREES if seed.name == "held: min depth")
    assert trace(counted, counted.prepare(at), at, seed.make(at)).residual == (0, 0, 0)


def test_a_flow_down_a_tree_has_the_right_hand_side_as_its_codifferential() -> None:
    at = problem()
    wanted = np.random.default_rng(1).normal(size=at.shape.x.shape)
    v = flow(spanning_tree(at.graph, roots=at.roots), wanted)
    found = node_codifferential(at.graph, wp.array(v, dtype=wp.vec3d, device=CPU)).numpy()
    free = ~at.shape.pinned
    assert found[free] == pytest.approx(wanted[free], abs=1e-9)


def test_pointer_jumping_is_the_walk() -> None:
    at = problem()
    tree = spanning_tree(at.graph, roots=at.roots)
    walked = integrate_nodes(tree, at.v, at.rest).numpy()
    assert Jumping(tree, CPU).integrate(at.v, at.rest).numpy() == pytest.approx(walked, abs=1e-12)


@pytest.mark.parametrize("editing", [poisson_editing, laplacian_editing])
def test_editing_without_a_rotation_leaves_the_mesh(editing: object) -> None:
    made = editing("sphere:2", 0.0, CPU)
    assert made.errors(made.rest)[0] < 1e-9


def test_cloning_a_picture_onto_its_own_values_gives_the_picture() -> None:
    made = image_editing(16, False, CPU)
    inside = ~made.shape.pinned
    laplacian = node_codifferential(made.graph, made.v).numpy()[inside]
    again = Problem(made.case, made.shape, made.v, made.solver, made.state)
    reached = again.reference.numpy()
    dx = wp.array(reached[made.graph.head.numpy()] - reached[made.graph.tail.numpy()], dtype=wp.vec3d, device=CPU)
    assert node_codifferential(made.graph, dx).numpy()[inside] == pytest.approx(laplacian, abs=1e-9)
    assert (reached[made.shape.pinned] == made.shape.x[made.shape.pinned]).all()


def test_a_journal_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journals, "RESULTS", tmp_path)
    first = journals.Journal("study")
    first.once("curve", "a", lambda: [{"x": 1.23456789, "y": [None, 2]}])
    again = journals.Journal("study")
    assert again.has("curve", "a")
    again.once("curve", "a", lambda: pytest.fail("done already"))
    assert again.rows("curve") == [{"x": 1.2346, "y": [None, 2]}]


def test_every_marked_table_of_the_page_is_known() -> None:
    found = page.MARKED.findall(page.PAGE.read_text())
    assert len(found) == page.PAGE.read_text().count("<!-- table") == page.PAGE.read_text().count("<!-- end -->")
    assert found
    for _, device, name, body, _ in found:
        assert device in ("cpu", "cuda")
        assert name in page.TABLES
        assert body.startswith("| ")


def test_a_table_is_made_new_in_place_and_only_where_its_rows_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journals, "RESULTS", tmp_path)
    journal = journals.Journal("tree-cpu")
    timing = {"mesh": "sphere:6", "nodes": 40962, "energy s": 0.002}
    journal.once("transfer", "sphere:6", lambda: [timing])
    old = "| old |\n"
    text = "".join(
        f"Before.\n<!-- table: {where} -->\n{old}<!-- end -->\nAfter.\n"
        for where in ("cpu, transfer", "cuda, transfer", "cpu, energies")
    )
    new = page.refreshed(text, "cpu", journal)
    assert "| energy | 2 |" in new
    assert new.count(old) == 2
    assert page.refreshed(new, "cpu", journal) == new
    assert new.count("Before.") == new.count("After.") == 3
    with pytest.raises(KeyError):
        page.refreshed("<!-- table: cpu, nothing -->\n<!-- end -->", "cpu", journal)


@pytest.mark.parametrize("path", sorted((page.PAGE.parent).glob("*.md")), ids=lambda path: path.name)
def test_no_template_is_left_in_the_docs(path: Path) -> None:
    assert "{{" not in path.read_text()


def test_the_best_of_several_has_the_least_energy() -> None:
    at = problem()
    seeds = {seed.name: seed for seed in SEEDS}
    energy = {name: node_energy(at.graph, seeds[name].make(at), at.v)[0] for name in (*OF_BEST, BEST)}
    assert energy[BEST] == min(energy[name] for name in OF_BEST)


def test_a_line_goes_through_most_points() -> None:
    points = [(count, 3.0 + 2.0 * count) for count in (0, 5, 5, 9)] + [(7, 100.0)]
    assert line(points) == pytest.approx((3.0, 2.0))
    assert line([(4, 7.0), (4, 8.0), (4, 30.0)]) == (8.0, 0.0)
