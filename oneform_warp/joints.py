"""Joints: vertices that cut a mesh in two, and the side of them that turns."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.graph import Graph

__all__ = ["beyond_joint"]

Mask = NDArray[np.bool_]


def beyond_joint(x: NDArray[np.float64], faces: Any, joint: Mask, beyond: int | None) -> tuple[Mask, Mask]:
    """Masks (V,) of the side of a joint that turns and of the vertices that stay; the joint is in neither.

    beyond: a vertex on the side that turns; None for all sides but the largest. Components without a vertex of the
    joint stay. Raises InputError where the joint does not cut its component.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if faces is None:
        raise InputError("a joint needs faces", where="faces", fix="pass the mesh's faces as well")
    if not joint.any():
        raise InputError("no vertex is selected", where="joint", fix="select a band of vertices around the joint")
    graph = Graph.from_faces(x, faces, device="cpu")
    first = graph.vertex_at[graph.node_of]
    # Welded vertices are one: the joint is around all of them.
    cut = np.isin(first, first[joint])
    ends = graph.edges[~cut[graph.edges].any(axis=1)]
    pairs = coo_array((np.ones(len(ends), dtype=bool), tuple(ends.T)), shape=(len(x), len(x)))
    piece = connected_components(pairs, directed=False)[1][first]
    jointed = np.isin(graph.components, graph.components[joint]) & ~cut
    sides, sizes = np.unique(piece[jointed], return_counts=True)
    if len(sides) <= len(np.unique(graph.components[jointed])):
        raise InputError("the joint does not cut the mesh in two", where="joint", fix="select a whole band around it")
    if beyond is None:
        turned = jointed & (piece != sides[int(np.argmax(sizes))])
    elif not (0 <= beyond < len(x)) or cut[beyond] or not jointed[beyond]:
        raise InputError(f"vertex {beyond} is on no side of the joint", where="beyond", fix="give one that it cuts off")
    else:
        turned = piece == piece[beyond]
    return np.asarray(turned), np.asarray(~turned & ~cut)
