"""`oneform-warp info`: what there is in a mesh file."""

from pathlib import Path
from typing import Literal

import click

from oneform_warp.cli.options import FILE, Weld
from oneform_warp.cli.settings import CHOICES, weld_length
from oneform_warp.cli.terminal import start_warp

__all__ = ["command"]


@click.command("info")
@click.argument("source", metavar="IN", type=FILE)
@click.option("--weld", type=Weld(), metavar="exact|off|LENGTH", default="exact", help="As of deform.  [exact]")
@click.option("--backend", type=click.Choice(CHOICES["backend"]), default="auto", help="Reader.  [auto]")
def command(source: Path, weld: str, backend: Literal["auto", "pymeshlab", "trimesh"]) -> None:
    """Count what is in the mesh IN.

    Faces, components, boundaries, duplicates, groups and more. Edges and components
    are those of the welded mesh, which deform works on.
    """
    from oneform_warp.filters import read_mesh

    mesh = read_mesh(source, backend=backend)
    start_warp()
    from oneform_warp.cli.mesh_facts import facts

    for label, value in facts(mesh, weld_length(weld)):
        click.echo(f"{label:<20} {value}")
