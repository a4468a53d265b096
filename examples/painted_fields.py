"""Fields painted at every vertex instead of spread from handles, and brush strokes softened by sweeps.

The map e^z of the plane turns by y and stretches by e^x at z = x + iy. Painted on a rectangle as
    omega = y,  sigma = e^x
these fields wrap it around the origin. The 1-form is e^z up to O(h^2), so halving h quarters the error.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import oneform_warp as ow
from meshes import Floats
from pictures import figure_folder, report, save_row

HEIGHT = 1.5 * np.pi


def rectangle(cells: int) -> tuple[Floats, Any]:
    """The rectangle [0, 1] x [0, 3 pi / 2]."""
    x, faces = ow.shapes.grid(cells, 4 * cells, depth=HEIGHT, quads=True)
    return x[:, :2], faces


def wrapped(x: Floats, faces: Any) -> Floats:
    """The rectangle with the painted fields, one corner held -> (V, 2)."""
    painted = ow.Fields(omega=x[:, 1], sigma=np.exp(x[:, 0]))
    return ow.deform(x, faces, [ow.Handle([0], held=True)], fields=painted)


def exponential(x: Floats) -> Floats:
    """e^z, moved so that the first corner stays."""
    z = np.exp(x[:, 0] + 1j * x[:, 1])
    return np.stack([z.real, z.imag], axis=1) + x[0] - (z[0].real, z[0].imag)


def error(cells: int) -> float:
    """The largest distance from e^z."""
    x, faces = rectangle(cells)
    return float(np.linalg.norm(wrapped(x, faces) - exponential(x), axis=1).max())


def numbers() -> dict[str, float]:
    coarse, fine = error(8), error(16)
    return {"error of 8 cells": coarse, "error of 16 cells": fine, "order": float(np.log2(coarse / fine))}


def stroke(sweeps: int) -> tuple[Floats, Any, Floats]:
    """A tuft pulled out of a sphere: a few vertices stretched and turned, the fields softened by sweeps."""
    x, faces = ow.shapes.sphere(level=5)
    handles = [
        ow.Handle(x[:, 1] < -0.9, held=True),
        ow.Handle(x[:, 1] > 0.9, axis="y", angle=120, stretch=2.0),
    ]
    solution = ow.Deformer(x, faces, weights="uniform").solve(handles, sweeps=sweeps)
    return solution.x, faces, np.linalg.norm(solution.omega, axis=1)


def main(folder: Path) -> None:
    report(numbers())
    x, faces = rectangle(16)
    save_row(folder / "painted_fields.png", [("ω", x, faces, x[:, 1]), ("eᶻ", wrapped(x, faces), faces, x[:, 1])])
    items = [(f"sweeps: {sweeps}", *stroke(sweeps)) for sweeps in (10, 50, 250, 1250)]
    save_row(folder / "painted_strokes.png", items, height=400)


if __name__ == "__main__":
    main(figure_folder())
