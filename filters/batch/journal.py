"""The journal of a batch: a line of JSON for each file that is done, on the disk before the next one counts.

A line is written after its output has its name. So what the journal has is there, and what was interrupted between
the two is done once more, to the same bytes.
"""

import errno
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from oneform_warp.errors import InputError

__all__ = ["FAILED", "WRITTEN", "Done", "Entry", "Journal", "read_done", "read_entries"]

WRITTEN, FAILED = "written", "failed"


@dataclass(frozen=True)
class Entry:
    """What became of one input.

    `output` and the names of `companions` (materials, textures) are relative to the output folder; hashes are
    SHA-256; `energy`, `residual` and `iterations` are None without a deformation, `reason` None without a failure.
    """

    input: str
    output: str
    status: str
    recipe: str
    size: int | None = None
    hash: str | None = None
    output_hash: str | None = None
    companions: Mapping[str, str] = field(default_factory=dict)
    energy: float | None = None
    residual: float | None = None
    iterations: int | None = None
    converged: bool = True
    measures: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    reason: str | None = None


class Done(NamedTuple):
    """What a resume has to know of an output."""

    recipe: str
    size: int
    hash: str
    files: tuple[tuple[str, str], ...]
    """Names and hashes: the output, then its companions."""


class Journal:
    """The journal of one run, open for appending; no other run appends to it meanwhile.

    `done` has what this journal and those of other shards have as written, by output.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self.path = folder / name
        self._pending = b""
        self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        try:
            _lock(self._file, self.path)
            self._end = _whole_lines(self._file)
            self.done = read_done(folder)
        except BaseException:
            self.close()
            raise

    def write(self, entries: Iterable[Entry]) -> bool:
        """Append lines and bring them to the disk; False where that fails, then the next call tries again."""
        for entry in entries:
            self._pending += json.dumps(asdict(entry)).encode() + b"\n"
        try:
            written = 0
            while written < len(self._pending):
                written += os.write(self._file, self._pending[written:])
            os.fsync(self._file)
        except OSError:  # a full disk, or one that can only be read by now: no half line may stay
            with suppress(OSError):
                os.ftruncate(self._file, self._end)
            return False
        self._end += len(self._pending)
        self._pending = b""
        return True

    def close(self) -> None:
        """Let another run have it."""
        os.close(self._file)


def read_done(folder: Path) -> dict[str, Done]:
    """What the journals of a folder have as written, by output."""
    done: dict[str, Done] = {}
    for path in sorted(folder.glob("journal*.jsonl")):
        for table in _tables(path):
            if table["status"] == WRITTEN:
                files = ((table["output"], table["output_hash"]), *table["companions"].items())
                done[table["output"]] = Done(table["recipe"], table["size"], table["hash"], files)
            else:
                done.pop(table["output"], None)
    return done


def read_entries(folder: Path) -> Iterator[Entry]:
    """The last entry of each output in the journals of a folder."""
    last = {table["output"]: table for path in sorted(folder.glob("journal*.jsonl")) for table in _tables(path)}
    for table in last.values():
        yield Entry(**{**table, "warnings": tuple(table["warnings"]), "lost": tuple(table["lost"])})


KEYS = frozenset(Entry.__dataclass_fields__)


def _tables(path: Path) -> Iterator[dict[str, Any]]:
    """The lines of a journal; what is no entry, as half a line after a power failure, counts as not done."""
    with path.open(encoding="utf-8", errors="replace") as lines:
        for line in lines:
            try:
                table = json.loads(line)
            except ValueError:
                continue
            if isinstance(table, dict) and table.keys() == KEYS:
                yield table


def _whole_lines(file: int) -> int:
    """Cut off half a line at the end, which a kill may leave; the size in bytes."""
    end = os.fstat(file).st_size
    block = 1 << 16
    position = end
    while position > 0:
        start = max(0, position - block)
        newline = os.pread(file, position - start, start).rfind(b"\n")
        if newline >= 0:
            position = start + newline + 1
            break
        position = start
    if position != end:
        os.ftruncate(file, position)
    return position


def _lock(file: int, path: Path) -> None:
    """The kernel gives the lock back when the process ends, however it ends."""
    try:
        import fcntl
    except ImportError:  # not on Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):  # some network file systems have no locks
            return
        fix = "wait for it, choose another folder, or share the files out by --shard"
        raise InputError("another batch is writing to this folder", where=str(path.parent), fix=fix) from None
