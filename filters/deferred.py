"""A pymeshlab.MeshSet that may be ahead of MeshLab: with positions that it has not got, a file that it has not read.

MeshLab has no setter for positions, and a detour costs it more than loading the mesh did. A chain whose last steps are
ours, or all of them, never needs it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import ArrayLike, NDArray

from oneform_warp.errors import InputError
from oneform_warp.filters.changes import Looks, looks_of
from oneform_warp.filters.native import native_filters

__all__ = ["DeferredMeshSet"]

Positions = NDArray[np.float64]
Triangles = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class _Unread:
    """A file that MeshLab has not read, and what it will find in it."""

    path: Path
    positions: Positions
    faces: Triangles


@dataclass(frozen=True, eq=False)
class _Ahead:
    """The current mesh as it is for everybody but MeshLab."""

    positions: Positions
    faces: Triangles
    unread: _Unread | None = None


class DeferredMeshSet(pymeshlab.MeshSet):  # type: ignore[misc]
    """Moves vertices at once, but lets MeshLab follow only when it is asked for something.

    Whatever pymeshlab.MeshSet can do, filters, meshes, files, calls `settle` before. Only a pymeshlab.Mesh that was
    taken from the set before does not know of it; so vertices are moved late only where this is wished: by
    deferred=True, or inside `deferred()`.
    """

    def __init__(self, verbose: bool = False, *, deferred: bool = False) -> None:
        super().__init__(verbose)
        self._ahead: _Ahead | None = None
        self._deferring = deferred
        self._quiet = False
        self._first_looks: Looks | None = None

    # ------------------------------------------------------------------ the current mesh

    def vertex_matrix(self) -> Positions:
        """The positions (V, 3) of the current mesh, a copy."""
        return self._positions().copy() if self._ahead is not None else self._positions()

    def face_matrix(self) -> Triangles:
        """The triangles (F, 3) of the current mesh, a copy."""
        return self._faces().copy() if self._ahead is not None else self._faces()

    def set_vertex_matrix(self, positions: ArrayLike) -> None:
        """Moves the vertices of the current mesh to positions (V, 3), every bit; all its attributes stay."""
        points = np.ascontiguousarray(positions, dtype=np.float64)
        before, faces = self._positions(), self._faces()
        if points.shape != before.shape or not np.isfinite(points).all():
            raise InputError(f"positions {points.shape} for {len(before)} vertices", fix="give finite (V, 3)")
        if np.array_equal(points, before):
            return
        if not len(faces):
            label = pymeshlab.MeshSet.current_mesh(self).label()
            raise InputError("pymeshlab moves no points without faces", where=label, fix="add a mesh anew")
        unread = None if self._ahead is None else self._ahead.unread
        self._ahead = _Ahead(points + 0.0, faces, unread)  # -0 becomes 0, as in MeshLab's sums
        if not self._deferring:
            self.settle()

    def load_later(self, path: Path, positions: Positions, faces: Triangles) -> None:
        """Adds the first mesh: that of a file which MeshLab reads only when it is asked.

        positions (V, 3), faces (F, 3): exactly what MeshLab will find in the file.
        """
        if self.mesh_number():
            raise InputError("there are meshes already", where=str(path), fix="use load_new_mesh")
        self._ahead = _Ahead(positions, faces, _Unread(path, positions, faces))

    @property
    def unread(self) -> bool:
        """Whether MeshLab has not read the current mesh, so that nothing but positions can have changed."""
        return self._ahead is not None and self._ahead.unread is not None

    def current_mesh_id(self) -> int:
        """The number of the current mesh."""
        return 0 if self.unread else int(super().current_mesh_id())

    def mesh_number(self) -> int:
        """How many meshes there are."""
        return 1 if self.unread else int(super().mesh_number())

    def looks(self) -> Looks | None:
        """All of the current mesh but its positions; None while MeshLab has not read it."""
        return None if self.unread else looks_of(self)

    def looks_like(self, before: Looks | None) -> bool:
        """Whether `looks` still are what they were."""
        now = self.looks()
        before = self._first_looks if before is None else before
        return now is None or (before is not None and now.same_as(before))

    # ------------------------------------------------------------------ MeshLab

    @contextmanager
    def deferred(self) -> Iterator[None]:
        """Inside, MeshLab gets positions only when it is asked for something; afterwards it has them."""
        before, self._deferring = self._deferring, True
        try:
            yield
        finally:
            self._deferring = before
            if not before:
                self.settle()

    def settle(self) -> None:
        """Brings MeshLab up to date. Raises InputError where it reads the file otherwise than was said."""
        ahead, self._ahead = self._ahead, None
        if ahead is None:
            return
        with self._unrecorded():
            if ahead.unread is not None:
                self._read(ahead.unread)
            if not np.array_equal(self._positions(), ahead.positions):
                self._move(ahead.positions)

    def _read(self, file: _Unread) -> None:
        self.load_new_mesh(str(file.path))
        if not (np.array_equal(self._positions(), file.positions) and np.array_equal(self._faces(), file.faces)):
            raise InputError("MeshLab reads another mesh than the file has", where=str(file.path), fix="report it")
        self._first_looks = looks_of(self)

    def _move(self, points: Positions) -> None:
        """MeshLab has no setter: its vertices are drawn to those of a mesh that has nothing else."""
        current = self.current_mesh_id()
        self.add_mesh(pymeshlab.Mesh(points))
        target = self.current_mesh_id()
        self.set_current_mesh(current)
        for _ in range(2):  # the first pass leaves rounding errors of the difference, the second one none
            self.apply_filter("compute_coord_linear_morphing", targetmesh=target, percentmorph=100)
        self.set_current_mesh(target)
        self.apply_filter("delete_current_mesh")
        self.set_current_mesh(current)

    def _positions(self) -> Positions:
        if self._ahead is not None:
            return self._ahead.positions
        return np.ascontiguousarray(self.current_mesh().vertex_matrix(), dtype=np.float64)

    def _faces(self) -> Triangles:
        if self._ahead is not None:
            return self._ahead.faces
        mesh = self.current_mesh()
        faces = mesh.face_matrix() if mesh.face_number() else np.zeros((0, 3))
        return np.ascontiguousarray(faces, dtype=np.int32)

    @contextmanager
    def _unrecorded(self) -> Iterator[None]:
        """Filters that a filter of ours applies are no steps of the script."""
        before, self._quiet = self._quiet, True
        try:
            yield
        finally:
            self._quiet = before


def _settling(name: str) -> Callable[..., Any]:
    """pymeshlab's method of this name, once MeshLab is up to date."""
    native = getattr(pymeshlab.MeshSet, name)

    def method(self: DeferredMeshSet, *arguments: Any, **options: Any) -> Any:
        self.settle()
        return native(self, *arguments, **options)

    method.__name__, method.__doc__ = name, native.__doc__
    return method


# All that pymeshlab offers, in whatever version, but what is said above; its filters go by apply_filter.
_OFFERED = {name for name in vars(pymeshlab.MeshSet) if not name.startswith("_")} - native_filters()
for _name in (_OFFERED | {"__iter__", "__len__", "__getitem__"}) - vars(DeferredMeshSet).keys():
    setattr(DeferredMeshSet, _name, _settling(_name))
