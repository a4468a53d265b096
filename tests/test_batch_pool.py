"""Worker processes: a file that hangs, crashes or takes all memory costs only itself, and nothing is lost."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("pebble")
psutil = pytest.importorskip("psutil")

from oneform_warp.filters.batch import pool as pools  # noqa: E402
from oneform_warp.filters.batch import worker  # noqa: E402
from oneform_warp.filters.batch.pool import Limits, LocalPool  # noqa: E402
from oneform_warp.filters.batch.work import Failure  # noqa: E402

GB = 1_000_000_000


def double(item):
    """What workers do here: a number is doubled, a word is a misfortune."""
    if item == "hang":
        while True:
            time.sleep(1)
    if item == "hang in native code":
        ctypes.PyDLL(None).sleep(60)  # with the interpreter's lock: no Python runs, not even a signal handler
    if item == "crash":
        ctypes.string_at(0)
    if item == "exit":
        os._exit(7)
    if item == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if item == "memory":
        block = bytearray(2 * GB)
        time.sleep(60)
        return len(block)
    if item == "raise":
        raise ValueError("no such thing")
    return 2 * item


def pid(_):
    return os.getpid()


def thread_count(_):
    return os.environ["OMP_NUM_THREADS"]


def die_when_idle(item):
    """Ends its worker shortly after the result is on its way, while it has no file: pebble's pool breaks by this."""
    if item == 0:
        subprocess.Popen([sys.executable, "-c", f"import os, time; time.sleep(0.3); os.kill({os.getpid()}, 9)"])
    return item


def count_two_gpus(_):
    worker.share_gpus(2)


def gpu_of_worker(_):
    worker.take_gpu()
    time.sleep(0.2)
    return os.getpid(), os.environ.get("CUDA_VISIBLE_DEVICES")


def results(function, items, *, workers=2, seconds=20.0, memory=GB):
    with LocalPool(workers, Limits(seconds, memory)) as pool:
        return {item: result for group in pool.run(function, items) for item, result in group}


@pytest.mark.parametrize(
    ("misfortune", "reason", "seconds"),
    [
        ("hang", "longer than the limit of 2 seconds", 2.0),
        ("hang in native code", "longer than the limit of 2 seconds", 2.0),
        ("crash", "it crashed (SIGSEGV)", 20.0),
        ("exit", "exit code 7", 20.0),
        ("killed", "it was killed (SIGKILL)", 20.0),
        ("memory", "more memory than the limit of 1 GB", 20.0),
        ("raise", "ValueError: no such thing", 20.0),
    ],
)
def test_a_misfortune_costs_only_its_own_file(misfortune, reason, seconds):
    items = [1, 2, misfortune, 3, 4, 5, 6]
    begin = time.perf_counter()
    found = results(double, items, seconds=seconds)
    assert time.perf_counter() - begin < 18
    assert set(found) == set(items)
    assert reason in found.pop(misfortune).reason
    assert found == {item: 2 * item for item in found}


def test_misfortunes_alone_end_too():
    found = results(double, ["crash", "killed", "exit"], workers=1)
    assert all(isinstance(each, Failure) for each in found.values())
    assert len(found) == 3


def test_a_worker_that_dies_between_two_files_loses_nothing():
    def slowly():
        yield 0
        yield 1
        time.sleep(1.5)
        yield from range(2, 8)

    assert results(die_when_idle, slowly(), workers=1) == {item: item for item in range(8)}


def test_a_file_that_is_forgotten_is_done_again(monkeypatch):
    monkeypatch.setattr(pools, "GRACE", 0.5)
    schedule = pools.ProcessPool.schedule
    forgotten = []

    def forgetful(self, function, args, **options):
        if args == (3,) and not forgotten:
            forgotten.append(args)
            return pools.Future()  # as where a worker dies after it took a file and before it said so
        return schedule(self, function, args, **options)

    monkeypatch.setattr(pools.ProcessPool, "schedule", forgetful)
    assert results(double, range(6), seconds=8.0) == {item: 2 * item for item in range(6)}
    assert forgotten


def test_a_file_whose_pool_always_breaks_is_given_up(monkeypatch):
    monkeypatch.setattr(pools.ProcessPool, "schedule", lambda *_, **__: pools.Future())
    monkeypatch.setattr(pools, "GRACE", 0.1)
    assert "lost 3 times" in results(double, [1], seconds=0.1)[1].reason


def test_workers_are_replaced_before_leaks_add_up(monkeypatch):
    monkeypatch.setattr(pools, "RECYCLE", 3)
    found = results(pid, range(9), workers=1)
    assert len(set(found.values())) == 3


def test_workers_compute_in_one_thread_and_the_parent_as_before(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    assert results(thread_count, [0], workers=1) == {0: "1"}
    assert "OMP_NUM_THREADS" not in os.environ
    monkeypatch.setenv("OMP_NUM_THREADS", "5")
    assert results(thread_count, [0], workers=1) == {0: "5"}


def test_gpus_are_dealt_out_and_a_new_worker_takes_the_place_of_the_last(monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "4,7")
    monkeypatch.setattr(pools, "RECYCLE", 6)
    with LocalPool(2, Limits(20.0, GB)) as pool:
        list(pool.run(count_two_gpus, [None]))
        seen = {result for group in pool.run(gpu_of_worker, range(24)) for _, result in group}
    # The worker that counted sees all of them and is on the first; the other one, and whoever follows, see one.
    assert {gpu for _, gpu in seen} == {"4,7", "7", "4"}
    assert len(seen) == len({pid for pid, _ in seen}) >= 4


def test_no_more_items_are_taken_than_workers_need():
    taken = []

    def counted():
        for item in range(50):
            taken.append(item)
            yield item

    with LocalPool(2, Limits(20.0, 2 * GB)) as pool:
        seen = 0
        for group in pool.run(double, counted()):
            seen += len(group)
            assert len(taken) <= seen + 4


def test_leaving_ends_the_workers_whatever_they_do():
    begin = time.perf_counter()
    with LocalPool(2, Limits(60.0, 2 * GB)) as pool:
        running = pool.run(double, [1, "hang in native code", "hang in native code", 2])
        next(running)
    assert time.perf_counter() - begin < 8
    assert not [child for child in multiprocessing.active_children() if child.name == "pebble_pool_worker"]


ORPHANS = """
import sys
sys.path.insert(0, {tests!r})
from test_batch_pool import double, pid
from oneform_warp.filters.batch.pool import Limits, LocalPool
if __name__ == "__main__":
    with LocalPool(2, Limits(60.0, 2_000_000_000)) as pool:
        print(*(result for group in pool.run(pid, range(2)) for _, result in group), flush=True)
        list(pool.run(double, ["hang in native code"] * 2))
"""


def test_no_worker_outlives_a_parent_that_is_killed(tmp_path):
    script = tmp_path / "orphans.py"
    script.write_text(ORPHANS.format(tests=str(Path(__file__).parent)))
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    parent.stdout.readline()
    children = psutil.Process(parent.pid).children(recursive=True)
    time.sleep(1.0)
    parent.kill()
    parent.wait()
    gone, alive = psutil.wait_procs(children, timeout=10)
    assert alive == []
    assert gone
