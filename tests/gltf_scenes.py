"""glTF scenes made by hand, for the tests of files."""

from __future__ import annotations

import base64
import json
import struct

import numpy as np

TYPES = {"f4": 5126, "u2": 5123, "u1": 5121}
WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)], dtype="f4")
SIDES = np.array([0, 1, 3, 0, 3, 2, 4, 7, 5, 4, 6, 7, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6], dtype="u2")


class Scene:
    """A scene that grows: accessors, primitives and nodes."""

    def __init__(self) -> None:
        self.data = b""
        self.json = {
            "asset": {"version": "2.0", "generator": "a test"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "accessors": [],
            "bufferViews": [],
            "extras": {"note": "naïve ✓"},
        }

    def view(self, data: bytes, **more: int) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, **more: object) -> int:
        values = values.reshape(len(values), -1)
        kind = TYPES[values.dtype.str[1:]]
        entry = {"componentType": kind, "count": len(values), "type": WIDTHS[values.shape[1]], **more}
        entry["bufferView"] = self.view(values.tobytes())
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1

    def node(self, points: np.ndarray, faces: np.ndarray | None = SIDES, name: str = "", **more: object) -> dict:
        unit = points / np.linalg.norm(points, axis=1, keepdims=True)
        bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        attributes = {
            "POSITION": self.accessor(points, **bounds),
            "NORMAL": self.accessor(unit.astype("f4")),
            "TEXCOORD_0": self.accessor(points[:, :2].copy()),
        }
        primitive = {"attributes": attributes}
        if faces is not None:
            primitive["indices"] = self.accessor(faces)
        self.json["meshes"].append({"primitives": [primitive], "name": f"mesh of {name}"})
        self.json["nodes"].append({"mesh": len(self.json["meshes"]) - 1, "name": name, **more})
        self.json["scenes"][0]["nodes"].append(len(self.json["nodes"]) - 1)
        return primitive

    def glb(self) -> bytes:
        text = json.dumps({**self.json, "buffers": [{"byteLength": len(self.data)}]}).encode()
        chunks = b"".join(
            struct.pack("<I4s", len(padded), kind) + padded
            for kind, padded in (
                (b"JSON", text + b" " * (-len(text) % 4)),
                (b"BIN\0", self.data + b"\0" * (-len(self.data) % 4)),
                (b"XTRA", b"kept"),
            )
        )
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def gltf(self, uri: str | None = None) -> bytes:
        uri = uri or "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        return json.dumps({**self.json, "buffers": [{"byteLength": len(self.data), "uri": uri}]}).encode()


def read_json(data: bytes) -> dict:
    """The JSON of a .glb or .gltf."""
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")] if data[:4] == b"glTF" else data)
