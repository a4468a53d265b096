"""The armadillo's arm turned by 90 degrees: rest pose, integral along the maximal tree, solution (Fig. 7 of the paper).

The estimate along a tree needs no solve and already has the large motion; the solver only repairs where it tears.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import oneform_warp as ow
from meshes import Floats, Pose, bent_starfish, box, limb, load
from pictures import figure_folder, report, save_row

STARTS = ("rest", "min_depth", "maximal", "minimal")


def pose() -> Pose:
    mesh = load("paper/libigl_armadillo.obj")
    if mesh is None:
        return bent_starfish()
    x, faces = mesh
    arm, body = limb(x, faces, (0.0, 0.83, 0.78), 0.2, 0.33)
    return x, faces, [ow.Handle(body, held=True), ow.Handle(arm, axis="z", angle=90)]


def numbers(pose: Pose) -> dict[str, float]:
    """The largest distance of each start from the solution, in percent of the box, and the solve's iterations."""
    x, faces, handles = pose
    deformer = ow.Deformer(x, faces)
    solution = deformer.solve(handles)
    values: dict[str, Any] = {}
    for start in STARTS:
        result = deformer.solve(handles, start=start)
        values[f"{start}: error of the start / %"] = 100.0 * distance(result.estimate, solution.x) / box(x)
        values[f"{start}: error of the solution / %"] = 100.0 * distance(result.x, solution.x) / box(x)
        values[f"{start}: iterations"] = result.iterations
    return values


def distance(x: Floats, y: Floats) -> float:
    return float(np.linalg.norm(x - y, axis=1).max())


def main(folder: Path) -> None:
    report(numbers(pose()))
    x, faces, handles = pose()
    result = ow.Deformer(x, faces).solve(handles, start="maximal")
    items = [
        ("rest pose, |ω|", x, faces, np.linalg.norm(result.omega, axis=1)),
        ("estimate along the maximal tree", result.estimate, faces),
        ("solution", result.x, faces),
    ]
    save_row(folder / "fig7_armadillo.png", items, height=600)


if __name__ == "__main__":
    main(figure_folder())
