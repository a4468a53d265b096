"""A bar twisted by half a turn and by two, alone and with struts through its inside, which keep its volume."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import oneform_warp as ow
from fig2_bar_gallery import volume
from meshes import Floats
from pictures import figure_folder, report, save_row

ANGLES = (180, 720)


def mesh() -> tuple[Floats, Floats]:
    return ow.shapes.bar(segments=60, sides=12, quads=True)


def twisted(angle: float, strength: float | None) -> ow.Deformation:
    """The bar on its held foot, its head turned by an angle."""
    x, faces = mesh()
    handles = [ow.Handle(x[:, 2] < 0.07, held=True), ow.Handle(x[:, 2] > 0.93, axis="z", angle=angle)]
    return ow.Deformer(x, faces, struts=strength).solve(handles)


def poses() -> dict[str, ow.Deformation]:
    named = {"alone": None, "with struts": 1.0}
    return {f"{angle}°, {name}": twisted(angle, each) for angle in ANGLES for name, each in named.items()}


def numbers() -> dict[str, float]:
    x, faces = mesh()
    return {f"volume lost at {name} / %": 100.0 * (1.0 - volume(y.x, faces) / volume(x, faces))
            for name, y in poses().items()}  # fmt: skip


def main(folder: Path) -> None:
    report(numbers())
    faces = mesh()[1]
    items = [(name, y.x, faces, np.linalg.norm(y.omega, axis=1)) for name, y in poses().items()]
    save_row(folder / "inner_struts.png", items, height=700, gap=60)


if __name__ == "__main__":
    main(figure_folder())
