"""The standard cases of the survey: ours against libigl and Open3D at equal targets, and at equal wall time.

`python -m bench.survey [--full] [--sizes bar cactus] [--methods ours libigl]`; --sizes names cases here.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.arap_methods import SMOOTH, ArapMethod, libigl, open3d, ours, paced
from bench.options import Options, options
from bench.survey_cases import MESHES, SurveyCase, cases
from bench.table import calm, save, show, timed
from oneform_warp.measures import Measures, measures

REPEATS = 30
"""Of which the shortest counts: what else runs on a machine only adds. Fewer where they take more than PATIENCE."""

PATIENCE = 3.0
"""Seconds."""

BUDGETS = (10, 100)
"""Ours gets the time that libigl takes for so many steps."""

SLACK = 1.02
"""By how much of it a run may be longer and still count as within it: clocks of shared machines are no better."""

EQUAL = 1.001
"""A ratio up to which two methods that have both arrived at one minimum are equal."""

MOST_STEPS = 5_000

TRIES = 5
"""Runs to find out how many steps fit into a budget."""

LADDER = (0, 1, 2, 3, 5, 8, 13, 21, 34, 55, 89)
"""Steps at which ours is looked at on its way."""

COLUMNS: dict[str, Callable[[Measures], float | int | None]] = {
    "ARAP": lambda m: m.arap,
    "dihedral": lambda m: m.dihedral_rms,
    "dihedral max": lambda m: m.dihedral_max,
    "edge %": lambda m: 100.0 * m.edge_rms,
    "edge max %": lambda m: 100.0 * m.edge_max,
    "Dirichlet": lambda m: m.symmetric_dirichlet,
    "s min": lambda m: m.singular_min,
    "s max": lambda m: m.singular_max,
    "area %": lambda m: 100.0 * (m.area - 1.0),
    "volume %": lambda m: None if m.volume is None else 100.0 * (m.volume - 1.0),
    "crossings": lambda m: m.self_intersections,
    "handle %": lambda m: 100.0 * m.handle_max,
}


def clock(method: ArapMethod, case: SurveyCase) -> tuple[NDArray[np.float64], float]:
    """Positions, and the shortest wall time."""
    calm()
    walls: list[float] = []
    while len(walls) < REPEATS and sum(walls) < PATIENCE:
        y, took = timed(partial(method.run, case))
        walls.append(took.wall)
    return y, min(walls)


def row(case: SurveyCase, method: str, steps: int | str, y: NDArray[np.float64], seconds: float) -> dict[str, Any]:
    m = measures(case.x, y, case.faces, targets=(case.pins, case.targets))
    values = {name: value for name, of in COLUMNS.items() if (value := of(m)) is not None}
    return {"case": case.name, "method": method, "steps": steps, "ms": 1e3 * seconds} | values


def rows_of(case: SurveyCase, given: Options) -> list[dict[str, Any]]:
    """All methods on one case; peers first, whose times are ours as well."""
    seconds: dict[str, float] = {}
    rows = [r for steps in (10, 100, 1000) for r in _peer(libigl(steps), steps, case, given, seconds)]
    rows += _peer(open3d(100), 100, case, given, seconds)
    if _wanted("ours", given):
        rows += _ours(case, given.device, {steps: seconds.get(libigl(steps).name) for steps in BUDGETS})
    return rows


def _ours(case: SurveyCase, device: Any, budgets: dict[int, float | None]) -> list[dict[str, Any]]:
    """One solve, ten steps more, and as many as fit into each budget of seconds."""
    (y, none), (z, ten) = (clock(ours(steps, device), case) for steps in (0, 10))
    rows = [row(case, ours(0).name, 0, y, none), row(case, ours(10).name, 10, z, ten)]
    rows[0]["path"] = _path(case, device)
    each = max((ten - none) / 10.0, 1e-6)
    for steps_of_libigl, budget in budgets.items():
        if budget is not None:
            guess = int(min(max((budget - none) / each, 0.0), MOST_STEPS))
            rows.append(row(case, within(steps_of_libigl), *_within(case, device, budget, none, guess)))
    return rows


def _path(case: SurveyCase, device: Any) -> list[tuple[int, float, float]]:
    """(steps, ARAP energy, dihedral RMS) without a clock: smoother shapes may come before that of least energy."""
    found = []
    for steps in LADDER:
        m = measures(case.x, paced(steps, device).run(case), case.faces, intersections=False)
        found.append((steps, m.arap, m.dihedral_rms))
    return found


def within(steps: int) -> str:
    """The name of ours in libigl's time."""
    return f"ours, in the time of {libigl(steps).name}"


