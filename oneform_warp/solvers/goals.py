"""How small the residual has to become, per component and column: kept on the device, so that nobody waits to ask."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.segments import Segments, launch_components, sum_of_chunks

__all__ = ["Account", "Goals", "attainable"]

SAFETY = wp.constant(wp.float64(0.5))
"""The inner solver aims below the goal, since its residual drifts from the true one."""

EPSILON = wp.constant(wp.float64(np.finfo(np.float64).eps))


@wp.kernel(enable_backward=False)
def _set(
    component_chunks: wp.array[wp.int32],
    # In:
    square: wp.array[wp.vec3d],
    reference: wp.array[wp.vec3d],
    rounding: wp.array[wp.vec3d],
    tol: wp.float64,
    # Out:
    norm_out: wp.array[wp.vec3d],
    goal_out: wp.array[wp.vec3d],
):
    c, lane = wp.tid()
    square_sum = wp.tile_extract(sum_of_chunks(component_chunks, square, c, lane), 0)
    reference_sum = wp.tile_extract(sum_of_chunks(component_chunks, reference, c, lane), 0)
    rounding_sum = wp.tile_extract(sum_of_chunks(component_chunks, rounding, c, lane), 0)
    if lane == 0:
        norm = wp.vec3d()
        goal = wp.vec3d()
        for d in range(3):
            norm[d] = wp.sqrt(square_sum[d])
            least = EPSILON * wp.sqrt(rounding_sum[d])
            size = wp.sqrt(reference_sum[d])
            # A form that is co-closed to rounding, as v = 0 is, has no size to compare with.
            goal[d] = wp.max(tol * wp.where(size > least, size, norm[d]), least)
        norm_out[c] = norm
        goal_out[c] = goal


@wp.kernel(enable_backward=False)
def _norm(
    component_chunks: wp.array[wp.int32],
    # In:
    square: wp.array[wp.vec3d],
    # Out:
    before_out: wp.array[wp.vec3d],
    norm_out: wp.array[wp.vec3d],
):
    c, lane = wp.tid()
    total = wp.tile_extract(sum_of_chunks(component_chunks, square, c, lane), 0)
    if lane == 0:
        before_out[c] = norm_out[c]
        norm_out[c] = wp.vec3d(wp.sqrt(total[0]), wp.sqrt(total[1]), wp.sqrt(total[2]))


@wp.kernel(enable_backward=False)
def _aim(
    # In:
    norm: wp.array[wp.vec3d],
    goal: wp.array[wp.vec3d],
    floor: wp.float64,
    # Out:
    unit_out: wp.array[wp.vec3d],
    size_out: wp.array[wp.vec3d],
    aim_out: wp.array[wp.vec3d],
    peak_out: wp.array[wp.vec3d],
):
    c = wp.tid()
    unit = wp.vec3d()
    size = wp.vec3d()
    aim = wp.vec3d()
    for d in range(3):
        unit[d] = wp.float64(1.0)
        if norm[c][d] > wp.float64(0.0) and wp.isfinite(norm[c][d]):
            unit[d] = wp.pow(wp.float64(2.0), wp.floor(wp.log2(norm[c][d])))
        least = wp.max(SAFETY * goal[c][d], floor * norm[c][d]) / unit[d]
        if norm[c][d] <= goal[c][d]:
            # What has arrived stays as it is while others go on; twice, since float32 may see a little more of it.
            least = wp.float64(2.0) * norm[c][d] / unit[d]
        aim[d] = least * least
        size[d] = norm[c][d] / unit[d]
        size[d] = size[d] * size[d]
    unit_out[c] = unit
    size_out[c] = size
    aim_out[c] = aim
    peak_out[c] = size


@wp.func
def attainable(aim: wp.vec3d, peak: wp.vec3d, floor: wp.float64) -> wp.vec3d:
    """The aim, but no less than the part `floor` of the largest norm that there was; all squared but the floor.

    Below that, the rounding errors of the largest steps are all that is left in a recursion, and it grows again.
    """
    return wp.max(aim, floor * floor * peak)


class Account(NamedTuple):
    """Norms on the host, (components with edges, 3) each."""

    norm: NDArray[np.float64]
    before: NDArray[np.float64]
    goal: NDArray[np.float64]


class Goals:
    """|r| per component and column, the norm at which it is small enough, and the same in units that float32 holds.

    `unit` is a power of two near |r|, `size` is |r / unit|^2, `aim` is what size should become, and `peak` is the
    largest that it was. Solvers on the same system share the arrays.
    """

    def __init__(self, segments: Segments) -> None:
        self.segments = segments
        # Together, so that the host fetches them at once; Warp makes no views of empty arrays.
        self._table = wp.zeros((3, max(segments.component_count, 1)), dtype=wp.vec3d, device=segments.device)
        self.norm, self.before, self.goal = (self._table[k] for k in range(3))
        self.unit, self.size, self.aim, self.peak = (segments.zeros() for _ in range(4))

    def set(self, squares: Sequence[wp.array[wp.vec3d]], tol: float) -> None:
        """Goal = max(tol |codiff v|, rounding), with |r| in place of |codiff v| where that is lost in rounding.

        squares: partial sums for r, for codiff v and for the rounding errors.
        """
        launch_components(_set, self.segments, [*squares, tol], [self.norm, self.goal])

    def measure(self, square: wp.array[wp.vec3d]) -> None:
        """|r| from partial sums of its squares; the last one becomes `before`."""
        launch_components(_norm, self.segments, [square], [self.before, self.norm])

    def take_aim(self, floor: float) -> None:
        """Unit, size and aim of the next correction; floor: the part of |r| that it can reach in its precision."""
        inputs, outputs = [self.norm, self.goal, floor], [self.unit, self.size, self.aim, self.peak]
        wp.launch(_aim, dim=self.segments.component_count, inputs=inputs, outputs=outputs, device=self.segments.device)

    def account(self) -> Account:
        """What came of it; waits for the device."""
        return Account(*self._table.numpy()[:, : self.segments.component_count].copy())

    @property
    def one(self) -> wp.array[wp.vec3d]:
        """The unit of a correction that needs none."""
        return wp.full(self.segments.component_count, wp.vec3d(1.0), dtype=wp.vec3d, device=self.segments.device)

    def norms(self) -> NDArray[np.float64]:
        """The norms that `size` has come down to, on the host."""
        norms: NDArray[np.float64] = self.unit.numpy() * np.sqrt(self.size.numpy())
        return norms
