"""What `oneform-warp batch` shows while it works: a bar, lines for a log, or nothing but failures."""

from types import TracebackType
from typing import TYPE_CHECKING, Protocol

import click

from oneform_warp.filters.batch.report import printable

if TYPE_CHECKING:
    from oneform_warp.filters.batch import BatchResult, Entry

__all__ = ["Bar", "Display", "Lines", "Quiet", "summary"]

SHOWN = 20  # failures that the summary repeats


class Display(Protocol):
    """A BatchProgress that is shown as long as it is entered."""

    def __enter__(self) -> "Display": ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
    def planned(self, total: int, kept: int) -> None: ...  # noqa: D102
    def finished(self, entry: "Entry") -> None: ...  # noqa: D102


class Quiet:
    """Nothing; the summary has the failures."""

    def __enter__(self) -> "Quiet":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def planned(self, total: int, kept: int) -> None:
        """How much there is to do."""

    def finished(self, entry: "Entry") -> None:
        """One file more."""


class Lines(Quiet):
    """A line for each file."""

    def planned(self, total: int, kept: int) -> None:
        """How much there is to do."""
        self.count, self.total = 0, total - kept
        click.echo(f"{total:,} files, {kept:,} of them done already")

    def finished(self, entry: "Entry") -> None:
        """One file more."""
        self.count += 1
        told = f"{sum(entry.seconds.values()):.2f} s" if entry.reason is None else printable(entry.reason)
        click.echo(f"{self.count}/{self.total} {entry.status} {printable(entry.output)}: {told}")


class Bar(Quiet):
    """A bar with rate, time left and failures so far; each failure is a line above it."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[failed]}"),
        )
        self.progress = Progress(*columns, console=Console(stderr=True))
        self.failures = 0

    def __enter__(self) -> "Bar":
        self.progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.progress.stop()

    def planned(self, total: int, kept: int) -> None:
        """How much there is to do."""
        self.task = self.progress.add_task("", total=total - kept, rate="", failed="")

    def finished(self, entry: "Entry") -> None:
        """One file more."""
        if entry.reason is not None:
            self.failures += 1
            line = f"failed {printable(entry.input)}: {printable(entry.reason)}"
            self.progress.console.print(line, markup=False, highlight=False, soft_wrap=True)
        task = self.progress.tasks[0]
        failed = f"{self.failures:,} failed" if self.failures else ""
        rate = f"{task.finished_speed or task.speed or 0.0:.1f} files/s"
        self.progress.update(self.task, advance=1, rate=rate, failed=failed)


def summary(result: "BatchResult") -> list[str]:
    """What a batch came to, failures last and with their reasons."""
    done = result.written + len(result.failures)
    rate = f", {done / result.seconds:.1f} files/s" if done and result.seconds > 0 else ""
    lines = [
        f"{result.written:,} written, {result.kept:,} unchanged, {len(result.failures):,} failed, "
        f"in {result.seconds:.1f} s{rate}"
    ]
    if result.not_converged:
        lines.append(f"{result.not_converged:,} of the written did not converge; the journal says which")
    if not result.journaled:
        lines.append("the journal could not be written to the end: run the batch again when there is room")
    for entry in result.failures[:SHOWN]:
        lines.append(f"failed {printable(entry.input)}: {printable(entry.reason or '')}")
    if len(result.failures) > SHOWN:
        lines.append(f"and {len(result.failures) - SHOWN:,} more, in the journal")
    return lines
