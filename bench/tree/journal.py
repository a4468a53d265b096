"""Results as they come, a line each: a run that was broken off goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.table import RESULTS


class Journal:
    """One JSONL file: lines {"part", "key", "rows"}."""

    def __init__(self, name: str) -> None:
        self.path: Path = RESULTS / f"{name}.jsonl"
        RESULTS.mkdir(exist_ok=True)
        self.lines = [json.loads(line) for line in self.path.read_text().splitlines()] if self.path.exists() else []
        self._done = {(line["part"], line["key"]) for line in self.lines}

    def has(self, part: str, key: str) -> bool:
        """Whether these rows are there."""
        return (part, key) in self._done

    def once(self, part: str, key: str, work: Callable[[], list[dict[str, Any]]]) -> None:
        """Does the work where its rows are not there yet, and writes them down at once."""
        if self.has(part, key):
            return
        line = {"part": part, "key": key, "rows": _short(work())}
        with self.path.open("a") as file:
            file.write(json.dumps(line) + "\n")
        self.lines.append(line)
        self._done.add((part, key))

    def rows(self, part: str) -> list[dict[str, Any]]:
        """All rows of a part."""
        return [row for line in self.lines if line["part"] == part for row in line["rows"]]


def _short(value: Any) -> Any:
    """Floats to five digits, in lists and dictionaries."""
    if isinstance(value, float):
        return float(f"{value:.5g}")
    if isinstance(value, dict):
        return {key: _short(each) for key, each in value.items()}
    return [_short(each) for each in value] if isinstance(value, list) else value
