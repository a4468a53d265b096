"""Which files a batch is about: files, folders, globs and lists of files."""

import glob
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from oneform_warp.errors import FileError, InputError
from oneform_warp.filters.meshfile import READABLE
from oneform_warp.filters.names import Source

__all__ = ["find_sources"]


def find_sources(
    inputs: Iterable[str | os.PathLike[str]],
    lists: Iterable[str | os.PathLike[str]] = (),
    *,
    extensions: Sequence[str] = (),
    out: Path | None = None,
) -> list[Source]:
    """The input files, each once, those of a folder in the order of their names.

    inputs: files, folders (searched through, hidden ones and `out` left out) and globs (`**` for any depth); a path
    that exists is never a glob. lists: text files with a path in each line, or with NUL between the paths. From
    folders and globs come only meshes, or only those with the given extensions. Raises InputError where an input
    does not exist and where nothing is found.
    """
    wanted = {extension.lower() for extension in extensions} or READABLE
    found: dict[Path, Source] = {}
    for each in inputs:
        for source in _sources(os.fspath(each), wanted, out):
            found.setdefault(source.path, source)
    for each in lists:
        for source in _listed(Path(each)):
            found.setdefault(source.path, source)
    if not found:
        fix = f"give files, folders or globs of {', '.join(sorted(wanted))}"
        raise InputError("there are no input files", where="inputs", fix=fix)
    return list(found.values())


def _sources(text: str, wanted: Iterable[str], out: Path | None) -> Iterator[Source]:
    path = _absolute(text)
    if path.is_dir():
        yield from _inside(path, wanted, out if out != path else None)
    elif os.path.lexists(path):
        yield Source(path)
    elif glob.has_magic(text):
        fixed = []
        for part in path.parts:
            if glob.has_magic(part):
                break
            fixed.append(part)
        root = Path(*fixed)
        left_out = out if out != root else None
        for name in sorted(glob.glob(str(path), recursive=True)):
            match = Path(name)
            if match.suffix.lower() in wanted and match.is_file() and not _below(match, left_out):
                yield Source(match, _folder(match, root), root)
    else:
        raise FileError("there is no such file or folder", where=text, fix="check the path")


def _inside(root: Path, wanted: Iterable[str], out: Path | None) -> Iterator[Source]:
    """The meshes in a folder and the folders in it; links to folders are not followed."""
    for folder, names, files in os.walk(root):
        here = Path(folder)
        names[:] = sorted(name for name in names if not name.startswith(".") and not _below(here / name, out))
        for name in sorted(files):
            path = here / name
            if path.suffix.lower() in wanted and not name.startswith(".") and path.is_file():
                yield Source(path, _folder(path, root), root)


def _listed(path: Path) -> Iterator[Source]:
    """The files of a list, whether they exist or not: what is missing is a failure of its own, not of the batch."""
    try:
        content = os.fsdecode(path.read_bytes())
    except OSError as error:
        raise FileError(f"cannot be read: {error.strerror}", where=str(path), fix="check the path") from None
    lines = content.split("\0") if "\0" in content else [line.rstrip("\r") for line in content.split("\n")]
    for line in filter(str.strip, lines):
        given = Path(line)
        inner = not given.is_absolute() and ".." not in given.parts
        yield Source(_absolute(line), _folder(given, Path()) if inner else "")


def _absolute(text: str) -> Path:
    return Path(os.path.abspath(os.path.expanduser(text)))


def _folder(path: Path, root: Path) -> str:
    """The folder of a file below another folder, "" where it is this one."""
    return "/".join(path.parent.relative_to(root).parts)


def _below(path: Path, folder: Path | None) -> bool:
    return folder is not None and path.is_relative_to(folder)
