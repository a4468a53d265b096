"""Iterations until every column has arrived: recorded once and replayed, so that a launch costs next to nothing."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import warp as wp

from oneform_warp.segments import LANES

__all__ = ["Loop", "Recording"]


@wp.kernel(enable_backward=False)
def _look(
    # In:
    rr: wp.array[wp.vec3d],
    aim: wp.array[wp.vec3d],
    batch: int,
    # Out:
    left_out: wp.array[wp.int32],
    active_out: wp.array[wp.int32],
):
    _block, lane = wp.tid()
    waiting = int(0)
    for c in range(lane, rr.shape[0], wp.block_dim()):
        for d in range(3):
            if rr[c][d] > aim[c][d]:
                waiting = 1
    total = wp.tile_extract(wp.tile_sum(wp.tile(waiting)), 0)
    if lane == 0:
        left = left_out[0] - batch
        left_out[0] = left
        active_out[0] = wp.where(total > 0 and left >= batch, 1, 0)


@cache
def _decides() -> bool:
    """Whether a GPU can run a graph until it sees by itself that it is done."""
    return bool(wp.is_conditional_graph_supported())


class Recording:
    """Launches that are made one by one the first time, which loads their modules, and replayed as a graph after that.

    Nothing in them may read device memory from the host, allocate, or depend on values that change.
    """

    def __init__(self, launches: Callable[[], None], device: Any) -> None:
        self.launches, self.device = launches, device
        self.warm = False
        self.graph: Any = None

    def run(self) -> None:
        """All launches, once."""
        if self.warm and self.graph is None:
            with wp.ScopedCapture(device=self.device) as capture:
                self.launches()
            self.graph = capture.graph
        if self.graph is not None:
            wp.capture_launch(self.graph)
        else:
            self.launches()
        self.warm = True


class Loop:
    """Runs `iterate` until the squared residuals `rr` are at most `aim`, per component and column.

    Nothing in `iterate` may read device memory from the host: not while it is recorded, nor does it otherwise.
    """

    def __init__(
        self, iterate: Callable[[], None], rr: wp.array[wp.vec3d], aim: wp.array[wp.vec3d], *, batch: int, device: Any
    ) -> None:
        """batch: iterations between two looks at the residual."""
        self.iterate, self.rr, self.aim, self.batch, self.device = iterate, rr, aim, batch, device
        self.left, self.active = (wp.zeros(1, dtype=wp.int32, device=device) for _ in range(2))
        self.one_batch = Recording(self._iterations, device)
        self.until_done: Any = None

    def run(self, budget: int, watch: Callable[[int], bool] | None) -> Callable[[], int]:
        """At most `budget` iterations -> how many were made, when asked. watch(count) after every batch; true stops.

        Where nobody watches, a GPU decides by itself when to stop, and the host need not wait.
        """
        if watch is None and budget >= self.batch and self.device.is_cuda and _decides():
            return self._until_done(budget)
        done, stopped = 0, False
        while done < budget and not stopped and self._waiting():
            done += self._some(min(self.batch, budget - done))
            stopped = watch is not None and watch(done)
        return lambda: done

    def _waiting(self) -> bool:
        return bool((self.rr.numpy() > self.aim.numpy()).any())

    def _some(self, count: int) -> int:
        """One batch, or fewer iterations one by one."""
        if count == self.batch:
            self.one_batch.run()
        else:
            for _ in range(count):
                self.iterate()
        return count

    def _until_done(self, budget: int) -> Callable[[], int]:
        """Whole batches until nothing waits, decided on the GPU."""
        whole = budget - budget % self.batch
        if self.until_done is None:
            self._look()
            with wp.ScopedCapture(device=self.device) as capture:
                wp.capture_while(self.active, self._iterations_and_look)
            self.until_done = capture.graph
        # The first look takes a batch from the budget without running it.
        self.left.fill_(whole + self.batch)
        self._look()
        wp.capture_launch(self.until_done)
        return lambda: whole - int(self.left.numpy()[0])

    def _iterations(self) -> None:
        for _ in range(self.batch):
            self.iterate()

    def _iterations_and_look(self) -> None:
        self._iterations()
        self._look()

    def _look(self) -> None:
        wp.launch_tiled(
            _look,
            dim=[1],
            inputs=[self.rr, self.aim, self.batch],
            outputs=[self.left, self.active],
            block_dim=LANES,
            device=self.device,
        )
