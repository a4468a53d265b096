"""What can be said of a sequence of steps before any mesh is there: what they need, and what undoes what."""

from __future__ import annotations

from collections.abc import Sequence

from oneform_warp.errors import InputError
from oneform_warp.filters.handle_set import StaleHandles
from oneform_warp.filters.step import Step

__all__ = ["check_order", "place"]

SETS, CLEARS, USES = "set_oneform_handle", "clear_oneform_handles", "apply_coord_oneform_deformation"
OTHER_SOURCES = ("condselect", "attribute", "group")

RENEWING = ("meshing_decimation_", "meshing_isotropic_", "meshing_surface_subdivision_", "generate_", "create_")
"""Native filters of these families leave other vertices, or another current mesh."""

IMPLICIT_SELECTION = frozenset({"meshing_close_holes"})
"""Native filters that select, but do not say so in their name."""


def place(number: int, step: Step) -> str:
    """Where a step stands, for messages; numbers from 1."""
    return f"step {number}, {step.filter}"


def check_order(steps: Sequence[Step]) -> None:
    """InputError for steps that cannot work on a mesh fresh from a file, whatever mesh it is.

    A handle without a selection, a deformation without a handle, and StaleHandles where a step between the two leaves
    other vertices.
    """
    selected, handles, renewed = False, 0, ""
    for number, step in enumerate(steps, 1):
        name = step.filter
        if name == SETS:
            if not selected and _by_selection(step):
                fix = "select vertices in a step before, or give condselect"
                raise InputError("nothing is selected", where=place(number, step), fix=fix)
            handles, renewed = handles + 1, "" if not handles else renewed
        elif name == CLEARS and not step.parameters.get("name"):
            handles, renewed = 0, ""
        elif name == USES:
            if not handles:
                raise InputError("there is no handle", where=place(number, step), fix=f"add a step {SETS} before it")
            if renewed:
                what = f"{renewed} leaves other vertices than those that the handles were set on"
                raise StaleHandles(what, where=place(number, step), fix="set the handles after it")
        elif name.startswith(RENEWING):
            renewed = place(number, step) if handles else ""
        selected = selected or "selection" in name or name in IMPLICIT_SELECTION


def _by_selection(step: Step) -> bool:
    """Whether a handle is made of the current selection."""
    if any(step.parameters.get(name) for name in OTHER_SOURCES):
        return False
    return step.parameters.get("source", "selection") in ("selection", "selected vertices", "selected faces")
