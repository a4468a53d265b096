"""What has become of the files of a batch so far: outputs put in place, lines journaled, failures counted."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from oneform_warp.errors import InputError
from oneform_warp.filters.batch.journal import FAILED, WRITTEN, Entry
from oneform_warp.filters.batch.plan import Task
from oneform_warp.filters.batch.work import Failure, Job, Made, reason_of
from oneform_warp.filters.batch.workspace import Workspace

__all__ = ["BatchProgress", "BatchResult", "Tally"]


class BatchProgress(Protocol):
    """Who wants to know how far a batch is."""

    def planned(self, total: int, kept: int) -> None:
        """There are so many files, of which so many are done already."""

    def finished(self, entry: Entry) -> None:
        """A file is done, or has failed."""


@dataclass(frozen=True)
class BatchResult:
    """What a batch came to; failures carry their reasons, all else is in the journal."""

    out: Path
    total: int
    kept: int
    """Outputs that were there already, made by this recipe from these inputs."""
    written: int = 0
    failures: tuple[Entry, ...] = ()
    not_converged: int = 0
    """How many of the written ones the solver gave up on: their positions are the best so far."""
    seconds: float = 0.0
    planned: tuple[Task, ...] = field(default=(), repr=False)
    """With dry_run: what would be done."""
    journaled: bool = True
    """False where the last lines could not be written: those files are done again by the next run."""

    @property
    def exit_code(self) -> int:
        """0 where every file has its output, else 1."""
        return 1 if self.failures or not self.journaled else 0


class Tally:
    """Takes results as they come; keeps failures, since they are what a user has to look at, and counts the rest."""

    def __init__(self, space: Workspace, recipe: str, progress: BatchProgress | None) -> None:
        self._space, self._recipe, self._progress = space, recipe, progress
        self.written = self.not_converged = 0
        self.failures: list[Entry] = []
        self.journaled = True

    def refuse(self, tasks: Iterable[Task]) -> None:
        """Journal the files that can have no output."""
        refused = [task for task in tasks if task.refusal is not None]
        self._record([self._failed(str(task.source), task.output, task.refusal or "") for task in refused])

    def take(self, results: Iterable[tuple[Job, Made | Failure]]) -> None:
        """Put outputs in place, then journal them."""
        entries = []
        for job, made in results:
            entries.append(self._entry(job, made))
            self._space.clear(job)
        self._record(entries)

    def result(self, out: Path, total: int, kept: int, seconds: float) -> BatchResult:
        """What it all came to."""
        failures = tuple(self.failures)
        return BatchResult(
            out, total, kept, self.written, failures, self.not_converged, seconds, journaled=self.journaled
        )

    def _entry(self, job: Job, made: Made | Failure) -> Entry:
        if isinstance(made, Failure):
            return self._failed(str(job.source), job.output, made.reason)
        try:
            companions = self._space.put(job, made)
        except (OSError, InputError) as error:
            return self._failed(str(job.source), job.output, reason_of(error))
        report = made.report
        return Entry(
            input=str(job.source),
            output=job.output,
            status=WRITTEN,
            recipe=self._recipe,
            size=made.size,
            hash=made.hash,
            output_hash=made.files[job.output.rpartition("/")[2]],
            companions=companions,
            energy=report.energy,
            residual=report.residual,
            iterations=report.iterations,
            converged=report.converged,
            measures=report.measures,
            warnings=report.warnings,
            lost=report.lost,
            seconds={stage: round(seconds, 6) for stage, seconds in made.seconds.items()},
        )

    def _failed(self, source: str, output: str, reason: str) -> Entry:
        return Entry(input=source, output=output, status=FAILED, recipe=self._recipe, reason=reason)

    def _record(self, entries: list[Entry]) -> None:
        if entries:
            self.journaled = self._space.journal.write(entries)
        for entry in entries:
            if entry.status == FAILED:
                self.failures.append(entry)
            else:
                self.written += 1
                self.not_converged += not entry.converged
            if self._progress is not None:
                self._progress.finished(entry)
