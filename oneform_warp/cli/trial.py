"""A kernel that does next to nothing, to see whether kernels compile and run."""

# mypy: disable-error-code="index, no-untyped-def, untyped-decorator"
# (Warp checks a kernel's types when it compiles it.)

import tempfile
import time
from typing import Any

import numpy as np
import warp as wp

__all__ = ["try_device"]


@wp.kernel(enable_backward=False, module="unique")
def _double(
    # Out:
    x_out: wp.array[wp.float64],
):
    i = wp.tid()
    x_out[i] = x_out[i] * wp.float64(2.0)


def try_device(device: Any) -> tuple[float, str | None]:
    """Compile and run a kernel anew on a device -> seconds, and what went wrong."""
    cache, begin = wp.config.kernel_cache_dir, time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        wp.config.kernel_cache_dir = folder  # so that nothing compiled earlier is found
        try:
            x = wp.ones(3, dtype=wp.float64, device=device)
            wp.launch(_double, dim=3, outputs=[x], device=device)
            right = bool(np.all(x.numpy() == 2.0))
        except Exception as error:  # noqa: BLE001  # compilers and drivers raise anything
            return time.perf_counter() - begin, " ".join(str(error).split())
        finally:
            wp.config.kernel_cache_dir = cache
    return time.perf_counter() - begin, None if right else "a kernel computes nonsense"
