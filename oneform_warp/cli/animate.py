"""`oneform-warp animate`: a mesh file and handles -> the way there: a scene that moves, numbered files, or a film."""

from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from oneform_warp.cli.keyframes import read_script
from oneform_warp.cli.options import FILE, handles_options, settings_options
from oneform_warp.cli.outputs import check_places, write_json
from oneform_warp.cli.recipe import Asked
from oneform_warp.cli.settings import settings_from
from oneform_warp.cli.specs import specs_from
from oneform_warp.cli.terminal import ProgressLine, Stopwatch, start_warp

if TYPE_CHECKING:
    from oneform_warp.cli.story import Story
    from oneform_warp.filters import MeshFile

__all__ = ["command"]

NOT_CONVERGED = 3
FRAMES, FPS = 48, 24.0

EPILOG = """\b
OUT is one of
  turn.glb               a scene that moves: each frame a morph target
  turn_{frame}.obj       numbered meshes, in the format that is read or another one

\b
SEL and SPEC are those of `oneform-warp deform`. At t = 0 the mesh is at rest, at t = 1 it is what
`deform` makes of the same handles, to the last bit. More keyframes stand in a recipe:
  [[handles]]
  select = "z < 0.1"
  held = true
  [[keyframes]]
  t = 0.5
  [[keyframes.handles]]
  select = "z > 0.9"
  name = "top"
  axis = "z"
  angle = 180
  [[keyframes]]
  t = 1
  [[keyframes.handles]]
  name = "top"
  axis = "x"
  angle = 90

\b
Example, a bar that twists by two turns in two seconds:
  oneform-warp animate bar.obj -o twist.glb --hold "z < 0.1" --handle "z > 0.9" axis=z,angle=720
"""


@click.command("animate", epilog=EPILOG)
@click.argument("source", metavar="IN", type=FILE)
@click.option("-o", "--out", type=FILE, metavar="OUT", help="A .glb, or numbered meshes as turn_{frame}.obj.")
@handles_options
@click.option("--frames", type=click.IntRange(min=2), help=f"How many, the first at rest.  [{FRAMES}]")
@click.option("--fps", type=click.FloatRange(min=0.0, min_open=True), help=f"Frames per second.  [{FPS:g}]")
@settings_options
@click.option("--dry-run", is_flag=True, help="Check everything, say what each handle does, write nothing.")
@click.option("--preview", type=FILE, metavar="GIF|MP4", help="Also a film.")
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
    frames: int | None,
    fps: float | None,
    dry_run: bool,
    preview: Path | None,
    report: Path | None,
    verbose: bool,
    quiet: bool,
    **given: Any,
) -> None:
    """Move the mesh IN by handles, from rest at t = 0 to t = 1, and write the frames to OUT."""
    if out is None and preview is None and not dry_run:
        raise click.UsageError("Missing option '-o' / '--out', or '--preview'.")
    script = read_script(recipe)
    settings = settings_from(script.recipe.settings, given)
    specs = [*script.recipe.handles, *specs_from(hold, handle)]
    asked = Asked(preset, constraint, script.recipe)
    if not (specs or script.keys or preset or constraint or script.recipe.presets or script.recipe.constraints):
        raise click.UsageError("There is no handle. Give --hold, --handle, --preset, --constraint or --recipe.")
    check_places(out, preview, report)
    from oneform_warp.filters import read_mesh

    watch = Stopwatch()
    mesh = read_mesh(source, backend=settings.backend)  # type: ignore[arg-type]
    _check(mesh, out, preview)
    watch.stop("read")
    start_warp(verbose=verbose, device=settings.device)
    from oneform_warp.cli.story import make_story

    watch.stop("warp")
    story = make_story(
        mesh, specs, script.keys, settings, frames or script.frames or FRAMES, fps or script.fps or FPS, asked
    )
    watch.stop("graph")
    if dry_run or verbose:
        click.echo("\n".join(story.lines()))
    if dry_run:
        return
    with ProgressLine(wanted=not quiet) as progress:
        notes = _write(story, out, preview, progress)
    watch.stop("frames")
    for note in notes:
        click.echo(f"warning: {note}", err=True)
    if report is not None:
        write_json(report, story.report(out, notes, watch.seconds))
    if not quiet:
        written = [f"wrote {path}" for path in (out, preview, report) if path is not None]
        click.echo("\n".join([*story.summary(watch.seconds), *written]))
    if not story.converged:
        ctx.exit(NOT_CONVERGED)


def _check(mesh: "MeshFile", out: Path | None, preview: Path | None) -> None:
    """What cannot be written is found before anything is solved."""
    from oneform_warp.filters.animation import check_animation
    from oneform_warp.movie import check_movie

    if out is not None:
        check_animation(mesh, out)
    if preview is not None:
        check_movie(preview)


def _write(story: "Story", out: Path | None, preview: Path | None, progress: ProgressLine) -> list[str]:
    """Solves frame by frame and writes each as it comes; -> warnings."""
    from oneform_warp.filters.animation import FIELD, write_animation, write_frames
    from oneform_warp.movie import save_movie

    film: list[Any] = []

    def frames() -> Iterator[tuple[Any, Any]]:
        for solution in story.solutions(progress):
            if preview is not None:
                film.append(solution.x)
            yield solution.x, solution.omega

    notes: tuple[str, ...] = ()
    if out is None:
        deque(frames(), maxlen=0)
    elif FIELD in out.name:
        notes = write_frames(story.mesh, out, frames())
    else:
        notes = write_animation(story.mesh, out, frames(), story.seconds)
    if preview is not None:
        progress.say("drawing")
        held, moved = story.vertices(held=True), story.vertices(held=False)
        save_movie(preview, film, story.mesh.faces, fps=story.fps, held=held, moved=moved)
    return [*story.warnings, *notes]
