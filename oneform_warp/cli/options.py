"""The options that commands share."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from oneform_warp.cli.settings import CHOICES, weld_length
from oneform_warp.errors import InputError

__all__ = ["FILE", "Weld", "handles_options", "settings_options"]

FILE = click.Path(path_type=Path)


class Weld(click.ParamType[Any]):
    """exact, off, or a length."""

    name = "exact|off|LENGTH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The value itself, once it is known to be one."""
        try:
            weld_length(value)
        except InputError as error:
            self.fail(f"{error.what}; {error.fix}", param, ctx)
        return value


def handles_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Where handles come from."""
    options = [
        click.option("--hold", multiple=True, metavar="SEL", help="Keep these vertices in place; repeatable."),
        click.option(
            "--handle", type=(str, str), multiple=True, metavar="SEL SPEC", help="Rotate or stretch; repeatable."
        ),
        click.option(
            "--preset", multiple=True, metavar="NAME,...", help="Handles of a common deformation; repeatable."
        ),
        click.option(
            "--constraint", type=(str, str), multiple=True, metavar="KIND SPEC", help="Something linear; repeatable."
        ),
        click.option("--recipe", type=FILE, metavar="TOML", help="Handles and options from a file."),
    ]
    return _with(options, function)


def settings_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """The options that a recipe may give as well, one for each field of Settings."""
    options = [
        click.option("--weights", type=click.Choice(CHOICES["weights"]), help="Edge weights.  [cotangent]"),
        click.option(
            "--weld",
            type=Weld(),
            metavar="exact|off|LENGTH",
            help="Join vertices at equal positions.  [exact]",
        ),
        click.option("--solver", type=click.Choice(CHOICES["solver"]), help="Solver.  [auto: by size]"),
        click.option("--tol", type=click.FloatRange(min=0.0), help="Relative residual to reach.  [1e-6]"),
        click.option("--max-iterations", type=click.IntRange(min=0), help="Over all restarts.  [the solver's own]"),
        click.option("--dtype", type=click.Choice(CHOICES["dtype"]), help="Of the inner iterations.  [float32]"),
        click.option("--start", type=click.Choice(CHOICES["start"]), help="Where the solver starts.  [auto]"),
        click.option("--sweeps", type=click.IntRange(min=0), help="Spread handles by so many Jacobi sweeps."),
        click.option("--length", type=click.FloatRange(min=0.0, min_open=True), help="Spread handles over a length."),
        click.option("--falloff", type=click.Choice(CHOICES["falloff"]), help="How handles spread.  [harmonic]"),
        click.option("--radius", type=click.FloatRange(min=0.0, min_open=True), help="Reach of --falloff geodesic."),
        click.option("--profile", type=click.Choice(CHOICES["profile"]), help="Its curve, as in Blender.  [smooth]"),
        click.option(
            "--struts", type=click.FloatRange(min=0.0, min_open=True), help="Keep the volume: 1 to begin with."
        ),
        click.option("--refine", type=click.IntRange(min=0), help="ARAP steps after the solve, 5 to 20.  [0]"),
        click.option(
            "--refine-tol", type=click.FloatRange(min=0.0), help="Least part of the energy that a step saves."
        ),
        click.option("--cells", type=click.Choice(CHOICES["cells"]), help="Of the ARAP energy.  [spokes_and_rims]"),
        click.option(
            "--smooth-rotations", type=click.FloatRange(min=0.0), help="Smooth-rotation ARAP, 0.01 to 0.1.  [0]"
        ),
        click.option("--device", help="Warp device, as cpu or cuda:0.  [Warp's own choice]"),
        click.option("--backend", type=click.Choice(CHOICES["backend"]), help="Reader of mesh files.  [auto]"),
    ]
    return _with(options, function)


def _with(options: list[Callable[..., Any]], function: Callable[..., Any]) -> Callable[..., Any]:
    for option in reversed(options):
        function = option(function)
    return function
