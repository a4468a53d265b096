"""An exact 1-form and one that is not: sums along two paths between the same ends (Fig. 4 of the paper).

dx of a deformed plane is exact, so every path sums to the same place. Turned by an angle that varies over the plane
it is not: the cycles do not close, and least squares has to share out what they miss.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import oneform_warp as ow
from meshes import Floats
from pictures import figure_folder, report

CELLS = 16
TURN = np.radians(150.0)


def plane() -> tuple[ow.Graph, Floats]:
    """A square in the plane, (V, 2), and the graph of its quads."""
    x, faces = ow.shapes.grid(CELLS, CELLS, quads=True)
    return ow.Graph.from_faces(x[:, :2], faces), x[:, :2]


def forms() -> dict[str, Floats]:
    """The two 1-forms, (m, 2)."""
    graph, x = plane()
    bent = x + 0.12 * np.sin(np.pi * x[:, ::-1])
    turned = ow.transform(graph, ow.differential(graph, x), TURN * x[:, 0] * x[:, 1], None)
    return {"exact: v = dy": ow.differential(graph, bent), "not exact: v = R(ω) dx": turned}


def paths() -> tuple[list[int], list[int]]:
    """From the first to the last corner: along two sides of the square, and along the two others."""
    across = [i * (CELLS + 1) for i in range(CELLS + 1)]
    return [*across, *range(across[-1] + 1, across[-1] + CELLS + 1)], [*range(CELLS), *(CELLS + i for i in across)]


def relative_cycle_residual(v: Floats) -> float:
    """The largest miss of a closing edge over the root mean square of |v|."""
    return float(ow.cycle_residual(plane()[0], v).max() / np.sqrt((v**2).sum(axis=1).mean()))


def path_difference(v: Floats) -> float:
    """How far apart the sums along the two paths end, in sides of the square."""
    one, other = (ow.path_integral(plane()[0], v, path) for path in paths())
    return float(np.linalg.norm(one - other))


def numbers() -> dict[str, float]:
    values = {}
    for name, v in forms().items():
        values[f"{name}: cycle residual"] = relative_cycle_residual(v)
        values[f"{name}: difference of two paths"] = path_difference(v)
    return values


def main(folder: Path) -> None:
    report(numbers())
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    graph, x = plane()
    figure = Figure(figsize=(11, 5.2), layout="constrained")
    for axes, (name, v) in zip(figure.subplots(1, 2), forms().items(), strict=True):
        y = ow.solve(graph, v, start=x).x
        miss = ow.cycle_residual(graph, v) * CELLS
        lines = axes.add_collection(LineCollection(y[graph.edges], array=miss, cmap="viridis", linewidths=1.2))
        lines.set_clim(0.0, 1.0)
        for path, color in zip(paths(), ("tab:red", "tab:orange"), strict=True):
            sums = y[0] + [ow.path_integral(graph, v, path[:k]) for k in range(1, len(path) + 1)]
            axes.plot(*sums.T, "o-", color=color, markersize=3, markevery=[0, -1], linewidth=2)
        axes.set(title=f"{name}\npaths end {path_difference(v):.2g} apart", aspect="equal")
        axes.set_axis_off()
    figure.colorbar(lines, ax=figure.axes, label="what the cycle of an edge misses, in edge lengths", shrink=0.7)
    figure.savefig(folder / "fig4_exactness.png", dpi=100)


if __name__ == "__main__":
    main(figure_folder())
