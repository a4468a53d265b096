"""What a batch has to do, checked before the first file: an output for each input, no two the same, none an input."""

import os
import unicodedata
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from oneform_warp.errors import FileError, InputError
from oneform_warp.filters.batch.journal import Done
from oneform_warp.filters.batch.work import digest_of
from oneform_warp.filters.names import Source, output_name

__all__ = ["Task", "plan_outputs", "unchanged"]


@dataclass(frozen=True, slots=True)
class Task:
    """An input and the name of its output; `refusal` says why there can be none."""

    source: Path
    output: str
    refusal: str | None = None


def plan_outputs(sources: Sequence[Source], pattern: str, out: Path) -> list[Task]:
    """A task for each source; InputError where two would write one output, or one would replace or join the inputs."""
    tasks = [_task(source, pattern) for source in sources]
    owners: dict[str, Path] = {}
    folds = _folds_case(out)
    for task in tasks:
        name = unicodedata.normalize("NFC", task.output).casefold() if folds else task.output
        other = owners.setdefault(name, task.source)
        if other != task.source:
            fix = "tell the outputs apart by {folder}, {parent}, {name} and {ext} in the pattern"
            raise InputError(f"{other} and {task.source} would both write it", where=task.output, fix=fix)
    _check_apart(sources, tasks, out)
    return tasks


def _check_apart(sources: Iterable[Source], tasks: Iterable[Task], out: Path) -> None:
    """InputError where an output would replace an input, or where the next run would take it for one."""
    inputs = {_identity(source.path) for source in sources}
    # A folder for outputs that lies below one that is searched is left out of the search.
    searched = {
        each for source in sources if (each := source.searched) and not (out != each and out.is_relative_to(each))
    }
    for task in tasks:
        target = out / task.output
        if _identity(target) in inputs:
            raise FileError("an output would replace an input", where=str(target), fix="choose another folder")
        if any(target.is_relative_to(each) for each in searched):
            what = "an output would lie among the inputs, and the next run would take it for one"
            raise FileError(what, where=str(target), fix="choose a folder of its own for the outputs")


def unchanged(tasks: Sequence[Task], done: dict[str, Done], digest: str, out: Path) -> set[str]:
    """The outputs that are there as the journal says, of inputs that are what they were, by the recipe of `digest`."""
    known = [task for task in tasks if task.output in done and done[task.output].recipe == digest]
    with ThreadPoolExecutor(min(32, os.cpu_count() or 1)) as threads:
        same = threads.map(lambda task: _is_unchanged(task.source, done[task.output], out), known)
        return {task.output for task, is_same in zip(known, same, strict=True) if is_same}


def _is_unchanged(source: Path, done: Done, out: Path) -> bool:
    try:
        if source.stat().st_size != done.size or digest_of(source) != done.hash:
            return False
        return all(digest_of(out / name) == digest for name, digest in done.files)
    except OSError:
        return False


def _task(source: Source, pattern: str) -> Task:
    try:
        return Task(source.path, output_name(pattern, source))
    except InputError as error:
        return Task(source.path, str(source.path), f"{error.what}; {error.fix}")


def _folds_case(folder: Path) -> bool:
    """Whether the file system takes names that differ by case alone for one."""
    while not folder.exists():
        folder = folder.parent
    swapped = Path(str(folder).swapcase())
    return swapped != folder and swapped.exists() and swapped.samefile(folder)


def _identity(path: Path) -> tuple[int, int] | str:
    """What two names of one file have in common."""
    try:
        found = path.stat()
    except OSError:
        return str(path)
    return (found.st_dev, found.st_ino)
