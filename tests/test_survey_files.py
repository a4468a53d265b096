"""The .sel and .def files of the survey: what they mean, and what they cannot mean."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from mesh_sets import bar
from oneform_warp.errors import FileError
from oneform_warp.filters.survey_files import SURVEY_HANDLES, read_motion, read_survey_handles

SIX_DIGITS = 2.0e-6  # of a rotation matrix that is written with six digits, in radians


def write(folder: Path, status: object, matrix: np.ndarray, *, digits: int = 17, vector: object = None) -> list[Path]:
    files = [folder / "case.sel", folder / "case.def", folder / "case.json"]
    lines = "\n".join(str(s) for s in status)  # type: ignore[attr-defined]
    files[0].write_text(f"# a comment\n# {len(lines)} vertices\n{lines}\n")
    rows = "\n".join(" ".join(f"{v:.{digits}g}" for v in row) for row in matrix)
    files[1].write_text(f"# 4x4 handle transformation matrix\n{rows}\n")
    if vector is not None:
        files[2].write_text(json.dumps({"rotation_vector": vector}))
    return files[:2]


def motion(linear: np.ndarray, move: object = (0.0, 0.0, 0.0)) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, move
    return matrix


@given(st.integers(0, 10_000), st.sampled_from(["rigid", "scaled", "stretched"]))
def test_the_moved_handle_goes_where_the_matrix_says(tmp_path: Path, seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    linear = Rotation.random(rng=rng).as_matrix()
    if kind != "rigid":
        axes = Rotation.random(rng=rng).as_matrix()
        linear = linear @ axes @ np.diag(rng.uniform(0.5, 2.0, 1 if kind == "scaled" else 3) * np.ones(3)) @ axes.T
    matrix = motion(linear, rng.normal(size=3))
    x, faces = ow.shapes.bar(segments=8, sides=2)
    status = np.where(x[:, 2] < 0.1, 0, np.where(x[:, 2] > 0.9, 2, 1))
    handles = read_survey_handles(*write(tmp_path, status, matrix))
    y = ow.Deformer(x, faces).solve(handles).x
    assert [handle.name for handle in handles] == ["fixed", "moved"]
    assert np.array_equal(y[status == 0], x[status == 0])
    assert y[status == 2] == pytest.approx(x[status == 2] @ matrix[:3, :3].T + matrix[:3, 3], abs=1e-12)


def test_whole_turns_come_from_the_json(tmp_path: Path) -> None:
    vector = [0.0, 4.0 * np.pi, 0.0]
    files = write(tmp_path, [0, 1, 2], np.eye(4), vector=vector)
    assert np.array_equal(read_survey_handles(*files)[1].rotation, vector)
    (tmp_path / "case.json").unlink()
    assert not read_survey_handles(*files)[1].rotation.any()


def test_six_digits_are_enough(tmp_path: Path) -> None:
    turn = np.array([0.3, -1.0, 0.5])
    matrix = motion(Rotation.from_rotvec(turn).as_matrix())
    rotation, stretch, frame, _ = read_motion(write(tmp_path, [2], matrix, digits=6)[1])
    assert rotation == pytest.approx(turn, abs=SIX_DIGITS)
    assert (stretch, frame) == (1.0, None)


def test_a_kind_without_vertices_is_no_handle(tmp_path: Path) -> None:
    assert [handle.name for handle in read_survey_handles(*write(tmp_path, [1, 2, 1], np.eye(4)))] == ["moved"]
    assert read_survey_handles(*write(tmp_path, [1, 1], np.eye(4))) == []


MIRROR = motion(np.diag([1.0, 1.0, -1.0]))
PERSPECTIVE = np.eye(4) + np.eye(4)[::-1]


@pytest.mark.parametrize(
    ("status", "matrix", "vector", "says"),
    [
        ([0, 3, 1], np.eye(4), None, "case.sel: vertex 1 has the status 3; use 0, 1 or 2"),
        ([0, 0.5], np.eye(4), None, "vertex 1 has the status 0.5"),
        ([0, "two"], np.eye(4), None, "case.sel: .*two"),
        ([0, "nan"], np.eye(4), None, "case.sel: a number is not finite"),
        ([0, 2], np.eye(3), None, "case.def: 9 numbers where a 4x4 matrix has 16"),
        ([0, 2], PERSPECTIVE, None, "case.def: the last row is"),
        ([0, 2], MIRROR, None, "case.def: the matrix mirrors or flattens"),
        ([0, 2], 0.0 * MIRROR + np.diag([0.0, 0.0, 0.0, 1.0]), None, "mirrors or flattens"),
        (
            [0, 2],
            np.eye(4),
            [0.0, 1.0, 0.0],
            "case.json: the rotation is another one than in case.def, by 57.3 degrees",
        ),
        ([0, 2], np.eye(4), [0.0, 1.0], "case.json: the rotation vector is"),
        ([0, 2], np.eye(4), "up", "case.json: has no rotation vector"),
    ],
)
def test_files_that_mean_nothing(tmp_path: Path, status: object, matrix: np.ndarray, vector: object, says: str) -> None:
    files = write(tmp_path, status, matrix, vector=vector)
    with pytest.raises(FileError, match=says):
        read_survey_handles(*files)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"nothing.sel: cannot be read"):
        read_survey_handles(tmp_path / "nothing.sel", tmp_path / "nothing.def")


def test_the_filter_sets_the_same_handles(tmp_path: Path) -> None:
    meshes = bar()
    x, faces = np.array(meshes.current_mesh().vertex_matrix()), meshes.current_mesh().face_matrix()
    status = np.where(x[:, 2] < 0.1, 0, np.where(x[:, 2] > 0.9, 2, 1))
    linear = Rotation.from_rotvec([0.0, 0.0, 0.5]).as_matrix() @ np.diag([1.0, 1.2, 1.0])
    files = write(tmp_path, status, motion(linear, (0.01, 0.0, 0.0)))
    counts = SURVEY_HANDLES.apply(meshes, selfile=str(files[0]), deffile=str(files[1]))
    assert counts == {"fixed": int((status == 0).sum()), "moved": int((status == 2).sum())}
    meshes.apply_coord_oneform_deformation()
    expected = ow.deform(x, faces, read_survey_handles(*files))
    assert np.array_equal(meshes.current_mesh().vertex_matrix(), expected)


def test_the_filter_refuses_another_meshs_file(tmp_path: Path) -> None:
    files = write(tmp_path, [0, 1, 2], np.eye(4))
    with pytest.raises(FileError, match=r"3 lines for \d+ vertices"):
        SURVEY_HANDLES.apply(bar(), selfile=str(files[0]), deffile=str(files[1]))


def test_every_case_of_the_survey(meshes: Path) -> None:
    cases = sorted((meshes / "survey").rglob("*.sel"))
    assert len(cases) == 8
    for status in cases:
        fixed, moved = read_survey_handles(status, status.with_suffix(".def"))
        assert len(fixed.vertices)
        assert len(moved.vertices)
        assert moved.frame is None, "rigid to six digits"
        assert moved.stretch == 1.0
