"""The files of a glTF scene: one .glb, or a .gltf with buffers in files of their own or in its text."""

import base64
import copy
import json
import struct
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import quote, unquote

from oneform_warp.errors import FileError
from oneform_warp.filters.formats.companions import inside

__all__ = ["Container", "read_container"]

MAGIC, JSON, BIN = b"glTF", b"JSON", b"BIN\0"


@dataclass(frozen=True, eq=False)
class Container:
    """The bytes of the file, its JSON, and all buffers by number; `chunks` are those of a .glb after the JSON."""

    data: bytes = field(repr=False)
    scene: Mapping[str, Any] = field(repr=False)
    buffers: Mapping[int, bytes] = field(repr=False)
    chunks: tuple[tuple[bytes, bytes], ...] | None = field(repr=False)

    def references(self) -> tuple[str, ...]:
        """The files that buffers and images are in, relative to the scene."""
        entries = (*self.scene.get("buffers", ()), *self.scene.get("images", ()))
        uris = [entry["uri"] for entry in entries if "uri" in entry and not entry["uri"].startswith("data:")]
        return tuple(dict.fromkeys(unquote(uri) for uri in uris))

    def files(
        self, name: str, changed: Mapping[int, bytes], bounds: Mapping[int, Mapping[str, Any]], taken: Set[str]
    ) -> Mapping[str, bytes]:
        """The scene under a name, with changed buffers and bounds of accessors, and the files of these buffers.

        A buffer's file is never one that is `taken`: a scene that is written over itself must be whole at any moment.
        """
        scene = copy.deepcopy(dict(self.scene))
        for number, each in bounds.items():
            scene["accessors"][number] |= each
        files: dict[str, bytes] = {}
        stem = PurePosixPath(name).stem
        candidates = (f"{stem}{f'-{i}' if i else ''}.bin" for i in count())
        chunks = self.chunks
        for number, data in changed.items():
            uri = scene["buffers"][number].get("uri")
            if uri is None:
                chunks = tuple((kind, data if kind == BIN else each) for kind, each in chunks or ())
            elif uri.startswith("data:"):
                scene["buffers"][number]["uri"] = uri[: uri.index(",") + 1] + base64.b64encode(data).decode()
            else:
                own = next(each for each in candidates if each not in taken)
                scene["buffers"][number]["uri"] = quote(own)
                files[own] = data
        text = json.dumps(scene, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode()
        return {name: text if chunks is None else _glb(text, chunks), **files}


def read_container(path: Path) -> Container:
    """Read a .glb or .gltf with its buffers; ValueError or FileError where that cannot be."""
    data = path.read_bytes()
    chunks = None
    text = data
    if data[:4] == MAGIC:
        first, *rest = (*_chunks(data), (b"", b""))
        if first[0] != JSON:
            raise ValueError("the first chunk is not JSON")
        text, chunks = first[1], tuple(rest[:-1])
    scene = json.loads(text)
    if not isinstance(scene, dict) or "asset" not in scene:
        raise ValueError("this is not glTF 2")
    buffers = {}
    for number, entry in enumerate(scene.get("buffers", ())):
        buffers[number] = _buffer(entry, chunks or (), path)
        if len(buffers[number]) < entry["byteLength"]:
            raise ValueError(f"buffer {number} ends too early")
    return Container(data, scene, buffers, chunks)


def _buffer(entry: Mapping[str, Any], chunks: tuple[tuple[bytes, bytes], ...], path: Path) -> bytes:
    uri = entry.get("uri")
    if uri is None:
        return next((data for kind, data in chunks if kind == BIN), b"")
    if uri.startswith("data:"):
        return base64.b64decode(uri[uri.index(",") + 1 :])
    file = inside(path.parent, unquote(uri))
    if file is None:
        raise FileError(f"its buffer {uri!r} is not in its folder", where=str(path), fix="put the files together")
    try:
        return file.read_bytes()
    except OSError as error:
        raise FileError(f"its buffer {uri!r} cannot be read: {error.strerror}", where=str(path)) from None


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Type and content of each chunk of a .glb."""
    at = 12
    while at + 8 <= len(data):
        length, kind = struct.unpack_from("<I4s", data, at)
        if at + 8 + length > len(data):
            raise ValueError("the file ends too early")
        yield kind, data[at + 8 : at + 8 + length]
        at += 8 + length


def _glb(text: bytes, chunks: tuple[tuple[bytes, bytes], ...]) -> bytes:
    parts = []
    for kind, data in ((JSON, text), *chunks):
        padded = data + (b" " if kind == JSON else b"\0") * (-len(data) % 4)
        parts.append(struct.pack("<I4s", len(padded), kind) + padded)
    body = b"".join(parts)
    return struct.pack("<4sII", MAGIC, 2, 12 + len(body)) + body
