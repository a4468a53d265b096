"""Handles from the .sel and .def files of Botsch and Sorkine's survey, as CGAL's deformation example reads them.

    .sel   one status per vertex: 0 fixed, 1 free, 2 handle
    .def   a 4x4 matrix that moves the handle
    .json  optional, beside the .def: {"rotation_vector": [...]} in radians, since a matrix knows no whole turns

Lines that begin with # are comments. Source: Botsch, Sorkine 2008, "On linear variational surface deformation methods".
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from oneform_warp.errors import FileError, InputError
from oneform_warp.filters.filter import Filter
from oneform_warp.filters.handle_set import PlacedHandle
from oneform_warp.filters.parameters import Text
from oneform_warp.handles import Handle

if TYPE_CHECKING:
    from oneform_warp.filters.meshset import MeshSet

__all__ = ["SURVEY_HANDLES", "read_motion", "read_status", "read_survey_handles"]

Floats = NDArray[np.float64]
Three = tuple[float, ...]

FIXED, FREE, MOVED = 0, 1, 2

ROUGH = 1.0e-4
"""By how much a matrix may miss a rotation, or another one: survey files have six digits."""


def read_survey_handles(status: str | Path, motion: str | Path) -> list[Handle]:
    """The handles "fixed", held, and "moved", which x -> M x + t turns, stretches and puts in place.

    status, motion: paths of the .sel and the .def file; a .json file of the .def's name says the whole turns. Where one
    kind has no vertex there is no such handle. Raises FileError for what the files cannot mean.
    """
    kinds = read_status(status)
    rotation, stretch, frame, move = read_motion(motion)
    handles = []
    if (kinds == FIXED).any():
        handles.append(Handle(np.flatnonzero(kinds == FIXED), held=True, name="fixed"))
    if (kinds == MOVED).any():
        chosen = np.flatnonzero(kinds == MOVED)
        handles.append(
            Handle(chosen, rotation=rotation, stretch=stretch, frame=frame, pivot=np.zeros(3), move=move, name="moved")
        )
    return handles


def read_status(path: str | Path) -> NDArray[np.int64]:
    """The status of each vertex, (V,): 0 fixed, 1 free, 2 handle."""
    values = _numbers(path)
    wrong = ~np.isin(values, (FIXED, FREE, MOVED))
    if wrong.any():
        vertex = int(np.argmax(wrong))
        raise FileError(f"vertex {vertex} has the status {values[vertex]:g}", where=str(path), fix="use 0, 1 or 2")
    return values.astype(np.int64)


def read_motion(path: str | Path) -> tuple[Floats, float | Three, Three | None, Floats]:
    """Rotation vector (3,), stretch (a factor, or three and their frame's rotation vector) and translation (3,)."""
    values = _numbers(path)
    if values.size != 16:
        raise FileError(f"{values.size} numbers where a 4x4 matrix has 16", where=str(path), fix="give four rows")
    matrix = values.reshape(4, 4)
    if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
        raise FileError(f"the last row is {matrix[3].tolist()}", where=str(path), fix="use 0 0 0 1")
    turn, stretch, frame = _parts(matrix[:3, :3], path)
    return _whole_turns(turn, path), stretch, frame, matrix[:3, 3]


def _numbers(path: str | Path) -> Floats:
    """All numbers of a file without its comments."""
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"cannot be read: {error}", where=str(path), fix="give a text file") from error
    words = [word for line in lines if not line.lstrip().startswith("#") for word in line.split()]
    try:
        values = np.array(words, dtype=np.float64)
    except ValueError as error:
        raise FileError(str(error), where=str(path), fix="give numbers, and comments after #") from error
    if not np.isfinite(values).all():
        raise FileError("a number is not finite", where=str(path), fix="repair it")
    return values


def _parts(matrix: Floats, path: str | Path) -> tuple[Floats, float | Three, Three | None]:
    """M = R S: the rotation vector, and S as one factor, or as three and the rotation vector of their directions."""
    from scipy.spatial.transform import Rotation

    u, factors, v = np.linalg.svd(matrix)
    if np.linalg.det(matrix) <= 0.0:
        raise FileError("the matrix mirrors or flattens", where=str(path), fix="use rotation, stretch and translation")
    rotation = Rotation.from_matrix(u @ v).as_rotvec()
    if np.ptp(factors) > ROUGH * factors[0]:
        axes = v.T * np.sign(np.linalg.det(v))
        return rotation, tuple(factors.tolist()), tuple(Rotation.from_matrix(axes).as_rotvec().tolist())
    mean = float(factors.mean())
    return rotation, 1.0 if abs(mean - 1.0) <= ROUGH else mean, None


def _whole_turns(turn: Floats, path: str | Path) -> Floats:
    """The rotation vector of the .json file, if there is one and it is the same rotation."""
    from scipy.spatial.transform import Rotation

    beside = Path(path).with_suffix(".json")
    if not beside.is_file():
        return turn
    try:
        vector = np.asarray(json.loads(beside.read_text(encoding="utf-8"))["rotation_vector"], dtype=np.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"has no rotation vector: {error}", where=str(beside), fix="remove or repair it") from error
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise FileError(f"the rotation vector is {vector.tolist()}", where=str(beside), fix="give three numbers")
    gap = (Rotation.from_rotvec(vector) * Rotation.from_rotvec(turn).inv()).magnitude()
    if gap > ROUGH:
        raise FileError(
            f"the rotation is another one than in {Path(path).name}, by {np.degrees(gap):.3g} degrees",
            where=str(beside),
            fix="remove or repair one of them",
        )
    return vector


def _set_handles(meshes: MeshSet, *, selfile: str, deffile: str) -> dict[str, Any]:
    if not (selfile and deffile):
        raise InputError("two files are needed", where="selfile", fix="give a .sel and a .def file")
    placed = meshes.placed_handles()
    kinds = read_status(selfile)
    if len(kinds) != len(placed.rest):
        what = f"{len(kinds)} lines for {len(placed.rest)} vertices"
        raise FileError(what, where=selfile, fix="use the file of this mesh")
    rotation, stretch, frame, move = read_motion(deffile)
    moved = PlacedHandle(
        name="moved",
        weights=kinds == MOVED,
        rotation=tuple(rotation.tolist()),
        stretch=stretch,
        held=False,
        frame=frame,
        place={"pivot": np.zeros(3), "move": move},
    )
    fixed = PlacedHandle("fixed", kinds == FIXED, (0.0, 0.0, 0.0), 1.0, held=True)
    handles = [handle for handle in (fixed, moved) if handle.mask.any()]
    for handle in handles:
        placed.place(handle)
    return {handle.name: int(handle.mask.sum()) for handle in handles}


SURVEY_HANDLES = Filter(
    "set_oneform_handles_by_file",
    "Sets the handles 'fixed' and 'moved' from a .sel file (0 fixed, 1 free, 2 handle, one per vertex) and a .def file "
    "(a 4x4 matrix), as the survey of Botsch and Sorkine and CGAL's deformation example have them.",
    (
        Text("selfile", "", "Path of the .sel file."),
        Text("deffile", "", "Path of the .def file; a .json file beside it may say the rotation with whole turns."),
    ),
    _set_handles,
)
