"""The pipeline on a bar: rest pose, fields, the 1-form integrated along a tree, solution (Fig. 1 of the paper).

The five calls here are what `ow.deform` does; the number asserted is their distance from it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import oneform_warp as ow
from meshes import Floats, box
from pictures import figure_folder, report, save_row


def pipeline(x: Floats, faces: Any, handles: list[ow.Handle]) -> tuple[ow.Fields, Floats, Floats]:
    """-> the fields, the integral of v along a tree, the positions that solve the least squares problem."""
    graph = ow.Graph.from_faces(x, faces)
    fields = ow.smooth_fields(graph, handles)
    dx = ow.differential(graph, x)
    v = ow.transform(graph, dx, fields.omega, fields.sigma)
    tree = ow.spanning_tree(graph)
    estimate = x[tree.roots[0]] + ow.integrate_tree(tree, v)
    solution = ow.solve(graph, v, start=x, fixed=handles[0].vertices)
    return fields, estimate, solution.x


def bar() -> tuple[Floats, Any, list[ow.Handle]]:
    x, faces = ow.shapes.bar(width=0.15, segments=40, quads=True)
    z = x[:, 2]
    return x, faces, [ow.Handle(z < 0.15, held=True), ow.Handle(z > 0.85, axis=(0, 0.5, 1), angle=200)]


def numbers() -> dict[str, float]:
    x, faces, handles = bar()
    solution = pipeline(x, faces, handles)[2]
    return {"distance from ow.deform / box": float(np.abs(solution - ow.deform(x, faces, handles)).max() / box(x))}


def main(folder: Path) -> None:
    report(numbers())
    x, faces, handles = bar()
    fields, estimate, solution = pipeline(x, faces, handles)
    angle = np.linalg.norm(fields.omega, axis=1)
    items = [
        ("rest pose x", x, faces),
        ("|ω| of the fields", x, faces, angle),
        ("v along a tree", estimate, faces, angle),
        ("solution x′", solution, faces, angle),
    ]
    save_row(folder / "fig1_pipeline.png", items, height=600, gap=60)


if __name__ == "__main__":
    main(figure_folder())
