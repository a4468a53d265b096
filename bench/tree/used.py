"""The package's starts with the package's solvers and their defaults: the default rule against the best of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp

import oneform_warp as ow
from bench.tree.cases import Problem
from bench.tree.hierarchy_seeds import nested
from bench.tree.rule import looked_at, package_start

STARTS = ("rest", "auto", "rings", "min_depth", "maximal", "minimal", "zero")
"""Of the package; nested iteration besides."""

SOLVERS = {"multigrid": ow.Multigrid(), "Jacobi CG": ow.CG(), "Jacobi": ow.Jacobi(tol=1.0e-3)}
"""With their defaults, float32 inside; Jacobi to a residual that it reaches."""

ROUNDS, PATIENCE = 5, 5.0


def used(problem: Problem, solvers: Sequence[str]) -> list[dict[str, Any]]:
    """A row per solver and start."""
    about = {**problem.case.facts, "nodes": problem.graph.node_count, **looked_at(problem)}
    return [{**about, **row} for name in solvers if name in SOLVERS for row in timed_starts(problem, name)]


def timed_starts(problem: Problem, name: str) -> list[dict[str, Any]]:
    """Iterations, and seconds of start and solve.

    Starts take turns in random order, so that shared cores and what ran before disturb them alike. A solve costs what
    it costs from any start: "seconds" is the median of making the start, and `a + b * iterations` fitted to all solves.
    """
    solver: Any = SOLVERS[name]
    state = solver.prepare(problem.graph, problem.shape.pinned)
    makers: dict[str, Callable[[], Any]] = {
        start: (lambda start=start: package_start(start, problem, solver)) for start in STARTS
    }
    if name == "multigrid":
        makers["nested"] = lambda: nested(problem)
    made: dict[str, list[float]] = {start: [] for start in makers}
    solved: dict[str, list[float]] = {start: [] for start in makers}
    counts: dict[str, int] = {}
    took_rings = False
    began = time.perf_counter()
    turns = np.random.default_rng(0)
    for number in range(ROUNDS + 1):
        for start in turns.permutation(list(makers)):
            x, making = _seconds(makers[start])
            took_rings = took_rings or (start == "auto" and x is not problem.rest)
            solution, solving = _seconds(lambda x=x: solver.solve(state, problem.v, x))
            counts[start] = solution.iterations
            # The first round has found cycles and trees that are kept.
            if number:
                made[start].append(making)
                solved[start].append(solving)
        if number and time.perf_counter() - began > PATIENCE:
            break
    opening, once = line([(counts[start], t) for start, times in solved.items() for t in times])
    return [
        {
            "solver": name,
            "start": start,
            "iterations": counts[start],
            "start s": statistics.median(made[start]),
            "opening s": opening,
            "iteration s": once,
            "seconds": statistics.median(made[start]) + opening + counts[start] * once,
            "wall s": statistics.median(made[start]) + statistics.median(solved[start]),
            "took": ("rings" if took_rings else "rest") if start == "auto" else "",
        }
        for start in makers
    ]


def line(points: Sequence[tuple[int, float]]) -> tuple[float, float]:
    """(a, b) of y = a + b x: the median slope of all pairs of points, and the median of what is left (Theil, Sen)."""
    x, y = (np.array(column, dtype=np.float64) for column in zip(*points, strict=True))
    i, j = np.triu_indices(len(x), 1)
    apart = x[i] != x[j]
    slope = float(np.median((y[j] - y[i])[apart] / (x[j] - x[i])[apart])) if apart.any() else 0.0
    return float(np.median(y - slope * x)), slope


def _seconds(work: Callable[[], Any]) -> tuple[Any, float]:
    wp.synchronize()
    began = time.perf_counter()
    value = work()
    wp.synchronize()
    return value, time.perf_counter() - began
