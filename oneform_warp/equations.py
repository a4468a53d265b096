"""Constraints on the vertices of a mesh at rest -> equations over its nodes, in the units of the solve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.constraints import Constraint
from oneform_warp.errors import InputError
from oneform_warp.rest import Rest
from oneform_warp.solvers.constrained import ConstrainedSolution, Equations

__all__ = ["constraint_notes", "equations", "misfits"]

NEGLIGIBLE = 1.0e-14
"""Rounding of a rotation about the normal of a plane, D = 2."""


def equations(constraints: Sequence[Constraint], rest: Rest) -> Equations:
    """All rows, one constraint after the other. InputError for vertices or axes that the mesh does not have.

    A vertex i of node n is at x_n + (its own rest position less that of the node), centred and scaled.
    """
    made = [_in_dimension(constraint, rest) for constraint in constraints]
    names = _told_apart([constraint.name for constraint in made])
    counts = [len(constraint.d) for constraint in made]
    first = np.cumsum([0, *counts])
    node_of, inside = rest.graph.node_of, rest.inside(rest.rows.data)
    vertex = _joined([constraint.vertex for constraint in made], np.int64)
    axis = _joined([constraint.axis for constraint in made], np.int64)
    node = node_of[vertex].astype(np.int64)
    # Exactly zero but where vertices are welded within a distance.
    beside = inside[vertex, axis] - rest.x.numpy()[node, axis]
    along = [(-1, -1) if c.along is None else node_of[list(c.along)] for c in made]
    return Equations(
        names=tuple(names),
        owner=np.repeat(np.arange(len(made)), counts),
        row=_joined([c.row + start for c, start in zip(made, first[:-1], strict=True)], np.int64),
        node=node,
        axis=axis,
        value=_joined([constraint.value for constraint in made]),
        origin=beside + rest.centre[axis] / rest.scale,
        d=_joined([constraint.d for constraint in made]) / rest.scale,
        compliance=_joined([_compliance(constraint) for constraint in made]),
        along=np.repeat(np.array(along, dtype=np.int64).reshape(-1, 2), counts, axis=0),
    )


def misfits(made: Equations, solution: ConstrainedSolution, rest: Rest) -> dict[str, float]:
    """The largest |C x - d| of each constraint's rows, in the unit of x, by name."""
    largest = np.zeros(len(made.names))
    np.maximum.at(largest, made.owner, np.abs(solution.misfit) * rest.scale)
    return dict(zip(made.names, largest.tolist(), strict=True))


def constraint_notes(made: Equations, solution: ConstrainedSolution) -> tuple[str, ...]:
    """What the user should know: the constraints with rows that follow from others."""
    rows = np.bincount(made.owner[solution.dropped], minlength=len(made.names))
    return tuple(
        f"constraint {made.names[k]!r}: {rows[k]} of {np.sum(made.owner == k)} rows follow from earlier ones "
        "and were left out"
        for k in np.flatnonzero(rows)
    )


def _in_dimension(constraint: Constraint, rest: Rest) -> Constraint:
    """The constraint with its coordinates below D, checked against the mesh."""
    dimension, count = rest.dimension, rest.graph.vertex_count
    wrong = (constraint.vertex < 0) | (constraint.vertex >= count)
    if wrong.any():
        raise InputError(
            f"vertex number {constraint.vertex[np.argmax(wrong)]} does not exist, there are {count} vertices",
            where=constraint.name,
            fix=f"use numbers from 0 to {count - 1}",
        )
    if constraint.vertex_count not in (None, count):
        raise InputError(
            f"made for {constraint.vertex_count} vertices where there are {count}",
            where=constraint.name,
            fix=f"give V * D = {count * dimension} columns",
        )
    if constraint.dimension not in (None, dimension):
        raise InputError(
            f"made for D = {constraint.dimension} where x has {dimension}",
            where=constraint.name,
            fix=f"give {dimension} numbers",
        )
    outside = constraint.axis >= dimension
    return _inside(constraint, outside) if outside.any() else constraint


def _inside(constraint: Constraint, outside: NDArray[np.bool_]) -> Constraint:
    """Without the coordinates that D does not have; InputError where a row needs them.

    A row may consist of them alone, with d = 0: then it says nothing. An edge that shows its direction later has none.
    """
    size = np.bincount(constraint.row, np.abs(constraint.value) * ~outside, len(constraint.d))
    beyond = np.bincount(constraint.row, np.abs(constraint.value) * outside, len(constraint.d))
    kept = size > NEGLIGIBLE * beyond
    leaves = (beyond > NEGLIGIBLE * size) & (kept | (constraint.d != 0.0))
    if constraint.along is None and leaves.any():
        raise InputError(
            "joins the plane of x with the third axis",
            where=constraint.name,
            fix="with D = 2 numbers turn by the angle alone, and leave z out",
        )
    chosen = ~outside & kept[constraint.row]
    weight = constraint.weight
    return replace(
        constraint,
        row=np.searchsorted(np.flatnonzero(kept), constraint.row[chosen]),
        vertex=constraint.vertex[chosen],
        axis=constraint.axis[chosen],
        value=constraint.value[chosen],
        d=constraint.d[kept],
        weight=weight if weight is None or weight.ndim == 0 else weight[kept],
    )


def _compliance(constraint: Constraint) -> NDArray[np.float64]:
    weight = constraint.weight
    return np.zeros(len(constraint.d)) if weight is None else np.broadcast_to(1.0 / weight, constraint.d.shape)


def _told_apart(names: list[str]) -> list[str]:
    """The same names, those that come again with numbers."""
    return [
        name if names.count(name) == 1 else f"{name} ({names[:number].count(name) + 1})"
        for number, name in enumerate(names)
    ]


def _joined(parts: Sequence[NDArray[Any]], dtype: type = float) -> NDArray[Any]:
    return np.concatenate([np.zeros(0, dtype=dtype), *parts])
