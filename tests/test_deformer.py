"""The whole way: rigid motions, invariances, welds, components, dimensions, starts, and named errors."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from oneform_warp.starts import STARTS

BOX = 1e-5  # of the bounding box: what the default precision promises


def bar_handles(x: np.ndarray, angle: float = 90.0, axis: object = "z") -> list[ow.Handle]:
    z = x[:, 2]
    return [ow.Handle(z < 0.1, held=True, name="foot"), ow.Handle(z > 0.9, axis=axis, angle=angle, name="head")]


def test_the_hello_world() -> None:
    x, faces = ow.shapes.bar()
    z = x[:, 2]
    handles = [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, axis="z", angle=180)]
    y = ow.deform(x, faces, handles)
    assert y.shape == x.shape
    assert (y[z < 0.1] == x[z < 0.1]).all()
    top = z == 1.0
    half_turn = Rotation.from_rotvec([0, 0, np.pi]).apply(x[top])
    assert np.abs(y[top][:, :2] - half_turn[:, :2]).max() < 0.05


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_identity_returns_the_same_bits(dtype: type, device: str) -> None:
    x, faces = ow.shapes.bar()
    x = (x + [1000.0, 0.0, -3.0]).astype(dtype)
    y = ow.deform(x, faces, [ow.Handle(x[:, 2] < -2.9, held=True), ow.Handle(x[:, 2] > -2.1)], device=device)
    assert y.dtype == dtype
    assert y.tobytes() == x.tobytes()


@pytest.mark.parametrize("start", STARTS)
def test_a_rotation_everywhere_is_a_rigid_motion_about_the_centroid(start: str) -> None:
    x, faces = ow.shapes.starfish()
    omega = np.array([0.3, -2.0, 5.0])
    solution = ow.Deformer(x, faces).solve([ow.Handle([0], rotation=omega, stretch=1.5)], start=start)
    centre = x.mean(axis=0)
    expected = 1.5 * Rotation.from_rotvec(omega).apply(x - centre) + centre
    assert solution.converged
    assert np.abs(solution.x - expected).max() < BOX
    assert solution.energy < 1e-9


def centred(x: np.ndarray) -> np.ndarray:
    return x - x.mean(axis=0)


@settings(max_examples=25)
@given(
    scale=st.floats(-6.0, 6.0).map(lambda e: 10.0**e),
    offset=st.floats(0.0, 1e6),
    mirrored=st.booleans(),
    seed=st.integers(0, 10**6),
)
def test_similarities_commute_with_deforming(scale: float, offset: float, mirrored: bool, seed: int) -> None:
    x, faces = ow.shapes.bar(segments=8)
    rng = np.random.default_rng(seed)
    q = Rotation.random(rng=rng).as_matrix() @ np.diag([1.0, 1.0, -1.0 if mirrored else 1.0])
    omega, z = rng.normal(size=3) * 2.0, x[:, 2]

    def pose(vector: np.ndarray) -> list[ow.Handle]:
        return [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, rotation=vector, stretch=1.3)]

    shift = offset * scale * rng.normal(size=3)
    plain = ow.Deformer(x, faces).solve(pose(omega)).x
    moved = ow.Deformer(scale * x @ q.T + shift, faces).solve(pose(np.linalg.det(q) * q @ omega)).x
    error = np.abs(moved - (scale * plain @ q.T + shift)).max() / scale
    assert error < BOX * np.ptp(plain)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_numbering_face_order_and_orientation_do_not_matter(seed: int) -> None:
    x, faces = ow.shapes.bar(segments=8)
    rng = np.random.default_rng(seed)
    shuffled = rng.permutation(len(x))
    x2 = np.empty_like(x)
    x2[shuffled] = x
    faces2 = rng.permutation(shuffled[faces])
    faces2 = np.where(rng.random(len(faces2))[:, None] < 0.5, faces2, faces2[:, ::-1])
    y = ow.deform(x, faces, bar_handles(x, 150.0, (1.0, 2.0, 3.0)))
    y2 = ow.deform(x2, faces2, bar_handles(x2, 150.0, (1.0, 2.0, 3.0)))
    assert np.abs(y2[shuffled] - y).max() < BOX


def test_soups_and_seams_deform_as_one_piece() -> None:
    x, faces = ow.shapes.bar()
    loose, corners = x[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
    y = ow.deform(x, faces, bar_handles(x))
    y_loose = ow.deform(loose, corners, bar_handles(loose))
    assert np.abs(y_loose - y[faces].reshape(-1, 3)).max() < BOX
    near = loose + 1e-7 * np.random.default_rng(0).normal(size=loose.shape)
    y_near = ow.deform(near, corners, bar_handles(loose), weld=1e-5)
    assert np.abs(y_near - y_loose).max() < BOX


def test_the_weld_of_the_first_rest_pose_is_kept() -> None:
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = [[0, 1, 2], [3, 4, 5]]
    deformer = ow.Deformer(x, faces)
    assert deformer.graph.component_count == 1
    opened = x.copy()
    opened[3:] += 0.5
    deformer.rest_on(opened)
    assert deformer.graph.component_count == 1
    y = deformer.deform([ow.Handle([0], held=True)])
    assert (y == opened).all()


def test_another_rest_pose_measures_weights_anew_unless_the_graph_brought_its_own() -> None:
    x, faces = ow.shapes.bar(segments=8)
    wide = x * [3.0, 1.0, 1.0]
    measured, given_ = ow.Deformer(x, faces), ow.Deformer(x, ow.Graph.from_faces(x, faces, weights="uniform"))
    measured.rest_on(wide)
    given_.rest_on(wide)

    def by_edge(graph: ow.Graph) -> dict[tuple[int, ...], float]:
        return {tuple(sorted(e)): w for e, w in zip(graph.edges.tolist(), graph.mu.numpy().tolist(), strict=True)}

    assert by_edge(measured.graph) == pytest.approx(by_edge(ow.Graph.from_faces(wide, faces)))
    assert (given_.graph.mu.numpy() == 1.0).all()


class CountingCG(ow.CG):
    """CG that knows how often it was prepared."""

    prepared = 0

    def prepare(self, *args: object, **options: object) -> object:
        CountingCG.prepared += 1
        return super().prepare(*args, **options)  # type: ignore[arg-type]


def test_new_rotations_prepare_nothing() -> None:
    x, faces = ow.shapes.bar()
    deformer = ow.Deformer(x, faces, solver=CountingCG())
    first = deformer.deform(bar_handles(x, 30.0))
    prepared = CountingCG.prepared
    assert prepared > 0
    assert not (deformer.deform(bar_handles(x, 60.0)) == first).all()
    assert (deformer.deform(bar_handles(x, 30.0)) == first).all()
    assert CountingCG.prepared == prepared
    deformer.deform([ow.Handle(x[:, 2] < 0.3, held=True), ow.Handle(x[:, 2] > 0.7, axis="z", angle=9)])
    assert CountingCG.prepared > prepared


def two_bars() -> tuple[np.ndarray, np.ndarray]:
    x, faces = ow.shapes.bar(segments=8)
    return np.concatenate([x, x + [5.0, 0.0, 0.0], [[9.0, 9.0, 9.0]]]), np.concatenate([faces, faces + len(x)])


def test_a_component_without_a_handle_stays_and_is_named() -> None:
    x, faces = two_bars()
    half = len(x) // 2
    first = np.arange(len(x)) < half
    deformer = ow.Deformer(x, faces)
    solution = deformer.solve(
        [ow.Handle(first & (x[:, 2] < 0.1), held=True), ow.Handle(first & (x[:, 2] > 0.9), axis="z", angle=90)]
    )
    assert (solution.x[half:] == x[half:]).all()
    assert not (solution.x[:half] == x[:half]).all()
    assert any(
        f"2 of 3 components, they stay as they are: the one of vertex {half} ({half} vertices)" in w
        for w in solution.warnings
    )
    with pytest.warns(ow.OneFormWarning, match="no handle touches 2 of 3 components"):
        deformer.deform([ow.Handle(first)])


def test_what_nothing_holds_keeps_its_centroid() -> None:
    x, faces = two_bars()
    half = len(x) // 2
    z = x[:, 2]
    handles = [ow.Handle(z < 0.1), ow.Handle((z > 0.9) & (z < 2.0), axis=(1, 1, 1), angle=200), ow.Handle([len(x) - 1])]
    y = ow.deform(x, faces, handles)
    assert np.abs(y[:half].mean(axis=0) - x[:half].mean(axis=0)).max() < 1e-12
    assert np.abs(y[half:-1].mean(axis=0) - x[half:-1].mean(axis=0)).max() < 1e-12
    assert (y[-1] == x[-1]).all()


def test_the_centroid_counts_welded_vertices_as_often_as_they_are_listed() -> None:
    x, faces = ow.shapes.bar(segments=8)
    copies = np.concatenate([x, x[:1], x[:1]])
    y = ow.deform(copies, faces, [ow.Handle([0]), ow.Handle(copies[:, 2] > 0.9, axis="x", angle=90)])
    assert np.abs(y.mean(axis=0) - copies.mean(axis=0)).max() < 1e-12
    assert (y[-2:] == y[0]).all()


def test_fast_rotations_are_warned_about() -> None:
    x, faces = ow.shapes.bar(segments=4)
    solution = ow.Deformer(x, faces).solve(bar_handles(x, 360.0))
    assert any("more than 45 degrees along" in text for text in solution.warnings)
    x, faces = ow.shapes.bar(segments=60)
    assert ow.Deformer(x, faces).solve(bar_handles(x, 360.0)).warnings == ()


def test_a_shape_that_gives_way_is_warned_about() -> None:
    x, faces = ow.shapes.bar()
    z = x[:, 2]

    def notes(angle: float) -> tuple[str, ...]:
        return (
            ow.Deformer(x, faces)
            .solve([ow.Handle(z < 0.2, held=True), ow.Handle(z > 0.8, axis="z", angle=angle)])
            .warnings
        )

    assert notes(180.0) == ()
    assert any("whole turns may be lost; spread it over more length" in text for text in notes(720.0))


def test_every_start_gives_the_same_answer() -> None:
    x, faces = ow.shapes.bar()
    deformer = ow.Deformer(x, faces)
    reference = deformer.solve(bar_handles(x, 270.0))
    for start in [*STARTS, x + 0.1, reference.x]:
        solution = deformer.solve(bar_handles(x, 270.0), start=start)
        assert np.abs(solution.x - reference.x).max() < BOX
        assert (solution.x[x[:, 2] < 0.1] == x[x[:, 2] < 0.1]).all()
    assert deformer.solve(bar_handles(x, 270.0), start="previous").iterations == 0


def test_the_tree_estimate_is_an_output() -> None:
    x, faces = ow.shapes.bar()
    deformer = ow.Deformer(x, faces)
    solution = deformer.solve(bar_handles(x, 90.0), start="maximal")
    tree = ow.spanning_tree(deformer.graph, -ow.edge_energy(deformer.graph, x, solution.v))
    expected = centred(ow.integrate_tree(tree, solution.v))
    free = x[:, 2] >= 0.1
    error = (solution.estimate - expected)[free]
    assert np.abs(error - error.mean(axis=0)).max() < 1e-9
    assert ow.energy(deformer.graph, solution.estimate, solution.v) > solution.energy


def test_solution_has_everything() -> None:
    x, faces = ow.shapes.bar()
    deformer = ow.Deformer(1000.0 * x, faces)
    solution = deformer.solve(bar_handles(x))
    graph = deformer.graph
    assert solution.energy == pytest.approx(ow.energy(graph, solution.x, solution.v), rel=1e-9)
    dx = ow.differential(graph, 1000.0 * x)
    assert solution.v == pytest.approx(ow.transform(graph, dx, solution.omega, solution.sigma), rel=1e-9, abs=1e-9)
    free = x[:, 2] >= 0.1
    r = ow.codifferential(graph, solution.v - ow.differential(graph, solution.x))[free]
    assert solution.residual[0] == pytest.approx(np.linalg.norm(r, axis=0), rel=1e-3, abs=1e-9)
    assert set(solution.seconds) == {"fields", "1-form", "start", "prepare", "solve"}
    assert solution.history[0][0] == 0


def test_not_converged_warns_and_returns_the_best_so_far() -> None:
    x, faces = ow.shapes.bar()
    with pytest.warns() as caught:
        y = ow.deform(x, faces, bar_handles(x), solver=ow.CG(max_iterations=3))
    assert "the iterations ran out; raise max_iterations" in str(caught.pop(ow.NotConverged).message)
    assert "the fields are not smooth yet" in str(caught.pop(ow.OneFormWarning).message)
    assert np.isfinite(y).all()


class StopsInFields(ow.CG):
    """CG that has no iterations for a form that is zero, as the smoothing of fields has."""

    def solve(self, state: object, v: wp.array, start: wp.array, **options: object) -> ow.Solution:
        solver = ow.CG(max_iterations=2) if v.shape[0] == 0 else ow.CG()
        return solver.solve(state, v, start, **options)  # type: ignore[arg-type]


def test_positions_for_unfinished_fields_have_not_converged() -> None:
    x, faces = ow.shapes.bar()
    solution = ow.Deformer(x, faces, solver=StopsInFields()).solve(bar_handles(x))
    assert (solution.residual <= solution.goal).all()
    assert not solution.converged
    assert solution.status is ow.Status.MAX_ITERATIONS


def test_painted_fields_skip_the_handles() -> None:
    x, faces = ow.shapes.bar()
    deformer = ow.Deformer(x, faces)
    spread = deformer.solve(bar_handles(x, 400.0))
    painted = deformer.solve([ow.Handle(x[:, 2] < 0.1, held=True)], fields=ow.Fields(spread.omega, spread.sigma))
    assert (painted.x == spread.x).all()
    with pytest.raises(ow.InputError, match="fields are given, so handles can only hold"):
        deformer.solve(bar_handles(x), fields=ow.Fields(spread.omega, spread.sigma))


def test_the_plane_and_the_line() -> None:
    x, faces = ow.shapes.grid(20, 4)
    flat = x[:, :2]
    left, right = flat[:, 0] == flat[:, 0].min(), flat[:, 0] == flat[:, 0].max()
    y = ow.deform(flat, faces, [ow.Handle(left, held=True), ow.Handle(right, angle=90)])
    space = ow.deform(x, faces, [ow.Handle(left, held=True), ow.Handle(right, axis="z", angle=90)])
    assert y.shape == flat.shape
    assert np.abs(y - space[:, :2]).max() < 1e-12
    line = np.linspace(0.0, 1.0, 51)
    graph = ow.Graph.from_polyline(51)
    stretched = ow.deform(line, graph, [ow.Handle([0], held=True), ow.Handle([50], stretch=4.0)])
    sigma = 4.0 ** (np.arange(51) / 50)
    expected = np.concatenate([[0.0], np.cumsum(np.sqrt(sigma[1:] * sigma[:-1]) / 50)])
    assert stretched.shape == (51,)
    assert np.abs(stretched - expected).max() < BOX * expected.max()


def test_warp_arrays_in_and_out(device: str) -> None:
    x, faces = ow.shapes.bar()
    given_ = wp.array(x.astype(np.float32), dtype=wp.vec3, device=device)
    y = ow.deform(given_, faces, bar_handles(x))
    assert isinstance(y, wp.array)
    assert y.dtype is wp.vec3
    assert y.device == wp.get_device(device)
    assert np.abs(y.numpy() - ow.deform(x, faces, bar_handles(x))).max() < BOX


def test_screening_length_keeps_far_parts_still() -> None:
    x, faces = ow.shapes.bar()
    deformer = ow.Deformer(100.0 * x, faces)
    handles = [ow.Handle(x[:, 2] < 0.05, held=True), ow.Handle(x[:, 2] > 0.95, axis="z", angle=90)]
    solution = deformer.solve(handles, length=5.0)
    assert np.abs(solution.omega[x[:, 2] < 0.5]).max() < 0.01
    assert np.abs(deformer.solve(handles).omega[np.abs(x[:, 2] - 0.5) < 0.05]).max() > 0.5


BAD_INPUT = [
    (
        lambda x, f: ow.deform(np.where(np.arange(len(x))[:, None] == 5, np.nan, x), f, []),
        "x: row 5 is .*not finite; remove",
    ),
    (lambda x, f: ow.deform(x[:, :1].astype(str), f, []), "x: a .* array of shape .* has no rows of real numbers"),
    (lambda x, f: ow.deform(np.zeros((5, 4)), f, []), "x: rows of 4 numbers; D is 1, 2 or 3"),
    (
        lambda x, f: ow.deform(x, np.array([[0, 1, 9999]]), []),
        "face 0: vertex number 9999 does not exist, the mesh has",
    ),
    (lambda x, f: ow.deform(x, [[0, 1, 2], [0, -1, 2]], []), "face 1: vertex number -1 does not exist"),
    (lambda x, f: ow.deform(x, np.array([[0.0, 1.0, 2.0]]), []), "faces: faces hold float64 numbers"),
    (lambda x, f: ow.deform(x, "faces.obj", []), "faces: faces cannot be a str"),
    (lambda x, f: ow.deform(x, (np.arange(3), np.array([0, 2, 5])), []), "the offsets of the pair .* do not fit"),
    (lambda x, f: ow.deform(x, [[[0, 1, 2]]], []), "face 0: a polygon is a flat list"),
    (lambda x, f: ow.deform(x, f, [], weights="cotan"), "weights: there is no kind 'cotan'; did you mean 'cotangent'"),
    (
        lambda x, f: ow.deform(x, f, [], weights=np.ones(3)),
        "weights: values per edge need the edges first; make the graph by a kind",
    ),
    (lambda x, f: ow.deform(x, ow.Graph.from_edges(len(x), [[0, 1]], weights=[0.0]), []), "weight of edge 0 is 0.0"),
    (lambda x, f: ow.deform(x, ow.Graph.from_edges(len(x), [[0, 1]], weights=[np.inf]), []), "weight of edge 0 is inf"),
    (lambda x, f: ow.Graph.from_edges(3, [[0, 3]]), r"edges: edge 0 is \[0, 3\], the graph has 3 vertices"),
    (lambda x, f: ow.Graph.from_edges(3, [0, 1]), "edges: an array of shape"),
    (lambda x, f: ow.Graph.from_points(x, neighbours=len(x)), "neighbours: .* neighbours among"),
    (lambda x, f: ow.deform(x, f, [], weld=-1.0), "weld: the weld tolerance is -1.0; give a length >= 0"),
    (lambda x, f: ow.deform(x, f, [], start="maximum"), "start: there is no start 'maximum'; did you mean 'maximal'"),
    (lambda x, f: ow.deform(x, f, [], start=x[:-1]), "start: .* rows where .* are needed"),
    (lambda x, f: ow.deform(x, ow.Graph.from_polyline(5), []), "positions for a graph of 5 vertices; give one row"),
    (lambda x, f: ow.deform(x, f, [], fields=ow.Fields(np.zeros((3, 3)), None)), "omega: 3 rows where"),
    (lambda x, f: ow.deform(x, f, [], fields=ow.Fields(None, np.zeros(len(x)))), "sigma: sigma is 0.0 at vertex 0"),
    (
        lambda x, f: ow.deform(x, f, bar_handles(x) + [ow.Handle([len(x) - 1], name="tip")]),
        "handle 'head' and handle 'tip'",
    ),
]


@pytest.mark.parametrize(("make", "message"), BAD_INPUT)
def test_bad_input_is_named_before_any_solving(make: object, message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    x, faces = ow.shapes.bar(segments=8)
    launch = wp.launch
    # What looks for bad numbers may run, and what the graph is made of: a contradiction between welded vertices shows only then.
    building = {"intake", "weld", "sorting", "assembly", "incidence", "order", "weights"}

    def launched(kernel: wp.Kernel, *args: object, **kwargs: object) -> None:
        assert kernel.module.name.removeprefix("oneform_warp.") in building, f"{kernel.key} ran"
        launch(kernel, *args, **kwargs)

    monkeypatch.setattr(wp, "launch", launched)
    with pytest.raises(ow.InputError, match=message):
        make(x, faces)  # type: ignore[operator]


def test_importing_initialises_nothing_and_needs_no_pymeshlab() -> None:
    code = (
        "import sys, oneform_warp as ow; assert 'warp' not in sys.modules and 'numpy' not in sys.modules;"
        "ow.Deformer; import warp._src.context as c; assert c.runtime is None;"
        "x, f = ow.shapes.bar(); ow.deform(x, f, [ow.Handle([0])]); assert c.runtime is not None;"
        "assert not {'pymeshlab', 'trimesh', 'matplotlib', 'polyscope'} & set(sys.modules)"
    )
    result = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
