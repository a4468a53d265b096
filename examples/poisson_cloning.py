"""Seamless cloning of one image into another (Perez, Gangnet, Blake: Poisson image editing, 2003).

The pixels are the graph, the colours the 0-form, D = 3. Inside a mask v is the source's gradient, outside the target
stays. Where `mixed`, v is the larger of the two gradients (their equation 13), else the source's alone (equation 9).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import oneform_warp as ow
from meshes import Floats
from pictures import figure_folder, report

Mask = NDArray[np.bool_]


def gradient(graph: ow.Graph, source: Floats, target: Floats, mixed: bool) -> Floats:
    """The 1-form to integrate, (m, 3): the source's gradient, or where mixed the larger of the two."""
    v, other = (ow.differential(graph, image.reshape(-1, 3)) for image in (source, target))
    if not mixed:
        return v
    larger = np.linalg.norm(other, axis=1) > np.linalg.norm(v, axis=1)
    return np.where(larger[:, None], other, v)


def clone(source: Floats, target: Floats, mask: Mask, *, mixed: bool = False) -> Floats:
    """The target (height, width, 3) with the source's gradients inside the mask (height, width)."""
    graph = ow.Graph.from_grid(mask.shape)
    v = gradient(graph, source, target, mixed)
    start = target.reshape(-1, 3)
    return ow.solve(graph, v, start=start, fixed=~mask.ravel(), solver=ow.CG(tol=1e-8)).x.reshape(target.shape)


def clone_densely(source: Floats, target: Floats, mask: Mask, *, mixed: bool = False) -> Floats:
    """The same by a dense matrix with a row for each pair of pixels, and NumPy's least squares."""
    graph = ow.Graph.from_grid(mask.shape)
    rows = np.arange(graph.edge_count)
    d = np.zeros((graph.edge_count, mask.size))
    d[rows, graph.edges[:, 0]], d[rows, graph.edges[:, 1]] = -1.0, 1.0
    x, free = target.reshape(-1, 3).copy(), mask.ravel()
    x[free] = np.linalg.lstsq(d[:, free], gradient(graph, source, target, mixed) - d[:, ~free] @ x[~free])[0]
    return x.reshape(target.shape)


def images(size: int) -> tuple[Floats, Floats, Mask]:
    """-> source: a striped ball before a grey wall; target: a sky with thin clouds; mask: a disc around the ball."""
    y, x = np.mgrid[0:size, 0:size] / (size - 1) * 2.0 - 1.0
    radius = np.hypot(x, y)
    dome = np.sqrt(np.clip(1.0 - (radius / 0.5) ** 2, 0.0, 1.0))
    light = 0.35 + 0.65 * np.clip(-0.5 * x - 0.5 * y + 0.7 * dome, 0.0, 1.0)
    stripes = 0.5 + 0.5 * np.tanh(4.0 * np.sin(14.0 * y + 3.0 * x * dome))
    paint = stripes[..., None] * [0.9, 0.55, 0.2] + (1.0 - stripes[..., None]) * [0.55, 0.2, 0.15]
    wall = (0.42 + 0.02 * np.sin(40.0 * x) * np.sin(40.0 * y))[..., None] * [0.9, 0.95, 1.0]
    source = np.where((radius < 0.5)[..., None], paint * light[..., None], wall)
    height = (y[..., None] + 1.0) / 2.0
    clouds = np.clip(np.sin(9.0 * y + 2.0 * np.sin(3.0 * x)) * np.sin(5.0 * x + 4.0 * y), 0.0, 1.0)[..., None]
    target = (1.0 - height) * [0.15, 0.25, 0.5] + height * [0.85, 0.6, 0.5] + 0.12 * clouds
    return source, target, radius < 0.62


def numbers() -> dict[str, float]:
    source, target, mask = images(14)
    values = {}
    for mixed in (False, True):
        error = clone(source, target, mask, mixed=mixed) - clone_densely(source, target, mask, mixed=mixed)
        values[f"largest error, mixed = {mixed}"] = float(np.abs(error).max() / np.ptp(target))
    return values


def main(folder: Path) -> None:
    report(numbers())
    from matplotlib.figure import Figure

    source, target, mask = images(256)
    panels = {
        "source": source,
        "pasted": np.where(mask[..., None], source, target),
        "cloned": clone(source, target, mask),
        "cloned, mixed gradients": clone(source, target, mask, mixed=True),
    }
    figure = Figure(figsize=(11.2, 3.1), layout="constrained")
    for axes, (name, image) in zip(figure.subplots(1, 4), panels.items(), strict=True):
        axes.imshow(np.clip(image, 0.0, 1.0))
        axes.set_title(name)
        axes.set_axis_off()
    figure.savefig(folder / "poisson_cloning.png", dpi=100)


if __name__ == "__main__":
    main(figure_folder())
