"""Iterations counted one by one, with the position error and the residual after each."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

import oneform_warp as ow
from bench.tree.cases import Problem
from oneform_warp.segments import launch_chunks
from oneform_warp.solvers.refinement import State

TOLERANCES = (1.0e-3, 1.0e-5, 1.0e-7)


@wp.kernel(enable_backward=False)
def _farthest(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    # In:
    start: wp.array[wp.vec3d],
    e: wp.array[wp.vec3d],
    unit: wp.array[wp.vec3d],
    scale: wp.float64,
    reference: wp.array[wp.vec3d],
    # Out:
    farthest_out: wp.array[wp.float64],
):
    k, lane = wp.tid()
    by = scale * unit[chunk_component[k]]
    most = wp.float64(0.0)
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        most = wp.max(most, wp.length(start[i] + wp.cw_mul(by, e[i]) - reference[i]))
    wp.tile_store(farthest_out, wp.tile_max(wp.tile(most)), offset=k)


@dataclass(frozen=True)
class Counted:
    """A solver whose iterations are counted, in float64 from the start to the end, without restarts."""

    name: str
    solver: Any
    plain: bool = False
    """Without the Jacobi preconditioner."""
    cap: int = 20_000

    def prepare(self, problem: Problem) -> State:
        state = self.solver.prepare(problem.graph, problem.shape.pinned)
        if self.plain:
            inverse = state.inner.rows.inverse_diagonal
            ones = wp.array((inverse.numpy() > 0.0).astype(np.float64), dtype=wp.float64, device=inverse.device)
            state.inner.rows = replace(state.inner.rows, inverse_diagonal=ones)
        return state


SOLVERS = {
    "multigrid": Counted("multigrid", ow.Multigrid(dtype="float64"), cap=100),
    "Jacobi CG": Counted("Jacobi CG", ow.CG(dtype="float64")),
    "plain CG": Counted("plain CG", ow.CG(dtype="float64"), plain=True),
    "Jacobi": Counted("Jacobi", ow.Jacobi(dtype="float64"), cap=10_000),
}


@dataclass(frozen=True)
class Count:
    """Iterations until each of TOLERANCES is reached, None where the cap came first."""

    residual: tuple[int | None, ...]
    """max over columns of |r| / |codiff v|."""
    position: tuple[int | None, ...]
    """The largest distance from the minimiser over the box's diagonal."""


def trace(counted: Counted, state: State, problem: Problem, start: Any) -> Count:
    """From `start` until the last tolerance of both kinds is reached, or the cap."""
    system, inner, goals = state.system, state.inner, state.system.goals
    r = wp.empty_like(start)
    system.open(start, problem.v, start, 1.0, r)
    reference = goals.account().goal
    goals.take_aim(inner.floor)
    goals.aim.zero_()
    # A budget of none: the vectors are set up, and no iteration is made.
    inner.correct(r, 0, None)
    segments = problem.graph.segments
    farthest = wp.zeros(segments.chunk_count, dtype=wp.float64, device=start.device)
    inputs = [segments.chunk_component, start, inner.e, goals.unit, wp.float64(inner.rows.scale), problem.reference]
    found: list[list[int | None]] = [[None] * len(TOLERANCES) for _ in range(2)]

    def look(count: int) -> bool:
        launch_chunks(_farthest, segments, inputs, [farthest])
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(reference > 0.0, goals.norms() / reference, 0.0)
        sizes = float(ratio.max()), float(farthest.numpy().max()) / problem.shape.diagonal
        for size, line in zip(sizes, found, strict=True):
            for k, tol in enumerate(TOLERANCES):
                if line[k] is None and size <= tol:
                    line[k] = count
        return all(line[-1] is not None for line in found) or not np.isfinite(sizes).all()

    _iterate(inner._iterate, look, counted.cap)
    return Count(tuple(found[0]), tuple(found[1]))


def _iterate(once: Callable[[], None], look: Callable[[int], bool], cap: int) -> None:
    """One by one, and looked at after each, or after a hundredth more of many."""
    done = 0
    while not look(done) and done < cap:
        step = max(done // 100, 1)
        for _ in range(step):
            once()
        done += step


def iteration_seconds(state: State, repeats: int = 5) -> float:
    """The median over batches of what one iteration takes."""
    loop = state.inner.loop
    loop.one_batch.run()
    loop.one_batch.run()
    walls = []
    for _ in range(repeats):
        wp.synchronize()
        began = time.perf_counter()
        loop.one_batch.run()
        wp.synchronize()
        walls.append(time.perf_counter() - began)
    return statistics.median(walls) / loop.batch
