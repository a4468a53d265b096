"""The memory limit: workers are watched from outside, since a limit on addresses would stop CUDA from starting."""

import multiprocessing
import threading
from multiprocessing.process import BaseProcess
from types import TracebackType

import psutil
from pebble.pool.process import WORKERS_NAME

__all__ = ["MemoryWatch", "fair_share", "worker_processes"]

PERIOD = 0.1  # seconds; what a file can take beyond its limit is what it touches meanwhile


class MemoryWatch:
    """A thread that kills each worker of this process which takes more than `limit` bytes; `killed` has their ids."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.killed: set[int] = set()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> "MemoryWatch":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._over.wait(PERIOD):
            for worker in worker_processes():
                if worker.pid is not None and self._is_large(worker.pid):
                    self.killed.add(worker.pid)
                    worker.kill()

    def _is_large(self, pid: int) -> bool:
        try:
            return psutil.Process(pid).memory_info().rss > self.limit
        except psutil.Error:  # it has ended
            return False


def worker_processes() -> list[BaseProcess]:
    """The workers of this process; pebble has no public list of them."""
    return [child for child in multiprocessing.active_children() if child.name == WORKERS_NAME]


def fair_share(workers: int) -> int:
    """The memory limit of a worker where none is given: its part of nine tenths of the machine's."""
    return int(psutil.virtual_memory().total * 0.9 / workers)
