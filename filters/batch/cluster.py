"""A dask cluster as the place where files are done: each still in a child process, so that dask's workers stay well.

A scheduler and workers are started by the user, each worker with one thread and one GPU:

    dask scheduler
    CUDA_VISIBLE_DEVICES=0 dask worker ADDRESS --nthreads 1 --resources GPU=1

A file whose dask worker is lost is done by another one; a file that fails or takes its child process down is a
failure, as without a cluster.
"""

import multiprocessing
import threading
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from itertools import islice
from types import TracebackType
from typing import Any, TypeVar

from oneform_warp.errors import InputError
from oneform_warp.filters.batch.pool import Limits, LocalPool
from oneform_warp.filters.batch.work import Failure, reason_of

__all__ = ["ClusterPool"]

T = TypeVar("T")
R = TypeVar("R")

CONNECTING = 30  # seconds
LOST = "the scheduler was lost; run the batch again when there is one"
AHEAD = 2  # files for each thread of the cluster, so that none waits for the next one


class ClusterPool:
    """The workers of a dask scheduler, those with a GPU resource where there are any."""

    def __init__(self, address: str, limits: Limits) -> None:
        self.address, self.limits = address, limits

    def __enter__(self) -> "ClusterPool":
        try:
            self._dask: Any = import_module("distributed")
        except ImportError:
            fix = "pip install 'oneform-warp[cluster]'"
            raise InputError("dask.distributed is not installed", where="cluster", fix=fix) from None
        try:
            self._client = self._dask.Client(self.address, timeout=CONNECTING)
        except (OSError, ValueError) as error:
            fix = "start `dask scheduler`, and give the address that it prints"
            raise InputError(f"no scheduler answers: {error}", where=self.address, fix=fix) from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.close()

    def run(self, function: Callable[[T], R], items: Iterable[T]) -> Iterator[list[tuple[T, R | Failure]]]:
        """See `Pool.run`."""
        rest = iter(items)
        given: dict[Any, T] = {}
        ended = self._dask.as_completed()
        options = self._options()
        while self._client.status == "running":
            for item in islice(rest, max(0, self._room() - len(given))):
                future = self._client.submit(_in_child, function, item, self.limits, **options)
                given[future] = item
                ended.add(future)
            if not given:
                return
            yield [(given.pop(future), self._result(future)) for future in ended.next_batch(block=True)]
        yield [(item, Failure(LOST)) for item in (*given.values(), *rest)]

    def _result(self, future: Any) -> Any:
        try:
            return future.result()
        except self._dask.CancelledError:
            return Failure(LOST)
        except Exception as error:  # noqa: BLE001  # whatever dask says of a file whose workers are lost
            return Failure(reason_of(error))

    def _workers(self) -> dict[str, Any]:
        workers: dict[str, Any] = self._client.scheduler_info(n_workers=-1)["workers"]
        return workers

    def _room(self) -> int:
        return AHEAD * max(1, sum(worker["nthreads"] for worker in self._workers().values()))

    def _options(self) -> dict[str, Any]:
        gpus = any(worker.get("resources", {}).get("GPU") for worker in self._workers().values())
        return {"pure": False, "retries": 2} | ({"resources": {"GPU": 1}} if gpus else {})


_pools: dict[tuple[int, Limits], LocalPool] = {}


def _in_child(function: Callable[[T], R], item: T, limits: Limits) -> R | Failure:
    """On a dask worker: the result of one item, by a child process that this thread keeps for the next one."""
    # Dask marks its workers as daemons, which may have no children; ours end with their parent by themselves.
    multiprocessing.current_process().daemon = False
    key = (threading.get_ident(), limits)
    if key not in _pools:
        _pools[key] = LocalPool(1, limits).__enter__()
    (((_, result),),) = _pools[key].run(function, [item])
    return result
