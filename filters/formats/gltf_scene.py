"""A glTF scene's nodes: what can be deformed in them, and the way from their space to the world's and back."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Part", "check_scene", "parts"]

Floats = NDArray[np.float64]

CODED = {
    "KHR_draco_mesh_compression": "its meshes are compressed by Draco",
    "EXT_meshopt_compression": "its meshes are compressed by meshopt",
    "KHR_meshopt_compression": "its meshes are compressed by meshopt",
    "KHR_mesh_quantization": "its meshes are quantised",
    "EXT_mesh_gpu_instancing": "its meshes are instanced",
}
FLOAT = 5126


@dataclass(frozen=True, eq=False)
class Part:
    """A primitive on a node: accessors by number, None where there is none, and the node's matrix to the world."""

    node: int
    primitive: int
    """Its number in the node's mesh."""
    name: str
    world: Floats
    mode: int
    positions: int
    indices: int | None
    normals: int | None
    tangents: int | None
    colors: int | None

    @cached_property
    def _plain(self) -> bool:
        """Whether the node is where the world is: then no number is touched."""
        return np.array_equal(self.world, np.eye(4))

    @cached_property
    def _back(self) -> Floats:
        return np.asarray(np.linalg.inv(self.world[:3, :3]), dtype=np.float64)

    def outside(self, points: Floats) -> Floats:
        """Points (n, 3) of the node in the world."""
        return points if self._plain else points @ self.world[:3, :3].T + self.world[:3, 3]

    def inside(self, points: Floats) -> Floats:
        """Points (n, 3) of the world on the node."""
        return points if self._plain else (points - self.world[:3, 3]) @ self._back.T

    def normals_outside(self, normals: ArrayLike) -> Floats:
        """Normals (n, 3) of the node in the world, of unit length: by the inverse transposed."""
        return np.asarray(normals, dtype=np.float64) if self._plain else _unit(np.asarray(normals) @ self._back)

    def normals_inside(self, normals: Floats) -> Floats:
        """Normals (n, 3) of the world on the node, of unit length."""
        return normals if self._plain else _unit(normals @ self.world[:3, :3])

    def tangents_outside(self, tangents: ArrayLike) -> Floats:
        """Directions (n, 3) of the node in the world, of unit length."""
        given = np.asarray(tangents, dtype=np.float64)
        return given if self._plain else _unit(given @ self.world[:3, :3].T)

    def tangents_inside(self, tangents: Floats) -> Floats:
        """Directions (n, 3) of the world on the node, of unit length."""
        return tangents if self._plain else _unit(tangents @ self._back.T)


def check_scene(scene: Mapping[str, Any]) -> None:
    """ValueError, with what it is, for meshes that are compressed, quantised, instanced, skinned or morphed."""
    for name in (*scene.get("extensionsUsed", ()), *scene.get("extensionsRequired", ())):
        if name in CODED:
            raise ValueError(f"{CODED[name]} ({name})")
    for number, mesh in enumerate(scene.get("meshes", ())):
        for primitive in mesh["primitives"]:
            if CODED.keys() & primitive.get("extensions", {}).keys():
                raise ValueError(CODED[min(CODED.keys() & primitive["extensions"].keys())])
            if primitive.get("targets"):
                raise ValueError(f"mesh {mesh.get('name', number)!r} has morph targets")
    for number, node in enumerate(scene.get("nodes", ())):
        if "mesh" in node and "skin" in node:
            raise ValueError(f"node {node.get('name', number)!r} is skinned")


def parts(scene: Mapping[str, Any]) -> Iterator[Part]:
    """All primitives with positions, by nodes from the roots of the scene down; ValueError for instances."""
    owners: dict[int, int] = {}
    for number, world in _nodes(scene):
        node = scene["nodes"][number]
        if "mesh" not in node:
            continue
        name = str(node.get("name", ""))
        mesh = scene["meshes"][node["mesh"]]
        for place, primitive in enumerate(mesh["primitives"]):
            attributes = primitive["attributes"]
            if "POSITION" not in attributes:
                continue
            part = Part(
                number,
                place,
                name,
                world,
                primitive.get("mode", 4),
                attributes["POSITION"],
                primitive.get("indices"),
                attributes.get("NORMAL"),
                attributes.get("TANGENT"),
                attributes.get("COLOR_0"),
            )
            _check_part(scene, part, owners, number)
            yield part


def _check_part(scene: Mapping[str, Any], part: Part, owners: dict[int, int], node: int) -> None:
    """What a part writes to must be its node's own, in plain 32-bit numbers."""
    label = f"node {part.name or node!r}"
    for accessor in (part.positions, part.normals, part.tangents):
        if accessor is None:
            continue
        entry = scene["accessors"][accessor]
        if owners.setdefault(accessor, node) != node:
            raise ValueError(f"{label} is an instance: node {owners[accessor]} has the same vertices")
        if "sparse" in entry or "bufferView" not in entry:
            raise ValueError(f"{label} has a sparse accessor")
        if entry["componentType"] != FLOAT:
            raise ValueError(f"{label} is quantised")
    if abs(np.linalg.det(part.world[:3, :3])) < 1e-30:
        raise ValueError(f"{label} is scaled to nothing")


def _nodes(scene: Mapping[str, Any]) -> Iterator[tuple[int, Floats]]:
    """The nodes of the scene with their matrices to the world, each before its children."""
    nodes = scene.get("nodes", ())
    children = {child for node in nodes for child in node.get("children", ())}
    roots = [number for number in range(len(nodes)) if number not in children]
    if scene.get("scenes"):
        roots = scene["scenes"][scene.get("scene", 0)].get("nodes", [])
    stack, seen = [(root, np.eye(4)) for root in reversed(roots)], set[int]()
    while stack:
        number, parent = stack.pop()
        if number in seen:
            raise ValueError(f"node {number} has two parents")
        seen.add(number)
        world = parent @ _matrix(nodes[number])
        yield number, world
        stack += [(child, world) for child in reversed(nodes[number].get("children", ()))]


def _matrix(node: Mapping[str, Any]) -> Floats:
    """A node's own matrix (4, 4), which may be given as translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    matrix[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _unit(vectors: Floats) -> Floats:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1))
