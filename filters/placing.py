"""Files put in place: complete or not there, whatever a library raises or leaves behind."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from oneform_warp.errors import FileError
from oneform_warp.filters.formats.companions import copy_companions, sync

__all__ = ["failures", "put", "same_folder"]


def put(folder: Path, target: Path) -> list[str]:
    """Move what was written in a folder beside the target, brought to the disk, the mesh last; -> warnings.

    MeshLab's materials, named after the mesh, and the buffers of a scene belong to it; a texture that is there already
    with other contents is somebody else's and stays.
    """
    beside = [made for made in sorted(folder.iterdir()) if made.name != target.name]
    own = [made for made in beside if made.name.startswith(target.name) or made.suffix == ".bin"]
    textures = [made for made in beside if made not in own]
    warnings = list(copy_companions(textures, folder, target.parent))
    for made in [*own, folder / target.name]:  # the mesh refers to the others
        sync(made)
        os.replace(made, target.parent / made.name)
    sync(target.parent)
    return warnings


def same_folder(left: Path, right: Path) -> bool:
    """Whether two paths are one folder."""
    return left.resolve() == right.resolve()


@contextmanager
def failures(path: Path, verb: str) -> Iterator[None]:
    """Turn what a backend raises into FileError, and go back to the folder that MeshLab leaves."""
    folder = os.getcwd()
    try:
        yield
    except FileError:
        raise
    except Exception as error:  # importers raise anything on broken files
        reason = " ".join(str(error).split()) or type(error).__name__
        fix = "check that it is a mesh of this format" if verb == "read" else "choose another format or folder"
        raise FileError(f"cannot be {verb}: {reason}", where=str(path), fix=fix) from error
    finally:
        os.chdir(folder)
