"""Materials, textures and buffers beside a mesh: looked for in its folder only, and copied along with it."""

import filecmp
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath

__all__ = ["copy_companions", "find_companions", "inside", "sync"]

MAP = re.compile(r"^[ \t]*(?:map_\w+|bump|disp|decal|refl|norm)[ \t]+([^\r\n]+)", re.M | re.I)


def inside(folder: Path, name: str) -> Path | None:
    """The path of a name below a folder; None where it leads out of it, by `..`, a root, a drive or a link."""
    plain = PurePosixPath(name.replace("\\", "/"))
    if plain.is_absolute() or ".." in plain.parts or PureWindowsPath(name).drive or "\0" in name:
        return None
    path = folder / plain
    try:
        return path if path.resolve().is_relative_to(folder.resolve()) else None
    except OSError:
        return None


def find_companions(folder: Path, names: Iterable[str]) -> tuple[list[Path], list[str]]:
    """The files in a folder that these names stand for and the textures of materials, and warnings for those outside.

    A name may have spaces, or be several ones; one that stands for nothing is left out, as it is missing already.
    """
    found: dict[Path, None] = {}
    warnings: list[str] = []
    for name in names:
        files, outside = _resolve(folder, [[name], name.split()])
        for file in files:
            found[file] = None
            if file.suffix.lower() == ".mtl":
                for match in MAP.finditer(file.read_text(encoding="utf-8", errors="surrogateescape")):
                    words = match[1].strip().split(" ")
                    textures, away = _resolve(file.parent, [[" ".join(words[i:])] for i in range(len(words))])
                    inner = [each for each in textures if inside(folder, os.path.relpath(each, folder))]
                    found |= dict.fromkeys(inner)
                    outside += away
        warnings += [f"{each!r} is not in the folder of the mesh, and is not copied" for each in outside]
    return list(found), list(dict.fromkeys(warnings))


def _resolve(folder: Path, readings: Sequence[Sequence[str]]) -> tuple[list[Path], list[str]]:
    """The files of the first way to read a name that gives any; else the parts of it that lead out of the folder."""
    outside: list[str] = []
    for names in readings:
        paths = [inside(folder, name) for name in names]
        files = [path for path in paths if path is not None and _is_file(path)]
        if files:
            return files, []
        outside += [name for name, path in zip(names, paths, strict=True) if path is None]
    return [], outside[-1:]


def copy_companions(files: Iterable[Path], source: Path, target: Path) -> Iterator[str]:
    """Copy files from below one folder to the same places below another; -> a warning for each that cannot be.

    What is there already with other contents is somebody else's, and stays.
    """
    for file in files:
        name = file.relative_to(source)
        place = inside(target, str(name))
        if place is None:
            yield f"{str(name)!r} would be written outside the folder, and is not copied"
        elif not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=place.parent, prefix=".") as folder:
                part = Path(folder) / "part"
                shutil.copyfile(file, part)
                sync(part)
                os.replace(part, place)
        elif not (_is_file(place) and filecmp.cmp(file, place, shallow=False)):
            yield f"{str(name)!r} is there already with other contents, and is not replaced"


def sync(path: Path) -> None:
    """Bring a file or folder to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long
        return False
