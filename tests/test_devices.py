"""CPU and CUDA agree, and runs on one GPU repeat bit for bit; skipped where there is no GPU."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

import oneform_warp as ow

BOX = 1e-5  # of the bounding box


@pytest.fixture
def cuda() -> str:
    wp.init()
    devices = wp.get_cuda_devices()
    if not devices:
        pytest.skip("there is no CUDA device here")
    return str(devices[0].alias)


def case(name: str) -> tuple[np.ndarray, np.ndarray, list[ow.Handle]]:
    x, faces = {
        "bar": lambda: ow.shapes.bar(segments=100, sides=20),
        "sphere": lambda: ow.shapes.sphere(5),
        "starfish": lambda: ow.shapes.starfish(),
    }[name]()
    t = (x[:, 0 if name == "starfish" else 2] - x.min()) / np.ptp(x)
    low, high = np.quantile(t, [0.05, 0.95])
    return x, faces, [ow.Handle(t <= low, held=True), ow.Handle(t >= high, axis=(1, 2, 3), angle=200, stretch=1.4)]


@pytest.mark.parametrize("name", ["bar", "sphere", "starfish"])
@pytest.mark.parametrize("weights", ["cotangent", "uniform", "inverse_length"])
@pytest.mark.parametrize("start", ["rest", "maximal"])
def test_cpu_and_cuda_agree(name: str, weights: str, start: str, cuda: str) -> None:
    x, faces, handles = case(name)
    here = ow.Deformer(x, faces, weights=weights, device="cpu").solve(handles, start=start)
    there = ow.Deformer(x, faces, weights=weights, device=cuda).solve(handles, start=start)
    assert here.converged
    assert there.converged
    assert np.abs(here.x - there.x).max() < BOX * np.ptp(x)
    assert here.energy == pytest.approx(there.energy, rel=1e-5)


@pytest.mark.parametrize("name", ["bar", "sphere"])
def test_ten_runs_on_one_gpu_are_the_same_bits(name: str, cuda: str) -> None:
    x, faces, handles = case(name)
    first = ow.Deformer(x, faces, device=cuda).solve(handles)
    for _ in range(9):
        again = ow.Deformer(x, faces, device=cuda).solve(handles)
        assert (again.x == first.x).all()
        assert (again.omega == first.omega).all()
        assert again.iterations == first.iterations


def test_a_warp_array_on_the_gpu_stays_there(cuda: str) -> None:
    x, faces, handles = case("bar")
    given = wp.array(x.astype(np.float32), dtype=wp.vec3, device=cuda)
    deformer = ow.Deformer(given, faces)
    assert deformer.graph.device == wp.get_device(cuda)
    y = deformer.deform(handles)
    assert y.device == wp.get_device(cuda)
    assert np.isfinite(y.numpy()).all()
