"""Handles: the vertices that the user sets, and the rotation, stretch and hold that they get."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.arrays import vertex_mask
from oneform_warp.errors import InputError
from oneform_warp.graph import Graph

__all__ = ["Handle", "Pins", "held_nodes", "rotation_pins", "stretch_pins"]

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False, init=False)
class Handle:
    """Vertices that are turned by a rotation vector, stretched by a factor, held in place, or any of these."""

    vertices: Any
    rotation: NDArray[np.float64] | None
    """Rotation vector in radians, (3,); None where the rotation is free."""
    stretch: float | None
    held: bool
    name: str | None
    planar: bool
    """The rotation was given as a bare angle: it needs D = 2."""

    def __init__(
        self,
        vertices: Any,
        *,
        rotation: Any = (0.0, 0.0, 0.0),
        axis: Any = None,
        angle: float | None = None,
        stretch: float | None = 1.0,
        held: bool = False,
        name: str | None = None,
    ) -> None:
        """Any number of turns: 720 degrees are not 0.

        vertices: by number or by mask (V,). rotation: a rotation vector in radians, right-handed (D = 2: one angle);
        None leaves it free. axis: "x", "y", "z" or a vector, with angle in degrees (D = 2: angle alone).
        stretch: factor > 0; None leaves it free. held: positions stay exactly where they are.
        Raises InputError for matrices, quaternions and Rotation objects, which lose whole turns, and for a held
        handle that is rotated or stretched.
        """
        where = name or "handle"
        vector, planar = _rotation_vector(rotation, axis, angle, where)
        if stretch is not None and not (np.isfinite(stretch) and stretch > 0.0):
            raise InputError(f"stretch is {stretch}", where=where, fix="give a factor > 0, 1.0 for none")
        if held and ((vector is not None and vector.any()) or stretch not in (None, 1.0)):
            raise InputError(
                "a held handle stays where it is and cannot be rotated or stretched as well",
                where=where,
                fix="drop held=True, or drop the rotation and stretch",
            )
        for field, value in (
            ("vertices", vertices),
            ("rotation", vector),
            ("stretch", stretch),
            ("held", bool(held)),
            ("name", name),
            ("planar", planar),
        ):
            object.__setattr__(self, field, value)

    def mask(self, vertex_count: int, number: int) -> NDArray[np.bool_]:
        """The handle's vertices as a mask (V,); InputError when there are none or they do not fit the mesh."""
        mask = vertex_mask(self.vertices, vertex_count, self.label(number))
        if not mask.any():
            raise InputError(
                "no vertex is selected",
                where=self.label(number),
                fix="check the selection that makes this handle",
            )
        return mask

    def label(self, number: int) -> str:
        """The handle's name for messages, its number where it has none."""
        return f"handle {number}" if self.name is None else f"handle {self.name!r}"


def _rotation_vector(
    rotation: Any, axis: Any, angle: float | None, where: str
) -> tuple[NDArray[np.float64] | None, bool]:
    """The rotation vector (3,), and whether it was a bare angle."""
    if axis is not None or angle is not None:
        if rotation is None or np.any(np.asarray(rotation) != 0.0):
            raise InputError("both a rotation and an axis or angle are given", where=where, fix="give one of the two")
        if angle is None or not np.isfinite(angle):
            raise InputError(f"the angle is {angle}", where=where, fix="give the angle in degrees, as angle=90")
        direction = (0.0, 0.0, 1.0) if axis is None else _axis(axis, where)
        return np.radians(angle) * np.asarray(direction), axis is None
    if rotation is None:
        return None, False
    if hasattr(rotation, "as_rotvec"):
        raise InputError(
            "a Rotation object has lost its whole turns",
            where=where,
            fix="pass rotation=R.as_rotvec(), or axis and angle for more than 180 degrees",
        )
    vector = np.asarray(rotation, dtype=np.float64)
    if vector.shape in ((3, 3), (4, 4), (4,)):
        raise InputError(
            f"an array of shape {vector.shape} is a matrix or quaternion, which lose whole turns",
            where=where,
            fix="pass a rotation vector in radians: scipy's Rotation.from_matrix(M).as_rotvec() makes one",
        )
    if vector.shape not in ((), (1,), (3,)) or not np.isfinite(vector).all():
        raise InputError(
            f"rotation is {rotation!r}",
            where=where,
            fix="give three finite radians (D = 2: one angle in radians)",
        )
    return (vector, False) if vector.shape == (3,) else (np.array([0.0, 0.0, float(vector.reshape(()))]), True)


