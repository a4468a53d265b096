"""Files that a command is going to write: checked before the work, and then complete or untouched."""

import json
import os
import tempfile
from pathlib import Path
from typing import Any

from oneform_warp.errors import FileError

__all__ = ["check_writable", "write_json"]


def check_writable(path: Path | None, suffix: str | None = None) -> None:
    """FileError where a file of this path (and suffix) could not be made; makes nothing."""
    if path is None:
        return
    if suffix is not None and path.suffix.lower() != suffix:
        raise FileError(f"the name does not end in {suffix}", where=str(path), fix="change the name")
    if path.is_dir():
        raise FileError("this is a folder", where=str(path), fix="add a file name")
    if not path.absolute().parent.is_dir():
        raise FileError("the folder does not exist", where=str(path), fix="make the folder first")
    try:
        with tempfile.TemporaryFile(dir=path.absolute().parent):
            pass
    except OSError as error:
        raise FileError(
            f"the folder cannot be written to: {error.strerror}", where=str(path), fix="choose another"
        ) from None


def write_json(path: Path, value: Any) -> None:
    """Write a value as JSON, in one step."""
    try:
        with tempfile.TemporaryDirectory(dir=path.absolute().parent, prefix=".") as folder:
            part = Path(folder) / path.name
            part.write_text(json.dumps(value, indent=2) + "\n", encoding="utf-8")
            os.replace(part, path)
    except OSError as error:
        raise FileError(f"cannot be written: {error.strerror}", where=str(path), fix="choose another folder") from None
