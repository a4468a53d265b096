"""What can be counted in a mesh before it is deformed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from oneform_warp.filters import MeshFile
from oneform_warp.incidence import unique_edges
from oneform_warp.polygons import as_polygons, polygon_edges
from oneform_warp.weld import weld as weld_positions

__all__ = ["Edges", "box_text", "count_edges", "facts"]

FOR_CONDITIONS = {"normals": "nx ny nz", "colors": "r g b a", "quality": "q"}


@dataclass(frozen=True)
class Edges:
    """Counts over the edges of the welded mesh; components include vertices without edges."""

    edges: int
    boundary: int
    non_manifold: int
    zero_length: int
    components: int
    largest: int
    """Vertices of the largest component, after welding."""


def facts(mesh: MeshFile, weld: float | None) -> list[tuple[str, str]]:
    """Labels and values to print, for a mesh welded as `deform` would."""
    polygons = as_polygons(mesh.faces, len(mesh.positions))
    groups = weld_positions(mesh.positions, weld)
    corners = polygon_edges(polygons)
    edges = count_edges(mesh.positions, groups, corners)
    vertices = len(mesh.positions)
    used = np.bincount(polygons.indices, minlength=vertices)
    attributes = [f"{name} ({words})" for name, words in FOR_CONDITIONS.items() if getattr(mesh, name) is not None]
    named = [f"{name} ({len(members):,} vertices)" for name, members in mesh.groups.items()]
    return [
        ("file", str(mesh.path)),
        ("read by", mesh.backend),
        ("vertices", f"{vertices:,}"),
        ("faces", _faces_text(np.diff(polygons.offsets))),
        ("box", box_text(mesh.positions)),
        ("duplicate positions", f"{vertices - int(groups.max()) - 1:,}"),
        ("isolated vertices", f"{np.count_nonzero(used == 0):,}"),
        ("edges", f"{edges.edges:,}"),
        ("components", f"{edges.components:,} (the largest has {edges.largest:,} vertices)"),
        ("boundary edges", f"{edges.boundary:,}"),
        ("non-manifold edges", f"{edges.non_manifold:,}"),
        ("zero-length edges", f"{edges.zero_length:,}"),
        ("attributes", ", ".join(attributes) or "none"),
        ("groups", ", ".join(named) or "none"),
    ]


def count_edges(x: NDArray[np.float64], groups: NDArray[np.int64], corners: NDArray[np.int64]) -> Edges:
    """Counts for positions (V, 3), the welded group of each vertex (V,) and one edge per polygon corner (k, 2).

    Boundary edges have one face and non-manifold ones more than two; those of length zero are counted before welding.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    nodes = int(groups.max()) + 1
    welded = unique_edges(groups[corners], nodes)
    faces = np.bincount(welded.edge_of[welded.edge_of >= 0], minlength=len(welded.pairs))
    before = unique_edges(corners, len(x)).pairs
    zero = (x[before[:, 0]] == x[before[:, 1]]).all(axis=1)
    i, j = welded.pairs.T
    table = coo_array((np.ones(len(i), dtype=np.int8), (i, j)), shape=(nodes, nodes))
    count, component = connected_components(table, directed=False)
    return Edges(
        edges=len(welded.pairs),
        boundary=int(np.count_nonzero(faces == 1)),
        non_manifold=int(np.count_nonzero(faces > 2)),
        zero_length=int(np.count_nonzero(zero)),
        components=int(count),
        largest=int(np.bincount(component).max()),
    )


def box_text(points: NDArray[np.float64]) -> str:
    """The bounding box of points (n, 3) in words."""
    low, high = points.min(axis=0), points.max(axis=0)
    return ", ".join(f"{axis} {a:.6g} to {b:.6g}" for axis, a, b in zip("xyz", low, high, strict=True))


def _faces_text(sizes: NDArray[np.int64]) -> str:
    words = {3: "triangles", 4: "quads"}
    kinds, counts = np.unique(sizes, return_counts=True)
    parts = [
        f"{count:,} {words.get(int(size), f'of {size} corners')}" for size, count in zip(kinds, counts, strict=True)
    ]
    return f"{len(sizes):,}" + (f" ({', '.join(parts)})" if parts else "")
