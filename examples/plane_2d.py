"""A figure in the plane, D = 2, whose arms are turned by angles alone.

In the plane a rotation is one number, so positions are (V, 2) and omega is (V,).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import oneform_warp as ow
from meshes import Floats, Pose, box, limb, load
from pictures import figure_folder, report, save_row


def pose() -> Pose:
    """The gingerbread man with both arms up, or a strip bent into an arc."""
    mesh = load("graph2d/woody_2d.obj")
    if mesh is None:
        x, faces = ow.shapes.grid(40, 6, width=1.0, depth=0.15)
        left, right = x[:, 0] < 0.1, x[:, 0] > 0.9
        return x[:, :2], faces, [ow.Handle(left, held=True), ow.Handle(right, angle=180)]
    x, faces = mesh[0][:, :2], mesh[1]
    left, without_left = limb(x, faces, (0.0, 0.6), 0.18, 0.36)
    right, without_right = limb(x, faces, (1.0, 0.6), 0.18, 0.36)
    handles = [ow.Handle(without_left & without_right, held=True)]
    return x, faces, [*handles, ow.Handle(left, angle=-60), ow.Handle(right, angle=60)]


def turned(x: Floats, degrees: float) -> Floats:
    """The rigid rotation of all positions about their centroid."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return (x - x.mean(axis=0)) @ np.array([[c, s], [-s, c]]) + x.mean(axis=0)


def numbers(degrees: float = 170.0) -> dict[str, float]:
    """One angle at one vertex and nothing held turns everything: the distance from that rigid motion."""
    x, faces = ow.shapes.grid(20, 10)
    y: Any = ow.deform(x[:, :2], faces, [ow.Handle([0], angle=degrees)])
    return {"distance from the rigid motion / box": float(np.abs(y - turned(x[:, :2], degrees)).max() / box(x))}


def main(folder: Path) -> None:
    report(numbers())
    x, faces, handles = pose()
    result = ow.Deformer(x, faces).solve(handles)
    items = [("rest pose", x, faces, result.omega), ("solution", result.x, faces, result.omega)]
    save_row(folder / "plane_2d.png", items, height=480)


if __name__ == "__main__":
    main(figure_folder())
