"""The deformations of the demo: twists of a bar by 90 to 720 degrees, and a bend."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from oneform_warp.deformer import Deformer
from oneform_warp.errors import FileError
from oneform_warp.filters import read_mesh
from oneform_warp.handle_values import AXES
from oneform_warp.handles import Handle
from oneform_warp.preview import save_scene
from oneform_warp.shapes import bar

__all__ = ["deform_bars", "turn_reached"]

BARS = {"90": ("z", 90), "180": ("z", 180), "360": ("z", 360), "720": ("z", 720), "bent": ("x", 90)}
"""Name, axis, degrees of rotation of the upper end."""

SIDES, SEGMENTS = 6, 30


def deform_bars(folder: Path, say: Callable[[str], None]) -> None:
    """Write bar.obj, each deformation of it and a picture of all into a folder; `say` gets a line for each."""
    x, faces = bar(segments=SEGMENTS, sides=SIDES)
    rest = folder / "bar.obj"
    _write_obj(rest, x, faces)
    mesh = read_mesh(rest)
    deformer, z = Deformer(mesh.positions, mesh.faces), mesh.positions[:, 2]
    say(f"{rest}: {len(x):,} vertices, {deformer.graph.edge_count:,} edges")
    scene = [("rest", mesh.positions, mesh.faces)]
    for name, (axis, angle) in BARS.items():
        solution = deformer.solve([Handle(z < 0.1, held=True), Handle(z > 0.9, axis=axis, angle=angle)])
        path = folder / f"bar-{name}.obj"
        mesh.write(path, solution.x)
        reached = turn_reached(mesh.positions, solution.x, axis)
        say(
            f"{path}: energy {solution.energy:.4g}, {solution.iterations} iterations, {solution.status.word}, "
            f"turned by {reached:.1f} of {angle} degrees about {axis}"
        )
        for warning in solution.warnings:
            say(f"  warning: {warning}")
        verb = "bent" if axis == "x" else "twisted"
        scene.append((f"{verb} by {angle}°", solution.x, mesh.faces))
    gallery = folder / "bar-gallery.png"
    drawn = save_scene(gallery, scene, title="A bar, its lower end held, its upper end rotated", columns=3)
    say(f"{gallery}: drawn by {drawn}")


def turn_reached(rest: NDArray[np.float64], x: NDArray[np.float64], axis: str) -> float:
    """Degrees between the two ends of the bar, whole turns included: the rings' own rotations, followed upwards."""
    rings = (SEGMENTS + 1, 4 * SIDES, 3)
    p, q = (points[: rings[0] * rings[1]].reshape(rings) for points in (rest, x))
    p, q = p - p.mean(axis=1, keepdims=True), q - q.mean(axis=1, keepdims=True)
    direction = np.asarray(AXES[axis])
    along = (p @ direction) * (q @ direction)
    sine = (np.cross(p, q) @ direction).sum(axis=1)
    cosine = ((p * q).sum(axis=2) - along).sum(axis=1)
    angles = np.unwrap(np.arctan2(sine, cosine))
    return float(np.degrees(angles[-1] - angles[0]))


def _write_obj(path: Path, x: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
    lines = [f"v {a:.9g} {b:.9g} {c:.9g}" for a, b, c in x]
    lines += ["f " + " ".join(str(vertex + 1) for vertex in face) for face in faces]
    try:
        path.write_text("\n".join(lines) + "\n", encoding="ascii")
    except OSError as error:
        raise FileError(f"cannot be written: {error.strerror}", where=str(path), fix="choose another folder") from None
