"""Pictures of meshes as PNG files, without a window.

Polyscope draws where it can, off-screen and in a process of its own, since a missing graphics driver may
abort it. Else the faces are projected, shaded and painted from back to front by matplotlib.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from oneform_warp.errors import FileError, InputError

__all__ = ["save_preview", "save_scene"]

Floats = NDArray[np.float64]
Backend = Literal["auto", "polyscope", "matplotlib"]
Item = tuple[str, ArrayLike, Any] | tuple[str, ArrayLike, Any, ArrayLike | None]

CLAY, HELD, MOVED = np.array([[0.80, 0.81, 0.83], [0.20, 0.43, 0.70], [0.90, 0.47, 0.13]])
FLAT = 0.03  # an extent below this part of the largest one counts as none
TALLER = 1.4  # many models lie longer in z than they stand in y
WIREFRAME = 6000  # up to so many faces, their edges are drawn


@dataclass(frozen=True)
class Panel:
    """One mesh: positions (V, 3), faces as indices and offsets, vertex colours (V, 3), marked vertices."""

    caption: str
    x: Floats
    indices: NDArray[np.int64]
    offsets: NDArray[np.int64]
    colors: Floats
    marks: NDArray[np.int64]


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
    panels = [_panel("rest", before, faces, None), _panel("deformed", after, faces, None)]
    if panels[0].x.shape != panels[1].x.shape:
        raise InputError(f"positions {panels[0].x.shape} and {panels[1].x.shape} differ", fix="give the same V")
    panels = [_marked(panel, held, moved) for panel in panels]
    both = np.concatenate([panel.x for panel in panels])
    camera = _camera(panels[0].x, both)
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
    panels = [_panel(item[0], item[1], item[2], item[3] if len(item) > 3 else None, limits) for item in items]
    every = np.concatenate([panel.x for panel in panels])
    cameras = [_camera(panel.x, every if shared_camera else panel.x) for panel in panels]
    if shared_camera:
        cameras = [cameras[0]] * len(panels)
    columns = columns or min(len(panels), 4)
    rows = -(-len(panels) // columns)
    return _save(Path(path), panels, cameras, columns, title, size or (480 * columns, 480 * rows), backend)


def _panel(caption: str, x: ArrayLike, faces: Any, scalar: Any, limits: tuple[float, float] = (0, 1)) -> Panel:
    """Check the arrays of one mesh, and colour it."""
    points = np.asarray(x, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or not len(points):
        raise InputError(f"a picture needs positions (V, 2) or (V, 3), not {points.shape}", where=caption)
    if not np.isfinite(points).all():
        raise InputError("positions are not finite", where=caption, fix="look at the solution before drawing it")
    if isinstance(faces, tuple):
        indices, offsets = (np.asarray(part, dtype=np.int64) for part in faces)
    else:
        table = np.asarray(faces, dtype=np.int64)
        table = table if table.size else table.reshape(0, 3)
        indices, offsets = table.ravel(), np.arange(0, table.size + 1, table.shape[1])
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    colors = np.tile(CLAY, (len(points), 1))
    if scalar is not None:
        from matplotlib import colormaps

        span = (np.asarray(scalar, dtype=np.float64) - limits[0]) / ((limits[1] - limits[0]) or 1.0)
        colors = colormaps["viridis"](np.nan_to_num(span))[:, :3]
    return Panel(caption, points, indices, offsets, colors, np.zeros(0, dtype=np.int64))


def _marked(panel: Panel, held: ArrayLike | None, moved: ArrayLike | None) -> Panel:
    """The panel with the held and the moved vertices in their colours."""
    colors, marks = panel.colors.copy(), []
    for chosen, color in ((held, HELD), (moved, MOVED)):
        if chosen is not None:
            rows = np.arange(len(panel.x))[np.asarray(chosen, dtype=None if np.size(chosen) else np.int64)]
            colors[rows] = color
            marks.append(rows[: 0 if len(rows) > 40 and len(panel.indices) else None])
    return replace(panel, colors=colors, marks=np.concatenate(marks) if marks else panel.marks)


def _camera(rest: Floats, every: Floats) -> tuple[Floats, Floats, float]:
    """A view that shows the large extents: its axes (right, up, towards the eye), centre, and half width.

    Up is y, or z where the rest pose is clearly taller in it. A plane that stays one is seen from its front,
    one that is bent obliquely from above.
    """
    extent, whole = np.ptp(rest, axis=0), np.ptp(every, axis=0)
    thin = int(np.argmin(extent))
    bent = extent[thin] < FLAT * extent.max() <= whole[thin]
    up = thin if bent else 2 if extent[2] > TALLER * extent[1] else 1
    flat = not bent and extent[thin] <= whole[thin] < FLAT * whole.max()
    sides = [axis for axis in range(3) if axis != up]
    front = thin if flat and thin != up else min(sides, key=lambda axis: extent[axis])
    toward, above = np.eye(3)[front], np.eye(3)[up]
    if (front, up) in ((1, 2), (2, 0), (0, 1)):
        toward = -toward  # then the remaining axis points right
    right = np.cross(above, toward)
    turn, lift = (0.0, 0.0) if flat else (np.radians(28), np.radians(38 if bent else 16))
    level = np.cos(turn) * toward + np.sin(turn) * right
    eye = np.cos(lift) * level + np.sin(lift) * above
    right = np.cross(above, eye) / np.linalg.norm(np.cross(above, eye))
    axes = np.stack([right, np.cross(eye, right), eye])
    seen = every @ axes.T
    centre = (seen.min(axis=0) + seen.max(axis=0)) / 2 @ axes
    return axes, centre, float(max(np.ptp(seen, axis=0)[:2].max() / 2, 1e-12))


def _save(
    path: Path,
    panels: Sequence[Panel],
    cameras: Sequence[tuple[Floats, Floats, float]],
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
    pictures = None if backend == "matplotlib" else _polyscope(panels, cameras, cell)
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
                _paint(axes, panels[i], cameras[i])
    if title:
        figure.suptitle(title, fontsize=14, color="0.1")
    with tempfile.TemporaryDirectory(dir=path.absolute().parent, prefix=".") as folder:
        figure.savefig(Path(folder) / path.name)
        os.replace(Path(folder) / path.name, path)
    return "polyscope" if pictures is not None else "matplotlib"


def _paint(axes: Any, panel: Panel, camera: tuple[Floats, Floats, float]) -> None:
    """Paint the faces from back to front, shaded by Lambert's law with a light beside the eye."""
    from matplotlib.collections import PolyCollection

    basis, centre, reach = camera
    seen = (panel.x - centre) @ basis.T
    axes.set(xlim=(-1.06 * reach, 1.06 * reach), ylim=(-1.06 * reach, 1.06 * reach), aspect="equal")
    sizes = np.diff(panel.offsets)
    if len(sizes):
        colors = np.add.reduceat(panel.colors[panel.indices], panel.offsets[:-1]) / sizes[:, None]
        depth = np.add.reduceat(seen[panel.indices, 2], panel.offsets[:-1]) / sizes
        following = np.arange(1, len(panel.indices) + 1)
        following[panel.offsets[1:] - 1] = panel.offsets[:-1]
        edges = np.cross(seen[panel.indices], seen[panel.indices[following]])
        normals = np.add.reduceat(edges, panel.offsets[:-1])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        light = np.abs(normals @ (np.array([-0.35, 0.45, 1.0]) / np.linalg.norm([0.35, 0.45, 1.0])))
        colors = np.clip(colors * (0.42 + 0.62 * light[:, None]), 0, 1)
        order = np.argsort(depth)
        polygons = _polygons(seen[:, :2], panel, order)
        wires = len(sizes) <= WIREFRAME
        rims = colors[order] * (0.72 if wires else 1.0)
        axes.add_collection(PolyCollection(polygons, facecolors=colors[order], edgecolors=rims, linewidths=0.35))
    dots = panel.marks if len(sizes) else np.arange(len(panel.x))
    dots = dots[np.argsort(seen[dots, 2])]
    axes.scatter(seen[dots, 0], seen[dots, 1], s=28 if len(sizes) else 6, c=panel.colors[dots] * 0.9, zorder=3)


