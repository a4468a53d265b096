"""A small glTF player for the tests, written from the specification and not from the writer."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from urllib.parse import unquote

import numpy as np

COMPONENTS = {5121: "u1", 5123: "u2", 5125: "u4", 5126: "f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Player:
    """A scene whose nodes have matrices or translations only, or none."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        self.binary = b""
        if data[:4] == b"glTF":
            _, version, length = struct.unpack_from("<4sII", data)
            assert (version, length) == (2, len(data))
            size = struct.unpack_from("<I", data, 12)[0]
            self.scene = json.loads(data[20 : 20 + size])
            at = 20 + size
            assert data[at + 4 : at + 8] == b"BIN\0"
            self.binary = data[at + 8 : at + 8 + struct.unpack_from("<I", data, at)[0]]
        else:
            self.scene = json.loads(data)
        self.buffers = [
            (path.parent / unquote(each["uri"])).read_bytes() if "uri" in each else self.binary
            for each in self.scene["buffers"]
        ]
        for each, buffer in zip(self.scene["buffers"], self.buffers, strict=True):
            assert 0 <= len(buffer) - each["byteLength"] <= 3

    def numbers(self, accessor: int) -> np.ndarray:
        entry = self.scene["accessors"][accessor]
        dtype, width = np.dtype("<" + COMPONENTS[entry["componentType"]]), WIDTHS[entry["type"]]
        if "bufferView" not in entry:
            return np.zeros((entry["count"], width))
        view = self.scene["bufferViews"][entry["bufferView"]]
        offset = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        assert offset % dtype.itemsize == 0
        step = view.get("byteStride", width * dtype.itemsize)
        assert step * (entry["count"] - 1) + width * dtype.itemsize <= view["byteLength"]
        values = np.ndarray(
            (entry["count"], width), dtype, self.buffers[view["buffer"]], offset, (step, dtype.itemsize)
        )
        if "min" in entry:
            np.testing.assert_array_equal(values.min(axis=0), np.array(entry["min"], dtype=dtype))
            np.testing.assert_array_equal(values.max(axis=0), np.array(entry["max"], dtype=dtype))
        return values.astype(np.float64)

    def weights(self, node: int, seconds: float) -> np.ndarray:
        """Of the morph targets of a node, linear between the animation's times and constant outside."""
        mesh = self.scene["meshes"][self.scene["nodes"][node]["mesh"]]
        for animation in self.scene.get("animations", ()):
            for channel in animation["channels"]:
                if channel["target"] == {"node": node, "path": "weights"}:
                    sampler = animation["samplers"][channel["sampler"]]
                    assert sampler["interpolation"] == "LINEAR"
                    times = self.numbers(sampler["input"])[:, 0]
                    table = self.numbers(sampler["output"]).reshape(len(times), -1)
                    assert table.shape[1] == len(mesh["weights"])
                    return np.array([np.interp(seconds, times, column) for column in table.T])
        return np.array(mesh.get("weights", ()))

    def shown(self, seconds: float, attribute: str = "POSITION") -> np.ndarray:
        """An attribute of all primitives of all nodes of the scene, in the node's own space but for translations."""
        found = []
        for number in self.scene["scenes"][0]["nodes"]:
            node = self.scene["nodes"][number]
            primitives = self.scene["meshes"][node["mesh"]]["primitives"]
            counts = {len(primitive.get("targets", ())) for primitive in primitives}
            assert len(counts) == 1
            for primitive in primitives:
                value = self.numbers(primitive["attributes"][attribute])[:, :3].copy()
                weights = self.weights(number, seconds)
                assert len(weights) == counts.copy().pop()
                for weight, target in zip(weights, primitive.get("targets", ()), strict=True):
                    assert target.keys() <= primitive["attributes"].keys()
                    if attribute in target:
                        value += weight * self.numbers(target[attribute])
                found.append(value + (node.get("translation", 0.0) if attribute == "POSITION" else 0.0))
        return np.concatenate(found)