def _within(
    case: SurveyCase, device: Any, budget: float, none: float, steps: int
) -> tuple[int, NDArray[np.float64], float]:
    """As many steps as the budget of seconds allows, near a guess; none, which take `none`, may be too many."""
    tried: dict[int, tuple[NDArray[np.float64], float]] = {}
    while steps not in tried and len(tried) < TRIES:
        y, took = clock(paced(steps, device), case)
        tried[steps] = y, took
        each = max((took - none) / max(steps, 1), 1e-6)
        steps = int(min(max((budget - none) / each, 0.0), MOST_STEPS, 2 * steps + 1))
    fitting = [count for count, (_, took) in tried.items() if took <= SLACK * budget]
    best = max(fitting) if fitting else min(tried)
    return best, *tried[best]


def _wanted(name: str, given: Options) -> bool:
    return not given.methods or any(word in name for word in given.methods)


def _peer(
    method: ArapMethod, steps: int, case: SurveyCase, given: Options, seconds: dict[str, float]
) -> list[dict[str, Any]]:
    """The row of a peer; of one that is not installed or fails, the reason."""
    if not _wanted(method.name, given):
        return []
    try:
        y, seconds[method.name] = clock(method, case)
    except (ImportError, RuntimeError) as error:
        return [{"case": case.name, "method": method.name, "steps": f"left out: {error}"}]
    return [row(case, method.name, steps, y, seconds[method.name])]


def verdicts(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Ours over libigl at equal wall time, by case: below 1 is better.

    both lower from ... to: the steps on our way at which energy and dihedral angles are both below libigl's.
    """
    found = []
    for case in dict.fromkeys(r["case"] for r in rows):
        by_name = {r["method"]: r for r in rows if r["case"] == case}
        for steps in BUDGETS:
            theirs, own = by_name.get(libigl(steps).name, {}), by_name.get(within(steps), {})
            if "ms" in theirs and "ms" in own:
                path = by_name[ours(0).name]["path"]
                both = [k for k, e, d in path if e < theirs["ARAP"] and d < theirs["dihedral"] and k <= own["steps"]]
                ratios = {name: own[name] / theirs[name] for name in ("ms", "ARAP", "dihedral")}
                found.append({"case": case, "libigl's steps": steps, "our steps": own["steps"]}
                             | ratios | {"verdict": _verdict(**ratios)}
                             | {"both lower at": f"{both[0]} to {both[-1]}" if both else "none"})  # fmt: skip
    return found


def _verdict(ms: float, ARAP: float, dihedral: float) -> str:
    if ms > SLACK:
        return "too slow"
    if max(ARAP, dihedral) <= 1.0:
        return "better"
    return "equal" if max(ARAP, dihedral) <= EQUAL else "WORSE"


def main(given: Options) -> None:
    if not MESHES.is_dir():
        print("bench.survey: the real meshes are not here, set ONEFORM_MESHES to their folder")
        return
    rows: list[dict[str, Any]] = []
    for case in cases(full=given.full, words=given.sizes):
        ours(1, given.device).run(case)  # loads every kernel
        of_case = rows_of(case, given)
        print()
        show(of_case)
        rows += of_case
    claim = (
        "standard cases at equal targets, from arrays to positions. ARAP: spokes and rims, a third of libigl's energy; "
        "dihedral: RMS change in degrees; edge: RMS change; s: factors by which triangles stretch; handle: of the box"
    )
    print(f"\n{claim}\n\nours, smooth = {SMOOTH:g} / steps, over libigl in the time of its steps, below 1 is better")
    show(verdicts(rows))
    save(f"survey-{'cuda' if given.device.is_cuda else 'cpu'}", claim, rows, given.device)


if __name__ == "__main__":
    main(options())
