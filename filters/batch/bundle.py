"""Small files in bundles: one worker loads all of a bundle, deforms them together, and writes each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress

from oneform_warp.errors import InputError
from oneform_warp.filters.batch.pool import Pool
from oneform_warp.filters.batch.work import Bench, Failure, Job, Made, chain_of, work
from oneform_warp.filters.batch.worker import take_gpu
from oneform_warp.filters.deformation import DEFORMATION, settings_of
from oneform_warp.filters.meshset import MeshSet
from oneform_warp.filters.recipe import Recipe
from oneform_warp.filters.together import foresee

__all__ = ["TOGETHER", "run_together", "work_together"]

TOGETHER = 128
"""Files in a bundle: enough to fill a GPU, few enough that their sums run in the order that they have alone."""

SMALL = 400_000
"""Bytes of a file up to which it may be a mesh that is solved by conjugate gradients."""

Bundle = tuple[Job, ...]


def run_together(
    pool: Pool, jobs: Sequence[Job], size: int, workers: int
) -> Iterator[list[tuple[Job, Made | Failure]]]:
    """All jobs, small ones in bundles of up to `size`, as evenly among the workers as they come.

    A bundle that takes its worker down, or exceeds the limits of a file, is done again file by file: so every failure
    is one of its own file.
    """
    small = [job for job in jobs if _is_small(job)] if size > 1 else []
    count = max(1, min(size, -(-len(small) // workers)))
    bundles = [tuple(small[begin : begin + count]) for begin in range(0, len(small), count)]
    grouped = {job.number for job in small}
    alone = [job for job in jobs if job.number not in grouped]
    for results in pool.run(work_together, bundles):
        for bundle, made in results:
            if isinstance(made, Failure):
                alone += bundle
            else:
                yield list(zip(bundle, made, strict=True))
    yield from pool.run(work, alone)


def _is_small(job: Job) -> bool:
    try:
        return job.source.stat().st_size <= SMALL
    except OSError:  # whatever is wrong with it is said when it is read
        return False


def work_together(bundle: Bundle) -> list[Made | Failure]:
    """What `work` makes of each file, to the last byte; the first deformation of all of them is solved at once."""
    take_gpu()
    benches = [Bench(job) for job in bundle]
    for bench in benches:
        bench.load()
    number = _first_deformation(bundle[0].recipe)
    if number is not None:
        for bench in benches:
            bench.run(number)
        _foresee([bench.passage.meshes for bench in benches if bench.passage is not None], bundle[0].recipe, number)
    return [bench.finish() for bench in benches]


def _first_deformation(recipe: Recipe) -> int | None:
    """The number, from 0, of the step that solves."""
    filters = [step.filter for step in chain_of(recipe).steps]
    return filters.index(DEFORMATION.name) if DEFORMATION.name in filters else None


def _foresee(sets: Sequence[MeshSet], recipe: Recipe, number: int) -> None:
    """Lengths in the settings are relative to each mesh; where there are any, each is deformed alone."""
    given = chain_of(recipe).steps[number].parameters
    if any(isinstance(value, str) and value.endswith("%") for value in given.values()):
        return
    placed = []
    for meshes in sets:
        with suppress(InputError):  # which the step itself is going to say
            placed.append(meshes.placed_handles())
    foresee(placed, settings_of(DEFORMATION.values(given, 0.0)))