def _axis(axis: Any, where: str) -> NDArray[np.float64]:
    if isinstance(axis, str):
        if axis.lower().lstrip("+-") not in AXES:
            raise InputError(f"there is no axis {axis!r}", where=where, fix="use 'x', 'y', 'z' or three numbers")
        sign = -1.0 if axis.startswith("-") else 1.0
        return sign * np.asarray(AXES[axis.lower().lstrip("+-")])
    vector = np.asarray(axis, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise InputError(f"the axis is {axis!r}", where=where, fix="use 'x', 'y', 'z' or three numbers, not all 0")
    return vector / length


@dataclass(frozen=True, eq=False)
class Pins:
    """Nodes whose value is given, and the values."""

    mask: NDArray[np.bool_]
    """(n,)"""
    values: NDArray[np.float64]
    """(n, 3), zero where nothing is given."""


def rotation_pins(graph: Graph, handles: Sequence[Handle], dimension: int) -> Pins:
    """The rotation vectors that handles set at nodes; InputError where two handles disagree, or D has no such turn."""
    for number, handle in enumerate(handles):
        _check_dimension(handle, number, dimension)
    return _pins(graph, handles, "rotations", lambda handle: handle.rotation)


def stretch_pins(graph: Graph, handles: Sequence[Handle]) -> Pins:
    """Log sigma that handles set at nodes, in the first column; InputError where two handles disagree."""
    return _pins(
        graph,
        handles,
        "stretches",
        lambda handle: None if handle.stretch is None else np.array([np.log(handle.stretch), 0.0, 0.0]),
    )


def held_nodes(graph: Graph, handles: Sequence[Handle]) -> NDArray[np.bool_]:
    """The nodes that keep their positions, (n,)."""
    held = np.zeros(graph.node_count, dtype=bool)
    for number, handle in enumerate(handles):
        if handle.held:
            held[graph.node_of[handle.mask(graph.vertex_count, number)]] = True
    return held


def _pins(
    graph: Graph,
    handles: Sequence[Handle],
    kind: str,
    value_of: Callable[[Handle], NDArray[np.float64] | None],
) -> Pins:
    owner = np.full(graph.node_count, -1)
    values = np.zeros((graph.node_count, 3))
    for number, handle in enumerate(handles):
        vertices = np.flatnonzero(handle.mask(graph.vertex_count, number))
        value = value_of(handle)
        if value is None:
            continue
        nodes = graph.node_of[vertices]
        clash = (owner[nodes] >= 0) & (values[nodes] != value).any(axis=1)
        if clash.any():
            vertex = vertices[np.argmax(clash)]
            other = int(owner[graph.node_of[vertex]])
            raise InputError(
                f"{handles[other].label(other)} and {handle.label(number)} give different {kind}",
                where=f"vertex {vertex}",
                fix="let handles overlap only where they agree (welded vertices count as one)",
            )
        owner[nodes], values[nodes] = number, value
    return Pins(owner >= 0, values)


def _check_dimension(handle: Handle, number: int, dimension: int) -> None:
    turn = handle.rotation
    if turn is None or not turn.any():
        return
    if dimension == 3 and handle.planar:
        raise InputError("an angle alone turns nothing in D = 3", where=handle.label(number), fix="give an axis too")
    if dimension == 2 and turn[:2].any():
        raise InputError(
            "in D = 2 there is only one axis",
            where=handle.label(number),
            fix="give an angle alone, or axis='z'",
        )
    if dimension == 1:
        raise InputError("a line has no rotations", where=handle.label(number), fix="use stretch")
