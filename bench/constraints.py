"""Linear constraints: what hundreds of them cost, with each solver.

`python -m bench.constraints [--full] [--device cuda:0] [--sizes 100000]`
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

import oneform_warp as ow
from bench.options import Options, options
from bench.table import calm, report, timed
from oneform_warp.arrays import read_rows
from oneform_warp.constraints import (
    Constraint,
    centroid,
    edge_direction,
    edge_length,
    face_normal,
    position,
    relative_position,
)
from oneform_warp.equations import equations
from oneform_warp.rest import Rest
from oneform_warp.solvers import Multigrid, Solver, SuperLU
from oneform_warp.solvers.constrained import Constrained

COUNTS = [30, 300, 900]
PINNED = 50
"""Nodes in a corner, in solving order; constraints stay away from a few more."""


def constraints(graph: ow.Graph, x: np.ndarray, faces: np.ndarray, count: int) -> list[Constraint]:
    """A sixth of each of six kinds, at random places; a third of them soft."""
    rng = np.random.default_rng(0)
    some = rng.permutation(np.flatnonzero(graph.node_of > graph.node_count // 50))
    points = iter(some)
    edges = graph.edges[np.isin(graph.edges, some).all(axis=1)]
    made: list[Constraint] = []
    for a, b in edges[rng.permutation(len(edges))[: count // 6]]:
        i, j, k, m, c, *five = (int(next(points)) for _ in range(10))
        corners = faces[(faces == c).any(axis=1).argmax()]
        spans = x[corners[1:]] - x[corners[0]]
        made += [
            position(i, x[i] + 0.05 * rng.normal(size=3)),
            edge_direction(a, b, x[b] - x[a]),
            edge_length(j, int(corners[0]), 1.2 * np.linalg.norm(x[j] - x[corners[0]]), direction=x[j] - x[corners[0]]),
            face_normal(corners, np.cross(spans[0], spans[1])),
            relative_position(k, m, 1.1 * (x[m] - x[k]), weight=1.0),
            centroid(five, x[five].mean(axis=0) + 0.1, weight=0.1),
        ]
    return made


def row(size: int, count: int, solver: Solver, device: Any) -> dict[str, Any]:
    side = round(size**0.5) - 1
    x, faces = ow.shapes.bumpy_plane(side, side)
    graph = ow.Graph.from_faces(x, faces, device=device)
    rest = Rest(read_rows(x, len(x), "x"), graph)
    made = equations(constraints(graph, x, faces, count), rest)
    pinned = np.zeros(graph.node_count, dtype=bool)
    pinned[:PINNED] = True
    form = ow.differential(graph, x) / rest.scale
    v, other = (wp.array(values, dtype=wp.vec3d, device=device) for values in (form, 1.01 * form))
    constrained = Constrained(solver, made, rest.x)
    calm()
    _, alone = timed(lambda: solver.prepare(graph, pinned))
    state, prepared = timed(lambda: constrained.prepare(graph, pinned))
    _, free = timed(lambda: solver.solve(state.base, other, rest.x))
    solution, first = timed(lambda: constrained.solve(state, v, rest.x))
    _, again = timed(lambda: constrained.solve(state, other, rest.x))
    return {
        "solver": type(solver).__name__,
        "vertices": len(x),
        "constraints": count,
        "rows": made.count,
        "forms": made.scalar_columns.forms.shape[1],
        "solver alone s": alone.wall,
        "prepare s": prepared.wall,
        "prepare CPU s": prepared.cpu,
        "free solve s": free.wall,
        "solve s": first.wall,
        "again s": again.wall,
        "misfit": float(np.abs(solution.misfit[made.hard]).max()),
        "status": solution.status.word,
    }


def main(given: Options) -> None:
    device = given.device
    sizes = given.counts([100_000, 1_000_000] if given.full else [100_000])
    row(2_000, 6, SuperLU(), device)  # loads every kernel
    row(5_000, 6, Multigrid(), device)
    rows = []
    for size in sizes:
        host = not device.is_cuda and size <= 250_000
        rows += [row(size, count, SuperLU(), device) for count in COUNTS if host]
        rows += [row(size, count, Multigrid(), device) for count in (COUNTS if device.is_cuda else COUNTS[:1])]
    claim = f"linear constraints on a bumpy plane on {device.name}: six kinds, a third of them soft"
    report(f"constraints-{'cuda' if device.is_cuda else 'cpu'}", claim, rows, device)


if __name__ == "__main__":
    main(options())
