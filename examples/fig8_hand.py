"""A hand that points: three fingers bent by one rotation each (Fig. 8 of the paper).

Each finger is known by its tip; what lies between finger and palm is free and bends as the smooth fields say.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import oneform_warp as ow
from meshes import Pose, bent_starfish, limb, load, turn_error
from pictures import figure_folder, report, save_row

# Tip in parts of the box, length of the stiff end, where the palm begins, axis of the bend.
FINGERS = [
    ((0.65, 1.00, 0.3), 0.14, 0.32, (1, 0, 0)),
    ((0.83, 0.89, 0.3), 0.13, 0.29, (1, -0.3, 0)),
    ((0.98, 0.67, 0.4), 0.10, 0.24, (1, -0.7, 0)),
]


def pose(angle: float = 110.0) -> Pose:
    mesh = load("paper/oded_hand_closed.obj")
    if mesh is None:
        return bent_starfish(angle=angle)
    x, faces = mesh
    limbs = [limb(x, faces, tip, near, far) for tip, near, far, _ in FINGERS]
    palm = np.all([body for _, body in limbs], axis=0)
    bends = [ow.Handle(end, axis=axis, angle=angle) for (end, _), (*_, axis) in zip(limbs, FINGERS, strict=True)]
    return x, faces, [ow.Handle(palm, held=True), *bends]


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
    items = [("rest pose", x, faces), ("|ω|", x, faces, angle), ("solution", result.x, faces)]
    save_row(folder / "fig8_hand.png", items, height=560)


if __name__ == "__main__":
    main(figure_folder())
