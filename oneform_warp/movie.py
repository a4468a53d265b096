"""A mesh that moves, as a GIF or an MP4 file, drawn as the pictures of `preview` are."""

import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from oneform_warp.errors import FileError, InputError
from oneform_warp.panels import Backend, Camera, Panel, by_polyscope, camera_of, marked, paint, panel_of

__all__ = ["check_movie", "save_movie"]

Picture = NDArray[np.uint8]
"""(height, width, 3)"""

TOGETHER = 24
"""Frames that one process draws: enough that its start is cheap, few enough for its memory and its time limit."""

TICKS = 100
"""A GIF counts time in so many parts of a second."""


def check_movie(path: str | os.PathLike[str]) -> None:
    """FileError where no film can be written to a path: its extension, its folder, or what writes MP4 is missing."""
    target = Path(path).absolute()
    if target.suffix.lower() not in (".gif", ".mp4"):
        raise FileError("a film is a .gif or .mp4 file", where=str(target), fix="change the name")
    if not target.parent.is_dir():
        raise FileError("the folder does not exist", where=str(target), fix="make the folder first")
    if target.suffix.lower() == ".mp4":
        try:
            import imageio_ffmpeg  # noqa: F401
        except ImportError:
            fix = "pip install 'oneform-warp[video]', or take a .gif"
            raise FileError("imageio-ffmpeg, which writes MP4, is not installed", where=str(target), fix=fix) from None


def save_movie(
    path: str | os.PathLike[str],
    frames: Sequence[ArrayLike],
    faces: Any,
    *,
    fps: float = 24.0,
    held: ArrayLike | None = None,
    moved: ArrayLike | None = None,
    size: tuple[int, int] = (640, 640),
    backend: Backend = "auto",
) -> str:
    """Draw positions (V, 2) or (V, 3) of each frame by one camera, and write them as a film; returns the backend.

    faces, held, moved, backend: as for `save_preview`; size in pixels, made even. A GIF repeats for ever, and rounds
    times to hundredths of a second. Raises InputError for shapes that do not fit and FileError as `check_movie`.
    """
    check_movie(path)
    if not frames or not (np.isfinite(fps) and fps > 0.0):
        raise InputError(f"{len(frames)} frames at {fps} per second make no film", fix="give frames, and fps > 0")
    panels = [marked(panel_of(f"frame {i}", x, faces, None), held, moved) for i, x in enumerate(frames)]
    if len({panel.x.shape for panel in panels}) > 1:
        raise InputError("the frames differ in their number of vertices", where="frames", fix="give the same V")
    camera = camera_of(panels[0].x, np.concatenate([panel.x for panel in panels]))
    cell = (size[0] + size[0] % 2, size[1] + size[1] % 2)
    pictures = None if backend == "matplotlib" else _off_screen(panels, camera, cell)
    if pictures is None and backend == "polyscope":
        raise InputError("polyscope cannot draw here", fix="install polyscope and EGL, or use matplotlib")
    drawn = "matplotlib" if pictures is None else "polyscope"
    if pictures is None:
        pictures = [_painted(panel, camera, cell) for panel in panels]
    target = Path(path).absolute()
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".") as folder:
        part = Path(folder) / target.name
        (_write_gif if target.suffix.lower() == ".gif" else _write_mp4)(part, pictures, fps)
        os.replace(part, target)
    return drawn


def _off_screen(panels: Sequence[Panel], camera: Camera, cell: tuple[int, int]) -> list[Picture] | None:
    """All panels drawn by polyscope; None where it cannot."""
    pictures: list[Picture] = []
    for some in _batches(panels, TOGETHER):
        drawn = by_polyscope(some, [camera] * len(some), cell)
        if drawn is None:
            return None
        pictures += drawn
    return pictures


def _batches(panels: Iterable[Panel], count: int) -> Iterator[list[Panel]]:
    rest = iter(panels)
    while some := list(islice(rest, count)):
        yield some


def _painted(panel: Panel, camera: Camera, cell: tuple[int, int]) -> Picture:
    """One panel drawn by matplotlib."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(cell[0] / 100, cell[1] / 100), dpi=100, facecolor="white")
    canvas: Any = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    paint(axes, panel, camera)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]


def _write_gif(path: Path, pictures: Sequence[Picture], fps: float) -> None:
    from PIL import Image

    # One palette for all, or colours flicker.
    sample = np.concatenate([pictures[i] for i in sorted({0, len(pictures) // 2, len(pictures) - 1})])
    palette = Image.fromarray(sample).quantize(256, dither=Image.Dither.NONE)
    images = [Image.fromarray(each).quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures]
    ends = np.rint(np.arange(len(images) + 1) * TICKS / fps).astype(int)
    # Viewers play frames of less than two ticks slowly.
    durations = (np.maximum(np.diff(ends), 2) * 1000 // TICKS).tolist()
    images[0].save(path, save_all=True, append_images=images[1:], duration=durations, loop=0)


def _write_mp4(path: Path, pictures: Sequence[Picture], fps: float) -> None:
    import imageio_ffmpeg

    height, width, _ = pictures[0].shape
    writer = imageio_ffmpeg.write_frames(str(path), (width, height), fps=fps, quality=8, macro_block_size=2)
    writer.send(None)
    for picture in pictures:
        writer.send(np.ascontiguousarray(picture))
    writer.close()
