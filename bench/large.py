"""As many vertices as a device holds: a plane made on the device, its graph, hierarchy and solution, and their bytes.

`python -m bench.large [--device cuda:0] [--sizes 10M 100M]`
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import warp as wp

import oneform_warp as ow
from bench.memory import device_bytes
from bench.options import Options, options
from bench.table import report, timed
from oneform_warp.assembly import gather
from oneform_warp.forms import node_transformed_differential
from oneform_warp.solvers.multigrid import structure

TOL = 1.0e-4


@wp.kernel(enable_backward=False)
def _points(
    side: int,
    # Out:
    x_out: wp.array[wp.vec3d],
):
    i, j = wp.tid()
    seed = wp.rand_init(0, i * side + j)
    step = wp.float64(2.0) / wp.float64(side)
    across = wp.float64(i) + wp.float64(0.4) * wp.float64(wp.randf(seed) - 0.5)
    along = wp.float64(j) + wp.float64(0.4) * wp.float64(wp.randf(seed) - 0.5)
    x_out[i * side + j] = wp.vec3d(step * across, step * along, wp.float64(0.0))


@wp.kernel(enable_backward=False)
def _triangles(
    side: int,
    # Out:
    face_out: wp.array[wp.vec3i],
):
    i, j = wp.tid()
    a = i * side + j
    f = 2 * (i * (side - 1) + j)
    face_out[f] = wp.vec3i(a, a + side, a + 1)
    face_out[f + 1] = wp.vec3i(a + 1, a + side, a + side + 1)


@wp.kernel(enable_backward=False)
def _twist(
    # In:
    x: wp.array[wp.vec3d],
    # Out:
    omega_out: wp.array[wp.vec3d],
    sigma_out: wp.array[wp.float64],
):
    i = wp.tid()
    omega_out[i] = x[i][0] * wp.vec3d(wp.float64(1.0), wp.float64(2.0), wp.float64(3.0))
    sigma_out[i] = wp.float64(1.0)


def plane(count: int, device: Any) -> tuple[wp.array[wp.vec3d], wp.array[wp.vec3i]]:
    """About `count` jittered points of a square, and its triangles, on the device."""
    side = math.isqrt(count)
    x = wp.empty(side * side, dtype=wp.vec3d, device=device)
    faces = wp.empty(2 * (side - 1) ** 2, dtype=wp.vec3i, device=device)
    wp.launch(_points, dim=(side, side), inputs=[side], outputs=[x], device=device)
    wp.launch(_triangles, dim=(side - 1, side - 1), inputs=[side], outputs=[faces], device=device)
    return x, faces


def row(count: int, device: Any) -> dict[str, Any]:
    x, faces = plane(count, device)
    graph, graph_time = timed(partial(ow.Graph.from_faces, x, faces, weld=None, device=device))
    start = gather(x, graph.first_vertex)
    del x, faces
    graph_bytes = device_bytes(graph)
    omega, sigma = wp.empty_like(start), wp.empty(start.shape[0], dtype=wp.float64, device=device)
    wp.launch(_twist, dim=start.shape[0], inputs=[start], outputs=[omega, sigma], device=device)
    v = node_transformed_differential(graph, start, omega, sigma)
    del omega, sigma
    pinned = np.zeros(graph.node_count, dtype=bool)
    pinned[0] = True
    made, structure_time = timed(lambda: structure(graph))
    solver = ow.Multigrid(tol=TOL)
    state, prepare_time = timed(lambda: solver.prepare(graph, pinned))
    solver.solve(state, v, start)
    solution, again = timed(lambda: solver.solve(state, v, start))
    n = graph.node_count
    result = {
        "vertices": n,
        "edges/vertex": graph.edge_count / n,
        "graph s": graph_time.wall,
        "structure s": structure_time.wall,
        "prepare s": prepare_time.wall,
        "again s": again.wall,
        "iterations": solution.iterations,
        "status": solution.status.word,
        "levels": len(made.sizes),
        "graph B/vertex": graph_bytes / n,
        "solver B/vertex": (device_bytes(graph, made, state) - graph_bytes) / n,
    }
    if device.is_cuda:
        result["peak B/vertex"] = wp.get_mempool_used_mem_high(device) / n
    return result


def main(given: Options) -> None:
    device = given.device
    counts = given.counts([10_000_000, 30_000_000, 100_000_000] if device.is_cuda else [100_000])
    row(10_000, device)  # loads every kernel
    claim = f"a plane on {device.name}, made there: solved to {TOL}"
    rows: list[dict[str, Any]] = []
    for count in counts:
        try:
            rows.append(row(count, device))
        except (MemoryError, RuntimeError) as error:
            print(f"  {count}: does not fit, {type(error).__name__}: {error}", flush=True)
            break
        report(f"large-{'cuda' if device.is_cuda else 'cpu'}", claim, rows)


if __name__ == "__main__":
    main(options())
