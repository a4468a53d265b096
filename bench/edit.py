"""A whole edit: a handle has changed, and the new positions are wanted (fields and solve to 1e-4).

`python -m bench.edit [--full] [--device cuda:0] [--sizes sphere:8 grid:100k]`
"""

from __future__ import annotations

import statistics
from functools import partial
from typing import Any

import numpy as np

import oneform_warp as ow
from bench.options import Options, options
from bench.problem import mesh
from bench.table import calm, report, timed

TOL = 1.0e-4
EDITS = 5
STAGES = ("fields", "1-form", "start", "prepare", "solve")


def handles(x: np.ndarray, angle: float) -> list[ow.Handle]:
    """A tenth of the mesh is held at one end, a tenth is turned at the other."""
    axis = int(np.argmax(np.ptp(x, axis=0)))
    t = (x[:, axis] - x[:, axis].min()) / np.ptp(x[:, axis])
    return [ow.Handle(t < 0.1, held=True), ow.Handle(t > 0.9, axis="xyz"[axis], angle=angle)]


def rows_of(name: str, device: Any) -> list[dict[str, Any]]:
    """The first edit of a mesh, and the median of later ones."""
    x, faces = mesh(name)
    deformer, made = timed(lambda: ow.Deformer(x, faces, weld=None, solver=ow.Multigrid(tol=TOL), device=device))
    edits = []
    for k in range(1 + EDITS):
        chosen, start = handles(x, 90.0 + 15.0 * k), "previous" if k else "rest"
        if not device.is_cuda:
            calm()  # a GPU would fall asleep meanwhile, which nobody who drags a handle lets it
        solution, took = timed(partial(deformer.solve, chosen, start=start))
        edits.append({**{stage: solution.seconds[stage] for stage in STAGES}, "wall": took.wall})
    later = {column: statistics.median(edit[column] for edit in edits[1:]) for column in edits[0]}
    about = {"mesh": name, "vertices": len(x)}
    last = {"iterations": solution.iterations, "status": solution.status.word}
    return [
        about | {"edit": "first", "deformer": made.wall} | edits[0] | last,
        about | {"edit": "later", "deformer": 0.0} | later | last,
    ]


def main(given: Options) -> None:
    on_cuda = given.device.is_cuda
    sizes = ["sphere:8", "sphere:9"] if on_cuda else ["grid:10k", "sphere:6", "grid:100k"]
    if given.full:
        sizes += ["sphere:10"] if on_cuda else ["sphere:8"]
    rows_of("grid:6k", given.device)  # loads every kernel
    rows = [row for name in given.sizes or sizes for row in rows_of(name, given.device)]
    claim = (
        f"a whole edit on {given.device.name}: seconds by stage; wall also has the checks and the copies to the host"
    )
    report(f"edit-{'cuda' if on_cuda else 'cpu'}", claim, rows)


if __name__ == "__main__":
    main(options())
