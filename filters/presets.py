"""apply_coord_oneform_bend, _twist, _taper, _stretch, _swell and _pose: common deformations in one step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from oneform_warp import presets
from oneform_warp.errors import InputError
from oneform_warp.filters.deformation import REFINING, SOLVING, moved, settings_of
from oneform_warp.filters.filter import Filter
from oneform_warp.filters.handle_filters import AXES, CUSTOM
from oneform_warp.filters.handle_set import HandleSet, PlacedHandle
from oneform_warp.filters.parameters import Choice, Flag, Number, Parameter, Vector, Whole
from oneform_warp.handles import Handle

if TYPE_CHECKING:
    from oneform_warp.filters.meshset import MeshSet

__all__ = ["PRESET_FILTERS"]

PRINCIPAL, ACROSS, PLANE, SELECTION = "principal axis", "widest across", "plane", "selection"

ALONG: tuple[Parameter, ...] = (
    Choice("axis", PRINCIPAL, "The axis along the shape; its low end stays where it is. The principal axis is the "
           "direction in which the vertices spread the most.", (PRINCIPAL, *AXES, CUSTOM)),
    Vector("customaxis", (0.0, 0.0, 0.0), "For axis='custom axis'; with the opposite sign the other end stays."),
)  # fmt: skip
ABOUT: tuple[Parameter, ...] = (
    Choice("rotaxis", ACROSS, "The axis that angle turns about; the direction at right angles to the shape in which it "
           "is widest, or an axis of the mesh.", (ACROSS, *AXES, CUSTOM)),
    Vector("customrotaxis", (0.0, 0.0, 0.0), "For rotaxis='custom axis'."),
)  # fmt: skip
ENDS = Number("ends", 0.1, "Each end that stays stiff, as a part of the length.", 0.0, 0.49, above=True)
SPELLED = {"keepvolume": "keep_volume"}
DEGREES = "Degrees, right-handed, any number of turns: 720 is not 0."


def _thickness(default: float, where: str) -> Number:
    return Number("factor", default, f"The thickness {where}, over that of the rest.", 0.0, above=True)


def _axes(values: Mapping[str, Any]) -> dict[str, Any]:
    """Which axes a preset gets; what is left out is the shape's own."""
    chosen: dict[str, Any] = {}
    for word, choice, custom in (("axis", "axis", "customaxis"), ("about", "rotaxis", "customrotaxis")):
        named = values.get(choice, ACROSS)
        if named in (PRINCIPAL, ACROSS):
            continue
        axis = AXES.get(named, values[custom])
        if not any(axis):
            raise InputError("the axis is zero", where=custom, fix="give three numbers, not all 0")
        chosen[word] = axis
    return chosen


def _joint(meshes: MeshSet, placed: HandleSet, values: Mapping[str, Any]) -> dict[str, Any]:
    """What says where a limb turns: the part of the length, or the selected vertices."""
    if values["joint"] == PLANE:
        return {"at": values["at"], "room": values["room"]}
    selected = np.asarray(meshes.current_mesh().vertex_selection_array(), dtype=bool)
    beyond = None if values["beyond"] < 0 else values["beyond"]
    return {"joint": selected, "faces": placed.faces, "beyond": beyond}


def _apply(meshes: MeshSet, make: Callable[..., list[Handle]], values: dict[str, Any], own: tuple[str, ...]) -> Any:
    """Deforms the mesh as it is now by a preset's handles, which take the place of others."""
    number = meshes.current_mesh_id()
    before = meshes.handle_sets.pop(number, None)
    try:
        placed = meshes.placed_handles()
        options = _axes(values) | {SPELLED.get(name, name): values[name] for name in own}
        options |= _joint(meshes, placed, values) if "joint" in values else {}
        for handle in make(placed.rest, **options):
            placed.place(PlacedHandle.of(handle, len(placed.rest)))
        return moved(meshes, placed, settings_of(values), None)
    except InputError:
        meshes.handle_sets.pop(number, None)
        if before is not None:
            meshes.handle_sets[number] = before
        raise


def _preset(make: Callable[..., list[Handle]], text: str, own: tuple[Parameter, ...], *more: Parameter) -> Filter:
    """The filter of a preset; `own` are the parameters that are named as its arguments."""
    names = tuple(parameter.name for parameter in own)

    def apply(meshes: MeshSet, **values: Any) -> Any:
        return _apply(meshes, make, values, names)

    help_text = f"{text} Handles that were set before are forgotten, and the rest pose is the mesh as it is now."
    name = f"apply_coord_oneform_{make.__name__}"
    return Filter(name, help_text, (*own, *ALONG, *more, *REFINING, *SOLVING), apply)


PRESET_FILTERS = (
    _preset(presets.bend, "Bends the mesh along an axis: one end stays and the other is turned.",
            (Number("angle", 90.0, DEGREES), ENDS), *ABOUT),
    _preset(presets.twist, "Twists the mesh along an axis: one end stays and the other is turned about the axis.",
            (Number("angle", 180.0, DEGREES), ENDS)),
    _preset(presets.taper, "Makes the mesh thinner or thicker towards one end; its length stays.",
            (_thickness(0.5, "at that end"), ENDS)),
    _preset(presets.stretch, "Makes the mesh longer or shorter along an axis, evenly; one end stays.",
            (Number("factor", 1.5, "The new length over the old one.", 0.0, above=True), ENDS,
             Flag("keepvolume", False, "Whether it gets thinner as it gets longer, so that the volume stays."))),
    _preset(presets.swell, "Makes the mesh thicker or thinner around one place; both ends stay.",
            (_thickness(1.5, "there"), Number("at", 0.5, "Where, from 0 at the low end to 1.", 0.001, 0.999), ENDS)),
    _preset(presets.pose, "Turns everything beyond a joint about it, as a limb; the rest stays.",
            (Number("angle", 90.0, DEGREES),), *ABOUT,
            Choice("joint", PLANE, "A plane across the axis, or the selected vertices, which cut the mesh in two.",
                   (PLANE, SELECTION)),
            Number("at", 0.5, "For joint='plane': where, from 0 at the low end to 1.", 0.001, 0.999),
            Number("room", 0.2, "For joint='plane': the part of the length around it that is free.", 0.0, 0.99),
            Whole("beyond", -1, "For joint='selection': a vertex on the side that turns; -1: the smaller side.", -1)),
)  # fmt: skip
