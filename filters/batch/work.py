"""What happens to one file, in a process of its own."""

import hashlib
import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from oneform_warp.errors import FileError, InputError
from oneform_warp.filters.batch.worker import take_gpu
from oneform_warp.filters.chain import Chain, ChainReport
from oneform_warp.filters.passage import FilePassage
from oneform_warp.filters.recipe import Recipe

__all__ = ["Bench", "Failure", "Job", "Made", "chain_of", "digest_of", "reason_of", "work"]


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
    take_gpu()
    bench = Bench(job)
    bench.load()
    return bench.finish()


class Bench:
    """One file while it is worked on, in a folder of its own; what goes wrong is kept, and ends the work."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self.passage: FilePassage | None = None
        self._part = job.scratch
        self._failure: Failure | None = None

    def load(self) -> None:
        """Make the folder, and load the file."""
        with self._inside():
            # Never the same folder twice: a run that was killed may have a worker left that still writes.
            self._part = Path(tempfile.mkdtemp(prefix=f"{self.job.number}-", dir=self.job.scratch))
            # A filter that writes a file by a relative name writes it here, where it is swept away.
            (self._part / "aside").mkdir()
            os.chdir(self._part / "aside")
            begin = time.perf_counter()
            _check_name(self.job.source)
            # Under the name that it will have, which companions may be named by.
            self._written = self._part / self.job.output.rpartition("/")[2]
            self._found = os.stat(self.job.source)
            self._digest = digest_of(self.job.source)
            self._hashing = time.perf_counter() - begin
            self.passage = chain_of(self.job.recipe).begin(self.job.source, self._written)

    def run(self, end: int) -> None:
        """Apply the steps before number `end`, from 0."""
        with self._inside():
            if self.passage is not None:
                self.passage.run(end)

    def finish(self) -> Made | Failure:
        """Apply the other steps, and write."""
        made: Made | None = None
        with self._inside():
            if self.passage is not None:
                self.passage.run()
                made = self._made(self.passage.save("rotate"))
        self.passage = None
        return made or self._failure or Failure("nothing was done")

    def _made(self, report: ChainReport) -> Made:
        after, found = os.stat(self.job.source), self._found
        if (after.st_size, after.st_mtime_ns) != (found.st_size, found.st_mtime_ns):
            raise InputError("the file was changed while it was read", fix="run the batch again")
        if not self._written.is_file():
            raise InputError("nothing was written", fix="choose another format")
        begin, part = time.perf_counter(), self._part
        written = (path for path in sorted(part.rglob("*")) if path.is_file() and part / "aside" not in path.parents)
        files = {path.relative_to(part).as_posix(): _synced(path) for path in written}
        full = _no_room(part)
        if full is not None:  # some of MeshLab's formats are cut off then, without an error
            raise InputError(full)
        seconds = {"hash": self._hashing, **report.seconds, "sync": time.perf_counter() - begin}
        return Made(found.st_size, self._digest, part, files, report, seconds)

    @contextmanager
    def _inside(self) -> Iterator[None]:
        """In the file's own folder once there is one, and back; an exception becomes the failure."""
        return_to = Path.cwd()
        try:
            if self.passage is not None:
                os.chdir(self._part / "aside")
            yield
        except Exception as error:  # noqa: BLE001  # importers and filters raise anything
            reason = _no_room(self.job.scratch) or reason_of(error).replace(f"{self._part}{os.sep}", "")
            self._failure, self.passage = Failure(reason), None
        finally:
            os.chdir(return_to)  # a file that MeshLab cannot read leaves the process in that file's folder


def chain_of(recipe: Recipe) -> Chain:
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
