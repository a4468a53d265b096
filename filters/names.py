"""What outputs are called: a pattern with the parts of an input's name -> a path below the output folder."""

import os
import string
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from oneform_warp.errors import InputError
from oneform_warp.filters.meshfile import SCENES, WRITABLE

__all__ = ["DEFAULT", "FIELDS", "OWN", "Source", "checked_pattern", "output_name"]

DEFAULT = "{folder}/{name}{ext}"
FIELDS = ("folder", "parent", "name", "ext")
OWN = ".oneform-warp"  # what the batch itself puts into the output folder begins so
LONGEST = 255  # bytes, on all common file systems


@dataclass(frozen=True, slots=True)
class Source:
    """An input file: its absolute path, and where it was found by search, the folder searched, and its own below it.

    `folder` is relative, as "a/b".
    """

    path: Path
    folder: str = ""
    searched: Path | None = None


def checked_pattern(pattern: str, where: str) -> str:
    """The pattern itself, once it is known to stay below a folder and to end in a format that can be written."""
    try:
        parts = list(string.Formatter().parse(pattern))
    except ValueError as error:
        raise InputError(f"{pattern!r}: {error}", where=where, fix=f"write fields as {DEFAULT}") from None
    known = ", ".join(f"{{{name}}}" for name in FIELDS)
    for _, name, spec, conversion in parts:
        if name is not None and (name not in FIELDS or spec or conversion):
            raise InputError(f"there is no field {{{name}}} in {pattern!r}", where=where, fix=f"use {known}")
    if pattern.startswith("/") or "\0" in pattern or ".." in pattern.split("/"):
        fix = "leave out '..' and the first '/'"
        raise InputError(f"{pattern!r} leads out of the output folder", where=where, fix=fix)
    suffix = PurePosixPath(pattern).suffix.lower()
    if not pattern.endswith("{ext}") and suffix not in WRITABLE | SCENES:
        formats = ", ".join(sorted(WRITABLE | SCENES))
        fix = f"end it in {{ext}} or one of {formats}"
        raise InputError(f"{pattern!r} names no format that can be written", where=where, fix=fix)
    return pattern


def output_name(pattern: str, source: Source) -> str:
    """The path of an input's output, relative and with "/"; InputError where a part of it is no name of a file.

    A pattern that begins with a field which is empty has no first "/".
    """
    stem, ext = os.path.splitext(source.path.name)
    values = {"folder": source.folder, "parent": source.path.parent.name, "name": stem, "ext": ext}
    pieces = (text + (values[name] if name else "") for text, name, _, _ in string.Formatter().parse(pattern))
    parts = [part for part in "".join(pieces).split("/") if part]
    if not parts or any(part in (".", "..") for part in parts) or parts[0].startswith(OWN):
        raise InputError(f"{'/'.join(parts)!r} cannot be the name of an output", fix="rename the input")
    for part in parts:
        if len(os.fsencode(part)) > LONGEST:
            raise InputError(f"the name of the output has more than {LONGEST} bytes", fix="shorten the input's name")
    return "/".join(parts)
