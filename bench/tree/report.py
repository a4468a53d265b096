"""The study's tables and figures from its journal."""

from __future__ import annotations

from bench.tree.journal import Journal
from bench.tree.page import TABLES, refresh


def main(journal: Journal, *, full: bool, figures: bool = True) -> None:
    """Writes bench/results/NAME.md and figures; of the full form into docs, where the page has its tables."""
    made = {name: table(journal) for name, table in TABLES.items()}
    text = "\n\n".join(f"## {name}\n\n{table}" for name, table in made.items() if table)
    journal.path.with_suffix(".md").write_text(text + "\n")
    print(text, flush=True)
    if figures:
        # Where the study is measured there need be nothing to draw with.
        from bench.tree.figures import draw

        draw(journal)
        if full:
            refresh()
