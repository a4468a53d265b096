"""A glTF scene that moves: every frame a morph target, and an animation that leads each into the next."""

import copy
from collections.abc import Iterable, Mapping, Set
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.filters.formats.gltf import GltfRecords
from oneform_warp.filters.formats.motion import Floats, Motion

__all__ = ["animated"]

FLOAT, ARRAY_BUFFER = 5126, 34962
Target = dict[str, int]
"""The accessors of a morph target by attribute."""


class Appendix:
    """What comes behind the numbers that a scene has: accessors, and the bytes that they are of."""

    def __init__(self, records: GltfRecords) -> None:
        self.records = records
        self.scene: dict[str, Any] = copy.deepcopy(dict(records.container.scene))
        self.buffer, self.offset = records.container.end
        self.pieces: list[bytes] = []

    def accessor(self, values: Floats, *, bounded: bool = False, target: int | None = None) -> int:
        """The number of a new accessor with values (n,) or (n, 3), as 32-bit numbers."""
        with np.errstate(over="ignore"):
            numbers = np.ascontiguousarray(values, dtype="<f4")
        if not np.isfinite(numbers).all():
            raise ValueError("a coordinate is too large for glTF's 32-bit numbers")
        views = self.scene.setdefault("bufferViews", [])
        view = {"buffer": self.buffer, "byteOffset": self.offset, "byteLength": numbers.nbytes}
        views.append(view if target is None else view | {"target": target})
        self.pieces.append(numbers.tobytes())
        self.offset += numbers.nbytes
        return self._entry(numbers, bounded, {"bufferView": len(views) - 1})

    def zeros(self, count: int) -> int:
        """The number of a new accessor with (count, 3) zeros, which need no bytes."""
        return self._entry(np.zeros((count, 3), dtype="<f4"), True, {})

    def _entry(self, numbers: NDArray[Any], bounded: bool, entry: dict[str, Any]) -> int:
        entry |= {
            "componentType": FLOAT,
            "count": len(numbers),
            "type": "SCALAR" if numbers.ndim == 1 else "VEC3",
        }
        if bounded:
            low, high = np.atleast_1d(numbers.min(axis=0)), np.atleast_1d(numbers.max(axis=0))
            entry |= {"min": low.astype(float).tolist(), "max": high.astype(float).tolist()}
        accessors = self.scene.setdefault("accessors", [])
        accessors.append(entry)
        return len(accessors) - 1

    def target(self, part: int, motion: Motion) -> Target:
        """The morph target that takes a part from where the scene has it to where a motion does; empty for nowhere."""
        each, span = self.records.parts[part], self.records.spans[part]
        found: Target = {}
        if not np.array_equal(motion.before[span], motion.after[span]):
            stored = self.records.read(each.positions)
            found["POSITION"] = self._difference(stored, slice(None), each.inside(motion.after[span]), bounded=True)
        for attribute, accessor, rows, values in self.records.turned(part, motion):
            if len(rows):
                found[attribute] = self._difference(self.records.read(accessor)[:, :3], rows, values)
        return found

    def _difference(self, stored: NDArray[Any], rows: Any, values: Floats, *, bounded: bool = False) -> int:
        change = np.zeros(stored.shape)
        change[rows] = values - stored[rows]
        return self.accessor(change, bounded=bounded, target=ARRAY_BUFFER)


def animated(
    records: GltfRecords, motions: Iterable[Motion], times: Floats, name: str, taken: Set[str] = frozenset()
) -> Mapping[str, bytes]:
    """The files of a scene that goes through motions of its vertices (V, 3) at times (T,) in seconds, ascending.

    Everything of the scene stays: its own pose is that without the animation. Frames in it need no numbers. Between
    frames a viewer blends linearly. The first file is the scene under `name`; others have names that are not `taken`.
    """
    appendix = Appendix(records)
    frames: list[list[Target]] = []
    for motion in motions:
        records.check_shared(motion)
        frames.append([appendix.target(part, motion) for part in range(len(records.parts))])
    moving = {part.node for frame in frames for part, found in zip(records.parts, frame, strict=True) if found}
    if not moving:
        return {name: records.data}
    clock = appendix.accessor(np.asarray(times, dtype=np.float64), bounded=True)
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for node in sorted(moving):
        shown = _put_targets(appendix, node, frames)
        weights = (shown[:, None] == np.arange(shown.max() + 1)).astype(np.float64)
        samplers.append({"input": clock, "output": appendix.accessor(weights.ravel()), "interpolation": "LINEAR"})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": "weights"}})
    animation = {"name": "oneform_warp", "samplers": samplers, "channels": channels}
    appendix.scene.setdefault("animations", []).append(animation)
    return records.container.extended(appendix.scene, b"".join(appendix.pieces), name, taken)


def _put_targets(appendix: Appendix, node: int, frames: list[list[Target]]) -> NDArray[np.int64]:
    """Gives a node's mesh its morph targets; -> the number of that of each frame (T,), -1 where it is at rest."""
    scene, records = appendix.scene, appendix.records
    mesh = scene["meshes"][scene["nodes"][node]["mesh"]]
    own = [number for number, part in enumerate(records.parts) if part.node == node]
    shown = np.array([any(frame[number] for number in own) for frame in frames])
    for number in own:
        part = records.parts[number]
        attributes = sorted({name for frame in frames for name in frame[number]}) or ["POSITION"]
        count = len(records.read(part.positions))
        mesh["primitives"][part.primitive]["targets"] = [
            {name: frame[number][name] if name in frame[number] else appendix.zeros(count) for name in attributes}
            for frame, wanted in zip(frames, shown, strict=True)
            if wanted
        ]
    mesh["weights"] = [0.0] * int(shown.sum())
    mesh["extras"] = {**mesh.get("extras", {}), "targetNames": [f"frame {i}" for i in np.flatnonzero(shown)]}
    return np.where(shown, np.cumsum(shown) - 1, -1)
