"""A line stretched towards one end, D = 1: the smallest problem with a closed form.

log sigma goes linearly from 0 to log 4, so on a line of n equal edges of length h
    x'_k = h s^(1/2) (s^k - 1) / (s - 1),  s = 4^(1/n).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import oneform_warp as ow
from meshes import Floats
from pictures import figure_folder, report

STRETCH = 4.0


def stretched(edges: int) -> Floats:
    """The line [0, 1], held at 0, stretched by the factor 4 at 1 -> (edges + 1,)."""
    x = np.linspace(0.0, 1.0, edges + 1)
    graph = ow.Graph.from_polyline(len(x))
    handles = [ow.Handle([0], held=True), ow.Handle([edges], stretch=STRETCH)]
    return ow.Deformer(x, graph, solver=ow.CG(tol=1e-12, dtype="float64")).deform(handles)


def closed_form(edges: int) -> Floats:
    s = STRETCH ** (1.0 / edges)
    return np.sqrt(s) / edges * (s ** np.arange(edges + 1) - 1.0) / (s - 1.0)


def numbers(edges: int = 100) -> dict[str, float]:
    y = stretched(edges)
    return {
        "error against the closed form": float(np.abs(y - closed_form(edges)).max()),
        "length": float(y[-1]),
        "length for edges of length 0": (STRETCH - 1.0) / np.log(STRETCH),
    }


def main(folder: Path) -> None:
    report(numbers())
    from matplotlib.figure import Figure

    edges = 20
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.plot(np.linspace(0, 1, edges + 1), np.ones(edges + 1), "o-", label="x")
    axes.plot(stretched(edges), np.zeros(edges + 1), "o-", label="x′, stretched by 1 at the left, by 4 at the right")
    axes.plot(closed_form(edges), np.zeros(edges + 1), "|", markersize=24, color="0.2", label="closed form")
    axes.set(ylim=(-0.6, 2.2), yticks=[], xlabel="position")
    axes.legend(loc="upper right", frameon=False)
    figure.savefig(folder / "polyline_1d.png", dpi=100)


if __name__ == "__main__":
    main(figure_folder())
