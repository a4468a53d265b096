"""What can be counted in a mesh before it is deformed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from oneform_warp.filters import MeshFile
from oneform_warp.graph import Graph
from oneform_warp.polygons import as_polygons

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
    graph = Graph.from_faces(mesh.positions, mesh.faces, weights="uniform", weld=weld, device="cpu")
    edges = count_edges(mesh, graph)
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
        ("duplicate positions", f"{vertices - graph.node_count:,}"),
        ("isolated vertices", f"{np.count_nonzero(used == 0):,}"),
        ("edges", f"{edges.edges:,}"),
        ("components", f"{edges.components:,} (the largest has {edges.largest:,} vertices)"),
        ("boundary edges", f"{edges.boundary:,}"),
        ("non-manifold edges", f"{edges.non_manifold:,}"),
        ("zero-length edges", f"{edges.zero_length:,}"),
        ("attributes", ", ".join(attributes) or "none"),
        ("groups", ", ".join(named) or "none"),
    ]


def count_edges(mesh: MeshFile, graph: Graph) -> Edges:
    """Counts for a mesh and its welded graph.

    Boundary edges have one face and non-manifold ones more than two; those of length zero are counted before welding.
    """
    faces = np.diff(graph.listing.offsets.numpy())
    i, j = Graph.from_faces(mesh.positions, mesh.faces, weights="uniform", weld=None, device="cpu").edges.T
    zero = (mesh.positions[i] == mesh.positions[j]).all(axis=1)
    return Edges(
        edges=graph.edge_count,
        boundary=int(np.count_nonzero(faces == 1)),
        non_manifold=int(np.count_nonzero(faces > 2)),
        zero_length=int(np.count_nonzero(zero)),
        components=graph.component_count,
        largest=int(np.diff(graph.component_offsets).max()),
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
