"""A batch: a recipe over many files, each in a worker process, everything that is done journaled at once."""

import math
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from oneform_warp.errors import InputError
from oneform_warp.filters.batch.bundle import TOGETHER, run_together
from oneform_warp.filters.batch.inputs import find_sources
from oneform_warp.filters.batch.journal import read_done
from oneform_warp.filters.batch.memory import fair_share
from oneform_warp.filters.batch.plan import Task, plan_outputs, unchanged
from oneform_warp.filters.batch.pool import Limits, LocalPool, Pool
from oneform_warp.filters.batch.shards import Shard
from oneform_warp.filters.batch.tally import BatchProgress, BatchResult, Tally
from oneform_warp.filters.batch.warmup import warm_up
from oneform_warp.filters.batch.work import Failure, Job, work
from oneform_warp.filters.batch.workspace import Workspace
from oneform_warp.filters.chain import Chain
from oneform_warp.filters.names import checked_pattern
from oneform_warp.filters.recipe import Recipe, read_recipe

__all__ = ["run_batch"]

SECONDS = 600.0
COMPILING = 1800.0  # seconds: all kernels for a GPU that Warp has never seen


def run_batch(
    recipe: Recipe | Chain | str | os.PathLike[str],
    inputs: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    lists: Sequence[str | os.PathLike[str]] = (),
    name: str | None = None,
    jobs: int | None = None,
    timeout: float = SECONDS,
    memory: int | None = None,
    force: bool = False,
    dry_run: bool = False,
    shard: str | None = None,
    cluster: str | None = None,
    together: int | None = None,
    progress: BatchProgress | None = None,
) -> BatchResult:
    """Run a recipe over files, folders and globs; outputs and journal.jsonl go below `out`.

    Only what is missing or changed is done, all of it with force. lists: files with a path in each line. name: the
    pattern of outputs, in place of the recipe's. jobs: worker processes, default one for each core. timeout in
    seconds and memory in bytes limit each file; default 600, and an equal share of the machine. shard: "I/N", this
    machine's part. cluster: the address of a dask scheduler that does the work, with `out` on a disk that all share.
    together: how many small files a worker loads and solves at once; default 128 on a GPU of this machine, else 1.
    Files that cannot be done are failures of the result. Raises InputError before the first file for a recipe, option
    or input that cannot be used, for outputs that collide, and where `out` cannot be written to or is in use.
    A script that calls this does so below `if __name__ == "__main__":`, since workers import it.
    """
    begin = time.perf_counter()
    checked = _recipe(recipe)
    part = Shard.parsed(shard) if shard is not None else Shard()
    workers = _cores() if jobs is None else int(_positive("jobs", jobs))
    bundle = None if together is None else int(_positive("together", together))
    limits = Limits(_positive("timeout", timeout), int(_positive("memory", memory or fair_share(workers))))
    pattern = checked.output.name if name is None else checked_pattern(name, "name")
    folder = Path(os.path.abspath(os.path.expanduser(out)))
    sources = find_sources(inputs, lists, extensions=checked.input.extensions, out=folder)
    tasks = part.of(plan_outputs(sources, pattern, folder))
    if dry_run:
        kept = set() if force else unchanged(tasks, read_done(folder), checked.digest, folder)
        return BatchResult(folder, len(tasks), len(kept), planned=tuple(t for t in tasks if t.output not in kept))
    with Workspace(folder, part) as space:
        kept = set() if force else unchanged(tasks, space.journal.done, checked.digest, space.out)
        if progress is not None:
            progress.planned(len(tasks), len(kept))
        tally = Tally(space, checked.digest, progress)
        todo = [task for task in tasks if task.output not in kept]
        tally.refuse(todo)
        files = list(_jobs(todo, space.scratch, checked))
        if files:
            workers = min(workers, len(files))
            with _pool(checked, workers, limits, cluster) as (pool, gpus):
                usual = TOGETHER if gpus and checked.has_own_steps else 1
                for results in run_together(pool, files, bundle or usual, workers):
                    tally.take(results)
    return tally.result(folder, len(tasks), len(kept), time.perf_counter() - begin)


def _recipe(recipe: Recipe | Chain | str | os.PathLike[str]) -> Recipe:
    """The recipe, once its steps are known to be good."""
    if isinstance(recipe, Chain):
        return Recipe.of(recipe)
    if isinstance(recipe, Recipe):
        recipe.chain()
        return recipe
    return read_recipe(recipe)


def _jobs(tasks: Iterable[Task], scratch: Path, recipe: Recipe) -> Iterator[Job]:
    for number, task in enumerate(tasks):
        if task.refusal is None:
            yield Job(number, task.source, task.output, scratch, recipe)


@contextmanager
def _pool(recipe: Recipe, workers: int, limits: Limits, cluster: str | None) -> Iterator[tuple[Pool, int]]:
    """Where the files are done, kernels compiled, and how many GPUs there are as far as one knows."""
    if cluster is not None:
        from oneform_warp.filters.batch.cluster import ClusterPool

        with ClusterPool(cluster, limits) as distant:
            yield distant, 0
        return
    with LocalPool(workers, limits, modules=(work.__module__,)) as pool:
        yield pool, _warm(pool) if recipe.has_own_steps else 0


def _warm(pool: LocalPool) -> int:
    """Compile in one worker what all of them need, while the others import; -> how many GPUs it sees."""
    (((_, gpus),),) = pool.run(warm_up, [None], seconds=COMPILING)
    if isinstance(gpus, Failure):
        fix = "`oneform-warp doctor` says more; a script calls run_batch below if __name__ == '__main__'"
        raise InputError(f"a trial deformation failed: {gpus.reason}", where="warm-up", fix=fix)
    return gpus


def _cores() -> int:
    """The cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _positive(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{name} is {value}", where=name, fix="give a number > 0")
    return value
