"""The cost by size: seconds of each stage, iterations to an error of 1e-6, and bytes a vertex on the device.

`python -m bench.scale [--full] [--device cuda:0] [--sizes 10k 1M]`
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import warp as wp

import oneform_warp as ow
from bench.memory import device_bytes
from bench.methods import ours
from bench.options import Options, options
from bench.problem import Case, Problem
from bench.solve import settle
from bench.table import Timing, calm, report, timed
from oneform_warp.solvers.multigrid import structure

REPEATS = 5
REFERENCE_UP_TO = 12_000_000
"""Nodes; above, the iterations are those to a residual of 1e-6, since the float64 reference is left out."""


def row(name: str, device: Any) -> dict[str, Any]:
    problem = Problem.of(Case(name), device)
    count = len(problem.pinned)
    calm()
    graph = replace(problem.graph)
    before = wp.get_mempool_used_mem_current(device) if device.is_cuda else 0
    made, structure_time = timed(lambda: structure(graph))
    state, prepare_time = timed(lambda: ow.Multigrid().prepare(graph, problem.pinned))
    _, first = timed(lambda: ow.Multigrid().solve(state, problem.v, problem.start))
    tol, error = 1.0e-6, float("nan")
    if count <= REFERENCE_UP_TO:
        tol, tried, _ = settle(ours()[0], (problem, state), problem)
        error = next(t["error"] for t in tried if t["tol"] == tol)
    again = []
    for _ in range(REPEATS):
        calm()
        solution, took = timed(lambda: ow.Multigrid(tol=tol).solve(state, problem.v, problem.start))
        again.append(took)
    seconds = {
        "graph s": problem.graph_time.wall,
        "structure s": structure_time.wall,
        "prepare s": prepare_time.wall,
        "first s": first.wall,
        "solve s": Timing.median(again).wall,
    }
    memory = {
        "graph B/vertex": device_bytes(problem.graph) / count,
        "solver B/vertex": (device_bytes(problem.graph, made, state) - device_bytes(problem.graph)) / count,
        "edges/vertex": graph.edge_count / count,
    }
    if device.is_cuda:
        memory["peak B/vertex"] = wp.get_mempool_used_mem_high(device) / count
        memory["of these before"] = before / count
    quality = {"iterations": solution.iterations, "tol": f"{tol:.1e}", "error": error, "status": solution.status.word}
    shape = {"levels": len(made.sizes), "complexity": made.complexity}
    return {"mesh": name, "vertices": count, **seconds, **quality, **shape, **memory}


def main(given: Options) -> None:
    device = given.device
    sizes = ["grid:10k", "grid:30k", "grid:100k"]
    if given.full or device.is_cuda:
        sizes += ["grid:300k", "grid:1M", "delaunay:1M"]
    if given.full and device.is_cuda:
        sizes += ["grid:3M", "grid:10M", "grid:30M"]
    name, claim = f"scale-{'cuda' if device.is_cuda else 'cpu'}", f"Multigrid by size on {device.name}"
    row("grid:6k", device)  # loads every kernel
    rows: list[dict[str, Any]] = []
    for size in given.sizes or sizes:
        try:
            rows.append(row(size if ":" in size else f"grid:{size}", device))
        except (MemoryError, RuntimeError) as error:
            print(f"  {size}: does not fit, {type(error).__name__}: {error}", flush=True)
            break
        report(name, claim, rows)


if __name__ == "__main__":
    main(options())
