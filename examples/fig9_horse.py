"""A horse that lowers its head and lifts a leg: two rotations on 48,000 vertices (Fig. 9 of the paper)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import oneform_warp as ow
from meshes import Pose, bent_starfish, limb, load, turn_error
from pictures import figure_folder, report, save_row


def pose() -> Pose:
    mesh = load("paper/horse.ply")
    if mesh is None:
        return bent_starfish(angle=-70.0)
    x, faces = mesh
    x = x[:, [1, 2, 0]]  # head to the right, back up
    head, behind_neck = limb(x, faces, (1.0, 0.75, 0.5), 0.16, 0.39)
    hoof, above_leg = limb(x, faces, (0.75, 0.0, 1.0), 0.10, 0.23)
    return (
        x,
        faces,
        [
            ow.Handle(behind_neck & above_leg, held=True),
            ow.Handle(head, axis="z", angle=-65),
            ow.Handle(hoof, axis="z", angle=-75),
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
    save_row(folder / "fig9_horse.png", [("|ω|", x, faces, angle), ("solution", result.x, faces)], height=640)


if __name__ == "__main__":
    main(figure_folder())
