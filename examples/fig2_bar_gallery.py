"""Twist, bend and stretch of a bar by one rotation and one stretch at its end (Fig. 2 of the paper).

Twists of more than 180 degrees work because omega is a rotation vector: 720 degrees stay 720 degrees.
The solve is linear, so a fast twist makes the bar thinner: by about 1 / (1 + (t g / 2 pi)^2) for t radians per length
and the girth g. Where that nears 0, as in a thick bar, turns slip.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import oneform_warp as ow
from meshes import Floats
from pictures import figure_folder, report, save_row

SEGMENTS, SIDES, WIDTH = 60, 6, 0.1
TWISTS = (90, 180, 270, 360, 540, 720)


def bar(axis: str = "z", angle: float = 0.0, stretch: float = 1.0) -> ow.Deformation:
    """The bar on its held foot, its head turned by an angle about an axis and stretched."""
    x, faces = ow.shapes.bar(width=WIDTH, segments=SEGMENTS, sides=SIDES, quads=True)
    z = x[:, 2]
    handles = [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, axis=axis, angle=angle, stretch=stretch)]
    return ow.Deformer(x, faces).solve(handles)


def rings(x: Floats) -> Floats:
    """The cross-sections, (sections, vertices around, 3): the first vertices of `shapes.bar`."""
    return x[: 4 * SIDES * (SEGMENTS + 1)].reshape(SEGMENTS + 1, 4 * SIDES, 3)


def turn_along(x: Floats) -> float:
    """The turn of the head against the foot in degrees: angles about z between neighbouring sections, added up."""
    spoke = rings(x) - rings(x).mean(axis=1, keepdims=True)
    direction = spoke[..., 0] + 1j * spoke[..., 1]
    return float(np.degrees(np.angle((direction[1:] * direction[:-1].conj()).sum(axis=1)).sum()))


def radius_ratio(x: Floats) -> float:
    """The radius of the middle section over that of the foot: 1 where the twist does not make the bar thinner."""
    spoke = np.linalg.norm(rings(x) - rings(x).mean(axis=1, keepdims=True), axis=2).mean(axis=1)
    return float(spoke[SEGMENTS // 2] / spoke[0])


def volume(x: Floats, faces: Floats) -> float:
    """The volume that a closed mesh of quads encloses."""
    a, b, c, d = (x[column] for column in faces.T)
    return float(((np.cross(a, b) * c).sum() + (np.cross(a, c) * d).sum()) / 6.0)


def numbers(angle: float = 720.0) -> dict[str, float]:
    x, faces = ow.shapes.bar(width=WIDTH, segments=SEGMENTS, sides=SIDES, quads=True)
    y = bar(angle=angle).x
    return {
        f"turn of the {angle:g} degree twist": turn_along(y),
        "middle radius / rest": radius_ratio(y),
        "volume / rest": volume(y, faces) / volume(x, faces),
    }


def main(folder: Path) -> None:
    report(numbers())
    faces = ow.shapes.bar(width=WIDTH, segments=SEGMENTS, sides=SIDES, quads=True)[1]
    results = {"rest": bar()}
    results |= {f"{angle}°": bar(angle=angle) for angle in TWISTS}
    results |= {"bend": bar(axis="x", angle=-120), "stretch": bar(stretch=1.25)}
    items = [(name, result.x, faces, np.linalg.norm(result.omega, axis=1)) for name, result in results.items()]
    save_row(folder / "fig2_bar_gallery.png", items, height=760, gap=44)


if __name__ == "__main__":
    main(figure_folder())
