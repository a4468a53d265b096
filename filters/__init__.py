"""Mesh files in and out of the deformer: what needs MeshLab or trimesh, and nothing of the core needs."""

from oneform_warp.filters.meshfile import MeshFile, read_mesh

__all__ = ["MeshFile", "read_mesh"]
