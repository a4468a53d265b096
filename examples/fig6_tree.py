"""Spanning trees of a small mesh: of minimum depth, maximal and minimal (Fig. 6 of the paper).

The cost of an edge is how wrong the rest pose is on it, mu_ij |dx_ij - v_ij|^2. The maximal tree takes the edges that
change most, so that its integral has the whole deformation in it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

import oneform_warp as ow
from meshes import Floats
from pictures import figure_folder, report


def twisted_bar() -> tuple[ow.Graph, Floats, Floats]:
    """-> graph, rest positions, and the 1-form v of a bar twisted by 180 degrees."""
    x, faces = ow.shapes.bar(segments=14, sides=3, width=0.25)
    z = x[:, 2]
    graph = ow.Graph.from_faces(x, faces)
    fields = ow.smooth_fields(graph, [ow.Handle(z < 0.1, held=True), ow.Handle(z > 0.9, axis="z", angle=180)])
    return graph, x, ow.transform(graph, ow.differential(graph, x), fields.omega, fields.sigma)


def trees(graph: ow.Graph, x: Floats, v: Floats) -> dict[str, ow.SpanningTree]:
    cost = ow.edge_energy(graph, x, v)
    return {
        "minimum depth": ow.spanning_tree(graph),
        "maximal": ow.spanning_tree(graph, -cost),
        "minimal": ow.spanning_tree(graph, cost),
    }


def numbers() -> dict[str, float]:
    graph, x, v = twisted_bar()
    cost = ow.edge_energy(graph, x, v)
    values = {}
    for name, tree in trees(graph, x, v).items():
        values[f"{name}: depth"] = int(tree.depth.max())
        values[f"{name}: share of the energy"] = float(cost[tree.edges].sum() / cost.sum())
    # scipy leaves out edges of cost 0, so all costs are raised by the same amount: the tree stays the same.
    raised = coo_array((cost + cost.max(), graph.edges.T), shape=(len(x), len(x)))
    least = minimum_spanning_tree(raised).sum() - (len(x) - 1) * cost.max()
    values["minimal tree against scipy's, relative"] = abs(
        values["minimal: share of the energy"] * cost.sum() / least - 1
    )
    return values


def main(folder: Path) -> None:
    report(numbers())
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    graph, x, v = twisted_bar()
    flat = x @ np.array([[0.8, -0.12], [0.6, 0.16], [0.0, 1.0]])
    figure = Figure(figsize=(9, 8), layout="constrained")
    panels = figure.subplots(1, 3)
    for axes, (name, tree) in zip(panels, trees(graph, x, v).items(), strict=True):
        axes.add_collection(LineCollection(flat[graph.edges], colors="0.88", linewidths=0.6))
        ends = graph.edges[tree.edges]
        depth = tree.depth[graph.node_of][ends].max(axis=1)
        axes.add_collection(LineCollection(flat[ends], array=depth, cmap="viridis_r", linewidths=2.0))
        axes.plot(*flat[tree.roots].T, "o", color="tab:red", markersize=8)
        axes.set(title=f"{name}: depth {tree.depth.max()}", aspect="equal")
        axes.autoscale()
        axes.set_axis_off()
    figure.savefig(folder / "fig6_tree.png", dpi=100)


if __name__ == "__main__":
    main(figure_folder())
