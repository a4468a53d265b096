"""The report of a batch as one HTML file, with nothing to load: pictures are in it, names are escaped."""

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from oneform_warp.filters.batch.journal import FAILED, Entry
from oneform_warp.filters.batch.workspace import sync_folder

__all__ = ["printable", "report_html", "write_report"]

ROWS = 10_000

PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>{title}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; padding: 0 1rem; color: #222; }}
table {{ border-collapse: collapse; width: 100%; }}
th, td {{ text-align: left; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid #ddd; vertical-align: top; }}
td {{ overflow-wrap: anywhere; }}
figure {{ margin: 1rem 0; }}
img {{ max-width: 100%; }}
.failed {{ color: #a3210f; }}
</style>
<h1>{title}</h1>
<p>{summary}</p>
{body}
</html>
"""


def report_html(title: str, entries: Sequence[Entry], pictures: Mapping[str, bytes | str]) -> str:
    """The page: failures and their reasons, pictures before and after, then what was written.

    pictures: PNG data, or why there is none, by output.
    """
    failed = [entry for entry in entries if entry.status == FAILED]
    written = [entry for entry in entries if entry.status != FAILED]
    parts = []
    if failed:
        rows = [(entry.input, entry.reason or "") for entry in failed]
        parts.append('<h2 class="failed">Failures</h2>' + _table(("input", "reason"), rows))
    if pictures:
        shown = {entry.output: entry for entry in written}
        figures = [_figure(shown[output], picture) for output, picture in pictures.items() if output in shown]
        parts.append("<h2>Before and after</h2>" + "".join(figures))
    if written:
        measures = list(dict.fromkeys(name for entry in written for name in entry.measures))
        heads = ("output", "residual", "iterations", "seconds", *measures, "notes")
        parts.append("<h2>Outputs</h2>" + _table(heads, [_row(entry, measures) for entry in written]))
    summary = f"{len(written):,} written, {len(failed):,} failed"
    return PAGE.format(title=_text(title), summary=summary, body="\n".join(parts))


def write_report(path: Path, text: str) -> None:
    """Write the page in one step, as the outputs are written."""
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
        sync_folder(path.parent)
    finally:
        part.unlink(missing_ok=True)


def printable(name: str) -> str:
    """A name with its line breaks, control characters and broken bytes spelled out."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in name)


def _row(entry: Entry, measures: Sequence[str]) -> tuple[str, ...]:
    notes = [*([] if entry.converged else ["not converged"]), *entry.warnings]
    notes += [f"the format cannot hold {each}" for each in entry.lost]
    residual = "" if entry.residual is None else f"{entry.residual:.3g}"
    iterations = "" if entry.iterations is None else f"{entry.iterations:,}"
    found = [f"{entry.measures[name]:.4g}" if name in entry.measures else "" for name in measures]
    return entry.output, residual, iterations, f"{sum(entry.seconds.values()):.2f}", *found, "; ".join(notes)


def _figure(entry: Entry, picture: bytes | str) -> str:
    caption = f"<figcaption>{_text(entry.output)}</figcaption>"
    if isinstance(picture, str):
        return f"<figure>{caption}<p>no picture: {_text(picture)}</p></figure>"
    data = base64.b64encode(picture).decode()
    return f'<figure>{caption}<img alt="before and after" src="data:image/png;base64,{data}"></figure>'


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["".join(f"<td>{_text(cell)}</td>" for cell in row) for row in rows[:ROWS]]
    more = f"<p>and {len(rows) - ROWS:,} more, in the journal</p>" if len(rows) > ROWS else ""
    head = "".join(f"<th>{_text(each)}</th>" for each in heads)
    return f"<table><tr>{head}</tr>" + "".join(f"<tr>{line}</tr>" for line in lines) + f"</table>{more}"


def _text(text: str) -> str:
    return escape(printable(text))
