"""`oneform-warp demo`: the bar of the paper, twisted and bent."""

from pathlib import Path

import click

from oneform_warp.cli.options import FILE
from oneform_warp.cli.terminal import start_warp
from oneform_warp.errors import FileError

__all__ = ["command"]

NEXT = """next: open {folder} in a mesh viewer, or try a mesh of your own:
  oneform-warp info MESH
  oneform-warp deform {bar} -o {out} --hold "z < 0.1" --handle "z > 0.9" axis=z,angle=180"""


@click.command("demo")
@click.argument("folder", metavar="[DIR]", type=FILE, default="demo", required=False)
def command(folder: Path) -> None:
    """Twist and bend a bar; meshes and a picture go to DIR.  [demo]"""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(
            f"the folder cannot be made: {error.strerror}", where=str(folder), fix="choose another"
        ) from None
    start_warp()
    from oneform_warp.cli.bars import deform_bars

    deform_bars(folder, click.echo)
    click.echo(NEXT.format(folder=folder, bar=folder / "bar.obj", out=folder / "mine.obj"))
