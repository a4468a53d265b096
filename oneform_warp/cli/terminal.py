"""What the user sees while a command runs: Warp's own messages, a progress line, and how long things took."""

import ctypes
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import click

from oneform_warp.errors import InputError

__all__ = ["ProgressLine", "Stopwatch", "start_warp"]

DRIVERS = {"win32": ("nvcuda.dll",)}
NO_DRIVER = "Could not find or load the NVIDIA CUDA driver"


def start_warp(*, verbose: bool = False, device: str | None = None) -> None:
    """Initialise Warp, its banner only where wanted; InputError for a device that is not there."""
    import warp as wp

    wp.config.log_level = wp.LOG_INFO if verbose else wp.LOG_WARNING
    if verbose or _has_driver():
        wp.init()
    else:
        with _without_line(NO_DRIVER):
            wp.init()
    if device is None:
        return
    try:
        wp.get_device(device)
    except ValueError:
        known = ", ".join(each.alias for each in wp.get_devices())
        raise InputError(f"there is no device {device!r}", where="device", fix=f"use one of: {known}") from None


def _has_driver() -> bool:
    """Whether Warp will find a CUDA driver: it tries these names too."""
    for name in DRIVERS.get(sys.platform, ("libcuda.so", "libcuda.so.1")):
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


@contextmanager
def _without_line(unwanted: str) -> Iterator[None]:
    """Drop the lines that native code writes to stderr with this text, and pass on the others afterwards."""
    try:
        saved = os.dup(2)
    except OSError:  # there is no stderr
        yield
        return
    with tempfile.TemporaryFile() as kept:
        os.dup2(kept.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            kept.seek(0)
            for line in kept:
                if unwanted.encode() not in line:
                    os.write(2, line)


class ProgressLine:
    """One line on stderr that is written over, where that is a terminal."""

    def __init__(self, *, wanted: bool) -> None:
        self.wanted = wanted and sys.stderr.isatty()
        self.last = 0.0

    def say(self, text: str) -> None:
        """Show this text in place of the last."""
        if self.wanted:
            click.echo(f"\r\x1b[K{text}", nl=False, err=True)

    def __call__(self, iterations: int, ratio: float) -> None:
        """The callback of a solver; ten times a second is enough."""
        if self.wanted and time.perf_counter() - self.last > 0.1:
            self.last = time.perf_counter()
            self.say(f"{iterations:,} iterations, the residual is {ratio:.3g} times its goal")

    def __enter__(self) -> "ProgressLine":
        return self

    def __exit__(self, *_: Any) -> None:
        self.say("")


class Stopwatch:
    """Wall time of each stage in seconds."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.last = time.perf_counter()

    def stop(self, stage: str) -> None:
        """The time since the last stop was for this stage."""
        now = time.perf_counter()
        self.seconds[stage], self.last = now - self.last, now

    def add(self, seconds: Mapping[str, float]) -> None:
        """Stages that something else has timed since the last stop."""
        self.seconds |= seconds
        self.last = time.perf_counter()
