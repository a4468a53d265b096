"""Keyframes: a bar that twists by a whole turn while it grows, and from there bends down.

Rotation vectors go straight from key to key, so that half-way to a whole turn is half a turn, and not none. The frame
at a key is what `Deformer.solve` makes of its handles, to the last bit.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import oneform_warp as ow
from pictures import figure_folder, report, save_row

X, FACES = ow.shapes.bar(width=0.15, segments=60, sides=6, quads=True)
FOOT = ow.Handle(X[:, 2] < 0.1, held=True, name="foot")
HEAD = X[:, 2] > 0.9
TWISTED = [FOOT, ow.Handle(HEAD, axis="z", angle=360, stretch=1.2, name="head")]
BENT = [FOOT, ow.Handle(HEAD, axis="x", angle=-150, name="head")]
SHOWN = (0.0, 0.25, 0.5, 0.625, 0.75, 0.875, 1.0)


def sequence() -> ow.Keyframes:
    """Twisted at t = 0.5, bent at t = 1."""
    return ow.Keyframes(ow.Deformer(X, FACES), {0.5: TWISTED, 1.0: BENT})


def numbers() -> dict[str, float]:
    keyframes, once = sequence(), ow.Deformer(X, FACES).solve(BENT)
    return {
        "last frame - one-off result": float(np.abs(keyframes.solve(1.0).x - once.x).max()),
        "half-way to a whole turn / degrees": float(np.degrees(keyframes.solve(0.25).omega[:, 2].max())),
    }


def main(folder: Path) -> None:
    report(numbers())
    frames = sequence().frames(SHOWN)
    items = [
        (f"t = {t:g}", frame.x, FACES, np.linalg.norm(frame.omega, axis=1))
        for t, frame in zip(SHOWN, frames, strict=True)
    ]
    save_row(folder / "sequence.png", items, height=560)


if __name__ == "__main__":
    main(figure_folder())
