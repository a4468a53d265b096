"""What nothing holds keeps its centroid: the constant that the 1-form leaves open."""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.graph import Graph
from oneform_warp.segments import launch_chunks, sum_chunks

__all__ = ["keep_centroids"]


@wp.kernel(enable_backward=False)
def _moves(
    chunk_offsets: wp.array[wp.int32],
    # In:
    copies: wp.array[wp.float64],
    x: wp.array[wp.vec3d],
    like: wp.array[wp.vec3d],
    # Out:
    move_out: wp.array[wp.vec3d],
    count_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    move = wp.vec3d()
    count = wp.vec3d()
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        move += copies[i] * (like[i] - x[i])
        count += wp.vec3d(copies[i])
    wp.tile_store(move_out, wp.tile_sum(wp.tile(move, preserve_type=True)), offset=k)
    wp.tile_store(count_out, wp.tile_sum(wp.tile(count, preserve_type=True)), offset=k)


@wp.kernel(enable_backward=False)
def _shift(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    chunk_component: wp.array[wp.int32],
    # In:
    floating: wp.array[wp.float64],
    move: wp.array[wp.vec3d],
    count: wp.array[wp.vec3d],
    # Out:
    x_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    c = chunk_component[k]
    by = floating[c] * wp.cw_div(move[c], count[c])
    for i in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        x_out[i] = x_out[i] + by


def keep_centroids(graph: Graph, floating: NDArray[np.bool_], x: wp.array[wp.vec3d], like: wp.array[wp.vec3d]) -> None:
    """Moves each floating component of x, in place, so that the mean of its vertices is the one it has in `like`.

    floating: (components with edges,); x, like: rows per node. A welded node counts once per vertex.
    """
    if not floating.any():
        return
    segments = graph.segments
    parts = segments.partials(), segments.partials()
    launch_chunks(_moves, segments, [graph.copies, x, like], list(parts))
    move, count = (sum_chunks(segments, part, segments.zeros()) for part in parts)
    which = wp.array(floating.astype(np.float64), dtype=wp.float64, device=graph.device)
    launch_chunks(_shift, segments, [segments.chunk_component, which, move, count], [x])
