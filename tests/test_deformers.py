"""Several meshes at once: each comes out as it does alone."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

import oneform_warp as ow

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
