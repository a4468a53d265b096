"""`oneform-warp batch --report`: pictures drawn in workers, and the page that shows them."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oneform_warp.filters.batch import Entry

__all__ = ["make_report"]

SECONDS, MEMORY = 120.0, 8 << 30
SIZE = (960, 480)


@dataclass(frozen=True)
class Pair:
    """A mesh before and after."""

    output: str
    before: Path
    after: Path


def make_report(out: Path, path: Path, title: str, *, pictures: int, jobs: int) -> None:
    """Write the page for all that the journals in `out` have, with so many pictures, spread evenly over the outputs."""
    from oneform_warp.filters.batch import read_entries
    from oneform_warp.filters.batch.journal import WRITTEN
    from oneform_warp.filters.batch.report import report_html, write_report

    entries = sorted(read_entries(out), key=lambda entry: entry.output)
    written = [entry for entry in entries if entry.status == WRITTEN]
    chosen = [_pair(entry, out) for entry in _spread(written, pictures)]
    write_report(path, report_html(title, entries, _drawn(chosen, jobs)))


def _spread(entries: "Sequence[Entry]", count: int) -> "list[Entry]":
    count = min(count, len(entries))
    return [entries[number * len(entries) // count] for number in range(count)]


def _pair(entry: "Entry", out: Path) -> Pair:
    return Pair(entry.output, Path(entry.input), out / entry.output)


def _drawn(pairs: Sequence[Pair], jobs: int) -> dict[str, bytes | str]:
    """A picture of each pair as PNG, or why there is none, by output and in the order of the pairs."""
    from oneform_warp.filters.batch.pool import Limits, LocalPool
    from oneform_warp.filters.batch.work import Failure

    pictures: dict[str, bytes | str] = {}
    if pairs:
        with LocalPool(min(jobs, len(pairs)), Limits(SECONDS, MEMORY)) as pool:
            for results in pool.run(draw, pairs):
                for pair, picture in results:
                    pictures[pair.output] = picture.reason if isinstance(picture, Failure) else picture
    return {pair.output: pictures[pair.output] for pair in pairs}


def draw(pair: Pair) -> bytes:
    """The picture of a pair, as PNG."""
    from oneform_warp.filters import read_mesh
    from oneform_warp.preview import save_scene

    before, after = read_mesh(pair.before), read_mesh(pair.after)
    items = [("before", before.positions, before.faces), ("after", after.positions, after.faces)]
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "picture.png"
        save_scene(picture, items, shared_camera=True, size=SIZE)
        return picture.read_bytes()
