"""A pymeshlab.MeshSet that knows the filters of this package, and of others, beside MeshLab's own."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import ArrayLike, NDArray

from oneform_warp.errors import InputError
from oneform_warp.filters.attributes import SCENES, Parts, add_attributes, loadable, named_parts
from oneform_warp.filters.deferred import DeferredMeshSet
from oneform_warp.filters.filter import Filter
from oneform_warp.filters.handle_set import HandleSet
from oneform_warp.filters.native import (
    as_pymeshlab,
    forget_failure,
    native_filters,
    native_values,
    plain_values,
    same_folder,
)
from oneform_warp.filters.parameters import Length
from oneform_warp.filters.registry import own_filters
from oneform_warp.filters.script import Script
from oneform_warp.filters.step import Step

__all__ = ["MeshSet"]


class MeshSet(DeferredMeshSet):
    """Everything that a pymeshlab.MeshSet is, with more filters.

    `apply_filter(name, ...)` and methods named after the filters work for all of them. Handles belong to a mesh, by
    its id; `handle_sets` has them. deferred: MeshLab gets new positions only when it is asked for something.
    """

    def __init__(self, verbose: bool = False, *, deferred: bool = False) -> None:
        super().__init__(verbose, deferred=deferred)
        self.handle_sets: dict[int, HandleSet] = {}
        self._files: dict[int, Path] = {}
        self._parts: dict[int, tuple[int, Parts]] = {}
        self._script = Script()

    # ------------------------------------------------------------------ filters

    def apply_filter(self, filter_name: str, **values: Any) -> dict[str, Any]:
        """Applies a filter to the current mesh; -> what it returns.

        Raises PyMeshLabException: for filters of this package its __cause__ is the InputError.
        """
        own = own_filters().get(filter_name)
        return self._apply_native(filter_name, values) if own is None else self._apply_own(own, values)

    def __getattr__(self, name: str) -> Any:
        own = own_filters().get(name)
        if own is None:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

        def filter_function(**values: Any) -> dict[str, Any] | None:
            return self.apply_filter(name, **values) or None

        filter_function.__name__, filter_function.__doc__ = name, own.describe()
        return filter_function

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *own_filters()})

    def filter_parameter_values(self, filter_name: str, **values: Any) -> dict[str, Any]:
        """The values that a filter would use on the current mesh: those given, and the defaults of the others."""
        own = own_filters().get(filter_name)
        if own is None:
            return dict(super().filter_parameter_values(filter_name, **values))
        with as_pymeshlab(f"Failed to get values of filter: {filter_name}"):
            return own.values(values, self._diagonal(own))

    def _apply_own(self, own: Filter, values: dict[str, Any]) -> dict[str, Any]:
        unknown = values.keys() - {parameter.name for parameter in own.parameters}
        message = f"Parameter {min(unknown)} not found for filter {own.name}." if unknown else ""
        with as_pymeshlab(message or f"Failed to apply filter: {own.name}"):
            plain = own.plain(values)
            with self._unrecorded():
                result = own.apply(self, **own.values(plain, self._diagonal(own)))
        if not self._quiet:
            self._script.add(Step(own.name, plain))
        return dict(result or {})

    def _apply_native(self, name: str, values: dict[str, Any]) -> dict[str, Any]:
        used = self._used(name, values)
        try:
            result: dict[str, Any] = super().apply_filter(name, **values)
        except Exception:
            forget_failure()
            raise
        self._script.add_native(name, None if self._quiet else used)
        for known in (self.handle_sets, self._files, self._parts):
            for number in [number for number in known if not self.mesh_id_exists(number)]:
                del known[number]
        for number, placed in self.handle_sets.items():
            placed.notice(name, self.mesh(number).vertex_number())
        return result

    def _used(self, name: str, values: dict[str, Any]) -> dict[str, Any]:
        """The values that a native filter is going to use, for the script; what is wrong with them, it says itself."""
        if self._quiet or name not in native_filters():
            return {}
        try:
            return plain_values(super().filter_parameter_values(name, **values))
        except Exception:  # noqa: BLE001 - pybind11 raises RuntimeError, pymeshlab several kinds of its own
            return {}

    def _diagonal(self, own: Filter) -> float:
        """The diagonal of the current mesh's bounding box."""
        if not self.mesh_number():
            raise InputError(f"{own.name} requires at least one mesh loaded in the MeshSet.")
        if not any(isinstance(parameter, Length) for parameter in own.parameters):
            return 0.0  # and nobody will ask
        positions = self._positions()
        return float(np.linalg.norm([np.ptp(column) for column in positions.T])) if len(positions) else 0.0

    # ------------------------------------------------------------------ what filters of ours build on

    def placed_handles(self) -> HandleSet:
        """The handles of the current mesh, or a new empty set; StaleHandles where its vertices are others now."""
        if not self.unread:
            mesh = pymeshlab.MeshSet.current_mesh(self)  # where its vertices are does not matter
            if not np.array_equal(mesh.transform_matrix(), np.eye(4)):
                what = "the mesh has a transform matrix that its vertices do not have yet"
                raise InputError(what, where=mesh.label(), fix="apply_matrix_freeze comes first")
        positions, faces = self._positions(), self._faces()
        placed = self.handle_sets.get(self.current_mesh_id())
        if placed is None:
            placed = self.handle_sets[self.current_mesh_id()] = HandleSet(positions, faces)
        placed.meet(positions, faces)
        return placed

    def set_vertex_scalar_array(self, values: ArrayLike) -> None:
        """Writes the quality (V,) of the current mesh, every bit.

        pymeshlab has no setter, and a custom attribute cannot be removed again: the values go by the coordinates.
        """
        quality = np.ascontiguousarray(values, dtype=np.float64)
        positions = self.vertex_matrix()
        if quality.shape != (len(positions),):
            raise InputError(f"quality {quality.shape} for {len(positions)} vertices", fix="give (V,)")
        self.set_vertex_matrix(np.stack([quality, *np.zeros((2, len(quality)))], axis=1))
        with self._unrecorded():
            self.apply_filter("compute_scalar_by_function_per_vertex", q="x")
        self.set_vertex_matrix(positions)

    def vertex_attribute(self, name: str, *, columns: int) -> NDArray[np.float64]:
        """A custom attribute of the current mesh: scalars (V,) for columns=1, points (V, 3) for columns=3."""
        mesh = self.current_mesh()
        try:
            if columns == 1:
                return np.array(mesh.vertex_custom_scalar_attribute_array(name), dtype=np.float64)
            return np.array(mesh.vertex_custom_point_attribute_matrix(name), dtype=np.float64)
        except pymeshlab.PyMeshLabException:
            kind = "scalar" if columns == 1 else "point"
            fix = f"load a file that has it, or mesh.add_vertex_custom_{kind}_attribute(values, {name!r})"
            raise InputError(f"the mesh has no {kind} attribute {name!r}", where="attribute", fix=fix) from None

    def named_parts(self) -> Parts:
        """The vertices of each group, object and material of the file of the current mesh; none where they changed."""
        number = self.current_mesh_id()
        if number not in self._parts:
            self._parts[number] = named_parts(self._files[number]) if number in self._files else (0, {})
        vertices, parts = self._parts[number]
        return parts if vertices == self.current_mesh().vertex_number() else {}

    def name_parts(self, parts: Parts) -> None:
        """Gives names to vertices of the current mesh, for handles on a group."""
        self._parts[self.current_mesh_id()] = self.current_mesh().vertex_number(), parts

    # ------------------------------------------------------------------ meshes

    def load_new_mesh(self, file_name: str | os.PathLike[str], **values: Any) -> None:
        """Loads a mesh, with the properties that pymeshlab leaves out as custom attributes; scenes in world space.

        Files that would crash pymeshlab raise PyMeshLabException as others do; the process stays in its folder.
        """
        path, before = Path(file_name).absolute(), {mesh.id() for mesh in self}
        with as_pymeshlab(f"Unable to open file: {path}"), same_folder(), loadable(path) as read:
            super().load_new_mesh(str(read), **values)
        for number in sorted({mesh.id() for mesh in self} - before):
            self._files[number] = path
            if path.suffix.lower() in SCENES:
                self._freeze(number)
            add_attributes(self.mesh(number), path)

    def save_current_mesh(self, file_name: str | os.PathLike[str], **values: Any) -> None:
        """Writes the current mesh by MeshLab, a transform matrix applied; the process stays in its folder."""
        with same_folder():
            super().save_current_mesh(str(Path(file_name).absolute()), **values)

    def set_current_mesh(self, new_curr_id: int) -> None:
        """Makes a mesh the current one; PyMeshLabException where there is none (pymeshlab crashes later)."""
        if not self.mesh_id_exists(new_curr_id):
            raise pymeshlab.PyMeshLabException(f"Mesh ID {new_curr_id} not found in MeshSet.")
        super().set_current_mesh(new_curr_id)

    def clear(self) -> None:
        """Deletes all meshes, and the handles on them."""
        self._ahead = None
        super().clear()
        self.handle_sets.clear()
        self._files.clear()
        self._parts.clear()

    def _freeze(self, number: int) -> None:
        """Applies a mesh's transform matrix to its vertices."""
        current = self.current_mesh_id()
        with self._unrecorded():
            super().set_current_mesh(number)
            self.apply_filter("apply_matrix_freeze")
            super().set_current_mesh(current)

    # ------------------------------------------------------------------ scripts

    @property
    def steps(self) -> tuple[Step, ...]:
        """The filters applied so far, or those of the script that was loaded."""
        return self._script.steps

    def save_filter_script(self, filter_script_name: str | os.PathLike[str]) -> None:
        """Writes the script as .mlx, with all digits, so that a replay gives the same bits."""
        with as_pymeshlab("Failed to save the filter script"):
            self._script.save(filter_script_name, super().save_filter_script)

    def load_filter_script(self, filter_script_name: str | os.PathLike[str]) -> None:
        """Reads a script from .mlx in place of the current one; an exception names a filter that is not known."""
        with as_pymeshlab("Failed to load the filter script"):
            self._script.load(filter_script_name)
        super().clear_filter_script()

    def clear_filter_script(self) -> None:
        """Empties the script."""
        super().clear_filter_script()
        self._script.clear()

    def apply_filter_script(self) -> None:
        """Applies the filters of the script, in order."""
        with self._unrecorded(), self.deferred():
            for step in self.steps:
                self.apply_step(step)

    def apply_step(self, step: Step) -> dict[str, Any]:
        """Applies one step of plain data."""
        own = step.filter in own_filters()
        return self.apply_filter(
            step.filter, **(step.parameters if own else native_values(step.filter, step.parameters))
        )

    def print_filter_script(self) -> None:
        """Prints the filters of the script with their parameters."""
        print(f"Filter Script Size : {len(self.steps)}\n")
        for number, step in enumerate(self.steps):
            print(f"{number}: {step.filter}")
            print("".join(f"\t{name} = {value!r}\n" for name, value in step.parameters.items()))
