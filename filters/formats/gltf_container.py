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
        chunks, stem = self.chunks, PurePosixPath(name).stem
        for number, data in changed.items():
            uri = scene["buffers"][number].get("uri")
            if uri is None:
                chunks = tuple((kind, data if kind == BIN else each) for kind, each in chunks or ())
            elif uri.startswith("data:"):
                scene["buffers"][number]["uri"] = uri[: uri.index(",") + 1] + base64.b64encode(data).decode()
            else:
                own = _free_name(stem, taken | files.keys())
                scene["buffers"][number]["uri"] = quote(own)
                files[own] = data
        return {name: _packed(scene, chunks), **files}

    @property
    def end(self) -> tuple[int, int]:
        """Where more numbers can stand: the buffer in a .glb itself, or else a new one, and how much comes before."""
        own = self.buffers and "uri" not in self.scene["buffers"][0]
        if own and any(kind == BIN for kind, _ in self.chunks or ()):
            return 0, len(self.buffers[0]) + -len(self.buffers[0]) % 4
        return len(self.buffers), 0

    def extended(self, scene: dict[str, Any], data: bytes, name: str, taken: Set[str]) -> Mapping[str, bytes]:
        """Another scene under a name, with data at the `end` of what is here; names are not `taken`, as for `files`."""
        number, offset = self.end
        files, chunks, entry = dict[str, bytes](), self.chunks, {"byteLength": offset + len(data)}
        if offset or number < len(self.buffers):
            scene["buffers"][number] |= entry
            whole = self.buffers[number].ljust(offset, b"\0") + data
            chunks = tuple((kind, whole if kind == BIN else each) for kind, each in chunks or ())
        elif chunks is not None and not number:
            scene["buffers"], chunks = [entry], ((BIN, data), *chunks)
        else:
            own = _free_name(f"{PurePosixPath(name).stem}-frames", taken)
            scene.setdefault("buffers", []).append(entry | {"uri": quote(own)})
            files[own] = data
        return {name: _packed(scene, chunks), **files}


def _free_name(stem: str, taken: Set[str]) -> str:
    candidates = (f"{stem}{f'-{i}' if i else ''}.bin" for i in count())
    return next(each for each in candidates if each not in taken)


def _packed(scene: Mapping[str, Any], chunks: tuple[tuple[bytes, bytes], ...] | None) -> bytes:
    text = json.dumps(scene, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode()
    return text if chunks is None else _glb(text, chunks)


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
