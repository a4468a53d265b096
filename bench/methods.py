"""What a method of the comparison is, and ours as such."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import oneform_warp as ow
from bench.problem import Problem
from bench.table import timed
from oneform_warp.solvers.multigrid import structure


@dataclass(frozen=True)
class Method:
    """One way to solve a Problem, ours or a peer's, in four steps of which the middle two are timed."""

    name: str
    load: Callable[[Problem], Any]
    """Problem -> the data in the method's own format, on its device. ImportError where the package is missing."""
    setup: Callable[[Any], Any]
    """Data -> state: hierarchy, factor, preconditioner. Timed."""
    solve: Callable[[Any, float], tuple[Any, int]]
    """(state, tolerance) -> (solution, iterations), all three columns. Timed."""
    positions: Callable[[Problem, Any], NDArray[np.float64]] = Problem.moved
    """Solution -> positions per node, (n, 3)."""
    direct: bool = False
    """No tolerance to choose."""
    largest: int = 20_000_000
    """Vertices beyond which it takes too long or too much memory."""
    free: Callable[[Any], None] = lambda _state: None
    """Gives back what Python's own collection does not."""
    stages: Callable[[Problem], dict[str, float]] | None = None
    """The first solve of this problem taken apart, in seconds."""


def ours() -> list[Method]:
    """The package's solvers, with the defaults that a user gets."""
    return [
        _ours("ours: Multigrid", ow.Multigrid, stages=first_by_stage),
        _ours("ours: CG", ow.CG, largest=3_000_000),
        *(_ours(f"ours: {name}", made) for name, made in _direct_solvers()),
    ]


def _direct_solvers() -> Iterator[tuple[str, Any]]:
    """Those that this version has; each imports its own package when it prepares."""
    for name in ("Cholmod", "CuDSS", "SuperLU"):
        with suppress(AttributeError, ImportError):
            yield name, getattr(ow, name)


def first_by_stage(problem: Problem) -> dict[str, float]:
    """Faces -> graph -> structure -> hierarchy for the pins -> first and second solve, in seconds."""
    graph, solver = replace(problem.graph), ow.Multigrid()
    times = {"graph s": problem.graph_time.wall}
    _, took = timed(lambda: structure(graph))
    times["structure s"] = took.wall
    state, took = timed(lambda: solver.prepare(graph, problem.pinned))
    times["prepare s"] = took.wall
    for name in ("first solve s", "second solve s"):
        _, took = timed(lambda: solver.solve(state, problem.v, problem.start))
        times[name] = took.wall
    return times


def _ours(name: str, solver: Any, **options: Any) -> Method:
    def setup(problem: Problem) -> tuple[Problem, Any]:
        # A copy of the graph: what is remembered for a graph as long as it lives must be made anew.
        return problem, solver().prepare(replace(problem.graph), problem.pinned)

    def solve(made: tuple[Problem, Any], tol: float) -> tuple[Any, int]:
        problem, state = made
        solution = solver(tol=tol).solve(state, problem.v, problem.start)
        return solution, solution.iterations

    def positions(_problem: Problem, solution: Any) -> NDArray[np.float64]:
        return solution.x.numpy()

    return Method(name, lambda problem: problem, setup, solve, positions, **options)


def by_columns(solve: Callable[[Any], tuple[Any, int]], columns: list[Any]) -> tuple[list[Any], int]:
    """Solves for each column in turn -> (solutions, most iterations)."""
    results = [solve(column) for column in columns]
    return [x for x, _ in results], max(count for _, count in results)


class Counter:
    """A callback that counts how often it is called."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, *_: Any) -> None:
        self.count += 1
