"""Files that a command is going to write: checked before the work, and then complete or untouched."""

import json
import os
import tempfile
from pathlib import Path
from typing import Any

from oneform_warp.errors import FileError

__all__ = ["check_places", "check_writable", "write_json"]


def check_writable(out: Path | None, preview: Path | None, report: Path | None) -> None:
    """FileError where one of the files of `deform` could not be made; makes nothing."""
    check_places(out, preview, report)
    if preview is not None and preview.suffix.lower() != ".png":
        raise FileError("a picture is a .png file", where=str(preview), fix="change the name")


def check_places(*paths: Path | None) -> None:
    """FileError where one of several files could not be made, or two are one; makes nothing."""
    given = [path for path in paths if path is not None]
    for path in given:
        if [other.absolute() for other in given].count(path.absolute()) > 1:
            raise FileError("two files are to be written here", where=str(path), fix="give them different names")
        _check_place(path)


def _check_place(path: Path) -> None:
    """FileError where no file can be made at this path."""
    folder = path.absolute().parent
    if path.is_dir():
        raise FileError("this is a folder", where=str(path), fix="add a file name")
    if not folder.is_dir():
        raise FileError("the folder does not exist", where=str(path), fix="make the folder first")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        what = f"the folder cannot be written to: {error.strerror}"
        raise FileError(what, where=str(path), fix="choose another folder") from None


def write_json(path: Path, value: Any) -> None:
    """Write a value as JSON, in one step."""
    try:
        with tempfile.TemporaryDirectory(dir=path.absolute().parent, prefix=".") as folder:
            part = Path(folder) / path.name
            part.write_text(json.dumps(value, indent=2) + "\n", encoding="utf-8")
            os.replace(part, path)
    except OSError as error:
        raise FileError(f"cannot be written: {error.strerror}", where=str(path), fix="choose another folder") from None
