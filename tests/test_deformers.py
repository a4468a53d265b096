"""Several meshes at once: each comes out as it does alone."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

import oneform_warp as ow
from oneform_warp.order import Boxes, along_a_curve

# Both solve to 1e-6 of |codiff v|; the position error is up to the condition number of the shapes below times that.
ALONE = 2e-4


def meshes() -> list[tuple[np.ndarray, object]]:
    bar, sphere, grid = ow.shapes.bar(), ow.shapes.sphere(3), ow.shapes.bar(segments=12, sides=2, quads=True)
    # One is a thousand times larger and far away; the last two share positions, and must not be welded.
    return [bar, (1e3 * sphere[0] + 1e4, sphere[1]), grid, bar]


def handles(x: np.ndarray, angle: float) -> list[ow.Handle]:
    z = (x[:, 2] - x[:, 2].min()) / np.ptp(x[:, 2])
    return [ow.Handle(z < 0.1, held=True), ow.Handle(np.flatnonzero(z > 0.9), axis="z", angle=angle)]


ANGLES = (90.0, 30.0, 720.0, -45.0)


@pytest.mark.parametrize("solver", [None, ow.Multigrid(), ow.CG()])
def test_each_comes_out_as_alone(solver: object, device: str) -> None:
    given = meshes()
    together = ow.Deformers(given, solver=solver, device=device)
    chosen = [handles(x, angle) for (x, _), angle in zip(given, ANGLES, strict=True)]
    found = together.solve(chosen)
    assert found.converged.all()
    for (x, faces), some, y in zip(given, chosen, found.x, strict=True):
        alone = ow.Deformer(x, faces, solver=ow.SuperLU(), device=device).solve(some).x
        assert np.abs(y - alone).max() < ALONE * np.ptp(x, axis=0).max()
        assert (y[some[0].vertices] == x[some[0].vertices]).all()


def loose() -> tuple[np.ndarray, np.ndarray]:
    """Two bars, a vertex without an edge, and two vertices at one place."""
    x, faces = ow.shapes.bar(segments=9, sides=3)
    both = np.concatenate([x, x[:1], 0.7 * x + [3.0, 0.0, 0.0], [[9.0, 9.0, 0.2]]])
    return both, np.concatenate([faces, [[len(x), *faces[0, 1:]]], faces + len(x) + 1])


def several(rng: np.random.Generator, count: int) -> list[tuple[tuple[np.ndarray, object], list[ow.Handle]]]:
    """Meshes of all kinds, anywhere and of any size, with up to three handles that turn, stretch, hold, or leave free."""
    made = []
    for _ in range(count):
        x, faces = [*meshes(), loose()][rng.integers(5)]
        x = (x + 0.004 * np.ptp(x) * rng.normal(size=x.shape)) * 10.0 ** rng.integers(-3, 4) + rng.normal(size=3)
        z = (x[:, 2] - x[:, 2].min()) / np.ptp(x[:, 2])
        bands = [
            ow.Handle(z < 0.1, held=True),
            ow.Handle(z > 0.9, axis=rng.normal(size=3), angle=rng.uniform(-400, 400)),
        ]
        stretch, rotation = [(1.0, None), (1.7, np.zeros(3)), (None, rng.normal(size=3))][rng.integers(3)]
        bands += [ow.Handle((z > 0.4) & (z < 0.6), rotation=rotation, stretch=stretch)] * rng.integers(2)
        made.append(((x, faces), bands[rng.integers(2) :]))
    return made


@pytest.mark.parametrize("solver", [ow.CG(), ow.CG(dtype="float64")])
@pytest.mark.parametrize("seed", range(4))
def test_each_has_the_bits_that_it_has_alone(solver: object, seed: int, device: str) -> None:
    chosen = several(np.random.default_rng(seed), 6)
    found = ow.Deformers([mesh for mesh, _ in chosen], solver=solver, device=device).solve([some for _, some in chosen])
    for number, ((x, faces), some) in enumerate(chosen):
        alone = ow.Deformer(x, faces, solver=solver, device=device).solve(some)
        assert (found.x[number] == alone.x).all()
        assert found.converged[number] == alone.converged
        assert found.energy[number] == pytest.approx(alone.energy, rel=1e-9)  # summed in another order
        assert found.residual[number] == pytest.approx(max(_worst(s) for s in alone.solutions), rel=1e-9)
        assert found.noted[number] == bool(alone.warnings or not alone.converged)


def _worst(solution: object) -> float:
    residual, goal = solution.residual, solution.goal  # type: ignore[attr-defined]
    return float(np.where(residual > 0.0, residual / np.where(goal > 0.0, goal, 1e-300), 0.0).max(initial=0.0))


def test_order_along_the_curve_is_that_of_each_mesh_alone() -> None:
    x = np.concatenate([np.random.default_rng(0).normal(size=(40, 3)), 1e4 + np.random.default_rng(1).random((30, 3))])
    mesh_of = np.repeat([0, 1], [40, 30]).astype(np.int32)
    every = wp.array(np.arange(70), dtype=wp.int32, device="cpu")
    order = along_a_curve(wp.array(x, dtype=wp.vec3d, device="cpu"), every, Boxes.of(x, mesh_of, "cpu")).numpy()
    for mesh in (0, 1):
        own = x[mesh_of == mesh]
        box = Boxes(own.min(axis=0)[None], own.max(axis=0)[None], wp.zeros(0, dtype=wp.int32, device="cpu"))
        numbers = wp.array(np.arange(len(own)), dtype=wp.int32, device="cpu")
        alone = along_a_curve(wp.array(own, dtype=wp.vec3d, device="cpu"), numbers, box).numpy()
        assert (order[mesh_of[order] == mesh] - 40 * mesh == alone).all()


def test_flat_meshes_stay_flat() -> None:
    x, faces = ow.shapes.sphere(2)
    flat = x[:, :2] + 0.1 * x[:, 2:]
    chosen = [ow.Handle(flat[:, 0] < -0.5, held=True), ow.Handle(flat[:, 0] > 0.5, angle=30.0)]
    y = ow.Deformers([(flat, faces), (100.0 * flat, faces)]).solve([chosen, []]).x
    alone = ow.deform(flat, faces, chosen)
    assert y[0].shape == flat.shape
    assert np.abs(y[0] - alone).max() < ALONE * np.ptp(flat)
    assert (y[1] == 100.0 * flat).all()


def test_poses_of_one_mesh(device: str) -> None:
    x, faces = ow.shapes.bar()
    poses = [handles(x, angle) for angle in (10.0, 20.0, 0.0)]
    y = ow.Deformers([(x, faces)] * 3, device=device).deform(poses)
    assert (y[2] == x).all()
    assert np.abs(y[0] - y[1]).max() > 0.01


def test_changed_rotations_prepare_nothing_and_repeat_bit_for_bit() -> None:
    given = meshes()
    together = ow.Deformers(given)
    some = [handles(x, 40.0) for x, _ in given]
    first = together.deform(some)
    together.deform([handles(x, 50.0) for x, _ in given])
    for a, b in zip(first, together.deform(some), strict=True):
        assert (a == b).all()


def test_without_handles_a_mesh_stays() -> None:
    given = meshes()[:2]
    with pytest.warns(ow.OneFormWarning, match="no handle touches 1 of 2 components"):
        y = ow.Deformers(given).deform([[], handles(given[1][0], 30.0)])
    assert (y[0] == given[0][0]).all()


def test_kinds_of_arrays_come_back() -> None:
    x, faces = ow.shapes.bar()
    y = ow.Deformers([(x.astype(np.float32), faces), (wp.array(x, dtype=wp.vec3d), faces)]).deform(
        [handles(x, 30.0)] * 2
    )
    assert y[0].dtype == np.float32
    assert isinstance(y[1], wp.array)


BAR = ow.shapes.bar()
WRONG = [
    ("there are no meshes", lambda: ow.Deformers([])),
    ("mesh 1, face 0: vertex number 99", lambda: ow.Deformers([BAR, (np.zeros((3, 3)), np.array([[0, 1, 99]]))])),
    ("mesh 1, x: row 0", lambda: ow.Deformers([BAR, (np.full((3, 3), np.nan), np.array([[0, 1, 2]]))])),
    ("handles for 1 meshes, there are 2", lambda: ow.Deformers([BAR, BAR]).solve([[]])),
    ("mesh 1, handle 'top': no vertex", lambda: ow.Deformers([BAR, BAR]).solve([[], [ow.Handle([], name="top")]])),
    ("mesh 0, handle 0: vertex number 9999", lambda: ow.Deformers([BAR]).solve([[ow.Handle([9999])]])),
    ("D = \\[2, 3\\]", lambda: ow.Deformers([BAR, (np.eye(3)[:, :2], np.array([[0, 1, 2]]))])),
    ("weld is 0.1", lambda: ow.Deformers([BAR], weld=0.1)),
    ("'a of mesh 1' and handle 'b of mesh 1' give different rotations", lambda: ow.Deformers([BAR, BAR]).solve(
        [[], [ow.Handle([0], name="a"), ow.Handle([0], axis="z", angle=1.0, name="b")]]
    )),
]  # fmt: skip


@pytest.mark.parametrize(("message", "call"), WRONG, ids=[message for message, _ in WRONG])
def test_errors_name_the_mesh(message: str, call: object) -> None:
    with pytest.raises(ow.InputError, match=message):
        call()  # type: ignore[operator]


def test_what_is_worth_a_look_is_noted_of_its_mesh_alone() -> None:
    long, thick, coarse = ow.shapes.bar(), ow.shapes.bar(segments=40, sides=8), ow.shapes.bar(segments=3, sides=1)
    given = [long, (thick[0] * [4.0, 4.0, 1.0], thick[1]), coarse, long]
    chosen = [handles(given[k][0], angle) for k, angle in enumerate((30.0, 1440.0, 300.0, 40.0))]
    words = [ow.Deformer(x, f, solver=ow.CG()).solve(h).warnings for (x, f), h in zip(given, chosen, strict=True)]
    assert any("the edges miss" in text for text in words[1])
    assert not any("45 degrees" in text for text in words[1])
    assert any("45 degrees" in text for text in words[2])
    assert ow.Deformers(given, solver=ow.CG()).solve(chosen).noted.tolist() == [False, True, True, False]
