"""A set of points without faces, on the graph of its nearest neighbours.

Nothing in the method needs a surface: a graph is enough. The points fill a bar, and the bar is bent.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from meshes import Floats, box
from pictures import figure_folder, report, save_row


def points(count: int = 3000) -> Floats:
    """Random points in the bar [-0.1, 0.1] x [0, 1] x [-0.1, 0.1]."""
    unit = np.random.default_rng(0).random((count, 3))
    return (unit - [0.5, 0.0, 0.5]) * [0.2, 1.0, 0.2]


def numbers() -> dict[str, float]:
    """One rotation at one point and nothing held turns everything: the distance from that rigid motion."""
    x = points()
    omega = np.array([0.3, -2.0, 1.0])
    y = ow.deform(x, ow.Graph.from_points(x), [ow.Handle([7], rotation=omega)])
    rigid = Rotation.from_rotvec(omega).apply(x - x.mean(axis=0)) + x.mean(axis=0)
    return {"distance from the rigid motion / box": float(np.abs(y - rigid).max() / box(x))}


def main(folder: Path) -> None:
    report(numbers())
    x = points()
    height = x[:, 1]
    handles = [ow.Handle(height < 0.15, held=True), ow.Handle(height > 0.85, axis="z", angle=-150)]
    y = ow.deform(x, ow.Graph.from_points(x), handles)
    none = np.zeros((0, 3), dtype=int)
    save_row(folder / "point_set.png", [("points", x, none, height), ("bent by 150°", y, none, height)], height=480)


if __name__ == "__main__":
    main(figure_folder())
