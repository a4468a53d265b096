"""The README is true: its Python runs as pasted, its commands exist."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import oneform_warp as ow

README = Path(__file__).resolve().parents[1] / "README.md"


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)


def test_the_python_of_the_readme_runs_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trimesh = pytest.importorskip("trimesh")
    monkeypatch.chdir(tmp_path)
    x, faces = ow.shapes.bar()
    trimesh.Trimesh(x, faces, process=False).export("scan.ply")
    names: dict[str, object] = {"trimesh": trimesh}
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), names)
    y, solution = names["y"], names["solution"]
    assert isinstance(y, np.ndarray)
    assert y.shape == x.shape
    assert np.abs(y - solution.x).max() < 1.0  # type: ignore[attr-defined]
    assert solution.converged  # type: ignore[attr-defined]


def test_the_commands_of_the_readme_exist() -> None:
    pytest.importorskip("lark")
    from oneform_warp.cli import main

    text = README.read_text(encoding="utf-8")
    commands = set(re.findall(r"oneform-warp (\w+)", text))
    options = set(re.findall(r"(--[a-z][a-z-]+)", text))
    assert {"deform", "info", "doctor"} <= commands
    for command in commands:
        assert CliRunner().invoke(main, [command, "--help"]).exit_code == 0, command
    shown = CliRunner().invoke(main, ["deform", "--help"]).output
    assert {option for option in options if option not in shown} <= {"--help"}


def test_what_the_readme_points_to_is_there() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README.read_text(encoding="utf-8")):
        assert target.startswith("http") or (README.parent / target).exists(), target
