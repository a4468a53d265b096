"""`oneform-warp batch`: a recipe over many files."""

import re
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from oneform_warp.cli.options import FILE
from oneform_warp.errors import InputError

if TYPE_CHECKING:
    from oneform_warp.cli.batch_progress import Display
    from oneform_warp.filters.batch import BatchResult

__all__ = ["command"]

NOTHING_RAN = 2
UNITS = {"": 1, "K": 1000, "M": 1000**2, "G": 1000**3, "T": 1000**4}

EPILOG = """\b
INPUTS are files, folders (searched through) and quoted globs:
  oneform-warp batch twist.toml scans/ -o out
  oneform-warp batch twist.toml "scans/**/*.ply" -o out --name "{folder}/{name}_twisted{ext}"

\b
OUT/journal.jsonl has a line for each file: what it became, or why it failed. Run the
same command again after a failure or an interruption: only what is missing or changed
is done.

\b
Exit codes: 0 all files done, 1 some failed, 2 nothing could run,
130 and 143 interrupted.
"""


class Bytes(click.ParamType[int]):
    """A size as 500MB or 4G."""

    name = "SIZE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """The number of bytes."""
        found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?)B?", str(value).upper())
        if not found or float(found[1]) == 0.0:
            self.fail(f"{value!r} is not a size; write 500MB or 4GB", param, ctx)
        return int(float(found[1]) * UNITS[found[2]])


@click.command("batch", epilog=EPILOG)
@click.argument("recipe", metavar="RECIPE", type=FILE)
@click.argument("inputs", metavar="INPUTS...", nargs=-1, type=FILE)
@click.option("-o", "--out", type=FILE, metavar="OUT", required=True, help="Folder for outputs and the journal.")
@click.option("--list", "lists", multiple=True, type=FILE, help="A file with a path in each line; repeatable.")
@click.option("--name", metavar="PATTERN", help="Names of outputs: {folder} {parent} {name} {ext}.")
@click.option("-j", "--jobs", type=click.IntRange(min=1), help="Worker processes.  [one for each core]")
@click.option(
    "--timeout", type=click.FloatRange(min=0, min_open=True), default=600.0, help="Seconds for a file.  [600]"
)
@click.option("--memory", type=Bytes(), metavar="SIZE", help="Memory for a file, as 4GB.  [a fair share]")
@click.option("--force", is_flag=True, help="Do all files, also those that are done.")
@click.option("--dry-run", is_flag=True, help="Check everything and say what would be written.")
@click.option("--shard", metavar="I/N", help="Do the I-th of N parts, I from 1.")
@click.option("--cluster", metavar="ADDRESS", help="Do the work on a dask cluster.")
@click.option("--together", type=click.IntRange(min=1), help="Small files solved at once.  [128 on a GPU, else 1]")
@click.option("--report", is_flag=True, help="Also OUT/report.html, with pictures.")
@click.option("--pictures", type=click.IntRange(min=0), default=24, help="Pictures in the report.  [24]")
@click.option("--plain", is_flag=True, help="A line for each file, for logs.")
@click.option("-q", "--quiet", is_flag=True, help="Only failures and errors.")
@click.pass_context
def command(
    ctx: click.Context,
    /,
    recipe: Path,
    inputs: tuple[Path, ...],
    out: Path,
    report: bool,
    pictures: int,
    plain: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Run RECIPE over INPUTS... and write the results below OUT."""
    if not inputs and not options["lists"]:
        raise click.UsageError("There are no inputs. Give files, folders, globs or --list.")
    from oneform_warp.filters.batch import run_batch

    signal.signal(signal.SIGTERM, _terminated)
    try:
        with _display(plain=plain, quiet=quiet) as display:
            result = run_batch(recipe, inputs, out, progress=display, **options)
        _say(result, quiet=quiet)
        if report and not options["dry_run"]:
            _report(result, recipe, pictures, options)
    except InputError as error:
        click.echo(f"error: {error}", err=True)
        ctx.exit(NOTHING_RAN)
    ctx.exit(result.exit_code)


def _display(*, plain: bool, quiet: bool) -> "Display":
    from oneform_warp.cli.batch_progress import Bar, Lines, Quiet

    if quiet:
        return Quiet()
    return Lines() if plain or not sys.stderr.isatty() else Bar()


def _say(result: "BatchResult", *, quiet: bool) -> None:
    from oneform_warp.cli.batch_progress import summary
    from oneform_warp.filters.batch.report import printable

    for task in result.planned:
        told = task.refusal if task.refusal is not None else result.out / task.output
        click.echo(f"{printable(str(task.source))} -> {printable(str(told))}")
    lines = summary(result)
    if result.planned or (quiet and not result.exit_code):
        return
    click.echo("\n".join(lines), err=bool(result.exit_code))


def _report(result: "BatchResult", recipe: Path, pictures: int, options: dict[str, Any]) -> None:
    from oneform_warp.cli.batch_report import make_report
    from oneform_warp.filters.batch.shards import Shard

    shard = Shard.parsed(options["shard"]) if options["shard"] else Shard()
    path = result.out / f"report{shard.suffix}.html"
    make_report(result.out, path, recipe.stem, pictures=pictures, jobs=options["jobs"] or 2)
    click.echo(f"wrote {path}")


def _terminated(_: int, __: Any) -> NoReturn:
    """Leave as after an interruption: workers are ended, what is done stays done."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise SystemExit(128 + signal.SIGTERM)
