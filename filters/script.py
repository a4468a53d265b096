"""The filter script of a MeshSet: what was applied, ours and MeshLab's, in order."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from oneform_warp.filters.mlx import Applied, read_script, recorded, write_script
from oneform_warp.filters.step import Step

__all__ = ["Script"]


class Script:
    """Steps in order. MeshLab keeps a script of its own filters only, whose words for them are used when saving."""

    def __init__(self) -> None:
        self._applied: list[Applied] = []
        self._natives: dict[int, int] = {}
        """Place of a native filter here -> its number in MeshLab's script."""
        self._native_count = 0

    @property
    def steps(self) -> tuple[Step, ...]:
        """What was applied, or loaded."""
        return tuple(each.step for each in self._applied)

    def add(self, step: Step) -> None:
        """A filter of ours was applied."""
        self._applied.append(Applied(step))

    def add_native(self, name: str, used: Mapping[str, Any] | None) -> None:
        """MeshLab has applied a filter of its own, with these values; None where it is no step of the user's."""
        if used is not None:
            self._natives[len(self._applied)] = self._native_count
            self._applied.append(Applied(Step(name, used)))
        self._native_count += 1

    def clear(self) -> None:
        """Forgets everything."""
        self._applied, self._natives, self._native_count = [], {}, 0

    def load(self, path: str | os.PathLike[str]) -> None:
        """Reads a script in place of this one; FileError where it cannot be used."""
        applied = read_script(path)
        self.clear()
        self._applied = applied

    def save(self, path: str | os.PathLike[str], save_native: Callable[[str], None]) -> None:
        """Writes the script; `save_native(path)` writes MeshLab's."""
        script = list(self._applied)
        used = {number: script[place].step.parameters for place, number in self._natives.items()}
        with tempfile.TemporaryDirectory() as folder:
            native = Path(folder) / "native.mlx"
            save_native(str(native))
            elements = recorded(native, used)
        for place, number in self._natives.items():
            script[place] = Applied(script[place].step, elements[number])
        write_script(path, script)
