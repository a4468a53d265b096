"""What a deformation came to, in words and as JSON."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from oneform_warp import __version__
from oneform_warp.cli.plan import Plan
from oneform_warp.deformation import Deformation
from oneform_warp.graph import Graph
from oneform_warp.solvers.refinement import worst

__all__ = ["mesh_line", "report_json", "report_lines"]


def mesh_line(name: str, graph: Graph) -> str:
    """The mesh in one line."""
    welded = graph.vertex_count - graph.node_count
    parts = [
        f"{name}: {graph.vertex_count:,} vertices",
        *([f"{welded:,} of them welded"] if welded else []),
        f"{graph.edge_count:,} edges",
        f"{graph.component_count:,} component{'s' if graph.component_count > 1 else ''}",
        f"on {graph.device}",
    ]
    return ", ".join(parts)


def report_lines(plan: Plan, solution: Deformation, seconds: Mapping[str, float]) -> list[str]:
    """The report for people; warnings are apart."""
    ratio = worst(solution.residual, solution.goal)
    times = ", ".join(f"{stage} {value:.3f}" for stage, value in seconds.items())
    return [
        mesh_line(plan.mesh.path.name, plan.deformer.graph),
        f"{solution.status.word} after {solution.iterations:,} iterations of {_solver(plan)} "
        f"(restarts: {solution.restarts}), residual {ratio:.3g} times its goal",
        f"energy {solution.energy:.6g}",
        f"seconds: {times}; {sum(seconds.values()):.3f} in all",
    ]


def report_json(plan: Plan, solution: Deformation, seconds: Mapping[str, float], out: Path) -> dict[str, Any]:
    """The report for programs; numbers that are not finite become null."""
    graph = plan.deformer.graph
    return {
        "version": __version__,
        "input": str(plan.mesh.path),
        "output": str(out.absolute()),
        "backend": plan.mesh.backend,
        "device": str(graph.device),
        "vertices": graph.vertex_count,
        "nodes": graph.node_count,
        "edges": graph.edge_count,
        "components": graph.component_count,
        "settings": asdict(plan.settings),
        "handles": [_handle(plan, number) for number in range(len(plan.handles))],
        "solver": _solver(plan),
        "status": solution.status.word,
        "message": str(solution.status),
        "converged": solution.converged,
        "energy": _finite(solution.energy),
        "residual_over_goal": _finite(worst(solution.residual, solution.goal)),
        "residual": _finite(float(solution.residual.max(initial=0.0))),
        "iterations": solution.iterations,
        "restarts": solution.restarts,
        "seconds": dict(seconds),
        "measures": _measures(plan, solution),
        "warnings": list(solution.warnings),
    }


def _measures(plan: Plan, solution: Deformation) -> dict[str, float | None]:
    """What the deformation did, in numbers; self-intersections, which take longest, are left to the filter."""
    from oneform_warp.measures import measures

    found = measures(plan.mesh.positions, solution.x, plan.mesh.faces, intersections=False)
    return {name: _finite(value) for name, value in found.known().items()}


def _solver(plan: Plan) -> str:
    return type(plan.deformer.solver).__name__


def _handle(plan: Plan, number: int) -> dict[str, Any]:
    spec, handle = plan.specs[number], plan.handles[number]
    points = plan.mesh.positions[handle.vertices]
    return {
        "name": spec.name,
        "select": spec.select,
        "vertices": len(points),
        "box": [points.min(axis=0).tolist(), points.max(axis=0).tolist()],
        "held": handle.held,
        "rotation": None if handle.rotation is None else handle.rotation.tolist(),
        "stretch": None if handle.stretch is None else np.asarray(handle.stretch).tolist(),
        "text": handle.describe(),
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
