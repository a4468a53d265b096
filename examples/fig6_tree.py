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
from pictures import figure_folder


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
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    graph, x, v = twisted_bar()
    figure = Figure(figsize=(9, 6), layout="constrained")
    for number, (name, tree) in enumerate(trees(graph, x, v).items(), start=1):
        axes = figure.add_subplot(1, 3, number, projection="3d")
        axes.set_box_aspect(np.ptp(x, axis=0), zoom=1.7)
        axes.add_collection3d(Line3DCollection(x[graph.edges], colors="0.88", linewidths=0.5))
        depth = tree.depth[graph.node_of][graph.edges[tree.edges]].max(axis=1)
        axes.add_collection3d(Line3DCollection(x[graph.edges[tree.edges]], array=depth, cmap="viridis", linewidths=1.6))
        axes.scatter(*x[tree.roots].T, color="tab:red", s=40)
        axes.set(xlim=(-0.125, 0.125), ylim=(-0.125, 0.125), zlim=(0, 1), title=f"{name}: depth {tree.depth.max()}")
        axes.view_init(12, -55)
        axes.set_axis_off()
    figure.savefig(folder / "fig6_tree.png", dpi=100)


if __name__ == "__main__":
    print(numbers())
    main(figure_folder())
