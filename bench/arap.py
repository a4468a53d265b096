"""One ARAP step, local and global: ours against libigl, from the same handles on the same mesh.

`python -m bench.arap [--full] [--device cuda:0] [--sizes sphere:7 grid:26k]`

A step is the difference of a long and a short run over their difference in steps, so that what comes once is left out.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import oneform_warp as ow
from bench.options import Options, options
from bench.problem import mesh
from bench.survey_cases import SurveyCase, bent
from bench.table import calm, report, timed

SHORT, LONG = 5, 25
REPEATS = 5


def step_seconds(run: Callable[[int], Any], on_cuda: bool) -> float:
    """(long - short) / steps between, the shortest of each; run(steps) is warm."""
    run(1)
    walls: dict[int, list[float]] = {SHORT: [], LONG: []}
    for _ in range(REPEATS):
        for steps, found in walls.items():
            if not on_cuda:
                calm()
            found.append(timed(partial(run, steps))[1].wall)
    return (min(walls[LONG]) - min(walls[SHORT])) / (LONG - SHORT)


def libigl_step(case: SurveyCase) -> float | str:
    """Of spokes and rims, its matrix factored before; the reason where it is not installed."""
    try:
        import igl
    except ImportError as error:
        return f"left out: {error}"
    data = igl.ARAPData()
    data.energy = igl.ARAP_ENERGY_TYPE_SPOKES_AND_RIMS
    igl.arap_precomputation(case.x, case.faces, 3, case.pins.astype(np.int32), data)

    def run(steps: int) -> None:
        data.max_iter = steps
        igl.arap_solve(case.targets, data, case.x.copy())

    return step_seconds(run, False)


def row(name: str, device: Any, peers: bool) -> dict[str, Any]:
    x, faces = mesh(name)
    along, about = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    case = bent(name, x, faces, along, (0.1, 0.9), about, 60.0)
    deformer = ow.Deformer(x, faces, device=device)
    refined = deformer.solve(case.handles, refine=LONG).refined
    own = step_seconds(lambda steps: deformer.solve(case.handles, refine=steps), device.is_cuda)
    found = {
        "mesh": name,
        "vertices": len(x),
        "solver": type(deformer.solver).__name__,
        "steps": len(refined.energies) - 1,
        "energy": refined.energies[-1] / refined.energies[0],
        "ours ms": 1e3 * own,
    }
    theirs = libigl_step(case) if peers else ""
    if isinstance(theirs, float):
        return found | {"libigl ms": 1e3 * theirs, "ours faster": theirs / own}
    return found | {"libigl ms": theirs}


def main(given: Options) -> None:
    on_cuda = given.device.is_cuda
    sizes = ["sphere:7", "sphere:8"] if on_cuda else ["grid:26k", "sphere:6", "sphere:7"]
    warnings.simplefilter("ignore")
    row("grid:6k", given.device, False)  # loads every kernel
    rows = [row(name, given.device, not given.methods) for name in given.sizes or sizes]
    claim = f"one ARAP step of spokes and rims on {given.device.name}: rotations and positions, milliseconds"
    report(f"arap-{'cuda' if on_cuda else 'cpu'}", claim, rows)


if __name__ == "__main__":
    main(options())
