"""What the user should look at in a deformation, in words."""

from __future__ import annotations

import numpy as np

from oneform_warp.fields import JUMP_LIMIT, NodeFields, fast_edges
from oneform_warp.graph import Graph
from oneform_warp.grip import Grip

__all__ = ["bare_notes", "field_notes", "is_misfit", "misfit_notes", "place_notes", "turn_notes"]

MISFIT = 0.2
"""A thick bar twisted by 360 degrees misses 0.17, and one that loses turns 0.27 and more."""

STRAINED = 0.02
"""phi / sum mu |v|^2; targets that agree with the rotations on standard cases give up to 0.06, by twisting alone."""

FAR = 0.1
"""Of the box's diagonal: agreeing targets miss 0.005, a translated plate 0.35, CGAL's bent cactus 0.7."""


def field_notes(graph: Graph, nodes: NodeFields) -> list[str]:
    """What to look at in the fields."""
    notes = [f"the fields are not smooth yet: {s.status}" for s in nodes.solutions if not s.converged]
    count, first = fast_edges(graph, nodes.omega, JUMP_LIMIT)
    if count:
        i, j = graph.edges[first]
        notes.append(
            f"the rotation changes by more than 45 degrees along {count} edges (the first joins vertices {i} and {j}); "
            "at 180 a turn is lost: put more vertices between the handles, or more room"
        )
    return notes


def bare_notes(grip: Grip) -> list[str]:
    """Names the components that no handle touches."""
    graph, bare = grip.graph, np.flatnonzero(~grip.touched)
    if not len(bare):
        return []
    sizes = np.bincount(graph.components, minlength=graph.component_count)
    first = [int(graph.vertex_at[graph.component_offsets[c] : graph.component_offsets[c + 1]].min()) for c in bare[:3]]
    named = ", ".join(f"the one of vertex {v} ({sizes[c]} vertices)" for v, c in zip(first, bare[:3], strict=True))
    more = f" and {len(bare) - 3} more" if len(bare) > 3 else ""
    return [
        f"no handle touches {len(bare)} of {graph.component_count} components, they stay as they are: {named}{more}"
    ]


def is_misfit(phi: float, asked: float) -> bool:
    """Whether the edges miss enough of what the fields ask for to wonder about the places of handles."""
    return phi > STRAINED * asked


def place_notes(grip: Grip, misses: dict[int, float], diagonal: float) -> list[str]:
    """Names the handles whose place contradicts the rotations; misses: distances by number."""
    return [
        f"the rotations alone would bring {grip.handles[number].label(number)} to a place {miss / diagonal:.0%} of the "
        "box away from its target, and the edges stretch to reach it: refine=10 finds rotations that fit the targets"
        for number, miss in misses.items()
        if miss > FAR * diagonal
    ]


def turn_notes(grip: Grip) -> list[str]:
    """Names placed handles that turn by more than half a turn: the ARAP energy is lower without it."""
    return [
        f"{handle.label(number)} turns by {np.degrees(angle):.0f} degrees and has a place: refining unwinds what is "
        "above half a turn; leave refine out, or the place"
        for number, handle in enumerate(grip.handles)
        if handle.moves and handle.rotation is not None and (angle := np.linalg.norm(handle.rotation)) > np.pi + 1e-9
    ]


def misfit_notes(phi: float, asked: float) -> list[str]:
    """Whether the shape gave way: phi = sum mu |dx - v|^2 against sum mu |v|^2."""
    if phi <= MISFIT * asked:
        return []
    return [
        f"the edges miss {phi / asked:.0%} of what the fields ask for (phi / sum mu |v|^2): the rotation changes too "
        "fast for the thickness of the shape, and whole turns may be lost; spread it over more length"
    ]