def _polygons(flat: Floats, panel: Panel, order: NDArray[np.int64]) -> Any:
    """The corners of the faces in an order: one array where all have the same size, which draws faster."""
    sizes = np.diff(panel.offsets)
    if np.all(sizes == sizes[0]):
        return flat[panel.indices.reshape(-1, sizes[0])[order]]
    faces = np.split(flat[panel.indices], panel.offsets[1:-1])
    return [faces[i] for i in order]


def _polyscope(
    panels: Sequence[Panel], cameras: Sequence[tuple[Floats, Floats, float]], cell: tuple[int, int]
) -> list[NDArray[np.uint8]] | None:
    """Draw the panels by polyscope in a child process; None where it cannot."""
    from importlib.util import find_spec

    if find_spec("polyscope") is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        arrays: dict[str, Any] = {"cell": cell, "count": len(panels)}
        for i, (panel, (basis, centre, reach)) in enumerate(zip(panels, cameras, strict=True)):
            arrays |= {f"{i}.{name}": getattr(panel, name) for name in ("x", "indices", "offsets", "colors", "marks")}
            arrays |= {f"{i}.basis": basis, f"{i}.centre": centre, f"{i}.reach": reach}
        np.savez(Path(folder) / "in.npz", **arrays)
        command = [sys.executable, "-m", "oneform_warp.preview_polyscope", folder]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
        try:
            done = subprocess.run(command, env=environment, capture_output=True, timeout=180, check=False)
        except (OSError, subprocess.TimeoutExpired):
            return None
        if done.returncode:
            return None
        with np.load(Path(folder) / "out.npz") as pictures:
            return [pictures[str(i)] for i in range(len(panels))]
