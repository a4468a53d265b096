"""Small MeshSets that several tests use."""

from __future__ import annotations

import numpy as np
import pymeshlab

import oneform_warp as ow
from oneform_warp.filters import MeshSet


def bar(meshes: MeshSet | None = None) -> MeshSet:
    meshes = MeshSet() if meshes is None else meshes
    x, faces = ow.shapes.bar(segments=12, sides=4)
    meshes.add_mesh(pymeshlab.Mesh(x, np.asarray(faces, dtype=np.int32)), "bar")
    return meshes


def positions(meshes: MeshSet) -> np.ndarray:
    return np.array(meshes.current_mesh().vertex_matrix())
