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


def test_the_recipe_of_the_readme_does_what_its_script_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pymeshlab")
    trimesh = pytest.importorskip("trimesh")
    from oneform_warp.cli import main

    monkeypatch.chdir(tmp_path)
    Path("scans").mkdir()
    trimesh.Trimesh(*ow.shapes.bar(), process=False).export("scan.ply")
    Path("scans/scan.ply").write_bytes(Path("scan.ply").read_bytes())
    script = next(block for block in blocks("python") if "MeshSet" in block)
    exec(compile(script, "README.md", "exec"), {})
    Path("pose.toml").write_text(blocks("toml")[0], encoding="utf-8")
    command = next(line for line in README.read_text(encoding="utf-8").splitlines() if "oneform-warp batch" in line)
    result = CliRunner().invoke(main, command.split()[1:])
    assert result.exit_code == 0, result.output
    by_script, by_batch = (trimesh.load(path, process=False).vertices for path in ("posed.ply", "posed/scan.ply"))
    # The batch keeps the file as it was, with float32 positions; MeshLab writes float64.
    assert (np.asarray(by_script, dtype=np.float32) == np.asarray(by_batch, dtype=np.float32)).all()


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
