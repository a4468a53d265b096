"""Worker processes on this machine, by pebble: a file that hangs, crashes or takes all memory costs only itself."""

import multiprocessing
import queue
import signal
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Protocol, TypeVar

from pebble import ProcessExpired, ProcessPool

from oneform_warp.filters.batch.memory import MemoryWatch, worker_processes
from oneform_warp.filters.batch.work import Failure
from oneform_warp.filters.batch.worker import single_threaded, start_worker

__all__ = ["Limits", "LocalPool", "Pool"]

T = TypeVar("T")
R = TypeVar("R")
Task = tuple[T, int]  # what is to be done, and how often it was begun

RECYCLE = 200  # files until a worker is replaced: MeshLab leaks up to 0.2 MB with each OBJ
GRACE = 90.0  # seconds beyond the limit until a silent pool counts as broken; pebble waits 60 s for its locks
TRIES = 3


@dataclass(frozen=True)
class Limits:
    """What one file may take: seconds, and bytes of memory of its worker."""

    seconds: float
    memory: int


class Pool(Protocol):
    """Where files are done: `function` of each item, in any order, as (item, result) in groups that end together."""

    def run(self, function: Callable[[T], R], items: Iterable[T]) -> Iterator[list[tuple[T, R | Failure]]]:
        """Results as they come; at no time are more items taken than the workers need."""
        ...


@dataclass
class _Round(Generic[T]):
    """A pebble pool, and what it has been given."""

    pool: ProcessPool
    ended: "queue.SimpleQueue[Future[Any]]"
    given: dict["Future[Any]", Task[T]]

    def give(self, function: Callable[[T], Any], task: Task[T], seconds: float) -> None:
        """Hand a task to the pool; one that is broken ends it at once."""
        try:
            future: Future[Any] = self.pool.schedule(function, (task[0],), timeout=seconds)
        except RuntimeError as error:
            future = Future()
            future.set_exception(BrokenProcessPool(str(error)))
        self.given[future] = task
        future.add_done_callback(self.ended.put)


class LocalPool:
    """Spawned worker processes: threads are unsafe in MeshLab, and a fork in CUDA.

    A pebble pool breaks for good where a worker dies between two files, and forgets a file whose worker dies while it
    takes it. Then a new one goes on with what was not finished.
    """

    def __init__(self, workers: int, limits: Limits, *, modules: tuple[str, ...] = ()) -> None:
        """modules: what workers import when they start, and not only for their first file."""
        self.workers, self.limits = workers, limits
        self._modules = modules
        self._stack = ExitStack()

    def __enter__(self) -> "LocalPool":
        folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="oneform-warp-"))
        self._station = Path(folder)
        self._stack.enter_context(single_threaded())
        self._memory = self._stack.enter_context(MemoryWatch(self.limits.memory))
        self._pool: ProcessPool | None = None
        self._stack.callback(self._stop)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def run(
        self, function: Callable[[T], R], items: Iterable[T], *, seconds: float | None = None
    ) -> Iterator[list[tuple[T, R | Failure]]]:
        """See `Pool.run`; seconds: another limit than that of files."""
        seconds = self.limits.seconds if seconds is None else seconds
        tasks: Iterator[Task[T]] = ((item, 0) for item in items)
        again: list[Task[T]] = []
        now = self._round()
        while True:
            room = 2 * self.workers - len(now.given)  # one more for each worker, so that it need not wait
            fresh, again = [*again[:room], *islice(tasks, max(0, room - len(again)))], again[room:]
            for item, begun in fresh:
                now.give(function, (item, begun + 1), seconds)
            if not now.given:
                return
            results, broken = self._results(now, seconds)
            if broken:
                lost = list(now.given.values())
                again += [task for task in lost if task[1] < TRIES]
                tired = [item for item, begun in lost if begun >= TRIES]
                results += [(item, Failure(f"its worker was lost {TRIES} times")) for item in tired]
                self._stop()
                now = self._round()
            if results:
                yield results

    def _round(self) -> _Round[Any]:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPool(self.workers, RECYCLE, start_worker, (self._station, self._modules), context)
        return _Round(self._pool, queue.SimpleQueue(), {})

    def _stop(self) -> None:
        """End the workers, whatever they do: pebble would wait for each in turn."""
        if self._pool is not None:
            for worker in worker_processes():
                worker.kill()
            self._pool.stop()  # type: ignore[no-untyped-call]
            self._pool.join()
            self._pool = None

    def _results(self, now: _Round[T], seconds: float) -> tuple[list[tuple[T, Any]], bool]:
        """What has ended, at least one thing, and whether the pool is broken."""
        try:
            ended = [now.ended.get(timeout=seconds + GRACE)]
        except queue.Empty:
            return [], True
        while not now.ended.empty():
            ended.append(now.ended.get())
        results = []
        for future in ended:
            error = future.exception()
            if not isinstance(error, BrokenProcessPool):
                item, _ = now.given.pop(future)
                results.append((item, future.result() if error is None else Failure(self._reason(error, seconds))))
        return results, len(results) < len(ended)

    def _reason(self, error: BaseException, seconds: float) -> str:
        if isinstance(error, TimeoutError):
            return f"it took longer than the limit of {seconds:g} seconds"
        if isinstance(error, ProcessExpired):
            if error.pid in self._memory.killed:
                return f"it needed more memory than the limit of {self.limits.memory / 1e9:.3g} GB"
            return f"its worker process ended: {_ending(error.exitcode)}"
        return f"{type(error).__name__}: {error}"


def _ending(code: int | None) -> str:
    """An exit code in words."""
    if code is None or code >= 0:
        return f"exit code {code}"
    known = {signal.SIGSEGV: "it crashed", signal.SIGABRT: "it gave up", signal.SIGKILL: "it was killed"}
    try:
        kind = signal.Signals(-code)
    except ValueError:
        return f"signal {-code}"
    return f"{known.get(kind, 'it was stopped')} ({kind.name})"
