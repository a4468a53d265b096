"""The output folder while a batch works in it: locked, cleared of what an earlier run left, outputs put in place."""

import os
import secrets
import shutil
from pathlib import Path
from types import TracebackType

from oneform_warp.errors import FileError, InputError
from oneform_warp.filters.batch.journal import Journal
from oneform_warp.filters.batch.shards import Shard
from oneform_warp.filters.batch.work import Job, Made, digest_of
from oneform_warp.filters.names import OWN

__all__ = ["Workspace"]


class Workspace:
    """The output folder, its journal, and a folder in it for what is not finished.

    Only the process that has the journal gives files their names; workers write into `scratch` alone.
    """

    def __init__(self, out: Path, shard: Shard) -> None:
        self._room = out / f"{OWN}{shard.suffix}"
        try:
            make_folder(out)
            self.out = out.resolve()
            self.journal = Journal(self.out, f"journal{shard.suffix}.jsonl")
        except OSError as error:
            raise _unusable(out, error) from None
        try:
            shutil.rmtree(self._room, ignore_errors=True)
            self.scratch = self._room / secrets.token_hex(4)
            self.scratch.mkdir(parents=True)
        except OSError as error:
            self.journal.close()
            raise _unusable(out, error) from None
        # Who made a material or texture: another input's must not be replaced.
        self._owners = {name: output for output, done in self.journal.done.items() for name, _ in done.files[1:]}

    def __enter__(self) -> "Workspace":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        shutil.rmtree(self._room, ignore_errors=True)
        self.journal.close()

    def put(self, job: Job, made: Made) -> dict[str, str]:
        """Give an output and its companions their names; the companions and their hashes, relative to `out`.

        Raises InputError where a companion would replace a file that is not this output's own, and OSError.
        """
        folder, _, name = job.output.rpartition("/")
        target = self._folder(folder)
        companions = {each: digest for each, digest in made.files.items() if each != name}
        relative = {each: f"{folder}/{each}" if folder else each for each in companions}
        for each, digest in companions.items():
            self._check_companion(job.output, relative[each], target / each, digest)
        # The mesh last: it refers to the others.
        for each in (*companions, name):
            folder_of_it = self._folder(relative[each].rpartition("/")[0]) if each in relative else target
            os.replace(made.part / each, folder_of_it / Path(each).name)
            sync_folder(folder_of_it)
        self._owners |= dict.fromkeys(relative.values(), job.output)
        return {relative[each]: digest for each, digest in companions.items()}

    def clear(self, job: Job) -> None:
        """Remove what a job has left, whether it was done or killed."""
        for part in self.scratch.glob(f"{job.number}-*"):
            shutil.rmtree(part, ignore_errors=True)

    def _folder(self, relative: str) -> Path:
        """A folder below `out`, made where it is not there; InputError where a link leads out of it."""
        target = self.out / relative
        if target.resolve() != target:
            raise InputError("a link leads out of the output folder", fix=f"remove the link at {relative!r}")
        make_folder(target)
        return target

    def _check_companion(self, output: str, relative: str, path: Path, digest: str) -> None:
        if not os.path.lexists(path) or self._owners.get(relative) == output:
            return
        if path.is_symlink() or not path.is_file() or digest_of(path) != digest:
            what = f"its file {relative!r} would replace another one of this name"
            raise InputError(what, fix="keep the outputs apart by {folder} in the pattern")


def make_folder(path: Path) -> None:
    """Make a folder and those above it, each brought to the disk."""
    missing = []
    while not path.exists():
        missing.append(path)
        path = path.parent
    for each in reversed(missing):
        each.mkdir(exist_ok=True)
        sync_folder(each.parent)


def sync_folder(path: Path) -> None:
    """Bring the names in a folder to the disk."""
    folder = os.open(path, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _unusable(out: Path, error: OSError) -> FileError:
    return FileError(f"the folder cannot be written to: {error.strerror}", where=str(out), fix="choose another folder")
