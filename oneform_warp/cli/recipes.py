"""`oneform-warp recipe`: check, show and make the recipes of `oneform-warp batch`."""

import json
from pathlib import Path

import click

from oneform_warp.cli.options import FILE
from oneform_warp.errors import FileError

__all__ = ["command"]

TEMPLATE = """\
# A recipe for `oneform-warp batch {name} INPUTS... -o OUT`.
# Each [[steps]] is a filter, MeshLab's or this package's, with its parameters below it.
# Lengths may be percentages of the bounding box's diagonal, as "5%".
title = "Turn the top"

[output]
# {{folder}} {{parent}} {{name}} {{ext}} are those of the input.
name = "{{folder}}/{{name}}_turned{{ext}}"

[[steps]]
filter = "set_oneform_handle"
condselect = "z < zmin + 0.1*(zmax-zmin)"
held = true

[[steps]]
filter = "set_oneform_handle"
condselect = "z > zmin + 0.9*(zmax-zmin)"
rotaxis = "Z axis"
angle = 90

[[steps]]
filter = "apply_coord_oneform_deformation"
"""


@click.group("recipe")
def command() -> None:
    """Check, show and make recipes for batches."""


@command.command("check")
@click.argument("recipes", metavar="RECIPE...", nargs=-1, required=True, type=FILE)
def check(recipes: tuple[Path, ...]) -> None:
    """Check recipes whole: keys, filters, parameters and names."""
    from oneform_warp.filters.recipe import read_recipe

    for path in recipes:
        count = len(read_recipe(path).steps)
        click.echo(f"{path}: {count} step{'s' if count > 1 else ''}, all good")


@command.command("show")
@click.argument("recipe", metavar="RECIPE", type=FILE)
def show(recipe: Path) -> None:
    """Show what a recipe does, step by step."""
    from oneform_warp.filters.recipe import read_recipe

    read = read_recipe(recipe)
    lines = [read.title or recipe.stem, *([read.description] if read.description else []), ""]
    for number, step in enumerate(read.steps, 1):
        lines.append(f"{number}. {step['filter']}")
        lines += [f"     {key} = {json.dumps(value)}" for key, value in step.items() if key != "filter"]
    kinds = ", ".join(read.input.extensions) or "all meshes"
    click.echo("\n".join([*lines, "", f"inputs   {kinds}", f"outputs  {read.output.name}", f"hash     {read.digest}"]))


@command.command("new")
@click.argument("recipe", metavar="RECIPE", type=FILE)
def new(recipe: Path) -> None:
    """Write a recipe to begin with."""
    _write_new(recipe, TEMPLATE.format(name=recipe.name))


@command.command("from-mlx")
@click.argument("script", metavar="MLX", type=FILE)
@click.argument("recipe", metavar="RECIPE", type=FILE)
def from_mlx(script: Path, recipe: Path) -> None:
    """Make a recipe of a MeshLab filter script.

    A script has lengths in the unit of the mesh that it was made on; make percentages of them for other meshes.
    """
    from oneform_warp.filters.chain import Chain
    from oneform_warp.filters.mlx import read_script
    from oneform_warp.filters.recipe import Recipe, recipe_text

    chain = Chain([applied.step for applied in read_script(script)])
    _write_new(recipe, recipe_text(Recipe.of(chain)))


@command.command("to-mlx")
@click.argument("recipe", metavar="RECIPE", type=FILE)
@click.argument("mesh", metavar="MESH", type=FILE)
@click.argument("script", metavar="MLX", type=FILE)
def to_mlx(recipe: Path, mesh: Path, script: Path) -> None:
    """Make a MeshLab filter script of a recipe, by running it on MESH.

    Percentages become lengths in the unit of MESH, since scripts have no others.
    """
    from oneform_warp.filters.meshset import MeshSet
    from oneform_warp.filters.recipe import read_recipe

    chain = read_recipe(recipe).chain()
    meshes = MeshSet()
    meshes.load_new_mesh(mesh)
    chain.run(meshes)
    meshes.save_filter_script(script)
    click.echo(f"wrote {script}")


@command.command("schema")
def schema() -> None:
    """Print the JSON schema of recipes, for editors."""
    from oneform_warp.filters.recipe_schema import recipe_schema

    click.echo(json.dumps(recipe_schema(), indent=1))


def _write_new(path: Path, text: str) -> None:
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise FileError("there is a file of this name", where=str(path), fix="choose another name") from None
    except OSError as error:
        raise FileError(f"cannot be written: {error.strerror}", where=str(path), fix="check the folder") from None
    click.echo(f"wrote {path}")
