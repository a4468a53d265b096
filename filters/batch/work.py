"""What happens to one file, in a process of its own."""

import hashlib
import os
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from oneform_warp.errors import FileError, InputError
from oneform_warp.filters.batch.worker import take_gpu
from oneform_warp.filters.chain import Chain, ChainReport
from oneform_warp.filters.recipe import Recipe

__all__ = ["Failure", "Job", "Made", "digest_of", "reason_of", "work"]


@dataclass(frozen=True)
class Job:
    """One file to do: its number in this run, the input, the name of the output, and where there is room to work."""

    number: int
    source: Path
    output: str
    scratch: Path
    recipe: Recipe = field(repr=False)


@dataclass(frozen=True)
class Made:
    """A file that is done: the size and SHA-256 of the input, and what lies in `part`, by name, with its SHA-256."""

    size: int
    hash: str
    part: Path
    files: Mapping[str, str]
    report: ChainReport
    seconds: Mapping[str, float]


@dataclass(frozen=True)
class Failure:
    """A file that cannot be done, and why."""

    reason: str


ROOM = 1 << 16  # bytes

_last: tuple[Recipe, Chain] | None = None


def work(job: Job) -> Made | Failure:
    """Read the input, run the chain, and bring the output and its companions to the disk, in a folder of their own."""
    before, part = Path.cwd(), job.scratch
    take_gpu()
    try:
        # Never the same folder twice: a run that was killed may have a worker left that still writes.
        part = Path(tempfile.mkdtemp(prefix=f"{job.number}-", dir=job.scratch))
        # A filter that writes a file by a relative name writes it here, where it is swept away.
        (part / "aside").mkdir()
        os.chdir(part / "aside")
        return _made(job, part)
    except Exception as error:  # noqa: BLE001  # importers and filters raise anything
        return Failure(_no_room(job.scratch) or reason_of(error).replace(f"{part}{os.sep}", ""))
    finally:
        os.chdir(before)  # a file that MeshLab cannot read leaves the process in that file's folder


def _made(job: Job, part: Path) -> Made:
    begin = time.perf_counter()
    _check_name(job.source)
    written = part / job.output.rpartition("/")[2]  # under the name that it will have, which companions may be named by
    found = os.stat(job.source)
    digest = digest_of(job.source)
    hashed = time.perf_counter()
    report = _chain(job.recipe).process(job.source, written)
    after = os.stat(job.source)
    if (after.st_size, after.st_mtime_ns) != (found.st_size, found.st_mtime_ns):
        raise InputError("the file was changed while it was read", fix="run the batch again")
    if not written.is_file():
        raise InputError("nothing was written", fix="choose another format")
    synced = time.perf_counter()
    written_too = (path for path in sorted(part.rglob("*")) if path.is_file() and part / "aside" not in path.parents)
    files = {path.relative_to(part).as_posix(): _synced(path) for path in written_too}
    full = _no_room(part)
    if full is not None:  # some of MeshLab's formats are cut off then, without an error
        raise InputError(full)
    seconds = {"hash": hashed - begin, **report.seconds, "sync": time.perf_counter() - synced}
    return Made(found.st_size, digest, part, files, report, seconds)


def _chain(recipe: Recipe) -> Chain:
    """The chain of a recipe, made once for all files that this process does."""
    global _last
    if _last is None or _last[0] != recipe:
        _last = recipe, recipe.chain()
    return _last[1]


def digest_of(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _check_name(path: Path) -> None:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        what = "its name is not UTF-8, and MeshLab reads no others"
        raise InputError(what, fix="rename the file") from None


def _no_room(folder: Path) -> str | None:
    """Why nothing more can be written to a folder's disk, None where something can."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(ROOM))
    except OSError as error:
        return error.strerror
    return None


def _synced(path: Path) -> str:
    """Bring a file to the disk -> its SHA-256."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
        return hashlib.file_digest(file, "sha256").hexdigest()


def reason_of(error: BaseException) -> str:
    """Why, in one line: an InputError's own words, without the file, else what the importer or the system said."""
    if isinstance(error, InputError):
        what = error.what if isinstance(error, FileError) or not error.where else f"{error.where}: {error.what}"
        return f"{what}; {error.fix}" if error.fix else what
    if isinstance(error, MemoryError):
        return "there was not enough memory"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    text = " ".join(str(error).split())
    plain = isinstance(error, RuntimeError | ValueError) or type(error).__name__ == "PyMeshLabException"
    return text if text and plain else f"{type(error).__name__}: {text}"
