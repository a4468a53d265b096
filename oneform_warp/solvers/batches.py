"""A batch of iterations recorded once and replayed: a launch costs a fraction of a microsecond then."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import warp as wp

__all__ = ["Batches"]


class Batches:
    """Runs `iterate` a number of times; from the second batch of the same length on by replay."""

    def __init__(self, iterate: Callable[[], None], device: Any) -> None:
        self.iterate, self.device = iterate, device
        self.length = 0
        self.graph: Any = None

    def run(self, count: int) -> int:
        """`count` iterations -> count. The host must not read device memory while they are recorded, nor does it."""
        if count != self.length:
            # The first batch also loads the modules, which a recording could not.
            for _ in range(count):
                self.iterate()
            self.length, self.graph = count, None
            return count
        if self.graph is None:
            with wp.ScopedCapture(device=self.device) as capture:
                for _ in range(count):
                    self.iterate()
            self.graph = capture.graph
        wp.capture_launch(self.graph)
        return count
