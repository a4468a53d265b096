"""The bunny's ears bent, one down and one up."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import oneform_warp as ow
from meshes import Pose, bent_starfish, limb, load, turn_error
from pictures import figure_folder, report, save_row


def pose() -> Pose:
    mesh = load("paper/oded_bunny.obj")
    if mesh is None:
        return bent_starfish(angle=60.0)
    x, faces = mesh
    near_ear, below_near_ear = limb(x, faces, (0.5, 1.0, 0.33), 0.12, 0.25)
    far_ear, below_far_ear = limb(x, faces, (0.17, 0.96, 0.02), 0.12, 0.25)
    return (
        x,
        faces,
        [
            ow.Handle(below_near_ear & below_far_ear, held=True),
            ow.Handle(near_ear, axis="z", angle=-70),
            ow.Handle(far_ear, axis="x", angle=60),
        ],
    )


def numbers(pose: Pose) -> dict[str, float]:
    """How far the turned ends are from the rotations asked for: nothing pulls at them, so they should follow."""
    x, faces, handles = pose
    y = ow.Deformer(x, faces).solve(handles).x
    return {"largest error of a turn / degrees": turn_error(x, y, handles)}


def main(folder: Path) -> None:
    report(numbers(pose()))
    x, faces, handles = pose()
    result = ow.Deformer(x, faces).solve(handles)
    angle = np.linalg.norm(result.omega, axis=1)
    save_row(folder / "fig_bunny.png", [("|ω|", x, faces, angle), ("solution", result.x, faces)], height=560)


if __name__ == "__main__":
    main(figure_folder())
