"""The default start: the rest pose, and where a 1-form is nearly exact the integral from what is held."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from oneform_warp.cycles import node_energies, short_cycle_misses
from oneform_warp.forms import node_differential
from oneform_warp.graph import Graph
from oneform_warp.rings import Rings, integrate_rings
from oneform_warp.starts import STARTS, Problem, worthwhile
from oneform_warp.tree import spanning_tree

TWIST = np.radians(90.0)

GAIN = worthwhile(ow.Multigrid(), wp.get_device("cpu"))

ROUNDING = 1e-12
"""Of positions near 1 after a path of some hundred edges."""


def bar(rotation: float = TWIST, noise: float = 0.0) -> tuple[Graph, np.ndarray, np.ndarray, np.ndarray]:
    """A bar, its rest pose, held nodes and v per node: the differential of a twist about its axis, and noise."""
    x, faces = ow.shapes.bar(segments=40, sides=8)
    graph = ow.Graph.from_faces(x, faces)
    rest = x[graph.vertex_at]
    turned = twisted(rest, rotation)
    v = node_differential(graph, rows(turned)).numpy()
    length = np.linalg.norm(node_differential(graph, rows(rest)).numpy(), axis=1)
    v += noise * length[:, None] * np.random.default_rng(0).normal(size=v.shape)
    return graph, rest, rest[:, 2] < 0.1, v


def twisted(rest: np.ndarray, angle: float) -> np.ndarray:
    amount = np.clip((rest[:, 2] - 0.1) / 0.8, 0.0, 1.0)
    turned: np.ndarray = Rotation.from_rotvec(angle * amount[:, None] * [0.0, 0.0, 1.0]).apply(rest)
    return turned


def rows(values: np.ndarray) -> wp.array[wp.vec3d]:
    """On the device that graphs are made on."""
    return wp.array(values, dtype=wp.vec3d)


def auto(
    graph: Graph,
    rest: wp.array[wp.vec3d],
    pinned: np.ndarray | None,
    v: np.ndarray,
    placed: object = None,
    gain: float = GAIN,
) -> object:
    return STARTS["auto"](Problem(graph, rest, rows(v), None, pinned=pinned, placed=placed, gain=gain))


def smooth(graph: Graph, rest: np.ndarray) -> np.ndarray:
    """v of a rotation that grows along the bar: smooth, and not exact."""
    omega = TWIST * rest[graph.node_of][:, 2:] * [0.0, 0.0, 1.0]
    x = rest[graph.node_of]
    v: np.ndarray = ow.transform(graph, ow.differential(graph, x), omega, None)
    return v


def test_smooth_forms_start_at_rest_and_the_same_array_comes_back() -> None:
    graph, rest, held, _ = bar()
    begin = rows(rest)
    assert auto(graph, begin, held, smooth(graph, rest)) is begin


def test_for_smooth_forms_nothing_is_integrated(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(_problem: Problem) -> None:
        raise AssertionError("short cycles tell enough")

    monkeypatch.setattr("oneform_warp.starts._rings", never)
    x, faces = ow.shapes.bar(segments=100, sides=20)
    graph = ow.Graph.from_faces(x, faces)
    rest = x[graph.vertex_at]
    # Around a single cycle this form misses next to nothing, and around a thousand times its area much.
    assert short_cycle_misses(graph, rows(rest), rows(smooth(graph, rest))).q[0] < 1e-4
    auto(graph, rows(rest), rest[:, 2] < 0.1, smooth(graph, rest))


def test_what_does_not_move_starts_at_rest_bit_for_bit() -> None:
    graph, rest, held, _ = bar()
    begin = rows(rest)
    assert auto(graph, begin, held, node_differential(graph, begin).numpy()) is begin


def test_an_exact_form_starts_at_its_solution() -> None:
    graph, rest, held, v = bar()
    start = auto(graph, rows(rest), held, v)
    assert np.abs(start.numpy() - twisted(rest, TWIST)).max() < ROUNDING
    assert (start.numpy()[held] == rest[held]).all()


@pytest.mark.parametrize(("noise", "taken"), [(1e-4, True), (1e-2, True), (1e-1, False)])
def test_noise_decides_and_the_estimate_has_as_little_energy_as_asked_for(noise: float, taken: bool) -> None:
    graph, rest, held, v = bar(noise=noise)
    begin = rows(rest)
    start = auto(graph, begin, held, v)
    assert (start is not begin) == taken
    if taken:
        own, resting = node_energies(graph, start, begin, rows(v))
        assert own[0] < GAIN * resting[0]


def test_nobody_knows_what_is_pinned_nothing_is_estimated() -> None:
    graph, rest, _, v = bar()
    begin = rows(rest)
    assert auto(graph, begin, None, v) is begin


def test_a_polyline_is_a_tree_and_always_solved() -> None:
    graph = ow.Graph.from_polyline(200)
    rng = np.random.default_rng(3)
    rest, v = rng.normal(size=(200, 3)), rng.normal(size=(199, 3))
    held = np.arange(200) == 70
    start = auto(graph, rows(rest), held, v)
    assert node_energies(graph, start, start, rows(v))[0][0] < ROUNDING
    assert (start.numpy()[held] == rest[held]).all()


def test_handles_that_contradict_the_form_leave_the_rest_pose() -> None:
    graph, rest, held, _ = bar()
    moved = rest[:, 2] > 0.9
    placed = rows(rest + 0.5 * moved[:, None])
    v = node_differential(graph, rows(rest)).numpy()
    assert auto(graph, rows(rest), held | moved, v, placed) is placed


def test_components_choose_for_themselves_with_the_same_bits_as_alone() -> None:
    x, faces = ow.shapes.bar(segments=40, sides=8)
    n, held = len(x), x[:, 2] < 0.1
    alone = ow.Graph.from_faces(x, faces)
    both = ow.Graph.from_faces(
        np.concatenate([x, x + 5.0]), np.concatenate([faces, faces + n]), mesh_of=np.repeat([0, 1], n)
    )
    first = both.vertex_at < n
    assert (both.vertex_at[first] == alone.vertex_at).all()
    y = np.concatenate([twisted(x, TWIST), x + 5.0])
    omega = np.concatenate([0.0 * x, TWIST * x[:, 2:] * [0.0, 0.0, 1.0]])
    waving = ow.transform(both, ow.differential(both, y), omega, None)
    # The first bar's form is exact, the second one's is not.
    exact = ow.differential(both, y)
    v = np.where((both.edges[:, 0] < n)[:, None], exact, waving)
    begin = np.concatenate([x, x + 5.0])[both.vertex_at]
    start = auto(both, rows(begin), np.tile(held, 2)[both.vertex_at], v).numpy()
    assert (start[~first] == begin[~first]).all()
    own = auto(alone, rows(x[alone.vertex_at]), held[alone.vertex_at], ow.differential(alone, y[:n])).numpy()
    assert start[first].tobytes() == own.tobytes()
    assert np.abs(own - y[alone.vertex_at]).max() < ROUNDING


def test_what_is_worthwhile_goes_by_the_solver() -> None:
    cpu = wp.get_device("cpu")
    assert worthwhile(ow.SuperLU(), cpu) == 0.0 < worthwhile(ow.Multigrid(), cpu) < worthwhile(ow.CG(), cpu)
    graph, rest, held, v = bar()
    begin = rows(rest)
    assert auto(graph, begin, held, v, gain=worthwhile(ow.SuperLU(), cpu)) is begin


def test_a_bent_bar_starts_at_the_integral_for_cg_which_saves_a_quarter() -> None:
    x, faces = ow.shapes.bar(segments=40, sides=8)
    graph = ow.Graph.from_faces(x, faces)
    v = ow.transform(graph, ow.differential(graph, x), TWIST * x[:, 2:] * [1.0, 0.0, 0.0], None)
    begin, held = rows(x[graph.vertex_at]), x[graph.vertex_at][:, 2] < 0.05
    assert auto(graph, begin, held, v) is begin
    solver = ow.CG(tol=1e-6)
    start = auto(graph, begin, held, v, gain=worthwhile(solver, wp.get_device("cpu")))
    assert start is not begin
    state = solver.prepare(graph, held)
    counts = [solver.solve(state, rows(v), s).iterations for s in (start, begin)]
    assert counts[0] < 0.75 * counts[1]


def test_graphs_are_forgotten_with_their_trees_and_cycles() -> None:
    graph, rest, held, v = bar()
    auto(graph, rows(rest), held, v)
    STARTS["rings"](Problem(graph, rows(rest), rows(v), None, pinned=held))
    gone = weakref.ref(graph)
    del graph
    gc.collect()
    assert gone() is None


def test_rings_that_are_kept_integrate_another_form_as_new_ones_do() -> None:
    graph, rest, held, v = bar()
    tree = spanning_tree(graph, roots=graph.vertex_at[held])
    rings = Rings(tree)
    for form, begin in ((v, rest), (2.0 * v, rest + 1.0), (v, rest)):
        found = rings.integrate(rows(form), rows(begin)).numpy()
        assert found.tobytes() == integrate_rings(tree, rows(form), rows(begin)).numpy().tobytes()
        assert (found[held] == begin[held]).all()


def test_other_pins_get_other_trees() -> None:
    graph, rest, held, v = bar()
    for pins in (held, ~held, held, np.zeros_like(held)):
        x = STARTS["rings"](Problem(graph, rows(rest), rows(v), None, pinned=pins)).numpy()
        assert (x[pins] == rest[pins]).all()
        moved = x - twisted(rest, TWIST)
        if not (pins != held).any():
            assert np.abs(moved).max() < ROUNDING


def test_solving_from_the_estimate_takes_no_iteration_and_from_rest_many() -> None:
    graph, rest, held, v = bar()
    solver = ow.CG(tol=1e-6)
    state = solver.prepare(graph, held)
    start = auto(graph, rows(rest), held, v)
    assert solver.solve(state, rows(v), start).iterations == 0
    assert solver.solve(state, rows(v), rows(rest)).iterations > 50


@pytest.mark.parametrize("name", ["sphere", "torus of quads", "image", "points"])
def test_a_differential_misses_nothing_around_any_cycle(name: str) -> None:
    graph = {
        "sphere": lambda: ow.Graph.from_faces(*ow.shapes.sphere(3)),
        "torus of quads": lambda: ow.Graph.from_faces(*ow.shapes.torus(quads=True)),
        "image": lambda: ow.Graph.from_grid((20, 30)),
        "points": lambda: ow.Graph.from_points(np.random.default_rng(0).random((300, 3))),
    }[name]()
    rng = np.random.default_rng(1)
    x, y = (rows(rng.normal(size=(graph.node_count, 3))) for _ in range(2))
    exact = short_cycle_misses(graph, x, node_differential(graph, y))
    assert (exact.change > 0.0).all()
    assert (exact.q < 1e-28).all()
    noise = short_cycle_misses(graph, x, rows(rng.normal(size=(graph.edge_count, 3))))
    assert (noise.q > 0.1).all()


def test_q_of_noise_is_that_of_its_cycles() -> None:
    graph, rest, _, _ = bar()
    noise = np.random.default_rng(2).normal(size=(graph.edge_count, 3))
    v = node_differential(graph, rows(rest)).numpy() + noise
    found = short_cycle_misses(graph, rows(rest), rows(v))
    # Around a triangle of independent edges |c|^2 is the sum of |w|^2 in the mean; 1,400 cycles that share edges.
    assert found.q[0] == pytest.approx(1.0, abs=0.1)


def test_rho_tells_noise_from_what_is_smooth() -> None:
    graph, rest, _, noisy = bar(noise=1e-2)
    assert abs(short_cycle_misses(graph, rows(rest), rows(noisy)).rho[0]) < 0.1
    assert short_cycle_misses(graph, rows(rest), rows(smooth(graph, rest))).rho[0] > 0.8


def test_energies_of_components_are_those_of_the_whole() -> None:
    graph, rest, _, v = bar(noise=0.1)
    for found, x in zip(node_energies(graph, rows(rest), rows(2.0 * rest), rows(v)), (rest, 2.0 * rest), strict=True):
        assert found == pytest.approx(ow.energy(graph, x[graph.node_of], v), rel=1e-12)
