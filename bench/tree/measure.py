"""One case: every seed, its energy, its position error and what it costs, and every solver from every seed."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import warp as wp

from bench.tree.cases import Problem
from bench.tree.seeds import FEW, Seed
from bench.tree.theory import predict
from bench.tree.trace import SOLVERS, iteration_seconds, trace
from oneform_warp.forms import node_energy

EXPLAINED = 60_000
"""Nodes up to which trees are explained: paths are walked edge by edge."""

BY_JACOBI = (*FEW, "held: min depth + 16 sweeps", "held: min depth + 64 sweeps")
"""The seeds from which Jacobi runs too, which takes its time."""


def seconds(work: Callable[[], Any], repeats: int) -> float:
    """The median of `repeats` runs; of fewer where they take more than a second."""
    return made_in(work, repeats)[1]


def made_in(work: Callable[[], Any], repeats: int) -> tuple[Any, float]:
    """What the last of them made, and the median."""
    walls: list[float] = []
    while len(walls) < repeats and sum(walls) < 1.0:
        wp.synchronize()
        began = time.perf_counter()
        value = work()
        wp.synchronize()
        walls.append(time.perf_counter() - began)
    return value, statistics.median(walls)


def measure(problem: Problem, seeds: Sequence[Seed], solvers: Sequence[str], repeats: int) -> list[dict[str, Any]]:
    """A row per seed: columns "SOLVER residual" and "SOLVER position" list the iterations for each tolerance."""
    counted = [SOLVERS[name] for name in solvers]
    states = [each.prepare(problem) for each in counted]
    once = {}
    for each, state in zip(counted, states, strict=True):
        r = wp.empty_like(problem.rest)
        state.system.open(problem.rest, problem.v, problem.rest, 1.0e-12, r)
        state.system.goals.take_aim(state.inner.floor)
        state.inner.correct(r, 0, None)
        once[f"{each.name} iteration s"] = iteration_seconds(state)
    # Found before any seed is timed.
    _ = problem.reference, problem.previous
    about = {
        **problem.case.facts,
        "nodes": problem.graph.node_count,
        "edges": problem.graph.edge_count,
        "exactness": problem.exactness,
        "least": problem.least,
    }
    rows = []
    for seed in seeds:
        x, took = made_in(partial(seed.make, problem), repeats)
        farthest, mean = problem.errors(x)
        row: dict[str, Any] = {
            **about,
            "seed": seed.name,
            "energy": node_energy(problem.graph, x, problem.v)[0] / max(problem.least, 1e-300),
            "farthest": farthest,
            "rms": mean,
            "seed s": took,
            **once,
        }
        for each, state in zip(counted, states, strict=True):
            if each.name == "Jacobi" and seed.name not in BY_JACOBI:
                continue
            count = trace(each, state, problem, x)
            row[f"{each.name} residual"], row[f"{each.name} position"] = list(count.residual), list(count.position)
        if seed.tree is not None and seed.name.startswith("held") and problem.graph.node_count <= EXPLAINED:
            row["theory"] = asdict(predict(problem, seed.tree(problem)))
        rows.append(row)
    return rows
