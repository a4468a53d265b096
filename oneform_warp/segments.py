"""Sums over each component in a fixed order: nodes of a component stand together and are cut into equal chunks.

A kernel over chunks is launched with `launch_chunks`: a block per chunk, its lanes stride over the chunk's nodes and
leave one partial sum; `sum_chunks` adds the partial sums of each component. No atomics, so runs repeat bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

__all__ = ["CHUNK", "LANES", "Segments", "largest", "launch_chunks", "sum_chunks"]

CHUNK = 512
"""Nodes per chunk: enough to amortise a block, few enough to fill a GPU from 100k nodes on."""

LANES = 128
"""Threads per block on CUDA; a CPU block has one."""

CROWDED = 2000
"""Chunks from which blocks of twice as many threads are faster, by a twentieth."""

MANY_LANES = 1024
"""The same for the sums of a component with many chunks, which one block adds up."""


@dataclass(frozen=True, eq=False)
class Segments:
    """The chunks of every component, on a device."""

    component_count: int
    chunk_count: int
    chunk_offsets: wp.array[wp.int32]
    """Nodes of chunk k: chunk_offsets[k] to chunk_offsets[k + 1]."""
    chunk_component: wp.array[wp.int32]
    component_chunks: wp.array[wp.int32]
    """Chunks of component c: component_chunks[c] to component_chunks[c + 1]."""
    lanes: int
    """Threads per block where a block is a chunk."""
    component_lanes: int
    """Threads per block where a block is a component."""
    device: Any

    @classmethod
    def from_offsets(cls, node_offsets: NDArray[np.int64], device: Any) -> Segments:
        """node_offsets: component c has the nodes node_offsets[c] to node_offsets[c + 1]."""
        sizes = np.diff(node_offsets)
        chunks = -(-sizes // CHUNK)
        component_chunks = np.concatenate([[0], np.cumsum(chunks)])
        component = np.repeat(np.arange(len(sizes)), chunks)
        inside = np.arange(len(component)) - component_chunks[component]
        starts = node_offsets[component] + CHUNK * inside
        offsets = np.append(starts, node_offsets[-1])

        def upload(values: NDArray[np.int64]) -> wp.array[wp.int32]:
            return wp.array(values.astype(np.int32), dtype=wp.int32, device=device)

        return cls(
            component_count=len(sizes),
            chunk_count=len(component),
            chunk_offsets=upload(offsets),
            chunk_component=upload(component),
            component_chunks=upload(component_chunks),
            lanes=LANES if len(component) < CROWDED else 2 * LANES,
            component_lanes=LANES if chunks.max(initial=0) <= 2 * LANES else MANY_LANES,
            device=device,
        )

    def zeros(self) -> wp.array[wp.vec3d]:
        """One vec3d per component."""
        return wp.zeros(self.component_count, dtype=wp.vec3d, device=self.device)

    def partials(self) -> wp.array[wp.vec3d]:
        """Room for one partial sum per chunk."""
        return wp.zeros(self.chunk_count, dtype=wp.vec3d, device=self.device)


def launch_chunks(kernel: wp.Kernel, segments: Segments, inputs: Sequence[Any], outputs: Sequence[Any] = ()) -> None:
    """One block per chunk; the kernel's first argument is the chunk offsets, its thread index (chunk, lane)."""
    wp.launch_tiled(
        kernel,
        dim=[segments.chunk_count],
        inputs=[segments.chunk_offsets, *inputs],
        outputs=list(outputs),
        block_dim=segments.lanes,
        device=segments.device,
    )


def launch_components(
    kernel: wp.Kernel, segments: Segments, inputs: Sequence[Any], outputs: Sequence[Any] = ()
) -> None:
    """One block per component; the kernel's first argument is the components' chunks."""
    wp.launch_tiled(
        kernel,
        dim=[segments.component_count],
        inputs=[segments.component_chunks, *inputs],
        outputs=list(outputs),
        block_dim=segments.component_lanes,
        device=segments.device,
    )


@wp.kernel(enable_backward=False)
def _largest(
    # In:
    value: wp.array[wp.float64],
    chunk: int,
    # Out:
    largest_out: wp.array[wp.float64],
):
    k, lane = wp.tid()
    most = wp.float64(0.0)
    for i in range(k * chunk + lane, wp.min((k + 1) * chunk, value.shape[0]), wp.block_dim()):
        most = wp.max(most, value[i])
    wp.tile_store(largest_out, wp.tile_max(wp.tile(most)), offset=k)


def largest(values: wp.array[wp.float64]) -> float:
    """The largest of values >= 0, and 0 where there are none."""
    blocks = -(-values.shape[0] // CHUNK)
    most = wp.zeros(blocks, dtype=wp.float64, device=values.device)
    wp.launch_tiled(
        _largest, dim=[blocks], inputs=[values, CHUNK], outputs=[most], block_dim=LANES, device=values.device
    )
    return float(most.numpy().max(initial=0.0))


@wp.func
def sum_of_chunks(component_chunks: wp.array[wp.int32], partial: wp.array[wp.vec3d], c: int, lane: int):
    """The sum of a component's partial sums, in a fixed order; the same value in every lane's tile."""
    part = wp.vec3d()
    for k in range(component_chunks[c] + lane, component_chunks[c + 1], wp.block_dim()):
        part += partial[k]
    return wp.tile_sum(wp.tile(part, preserve_type=True))


@wp.kernel(enable_backward=False)
def _sum_chunks(
    # Graph:
    component_chunks: wp.array[wp.int32],
    # In:
    partial: wp.array[wp.vec3d],
    # Out:
    sum_out: wp.array[wp.vec3d],
):
    c, lane = wp.tid()
    wp.tile_store(sum_out, sum_of_chunks(component_chunks, partial, c, lane), offset=c)


def sum_chunks(segments: Segments, partial: wp.array[wp.vec3d], sum_out: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
    """Partial sums per chunk -> sums per component."""
    launch_components(_sum_chunks, segments, [partial], [sum_out])
    return sum_out
