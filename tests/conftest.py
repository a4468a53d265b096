"""Fixtures shared by all tests: the devices to run on, and the real meshes where they are at hand."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import warp as wp
from hypothesis import HealthCheck, settings

wp.config.log_level = wp.LOG_WARNING

# Shared machines stall: no deadline on a single example. Derandomised, so that a red run can be repeated.
settings.register_profile(
    "project",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("project")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "device" in metafunc.fixturenames:
        wp.init()
        metafunc.parametrize("device", ["cpu", *(d.alias for d in wp.get_cuda_devices()[:1])])


@pytest.fixture(scope="session")
def meshes() -> Path:
    """The folder of real meshes; tests that need it are skipped, with this reason, where it is not there."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "meshes"
    folder = Path(os.environ.get("ONEFORM_MESHES", beside))
    if not folder.is_dir():
        pytest.skip("the real meshes are not here: set ONEFORM_MESHES to their folder")
    return folder
