"""Work W: from weights and a 1-form to positions, ours against every peer that imports, at the same error.

`python -m bench.solve [--full] [--device cuda:0] [--sizes sphere:7 delaunay:100k] [--methods ours pyamg]`
"""

from __future__ import annotations

import gc
import sys
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu

from bench.methods import Method, ours
from bench.options import Options, options
from bench.peers import cpu_peers
from bench.peers_cuda import cuda_peers
from bench.problem import Case, Problem
from bench.table import Timing, calm, report, save, show, timed

GOAL = 1.0e-6
"""The error that all methods have to reach."""

CLAIM = "setup and solve at an error of at most 1e-6, three right-hand sides"
REPEATS, SETUPS, PATIENCE = 5, 3, 8.0
"""Warm solves, setups, and the seconds after which a slow method is not repeated any more."""

QUICK = ("ours: Multigrid", "pyamg SA, filtered", "cvxopt", "pypardiso", "cuDSS")
"""In the short form, the methods for the weights and pins that are not the default: the fast ones."""


def main(given: Options) -> None:
    check_reference(given.device)
    rows: list[dict[str, Any]] = []
    where = "cuda" if given.device.is_cuda else "cpu"
    for case in cases(given):
        print(f"\n{case}", flush=True)
        rows += (lines := compare(case, given))
        show(lines)
        save(f"solve-{where}", CLAIM, rows)
    stages = [row for row in rows if "structure s" in row.get("stages", {})]
    if stages:
        about = ("mesh", "weights", "pins", "vertices")
        lines = [{c: row[c] for c in about} | row["stages"] for row in stages]
        report(f"first-{where}", "ours: the first solve of a mesh by stage", lines)


def cases(given: Options) -> list[Case]:
    """The default weights on every mesh; the other weights and pins on the first mesh, in the full form on all."""
    if given.device.is_cuda:
        meshes = ["sphere:8", "delaunay:1M"] + (["sphere:9", "sphere:10"] if given.full else [])
    else:
        meshes = ["delaunay:100k", "sphere:6", "sphere:7"] + (["delaunay:1M", "sphere:8"] if given.full else [])
    meshes = list(given.sizes) or meshes
    others = [Case(name, w) for name in meshes for w in ("uniform", "inverse_length")]
    others += [Case(name, "cotangent", "tenth") for name in meshes]
    first = [case for case in others if case.mesh == meshes[0]]
    return [*(Case(name) for name in meshes), *(others if given.full else first)]


def methods(case: Case, given: Options) -> list[Method]:
    peers = cuda_peers() if given.device.is_cuda else cpu_peers()
    words = given.methods or (() if given.full or case == Case(case.mesh) else QUICK)
    return [m for m in [*ours(), *peers] if not words or any(word in m.name for word in words)]


def compare(case: Case, given: Options) -> list[dict[str, Any]]:
    """One row per method."""
    tiny = Problem.of(Case("delaunay:6k", case.weights, case.pins), given.device)
    problem = Problem.of(case, given.device)
    rows = []
    for method in methods(case, given):
        about = {**asdict(case), "vertices": len(problem.pinned), "method": method.name}
        if problem.graph.node_count > method.largest:
            print(f"  {method.name}: left out above {method.largest} vertices", flush=True)
            continue
        try:
            measure(method, tiny)
            rows.append({**about, **measure(method, problem)})
        except ImportError as error:
            print(f"  {method.name}: left out, {error}", flush=True)
        except Exception as error:  # noqa: BLE001 - a peer may fail in any way, and the others go on
            print(f"  {method.name}: failed, {type(error).__name__}: {error}", flush=True)
        give_back_memory()
    return rows


def give_back_memory() -> None:
    """What a peer's pool keeps, the next method may need."""
    gc.collect()
    if "cupy" in sys.modules:
        sys.modules["cupy"].get_default_memory_pool().free_all_blocks()


def measure(method: Method, problem: Problem) -> dict[str, Any]:
    """Setup, first solve and warm solve of one method at the loosest tolerance that reaches GOAL."""
    data = method.load(problem)
    calm()
    state, setup = timed(lambda: method.setup(data))
    tol, tried, once = settle(method, state, problem)
    error, count = next((t["error"], t["iterations"]) for t in tried if t["tol"] == tol)
    # What takes long is measured once; the small problem before has loaded all code.
    setups, firsts, warm = list[Timing](), list[Timing](), [once] if once.wall > PATIENCE else []
    if setup.wall + once.wall > PATIENCE:
        setups, firsts = [setup], [once]
    while not setups or (len(setups) < SETUPS and sum(t.wall for t in setups + firsts) < PATIENCE):
        method.free(state)
        del state
        calm()
        state, took = timed(lambda: method.setup(data))
        setups.append(took)
        firsts.append(timed(lambda state=state: method.solve(state, tol))[1])
    while not warm or (len(warm) < REPEATS and sum(t.wall for t in warm) < PATIENCE):
        calm()
        (solution, _), took = timed(lambda state=state: method.solve(state, tol))
        warm.append(took)
        error = problem.error(method.positions(problem, solution))
    method.free(state)
    setup, again = Timing.median(setups), Timing.median(warm)
    both = Timing.median([a + b for a, b in zip(setups, firsts, strict=True)])
    row: dict[str, Any] = {"setup s": setup.wall, "solve s": again.wall, "both s": both.wall}
    if not problem.graph.device.is_cuda:
        row |= {"setup cpu s": setup.cpu, "solve cpu s": again.cpu, "both cpu s": both.cpu}
    row |= {"iterations": count, "tol": "-" if method.direct else f"{tol:.1e}", "error": error}
    row["reached"] = "yes" if error <= GOAL else "NO"
    row["tried"] = tried
    row["stages"] = method.stages(problem) if method.stages else {}
    return row


def settle(method: Method, state: Any, problem: Problem) -> tuple[float, list[dict[str, float]], Timing]:
    """The loosest tolerance found whose error is at most GOAL, all that were tried, and how long its solve took."""
    tol, tried, took = GOAL, list[dict[str, float]](), dict[float, Timing]()
    while len(tried) < 8:
        (solution, count), took[tol] = timed(lambda tol=tol: method.solve(state, tol))
        error = problem.error(method.positions(problem, solution))
        tried.append({"tol": tol, "error": error, "iterations": count})
        good = [t["tol"] for t in tried if t["error"] <= GOAL]
        close = any(0.4 * GOAL <= t["error"] <= GOAL for t in tried)
        if method.direct or close or not np.isfinite(error) or (good and sum(t.wall for t in took.values()) > PATIENCE):
            break
        # The error follows the tolerance about linearly; where it jumps past the goal, this halves the gap.
        factor = float(np.clip(0.7 * GOAL / max(error, 1e-300), 1e-3, 20.0))
        bad = [t["tol"] for t in tried if t["error"] > GOAL]
        tol *= factor
        if good and bad and not max(good) < tol < min(bad):
            tol = float(np.sqrt(max(good) * min(bad)))
    best = max(good, default=tried[-1]["tol"])
    return best, tried, took[best]


def check_reference(device: Any) -> None:
    """The float64 reference against SuperLU, where that is quick."""
    problem = Problem.of(Case("sphere:5"), device)
    exact = problem.moved(splu(problem.matrix.tocsc()).solve(problem.right_hand_side))
    print(f"the reference differs from SuperLU by {problem.error(exact):.1e} on {problem.case}", flush=True)


if __name__ == "__main__":
    main(options())
