"""The group of commands, and what becomes of their errors."""

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NoReturn

import click

from oneform_warp import __version__
from oneform_warp.cli import animate, batch, deform, demo, doctor, info, recipes
from oneform_warp.errors import InputError

__all__ = ["INTERRUPTED", "main"]

INTERRUPTED = 130

EPILOG = """\b
Exit codes: 0 done, 1 input that cannot be used, 2 wrong usage,
3 not converged (the output is written), 130 interrupted.

\b
Shell completion, for bash (or zsh_source, fish_source):
  eval "$(_ONEFORM_WARP_COMPLETE=bash_source oneform-warp)"
"""


class Commands(click.Group):
    """Commands whose input errors are one line on stderr."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; see EPILOG for the exit codes."""
        try:
            return super().invoke(ctx)
        except InputError as error:
            _leave(ctx, f"error: {error}", 1)
        except KeyboardInterrupt:
            _leave(ctx, "interrupted", INTERRUPTED)


def _leave(ctx: click.Context, message: str, code: int) -> NoReturn:
    click.echo(message, err=True)
    ctx.exit(code)


def _show_version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        try:
            warp = version("warp-lang")
        except PackageNotFoundError:
            warp = "missing"
        click.echo(f"oneform-warp {__version__}, warp {warp}, Python {platform.python_version()}")
        ctx.exit()


@click.group(
    cls=Commands, epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110}
)
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_show_version, help="Versions.")
def main() -> None:
    """Deform meshes by integrating vector-valued 1-forms, on NVIDIA Warp."""


for command in (
    deform.command,
    animate.command,
    batch.command,
    recipes.command,
    info.command,
    doctor.command,
    demo.command,
):
    main.add_command(command)
