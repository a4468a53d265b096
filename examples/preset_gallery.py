"""Every preset on a bar and on a hand: bend, twist, taper, stretch, swell and pose, by the shape's own axis."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from meshes import Floats, load
from oneform_warp import presets
from pictures import figure_folder, report, save_row

SHOWN: dict[str, dict[str, Any]] = {
    "bend": {"angle": 90.0},
    "twist": {"angle": 180.0},
    "taper": {"factor": 0.4},
    "stretch": {"factor": 1.4},
    "swell": {"factor": 1.8},
    "pose": {"angle": 60.0},
}


def shapes() -> dict[str, tuple[Floats, Any]]:
    """A bar, and a hand where there is one."""
    found = {"bar": ow.shapes.bar(width=0.15, segments=50, sides=8, quads=True)}
    hand = load("paper/oded_hand_closed.obj")
    if hand is None:
        return found
    aside = Rotation.from_euler("y", 60, degrees=True)  # seen from the side that it bends to
    return found | {"hand": (aside.apply(hand[0]), hand[1])}


def poses(x: Floats, faces: Any) -> dict[str, ow.Deformation]:
    deformer = ow.Deformer(x, faces)
    return {name: deformer.solve(presets.PRESETS[name](x, **options)) for name, options in SHOWN.items()}


def numbers() -> dict[str, float]:
    """What each preset makes of the bar: the turn of its far end in degrees, a thickness or length over the rest's."""
    x, faces = shapes()["bar"]
    y = {name: each.x for name, each in poses(x, faces).items()}
    top, middle = x[:, 2] > 0.999, np.abs(x[:, 2] - 0.5) < 0.001
    return {
        "bend: turn / degrees": _turn(x[top], y["bend"][top]),
        "twist: turn / degrees": _turn(x[top], y["twist"][top]),
        "taper: thickness": _thickness(y["taper"][top]) / _thickness(x[top]),
        "stretch: length": float(np.ptp(y["stretch"][:, 2])),
        "swell: thickness": _thickness(y["swell"][middle]) / _thickness(x[middle]),
        "pose: turn / degrees": _turn(x[top], y["pose"][top]),
    }


def _turns(y: ow.Deformation) -> Floats | None:
    """The rotation angles as colours, where anything turns."""
    turns = np.linalg.norm(y.omega, axis=1)
    return turns if turns.any() else None


def _turn(x: Floats, y: Floats) -> float:
    return float(np.degrees(Rotation.align_vectors(y - y.mean(axis=0), x - x.mean(axis=0))[0].magnitude()))


def _thickness(x: Floats) -> float:
    return float(np.linalg.norm(x - x.mean(axis=0), axis=1).mean())


def main(folder: Path) -> None:
    report(numbers())
    with TemporaryDirectory() as rows:
        for name, (x, faces) in shapes().items():
            items: list[Any] = [("rest", x, faces)]
            items += [(key, y.x, faces, _turns(y)) for key, y in poses(x, faces).items()]
            save_row(Path(rows) / f"{name}.png", items, height=420, gap=16)
        _stack(sorted(Path(rows).glob("*.png")), folder / "preset_gallery.png")


def _stack(rows: list[Path], path: Path) -> None:
    from PIL import Image

    pictures = [Image.open(row).convert("RGB") for row in rows]
    sheet = Image.new("RGB", (max(p.width for p in pictures), sum(p.height for p in pictures)), "white")
    top = 0
    for picture in pictures:
        sheet.paste(picture, ((sheet.width - picture.width) // 2, top))
        top += picture.height
    sheet.save(path, optimize=True)


if __name__ == "__main__":
    main(figure_folder())
