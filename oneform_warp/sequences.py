"""Sequences: handles at keyframes, and the deformations on the way from one to the next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from oneform_warp.arrays import as_numpy
from oneform_warp.between import at_rest, between, constraint_at, fields_at
from oneform_warp.constraints import Constraint
from oneform_warp.deformation import Deformation
from oneform_warp.deformer import Deformer
from oneform_warp.errors import InputError
from oneform_warp.fields import Fields
from oneform_warp.handles import Handle

__all__ = ["Keyframes"]

Keys = Mapping[float, Iterable[Handle]] | Iterable[Handle]
Track = list[tuple[float, Handle]]
"""One handle at its keyframes, times ascending, the first at 0."""


class Keyframes:
    """Handles at times t in 0..1: rotation vectors, log stretches, moves and targets go straight from key to key.

    deformer: of the mesh; it serves all frames. keys: handles by time, as {0.5: [...], 1.0: [...]}; handles alone are
    those at t = 1. Handles of one name, or without names on the same vertices, are one handle at several times. It
    starts at rest at t = 0 unless it has a key there, and stays as it is after its last key. Where all handles have a
    key, the frame is what `Deformer.solve` makes of them, bit for bit.
    Raises InputError for times outside 0..1, and a handle that takes hold of its vertices in different ways.
    """

    def __init__(self, deformer: Deformer, keys: Keys) -> None:
        self.deformer = deformer
        given = keys.items() if isinstance(keys, Mapping) else [(1.0, keys)]
        self._keys = {_time(t): list(handles) for t, handles in given}
        times = sorted(self._keys)
        # In the order of the last key, which the frames after it keep.
        found: dict[Any, Track] = {_identity(handle): [] for t in reversed(times) for handle in self._keys[t]}
        for t in times:
            deformer.check(self._keys[t])
            for number, handle in enumerate(self._keys[t]):
                track = found[_identity(handle)]
                _check_twin(track, t, handle, number)
                track.append((t, handle))
        for track in found.values():
            if track[0][0] > 0.0:
                track.insert(0, (0.0, at_rest(track[0][1], deformer.rest)))
        self._tracks = tuple(found.values())
        for t in self.times:
            deformer.check(self.handles(t))

    @property
    def times(self) -> tuple[float, ...]:
        """The times of all keys and 0, ascending."""
        return tuple(sorted({0.0, *(t for track in self._tracks for t, _ in track)}))

    def handles(self, t: float) -> list[Handle]:
        """The handles at a time t in 0..1; those of a key are the caller's own."""
        now = _time(t)
        given = self._keys.get(now, [])
        # In the caller's order, which the last bits depend on.
        return list(given) if len(given) == len(self._tracks) else [self._on(track, now) for track in self._tracks]

    def solve(
        self, t: float, *, fields: Fields | None = None, constraints: Sequence[Constraint] = (), **options: Any
    ) -> Deformation:
        """The frame at a time t in 0..1; options as for `Deformer.solve`.

        Painted fields and constraints are those at t = 1: before, the log fields are scaled by t, and C x goes straight
        from what it is at rest to d.
        """
        now = _time(t)
        if constraints:
            options["constraints"] = [constraint_at(each, now, self.deformer.rest) for each in constraints]
        painted = None if fields is None else fields_at(fields, now)
        return self.deformer.solve(self.handles(now), fields=painted, **options)

    def frames(self, times: ArrayLike | int, **options: Any) -> Iterator[Deformation]:
        """The frames at these times (T,), or so many from 0 to 1; options as for `Deformer.solve`."""
        moments = np.linspace(0.0, 1.0, _count(times)) if isinstance(times, int) else np.atleast_1d(times)
        for t in [_time(each) for each in moments]:
            yield self.solve(t, **options)

    def _on(self, track: Track, t: float) -> Handle:
        times = [each for each, _ in track]
        k = int(np.searchsorted(times, t, side="right")) - 1
        if k == len(track) - 1:
            return track[k][1]
        share = (t - times[k]) / (times[k + 1] - times[k])
        return between(track[k][1], track[k + 1][1], share, self.deformer.rest)


def _time(t: Any) -> float:
    try:
        time = float(t)
    except (TypeError, ValueError):
        time = np.nan
    if not 0.0 <= time <= 1.0:
        raise InputError(f"the time is {t!r}", where="keyframes", fix="give times from 0, the rest pose, to 1, the end")
    return time


def _count(frames: int) -> int:
    if frames < 2:
        raise InputError(f"there are {frames} frames", where="frames", fix="give 2 or more, the first is at t = 0")
    return frames


def _identity(handle: Handle) -> Any:
    """What tells a handle from others: its name, or its vertices."""
    if handle.name is not None:
        return handle.name
    listed = as_numpy(handle.vertices)
    return listed.dtype.kind == "b", listed.shape, listed.tobytes()


def _check_twin(track: Track, t: float, handle: Handle, number: int) -> None:
    """InputError where a handle cannot be the one that has keys already."""
    if not track:
        return
    before, twin = track[-1]
    if before == t:
        raise InputError(f"it is there twice at t = {t:g}", where=handle.label(number), fix="give other names")
    if not handle.holds_like(twin):
        raise InputError(
            f"at t = {t:g} it takes hold in another way, or of other vertices, than at t = {before:g}",
            where=handle.label(number),
            fix="give both the same vertices, what is free or placed, and weight; or other names",
        )
