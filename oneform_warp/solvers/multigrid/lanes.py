"""Rows shared by several threads: where a level has few rows, one thread each would wait for memory in turn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import warp as wp

__all__ = ["launch_rows", "sum_over_lanes"]

WARP_SIZE = 32

# A kernel for a CPU has one lane, and nothing to add.
_SUM = """
#if defined(__CUDA_ARCH__)
    for (int step = lanes / 2; step > 0; step /= 2)
        for (int d = 0; d < 3; ++d)
            part[d] += __shfl_xor_sync(0xffffffffu, part[d], step);
#endif
    return part;
"""


@wp.func_native(snippet=_SUM)
def sum_over_lanes(part: wp.vec3, lanes: int) -> wp.vec3:
    """The sum of `part` over the lanes of a row, in a fixed order, for each of them; every thread must call it."""


def launch_rows(
    kernel: wp.Kernel, count: int, lanes: int, inputs: Sequence[Any], outputs: Sequence[Any], device: Any
) -> None:
    """`lanes` threads for each of `count` rows: thread t is lane t % lanes of row t // lanes; some rows do not exist.

    lanes: 1, 2, 4 to 32, the kernel's last input; one on a CPU.
    """
    shared = lanes if device.is_cuda else 1
    # Whole warps, so that the lanes of a row are all there or none is.
    threads = -(-count * shared // WARP_SIZE) * WARP_SIZE if device.is_cuda else count
    wp.launch(kernel, dim=threads, inputs=[*inputs, shared], outputs=list(outputs), device=device)
