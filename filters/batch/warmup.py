"""One deformation before the fan-out: kernels are compiled once, and what cannot run at all is known at once."""

import numpy as np

from oneform_warp import shapes
from oneform_warp.deformer import deform
from oneform_warp.filters.batch.worker import share_gpus
from oneform_warp.handles import Handle

__all__ = ["warm_up"]

SEGMENTS = (4, 64)  # few vertices and many: each has a solver of its own by default


def warm_up(_: None) -> int:
    """Deform bars of both sizes, so that the kernels lie in Warp's cache, and count the GPUs for the workers.

    The parent does not ask for them itself: CUDA would start there, and take memory of a GPU.
    """
    import warp as wp

    for segments in SEGMENTS:
        x, faces = shapes.bar(segments=segments, sides=16)
        low, high = np.quantile(x[:, 2], (0.1, 0.9))
        handles = [Handle(x[:, 2] <= low, held=True), Handle(x[:, 2] >= high, axis="z", angle=30)]
        deform(x, faces, handles)
    gpus = int(wp.get_cuda_device_count())
    share_gpus(gpus)
    return gpus
