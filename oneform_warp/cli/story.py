"""A mesh, its keyframes and the frames wanted: everything that is checked before the first frame, and how they went."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp import __version__
from oneform_warp.cli.constraint_spec import constraints_from
from oneform_warp.cli.keyframes import END
from oneform_warp.cli.mesh_facts import box_text
from oneform_warp.cli.plan import check_faces, falloff_of, make_deformer, make_handles, solve_options, touched
from oneform_warp.cli.preset_spec import presets_from
from oneform_warp.cli.recipe import Asked
from oneform_warp.cli.report import mesh_line
from oneform_warp.cli.settings import Settings
from oneform_warp.cli.specs import HandleSpec
from oneform_warp.cli.terminal import ProgressLine
from oneform_warp.constraints import Constraint
from oneform_warp.deformation import Deformation
from oneform_warp.filters import MeshFile
from oneform_warp.handles import Handle
from oneform_warp.sequences import Keyframes

__all__ = ["Story", "make_story"]


@dataclass(frozen=True, eq=False)
class Story:
    """What moves and how; `went` has a line for each frame that is solved."""

    mesh: MeshFile
    keys: Mapping[float, Sequence[Handle]]
    keyframes: Keyframes
    settings: Settings
    frames: int
    fps: float
    constraints: Sequence[Constraint] = ()
    went: list[dict[str, Any]] = field(default_factory=list)
    _notes: dict[str, str] = field(default_factory=dict)

    @property
    def seconds(self) -> NDArray[np.float64]:
        """When each frame is shown, (T,)."""
        return np.arange(self.frames) / self.fps

    @property
    def converged(self) -> bool:
        """Whether all frames are what they should be."""
        return all(frame["converged"] for frame in self.went)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to look at: of each kind of warning the last one, with its frame."""
        return tuple(self._notes.values())

    def solutions(self, progress: ProgressLine) -> Iterator[Deformation]:
        """The frames, one after the other."""
        for number, t in enumerate(np.linspace(0.0, END, self.frames).tolist()):
            progress.say(f"frame {number + 1} of {self.frames}")
            solution = self.keyframes.solve(t, constraints=self.constraints, **solve_options(self.settings))
            notes = [*solution.warnings, *([] if solution.converged else [str(solution.status)])]
            self._notes.update({re.sub(r"\d+", "", note): f"frame {number} (t = {t:.4g}): {note}" for note in notes})
            self.went.append({
                "t": t,
                "converged": solution.converged,
                "status": solution.status.word,
                "iterations": solution.iterations,
                "energy": solution.energy,
            })  # fmt: skip
            yield solution

    def vertices(self, *, held: bool) -> NDArray[np.bool_]:
        """The vertices (V,) of the handles that hold, or of the others."""
        handles = [handle for each in self.keys.values() for handle in each if handle.held == held]
        return touched(handles, len(self.mesh.positions))

    def lines(self) -> list[str]:
        """One line for each handle of each key."""
        lines = []
        for t, handles in sorted(self.keys.items()):
            for handle in handles:
                points = self.mesh.positions[handle.vertices]
                what = f"{len(points):,} vertices ({box_text(points)}), {handle.describe()}"
                lines.append(f"t = {t:g}, {handle.name}: {what}")
        return lines

    def summary(self, seconds: Mapping[str, float]) -> list[str]:
        """The report for people; warnings are apart."""
        done = sum(frame["converged"] for frame in self.went)
        times = ", ".join(f"{stage} {value:.3f}" for stage, value in seconds.items())
        return [
            mesh_line(self.mesh.path.name, self.keyframes.deformer.graph),
            f"{self.frames} frames at {self.fps:g} per second, {done} converged; "
            f"{sum(frame['iterations'] for frame in self.went):,} iterations of "
            f"{type(self.keyframes.deformer.solver).__name__}",
            f"seconds: {times}; {sum(seconds.values()):.3f} in all",
        ]

    def report(self, out: Path | None, warnings: Sequence[str], seconds: Mapping[str, float]) -> dict[str, Any]:
        """The report for programs."""
        graph = self.keyframes.deformer.graph
        return {
            "version": __version__,
            "input": str(self.mesh.path),
            "output": None if out is None else str(out.absolute()),
            "device": str(graph.device),
            "vertices": graph.vertex_count,
            "edges": graph.edge_count,
            "settings": asdict(self.settings),
            "keyframes": [
                {"t": t, "handles": [_told(each, graph.vertex_count) for each in self.keys[t]]}
                for t in sorted(self.keys)
            ],
            "fps": self.fps,
            "converged": self.converged,
            "frames": self.went,
            "seconds": dict(seconds),
            "warnings": list(warnings),
        }


def make_story(
    mesh: MeshFile,
    specs: Sequence[HandleSpec],
    keys: Mapping[float, Sequence[HandleSpec]],
    settings: Settings,
    frames: int,
    fps: float,
    asked: Asked,
) -> Story:
    """Checked handles and options; specs: handles at t = 1. InputError names what cannot be used."""
    check_faces(mesh)
    falloff_of(settings)
    handles = {t: make_handles(mesh, each)[1] for t, each in keys.items()}
    presets = presets_from(asked)
    if specs or presets:
        handles[END] = [*make_handles(mesh, specs, presets)[1], *handles.get(END, ())]
    held = [each.on(mesh) for each in constraints_from(asked)]
    return Story(mesh, handles, Keyframes(make_deformer(mesh, settings), handles), settings, frames, fps, held)


def _told(handle: Handle, vertex_count: int) -> dict[str, Any]:
    vertices = int(touched([handle], vertex_count).sum())
    return {"name": handle.name, "vertices": vertices, "text": handle.describe()}
