"""Patches: the polygons of a graph, or the stars of its nodes, on each of which a 0-form is nearly linear."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.assembly import listed_edges
from oneform_warp.graph import Graph

__all__ = ["Patches"]

Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Patches:
    """Every edge lies in one patch at least: in its polygons, or where it has none in the stars of its two ends."""

    offsets: wp.array[wp.int32]
    """Patch p has the nodes nodes[offsets[p]] to nodes[offsets[p + 1]], (patches + 1,)."""
    nodes: wp.array[wp.int32]
    """Of a star its centre comes first."""
    polygons: int
    """How many patches are polygons; the stars come after them."""
    along_offsets: wp.array[wp.int32]
    """Edge e lies in the patches along[along_offsets[e]] to along[along_offsets[e + 1]], (m + 1,)."""
    along: wp.array[wp.int32]

    @property
    def count(self) -> int:
        """How many patches there are."""
        return int(self.offsets.shape[0]) - 1

    @classmethod
    def of(cls, graph: Graph) -> Patches:
        """The polygons, and a star at each end of an edge that no polygon has."""
        sizes, nodes, edge, patch = _polygons(graph)
        bare = np.flatnonzero(np.bincount(edge, minlength=graph.edge_count) == 0)
        ends = np.concatenate([graph.tail.numpy()[bare], graph.head.numpy()[bare]])
        centres, star = np.unique(ends, return_inverse=True)
        star_sizes, star_nodes = _stars(graph, centres.astype(np.int64))
        edge = np.concatenate([edge, bare, bare])
        patch = np.concatenate([patch, len(sizes) + star.ravel()])
        order = np.argsort(edge, kind="stable")

        def upload(values: Integers) -> wp.array[wp.int32]:
            return wp.array(values.astype(np.int32), dtype=wp.int32, device=graph.device)

        return cls(
            upload(_offsets(np.concatenate([sizes, star_sizes]))),
            upload(np.concatenate([nodes, star_nodes])),
            len(sizes),
            upload(_offsets(np.bincount(edge, minlength=graph.edge_count))),
            upload(patch[order]),
        )


def _offsets(sizes: Integers) -> Integers:
    return np.concatenate([[0], np.cumsum(sizes)])


def _polygons(graph: Graph) -> tuple[Integers, Integers, Integers, Integers]:
    """Sizes and nodes of the polygons; the edges of their corners, and the polygon of each."""
    none = np.zeros(0, dtype=np.int64)
    if graph.faces is None:
        return none, none, none, none
    nodes = graph.faces.corners.numpy().astype(np.int64)
    sizes = np.diff(graph.faces.offsets.numpy().astype(np.int64))
    edge = listed_edges(graph)[0][: len(nodes)]
    proper = edge >= 0
    return sizes, nodes, edge[proper], np.repeat(np.arange(len(sizes)), sizes)[proper]


def _stars(graph: Graph, centres: Integers) -> tuple[Integers, Integers]:
    """Sizes and nodes of the stars of these nodes: each with its neighbours."""
    offsets = graph.offsets.numpy().astype(np.int64)
    degrees = offsets[centres + 1] - offsets[centres]
    inside = np.arange(int(degrees.sum())) - np.repeat(np.cumsum(degrees) - degrees, degrees)
    around = graph.neighbours.numpy()[np.repeat(offsets[centres], degrees) + inside].astype(np.int64)
    return degrees + 1, np.insert(around, np.cumsum(degrees) - degrees, centres)
