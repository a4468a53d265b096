"""set_oneform_handle, clear_oneform_handles and print_oneform_handles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from oneform_warp.errors import InputError
from oneform_warp.filters.filter import Filter, nearest
from oneform_warp.filters.handle_mirror import MIRRORING, mirrored
from oneform_warp.filters.handle_place import PLACE, place_of
from oneform_warp.filters.handle_set import PlacedHandle
from oneform_warp.filters.handle_weights import SOURCES, handle_weights
from oneform_warp.filters.parameters import Choice, ColorValue, Flag, Number, Text, Vector
from oneform_warp.handles import FIT

if TYPE_CHECKING:
    from oneform_warp.filters.meshset import MeshSet

__all__ = ["CLEAR_HANDLES", "PRINT_HANDLES", "SET_HANDLE"]

AXES = {"X axis": (1.0, 0.0, 0.0), "Y axis": (0.0, 1.0, 0.0), "Z axis": (0.0, 0.0, 1.0)}
CUSTOM = "custom axis"


def _set_handle(meshes: MeshSet, **values: Any) -> dict[str, Any]:
    rotation = _rotation(values)
    stretch = _stretch(values)
    if values["held"] and (np.any(rotation or ()) or np.any(np.asarray(stretch or 1.0) != 1.0)):
        fix = "drop held, or drop the rotation and the stretch"
        raise InputError("a held handle stays where it is and cannot be rotated or stretched", where="held", fix=fix)
    weights = handle_weights(meshes, values)
    chosen = np.asarray(weights > 0)
    placed = meshes.placed_handles()
    handle = PlacedHandle(
        name=values["name"] or placed.free_name(),
        weights=weights,
        rotation=FIT if values["fitrotation"] else rotation,
        stretch=stretch,
        held=values["held"],
        frame=values["stretchframe"] if isinstance(stretch, tuple) else None,
        place=place_of(meshes, values, chosen),
    )
    handle.check()
    twin = mirrored(handle, placed.rest, values)
    placed.place(handle)
    if twin is not None:
        placed.place(twin)
    return {"name": handle.name, "vertices": int(handle.mask.sum())}


def _rotation(values: dict[str, Any]) -> tuple[float, ...] | None:
    """The rotation vector in radians; None where the rotation is free."""
    given = [name for name in ("angle", "rotation") if np.any(values[name])]
    if values["freerotation"]:
        given.append("freerotation")
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)} are given", where="rotation", fix="give one of them")
    if values["freerotation"]:
        return None
    if not values["angle"]:
        return tuple(values["rotation"])
    axis = np.asarray(AXES.get(values["rotaxis"], values["customaxis"]))
    length = float(np.linalg.norm(axis))
    if not length:
        raise InputError("the axis is zero", where="customaxis", fix="give three numbers, not all 0")
    return tuple((np.radians(values["angle"]) * (axis / length)).tolist())


def _stretch(values: dict[str, Any]) -> float | tuple[float, ...] | None:
    """A factor, three of them, or None where the stretch is free."""
    given = [name for name, none in (("stretch", 1.0), ("stretchfactors", (1.0, 1.0, 1.0))) if values[name] != none]
    if values["freestretch"]:
        given.append("freestretch")
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)} are given", where="stretch", fix="give one of them")
    if values["freestretch"]:
        return None
    factors: tuple[float, ...] = values["stretchfactors"]
    return factors if "stretchfactors" in given else float(values["stretch"])


SET_HANDLE = Filter(
    "set_oneform_handle",
    "Makes a handle of vertices of the current mesh: they are held in place, put somewhere, rotated by any "
    "number of turns, stretched, or any of these. The rest pose is the mesh as it is when it is first deformed.",
    (
        Choice("source", "selection", "Where the vertices come from; 'selection' takes the selected vertices, or those "
               "of the selected faces. A condselect, attribute or group needs no source.", tuple(SOURCES)),
        Text("condselect", "", "MeshLab's condition on vertices, such as 'z > 0.9'."),
        Text("attribute", "", "Name of a custom scalar attribute with painted weights 0..1."),
        Text("group", "", "Name of a group, object or material of the OBJ file that was loaded."),
        ColorValue("color", (255, 0, 0, 255), "For source='color': vertices of this colour."),
        Number("colortolerance", 0.0, "By how much each channel may differ, 0..255.", 0.0, 255.0),
        Flag("normalize", False, "Whether painted weights are scaled to run from 0 to 1."),
        Text("name", "", "The handle's name; one of the same name is replaced."),
        Flag("held", False, "Whether the vertices stay exactly where they are; of painted ones those of at least 1/2."),
        Choice("rotaxis", "Z axis", "The axis that angle turns about.", (*AXES, CUSTOM)),
        Vector("customaxis", (0.0, 0.0, 0.0), "For rotaxis='custom axis'."),
        Number("angle", 0.0, "Degrees, right-handed, any number of turns: 720 is not 0."),
        Vector("rotation", (0.0, 0.0, 0.0), "A rotation vector in radians, instead of axis and angle."),
        Number("stretch", 1.0, "Factor by which the surroundings grow.", 0.0, above=True),
        Vector("stretchfactors", (1.0, 1.0, 1.0), "Three factors along x, y, z of the rest pose, instead of stretch."),
        Vector("stretchframe", (0.0, 0.0, 0.0), "A rotation vector in radians that turns x, y, z to other directions."),
        Flag("freerotation", False, "Whether the handle leaves the rotation free."),
        Flag("freestretch", False, "Whether the handle leaves the stretch free."),
        *PLACE,
        *MIRRORING,
    ),
    _set_handle,
)  # fmt: skip


def _clear_handles(meshes: MeshSet, *, name: str) -> None:
    placed = meshes.handle_sets.get(meshes.current_mesh_id())
    if not name:
        meshes.handle_sets.pop(meshes.current_mesh_id(), None)
    elif placed is None or name not in placed.handles:
        known = {} if placed is None else placed.handles
        raise InputError(f"there is no handle {name!r}", where="name", fix=nearest(name, known))
    else:
        del placed.handles[name]


CLEAR_HANDLES = Filter(
    "clear_oneform_handles",
    "Forgets the handles of the current mesh; without a name also the rest pose, so that the mesh stays as it is now.",
    (Text("name", "", "Only the handle of this name; the others and the rest pose stay."),),
    _clear_handles,
)


def _print_handles(meshes: MeshSet) -> None:
    placed = meshes.handle_sets.get(meshes.current_mesh_id())
    if placed is None or not placed.handles:
        print("no handles")
        return
    meshes.placed_handles()  # for the check that they are still those of this mesh
    print("\n".join(handle.describe(placed.rest) for handle in placed.handles.values()))


PRINT_HANDLES = Filter(
    "print_oneform_handles",
    "Lists the handles of the current mesh: names, numbers of vertices, boxes in the rest pose, and what they do.",
    (),
    _print_handles,
)
