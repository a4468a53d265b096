"""`oneform-warp deform`: a mesh file and handles -> a deformed mesh file."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from oneform_warp.cli.options import FILE, handles_options, settings_options
from oneform_warp.cli.outputs import check_writable, write_json
from oneform_warp.cli.recipe import Asked, read_recipe
from oneform_warp.cli.settings import Settings, settings_from
from oneform_warp.cli.specs import HandleSpec, specs_from
from oneform_warp.cli.terminal import ProgressLine, Stopwatch, start_warp

if TYPE_CHECKING:
    from oneform_warp.cli.plan import Plan
    from oneform_warp.deformation import Deformation

__all__ = ["NOT_CONVERGED", "command"]

NOT_CONVERGED = 3

EPILOG = """\b
SEL chooses vertices:
  "z < zmin + 0.1*zdim"   a condition in MeshLab's variables: x y z, vi (number),
                          nx ny nz, r g b a, q, xmin xmax xmid xdim ..., bbdiag
  box:xmin,ymin,zmin,xmax,ymax,zmax
  file:indices.txt        vertex numbers from 0, between spaces or commas
  group:NAME              a group or object of an OBJ file

\b
SPEC is key=value,... of
  axis=z, axis=0:0:1      with angle: the axis of the rotation
  angle=720               degrees; 720 are two turns
  rotation=0:0:3.14       a rotation vector in radians, free, or fit (to targets)
  stretch=1.5             a factor > 0, free, or three along x, y, z as 1:1:2
  frame=0:0:0.5           a rotation vector that turns these directions
  name=NAME               for messages
  held                    stay in place
  mirror=x, mirror=1:1:0  the same on the other side of a plane across this axis
  mirror_at=0.2           where that cuts the axis; default the middle of the box
  mirror_tolerance=0.01   how far a vertex may be from its partner's image
  move=0:0:0.3            go there: a translation
  pivot=centroid          go there: turn as a whole about a point, as 0:0:1
  to=FILE                 go there: where a mesh file has the same vertices
  weight=1, snap          be pulled there softly; end exactly there

\b
Example, a bar twisted by half a turn:
  oneform-warp deform bar.obj -o twisted.obj --hold "z < 0.1" --handle "z > 0.9" axis=z,angle=180

\b
A recipe holds the same as TOML; options replace its settings, handles add to its own:
  max_iterations = 5000
  [[handles]]
  select = "z > 0.9"
  axis = "z"
  angle = 180
"""


@dataclass(frozen=True)
class Outputs:
    """The files to write."""

    out: Path
    preview: Path | None
    report: Path | None


@click.command("deform", epilog=EPILOG)
@click.argument("source", metavar="IN", type=FILE)
@click.option("-o", "--out", type=FILE, metavar="OUT", help="Mesh to write; may be IN.")
@handles_options
@settings_options
@click.option("--t", type=click.FloatRange(0.0, 1.0), default=1.0, help="How much of the way from the rest pose.  [1]")
@click.option("--dry-run", is_flag=True, help="Check everything, say what each handle does, write nothing.")
@click.option("--preview", type=FILE, metavar="PNG", help="Also a picture, before and after.")
@click.option("--report", type=FILE, metavar="JSON", help="Also a report for programs.")
@click.option("-v", "--verbose", is_flag=True, help="Also each handle, and Warp's messages.")
@click.option("-q", "--quiet", is_flag=True, help="Only warnings and errors.")
@click.pass_context
def command(
    ctx: click.Context,
    /,
    source: Path,
    out: Path | None,
    hold: tuple[str, ...],
    handle: tuple[tuple[str, str], ...],
    preset: tuple[str, ...],
    constraint: tuple[tuple[str, str], ...],
    recipe: Path | None,
    t: float,
    dry_run: bool,
    preview: Path | None,
    report: Path | None,
    verbose: bool,
    quiet: bool,
    **given: Any,
) -> None:
    """Deform the mesh IN by handles and write it to OUT."""
    if out is None and not dry_run:
        raise click.UsageError("Missing option '-o' / '--out'.")
    book = read_recipe(recipe)
    settings = settings_from(book.settings, given)
    specs = [*book.handles, *specs_from(hold, handle)]
    if not (specs or preset or constraint or book.presets or book.constraints):
        raise click.UsageError("There is no handle. Give --hold, --handle, --preset, --constraint or --recipe.")
    check_writable(out, preview, report)
    watch = Stopwatch()
    plan = _plan(source, specs, settings, out, watch, asked=Asked(preset, constraint, book), t=t, verbose=verbose)
    if dry_run or verbose:
        click.echo("\n".join(plan.lines()))
    if dry_run or out is None:
        return
    with ProgressLine(wanted=not quiet) as progress:
        solution = plan.solve(progress)
    watch.add(solution.seconds)
    _write(plan, solution, Outputs(out, preview, report), watch, quiet=quiet)
    if not solution.converged:
        ctx.exit(NOT_CONVERGED)


def _plan(
    source: Path,
    specs: list[HandleSpec],
    settings: Settings,
    out: Path | None,
    watch: Stopwatch,
    *,
    asked: Asked,
    t: float,
    verbose: bool,
) -> "Plan":
    """Read the mesh, start Warp, and check everything else."""
    from oneform_warp.filters import read_mesh

    mesh = read_mesh(source, backend=settings.backend)  # type: ignore[arg-type]
    watch.stop("read")
    start_warp(verbose=verbose, device=settings.device)
    from oneform_warp.cli.plan import make_plan

    watch.stop("warp")
    plan = make_plan(mesh, specs, settings, out, asked=asked, t=t)
    watch.stop("graph")
    return plan


def _write(plan: "Plan", solution: "Deformation", outputs: Outputs, watch: Stopwatch, *, quiet: bool) -> None:
    """Write the mesh, the picture and the reports."""
    from oneform_warp.cli.report import report_json, report_lines

    notes = plan.mesh.write(outputs.out, solution.x, omega=solution.omega)
    watch.stop("write")
    if outputs.preview is not None:
        _draw(plan, solution, outputs.preview)
        watch.stop("preview")
    if outputs.report is not None:
        write_json(outputs.report, report_json(plan, solution, watch.seconds, outputs.out))
    for warning in (*solution.warnings, *notes):
        click.echo(f"warning: {warning}", err=True)
    if not solution.converged:
        click.echo(f"warning: {solution.status}", err=True)
    if not quiet:
        written = [path for path in (outputs.out, outputs.preview, outputs.report) if path is not None]
        click.echo("\n".join([*report_lines(plan, solution, watch.seconds), *(f"wrote {path}" for path in written)]))


def _draw(plan: "Plan", solution: "Deformation", path: Path) -> None:
    from oneform_warp.preview import save_preview

    mesh = plan.mesh
    held, moved = plan.vertices(held=True), plan.vertices(held=False)
    save_preview(path, mesh.positions, solution.x, mesh.faces, title=mesh.path.name, held=held, moved=moved)
