"""Meshes for the examples: from files where there are some, else from oneform_warp.shapes.

Files are looked for in the folder $ONEFORM_MESHES, then in shared/meshes beside the repository.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

import oneform_warp as ow

Floats = NDArray[np.float64]
Pose = tuple[Floats, Any, list[ow.Handle]]
"""Rest positions (V, 3), faces, handles."""


def load(name: str) -> tuple[Floats, Any] | None:
    """Positions and faces of a mesh file such as "paper/horse.ply", None where there is no such file."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "meshes"
    path = Path(os.environ.get("ONEFORM_MESHES", beside)) / name
    if not path.is_file():
        return None
    from oneform_warp.filters.meshfile import read_mesh

    mesh = read_mesh(path)
    return mesh.positions, mesh.faces


def distance(graph: ow.Graph, x: Floats, vertex: int) -> Floats:
    """The length of the shortest way along edges from a vertex to each, (V,): the way to name a limb by its tip."""
    i, j = graph.edges.T
    length = np.linalg.norm(x[j] - x[i], axis=1)
    table = coo_array((length, (i, j)), shape=(len(x), len(x))).tocsr()
    return dijkstra(table, directed=False, indices=vertex)


def limb(x: Floats, faces: Any, tip: Sequence[float], near: float, far: float) -> tuple[Any, Any]:
    """Masks of a limb and of the body, by the distance along the surface from the limb's tip.

    tip: in parts of the bounding box, the vertex closest to it is taken. near, far: where the limb ends and the body
    begins, in parts of the box's diagonal; the vertices between the two are free.
    """
    point = x.min(axis=0) + np.asarray(tip) * np.ptp(x, axis=0)
    vertex = int(np.argmin(np.linalg.norm(x - point, axis=1)))
    away = distance(ow.Graph.from_faces(x, faces), x, vertex) / box(x)
    return away < near, away > far


def box(x: Floats) -> float:
    """The diagonal of the bounding box."""
    return float(np.linalg.norm(np.ptp(x, axis=0)))


def bent_starfish(level: int = 4, angle: float = 90.0) -> Pose:
    """A starfish with one arm bent: what the figures draw where the paper's meshes are not there."""
    x, faces = ow.shapes.starfish(level=level, core=0.2)
    arm, body = limb(x, faces, (1, 0.5, 0.5), 0.18, 0.3)
    return x, faces, [ow.Handle(body, held=True), ow.Handle(arm, axis="z", angle=angle)]


def turn_error(x: Floats, y: Floats, handles: Sequence[ow.Handle]) -> float:
    """By how many degrees the rotations that best fit the turned handles differ from the ones asked for, the most."""
    errors = []
    for handle in (handle for handle in handles if not handle.held):
        before, after = (pose[handle.vertices] - pose[handle.vertices].mean(axis=0) for pose in (x, y))
        fit = Rotation.align_vectors(after, before)[0]
        errors.append((fit * Rotation.from_rotvec(handle.rotation).inv()).magnitude())
    return float(np.degrees(max(errors)))
