"""Pictures of meshes as PNG files, without a window: by polyscope where it can, else by matplotlib."""

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from oneform_warp.errors import FileError, InputError
from oneform_warp.panels import Backend, Camera, Panel, by_polyscope, camera_of, marked, paint, panel_of

__all__ = ["save_preview", "save_scene"]

Item = tuple[str, ArrayLike, Any] | tuple[str, ArrayLike, Any, ArrayLike | None]


def save_preview(
    path: str | os.PathLike[str],
    before: ArrayLike,
    after: ArrayLike,
    faces: Any,
    *,
    title: str | None = None,
    held: ArrayLike | None = None,
    moved: ArrayLike | None = None,
    size: tuple[int, int] = (1600, 800),
    backend: Backend = "auto",
) -> str:
    """Draw the rest pose left and the deformed one right, by the same camera and scale; returns the backend.

    `before` and `after` (V, 2) or (V, 3); `faces` (F, n) or indices with offsets (F + 1,); `held` (blue) and
    `moved` (orange) are vertex indices or masks; `size` in pixels. Raises InputError for shapes that do not
    fit and FileError where the picture cannot be written.
    """
    panels = [panel_of("rest", before, faces, None), panel_of("deformed", after, faces, None)]
    if panels[0].x.shape != panels[1].x.shape:
        raise InputError(f"positions {panels[0].x.shape} and {panels[1].x.shape} differ", fix="give the same V")
    panels = [marked(panel, held, moved) for panel in panels]
    both = np.concatenate([panel.x for panel in panels])
    camera = camera_of(panels[0].x, both)
    return _save(Path(path), panels, [camera] * 2, 2, title, size, backend)


def save_scene(
    path: str | os.PathLike[str],
    items: Sequence[Item],
    *,
    title: str | None = None,
    columns: int | None = None,
    shared_camera: bool = False,
    size: tuple[int, int] | None = None,
    backend: Backend = "auto",
) -> str:
    """Draw several meshes in a grid: (caption, positions, faces) and perhaps a scalar (V,) to colour them.

    One camera for all where `shared_camera`, else one for each mesh. The scalars share one colour scale.
    Returns the backend; raises as `save_preview`.
    """
    if not items:
        raise InputError("there is nothing to draw", where="items", fix="give at least one mesh")
    scalars = [np.asarray(item[3], dtype=np.float64) for item in items if len(item) > 3 and item[3] is not None]
    finite = np.concatenate([scalar[np.isfinite(scalar)] for scalar in scalars]) if scalars else np.zeros(0)
    limits = (finite.min(), finite.max()) if len(finite) else (0.0, 1.0)
    panels = [panel_of(item[0], item[1], item[2], item[3] if len(item) > 3 else None, limits) for item in items]
    every = np.concatenate([panel.x for panel in panels])
    cameras = [camera_of(panel.x, every if shared_camera else panel.x) for panel in panels]
    if shared_camera:
        cameras = [cameras[0]] * len(panels)
    columns = columns or min(len(panels), 4)
    rows = -(-len(panels) // columns)
    return _save(Path(path), panels, cameras, columns, title, size or (480 * columns, 480 * rows), backend)


def _save(
    path: Path,
    panels: Sequence[Panel],
    cameras: Sequence[Camera],
    columns: int,
    title: str | None,
    size: tuple[int, int],
    backend: Backend,
) -> str:
    """Draw the panels in a grid and write the picture; returns the backend that drew them."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if path.suffix.lower() != ".png" or not path.absolute().parent.is_dir():
        raise FileError("a picture is a .png file in a folder that exists", where=str(path), fix="change the path")
    rows = -(-len(panels) // columns)
    cell = (size[0] // columns, max(size[1] // rows - 34, 32))
    pictures = None if backend == "matplotlib" else by_polyscope(panels, cameras, cell)
    if pictures is None and backend == "polyscope":
        raise InputError("polyscope cannot draw here", fix="install polyscope and EGL, or use matplotlib")
    figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for i, axes in enumerate(grid):
        axes.set_axis_off()
        if i < len(panels):
            axes.set_title(panels[i].caption, fontsize=12, color="0.25", pad=2)
            if pictures is not None:
                axes.imshow(pictures[i])
            else:
                paint(axes, panels[i], cameras[i])
    if title:
        figure.suptitle(title, fontsize=14, color="0.1")
    with tempfile.TemporaryDirectory(dir=path.absolute().parent, prefix=".") as folder:
        figure.savefig(Path(folder) / path.name)
        os.replace(Path(folder) / path.name, path)
    return "polyscope" if pictures is not None else "matplotlib"
