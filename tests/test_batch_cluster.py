"""A batch on a dask cluster of this machine: a worker that is killed in the middle costs nothing."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

pytest.importorskip("pebble")
pytest.importorskip("pymeshlab")
pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")

from oneform_warp.filters.batch import run_batch  # noqa: E402
from test_batch import SMOOTH, hidden, lines, outputs, write_obj  # noqa: E402


def start(*arguments: str, log: Path, **environment: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "dask", *arguments, "--no-dashboard"]
    with log.open("wb") as file:
        return subprocess.Popen(command, stdout=file, stderr=file, env=os.environ | environment)


def wait_for(log: Path, text: str) -> None:
    end = time.monotonic() + 60
    while text not in log.read_text() and time.monotonic() < end:
        time.sleep(0.05)
    assert text in log.read_text(), log.read_text()


def end(process: subprocess.Popen[bytes]) -> None:
    children = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
    for each in (*children, process):
        try:
            each.kill()
        except psutil.NoSuchProcess:
            continue
    process.wait()


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    """A scheduler and two workers without a nanny, each with a GPU to its name: address, and the workers."""
    monkeypatch.chdir(tmp_path)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    logs = [tmp_path / f"{name}.log" for name in ("scheduler", "first", "second")]
    processes = [start("scheduler", "--host", "127.0.0.1", "--port", str(port), log=logs[0])]
    try:
        wait_for(logs[0], "Scheduler at")
        options = (
            "--nthreads",
            "1",
            "--no-nanny",
            "--resources",
            "GPU=1",
            "--local-directory",
            str(tmp_path / "spill"),
        )
        processes += [start("worker", address, *options, log=log) for log in logs[1:]]
        for log in logs[1:]:
            wait_for(log, "Registered to")
        yield address, processes[1:]
    finally:
        for process in processes:
            end(process)


def test_a_worker_that_is_killed_in_the_middle_costs_nothing(cluster, tmp_path):
    address, workers = cluster
    Path("smooth.toml").write_text(SMOOTH)
    for number in range(60):
        write_obj(Path(f"many/{number:02}.obj"), twist=0.01 * number, segments=200)
    run_batch("smooth.toml", ["many"], "clean", jobs=2)

    def kill_one() -> None:
        while not list(Path("out").glob("*.obj")):
            time.sleep(0.01)
        workers[0].kill()

    killer = threading.Thread(target=kill_one)
    killer.start()
    result = run_batch("smooth.toml", ["many"], "out", cluster=address)
    killer.join()
    assert workers[0].poll() is not None
    assert (result.written, result.failures) == (60, ())
    assert outputs() == outputs("clean")
    assert len(lines()) == 60
    assert hidden() == []


def test_failures_have_their_reasons_on_a_cluster_too(cluster):
    address, _ = cluster
    Path("smooth.toml").write_text(SMOOTH)
    write_obj(Path("some/good.obj"))
    Path("some/broken.obj").write_text("f 1 2 3\n")
    result = run_batch("smooth.toml", ["some"], "out", cluster=address)
    assert (result.written, len(result.failures)) == (1, 1)
    assert result.failures[0].reason
