"""What a worker process does before its first file."""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import connection, parent_process
from pathlib import Path

__all__ = ["share_gpus", "single_threaded", "start_worker", "take_gpu"]

PR_SET_PDEATHSIG = 1
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


GPUS = "gpus"  # the file that has the number of GPUs, once somebody has counted them

_station: Path | None = None
_place: int | None = None


def start_worker(station: Path, modules: tuple[str, ...]) -> None:
    """Be quiet, end with the parent, and import what will be needed.

    station: a folder in which the workers of a pool find their places.
    """
    global _station
    _station = station
    _die_with_parent()
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):  # MeshLab's messages would run through the progress bar
        os.dup2(nowhere, stream)
    for module in modules:
        import_module(module)


def share_gpus(gpus: int) -> None:
    """Let all workers of this pool know how many GPUs there are; this one, which counted them, is on the first."""
    if _station is not None:
        take_gpu()
        (_station / GPUS).write_text(str(gpus))


def take_gpu() -> None:
    """Show this process one GPU of several, in turn by its place, before Warp starts; later calls change nothing."""
    global _place
    if _station is None or _place is not None:
        return
    _place = _take_place(_station)
    counted = _station / GPUS
    gpus = int(counted.read_text()) if counted.exists() else 0
    if gpus > 1:
        seen = [each for each in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if each]
        names = seen or [str(number) for number in range(gpus)]
        os.environ["CUDA_VISIBLE_DEVICES"] = names[_place % len(names)]


def _die_with_parent() -> None:
    """Nobody would take the results of a worker whose parent was killed."""
    parent = parent_process()
    if parent is None:
        return
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent.pid:  # it was killed before
            os._exit(1)
    threading.Thread(target=_watch, args=(parent.sentinel,), daemon=True).start()


def _watch(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


def _take_place(station: Path) -> int:
    """The lowest number that no living worker has; the kernel frees it when the worker ends, however it ends."""
    import fcntl

    number = 0
    while True:
        place = os.open(station / f"place-{number}", os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(place)
            number += 1
        else:
            return number  # and the file stays open


@contextmanager
def single_threaded() -> Iterator[None]:
    """Processes that are started meanwhile compute in one thread each, where the user has not said otherwise.

    As many workers as cores need no more; and sums in another order would be other bytes on another machine.
    """
    added = [name for name in THREADS if name not in os.environ]
    os.environ |= dict.fromkeys(added, "1")
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)
