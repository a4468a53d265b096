"""One picture's content: a mesh with its colours, the camera that sees it, and the two ways to draw it.

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

from oneform_warp.errors import InputError

__all__ = ["Backend", "Camera", "Panel", "by_polyscope", "camera_of", "marked", "paint", "panel_of"]

Floats = NDArray[np.float64]
Backend = Literal["auto", "polyscope", "matplotlib"]
Camera = tuple[Floats, Floats, float]
"""Axes as rows (right, up, towards the eye), the centre, and half of the width that is seen."""

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


def panel_of(caption: str, x: ArrayLike, faces: Any, scalar: Any, limits: tuple[float, float] = (0, 1)) -> Panel:
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


def marked(panel: Panel, held: ArrayLike | None, moved: ArrayLike | None) -> Panel:
    """The panel with the held and the moved vertices in their colours."""
    colors, marks = panel.colors.copy(), []
    for chosen, color in ((held, HELD), (moved, MOVED)):
        if chosen is not None:
            rows = np.arange(len(panel.x))[np.asarray(chosen, dtype=None if np.size(chosen) else np.int64)]
            colors[rows] = color
            marks.append(rows[: 0 if len(rows) > 40 and len(panel.indices) else None])
    return replace(panel, colors=colors, marks=np.concatenate(marks) if marks else panel.marks)


def camera_of(rest: Floats, every: Floats) -> Camera:
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


def paint(axes: Any, panel: Panel, camera: Camera) -> None:
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


def by_polyscope(
    panels: Sequence[Panel], cameras: Sequence[Camera], cell: tuple[int, int]
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
