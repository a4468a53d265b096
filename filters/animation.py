"""Frames of a mesh, written as one glTF scene that moves, or as numbered files."""

import os
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from oneform_warp.errors import FileError, InputError
from oneform_warp.filters.formats import GltfRecords
from oneform_warp.filters.formats.companions import copy_companions, find_companions
from oneform_warp.filters.formats.gltf_frames import animated
from oneform_warp.filters.formats.motion import Motion, Normals
from oneform_warp.filters.meshfile import SCENES, MeshFile
from oneform_warp.filters.new_scene import scene_of
from oneform_warp.filters.placing import failures, put, same_folder

__all__ = ["FIELD", "Frame", "check_animation", "frame_path", "write_animation", "write_frames"]

Frame = tuple[ArrayLike, ArrayLike | None]
"""Positions (V, 3), and the rotation vectors (V, 3) in radians by which stored normals turn, or None."""

FIELD = "{frame}"
DIGITS = 4


def write_frames(
    mesh: MeshFile, pattern: str | os.PathLike[str], frames: Iterable[Frame], *, normals: Normals = "rotate"
) -> tuple[str, ...]:
    """Write each frame as `MeshFile.write` does, {frame} in the pattern becoming 0000, 0001, ...; -> warnings."""
    notes: dict[str, None] = {}
    check_animation(mesh, pattern)
    for number, (positions, omega) in enumerate(frames):
        notes |= dict.fromkeys(mesh.write(frame_path(pattern, number), positions, normals=normals, omega=omega))
    return tuple(notes)


def frame_path(pattern: str | os.PathLike[str], number: int) -> Path:
    """The file of a frame, in as many digits as file managers need to sort ten thousand."""
    path = Path(pattern)
    return path.with_name(path.name.replace(FIELD, f"{number:0{DIGITS}}"))


def write_animation(
    mesh: MeshFile,
    path: str | os.PathLike[str],
    frames: Iterable[Frame],
    times: ArrayLike,
    *,
    normals: Normals = "rotate",
) -> tuple[str, ...]:
    """Write a glTF scene that goes through the frames at times (T,) in seconds, ascending; -> warnings.

    Each frame is a morph target, and viewers blend linearly from one to the next. A mesh that was read from glTF keeps
    its scene with all in it, in its own format; any other becomes a new .glb of its triangles, with UVs, normals,
    colours, materials and textures. The scene's own pose is the mesh as it was read. The file is complete or not there.
    Raises FileError and InputError as `MeshFile.write`.
    """
    check_animation(mesh, path)
    target, clock = Path(path).absolute(), _checked_times(times)
    if normals not in get_args(Normals):
        raise InputError(f"{normals!r} is no way to treat normals", where="normals", fix="use rotate, recompute, keep")
    with failures(target, "written"), tempfile.TemporaryDirectory(dir=target.parent, prefix=".") as name:
        folder, warnings = Path(name), list[str]()
        records, vertices = mesh.records, np.arange(len(mesh.positions))
        names: tuple[str, ...] = ()
        if isinstance(records, GltfRecords):
            names = records.companions()
        else:
            records, vertices = scene_of(mesh, target.name)
        elsewhere = not same_folder(target.parent, mesh.path.parent)
        motions = _motions(mesh, records, vertices, _counted(frames, len(clock)), normals)
        for each, data in animated(records, motions, clock, target.name, frozenset(names)).items():
            (folder / each).write_bytes(data)
        if elsewhere:
            files, warnings = find_companions(mesh.path.parent, names)
            warnings += copy_companions(files, mesh.path.parent, target.parent)
        warnings += put(folder, target)
    return tuple(warnings)


def check_animation(mesh: MeshFile, path: str | os.PathLike[str]) -> None:
    """FileError where frames of a mesh cannot be written to a path, whose name has {frame} for numbered files."""
    target = Path(path).absolute()
    if FIELD in target.name:
        mesh.check_target(frame_path(target, 0))
        return
    suffix, own = target.suffix.lower(), mesh.path.suffix.lower()
    wanted = own if own in SCENES else ".glb"
    if suffix != wanted:
        scene = "of a scene keeps its format" if own in SCENES else "is one .glb file"
        fix = f"end the name in {wanted}, or write numbered meshes, as {target.stem}_{FIELD}{suffix or '.ply'}"
        raise FileError(f"an animation {scene}", where=str(target), fix=fix)
    if not target.parent.is_dir():
        raise FileError("the folder does not exist", where=str(target), fix="make the folder first")


def _checked_times(times: ArrayLike) -> NDArray[np.float64]:
    clock = np.asarray(times, dtype=np.float64)
    # Viewers see 32-bit seconds.
    if clock.ndim != 1 or not np.isfinite(clock).all() or (np.diff(clock.astype(np.float32)) <= 0).any():
        raise InputError("times do not ascend", where="times", fix="give seconds (T,), one for each frame")
    return clock


def _counted(frames: Iterable[Frame], count: int) -> Iterator[Frame]:
    """The frames; InputError where they are not as many as there are times."""
    number = -1
    for number, frame in enumerate(frames):
        if number < count:
            yield frame
    if number + 1 != count:
        raise InputError(f"{number + 1} frames for {count} times", where="times", fix="give one for each frame")


def _motions(
    mesh: MeshFile, records: GltfRecords, vertices: NDArray[np.int64], frames: Iterable[Frame], normals: Normals
) -> Iterator[Motion]:
    """Each frame as a motion of the scene's vertices, of which `vertices` (W,) are the mesh's."""
    before, polygons = records.positions(), records.polygons()
    for positions, omega in frames:
        points = np.asarray(positions, dtype=np.float64)
        if points.shape != mesh.positions.shape or not np.isfinite(points).all():
            what = f"a frame has positions {points.shape}, or some that are not finite"
            raise InputError(what, where="frames", fix=f"give finite {mesh.positions.shape}")
        # What did not move stays where the scene has it, in 32 bits.
        moved = (points != mesh.positions).any(axis=1)[vertices]
        after = np.where(moved[:, None], points[vertices], before)
        turns: Any = None if omega is None else np.asarray(omega, dtype=np.float64)[vertices]
        yield Motion(before, after, polygons, turns, normals)
