"""The page's tables, written in place from the journals: prose stays as it is, what stands between markers is made new.

    <!-- table: cpu, iterations, multigrid -->
    <!-- end -->

The first word is the journal's device, the rest is a name of TABLES.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from bench.tree import comparisons, tables
from bench.tree.journal import Journal
from bench.tree.seeds import BEST

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tree-study.md"

MARKED = re.compile(r"(<!-- table: (\w+), ([^\n]*) -->\n)(.*?)(<!-- end -->)", re.DOTALL)

SHOWN = ("rest", "min depth", "maximal", "held: min depth", "held: resistance", "held: AKPW", "rings", BEST, "nested",
         "previous")  # fmt: skip
"""The seeds of single cases."""

ELSEWHERE = ("rest", "min depth", "held: min depth", "held: resistance", "held: min depth + 16 sweeps", "rings",
             "nested", "previous")  # fmt: skip
"""Those of other algorithms."""

CASES = (
    ("bar:1k", "twist", 90.0),
    ("bar:1k", "bend", 90.0),
    ("paper/libigl_armadillo.obj", "arm", 90.0),
    ("paper/libigl_armadillo.obj", "twist", 90.0),
    ("sphere:7", "twist", 90.0),
)

Table = Callable[[Journal], str]


def _case(mesh: str, kind: str, amount: float) -> Table:
    return lambda journal: tables.one_case(journal.rows("curve"), mesh, kind, amount, SHOWN)


def _iterations(solver: str) -> Table:
    return lambda journal: tables.iterations(journal.rows("curve"), solver)


def _position(solver: str) -> Table:
    return lambda journal: tables.iterations(_shown(journal), solver, "position", 0)


def _shown(journal: Journal) -> tables.Rows:
    return [row for row in journal.rows("curve") if row["seed"] in ("zero", *SHOWN)]


def _others(journal: Journal) -> str:
    """At the larger of the angles, without the smallest sphere."""
    rows = journal.rows("others")
    rows = [row for row in rows if row.get("degrees", row["amount"]) != 10.0 and row["mesh"] != "sphere:4"]
    return tables.others([row for row in rows if row["seed"] in ELSEWHERE])


def _curve(table: Callable[[tables.Rows], str]) -> Table:
    return lambda journal: table(journal.rows("curve"))


TABLES: dict[str, Table] = {
    "what ran": _curve(comparisons.what_ran),
    "iterations, multigrid": _iterations("multigrid"),
    "iterations, Jacobi CG": _iterations("Jacobi CG"),
    "iterations, plain CG": _iterations("plain CG"),
    "iterations, Jacobi": _curve(comparisons.slow),
    "by noise": _curve(comparisons.by_noise),
    "position, multigrid": _position("multigrid"),
    "position, Jacobi CG": _position("Jacobi CG"),
    "by mesh, Jacobi CG": _curve(comparisons.by_mesh),
    "by tolerance": _curve(comparisons.by_tolerance),
    "by size": _curve(comparisons.by_size),
    "best by energy": _curve(comparisons.best_by_energy),
    "energies": _curve(tables.energies),
    "cost": _curve(tables.cost),
    "trees against each other": _curve(tables.claims),
    "energy and iterations": _curve(tables.correlation),
    "theory": _curve(tables.theory),
    "stretch": _curve(tables.stretch),
    "default start": lambda journal: tables.default_start(journal.rows("used")),
    "default start, all seeds": lambda journal: comparisons.default_and_all_seeds(
        journal.rows("curve"), journal.rows("used")
    ),
    "default start, the worst": lambda journal: tables.worst_starts(journal.rows("used")),
    "other algorithms": _others,
    "transfer": lambda journal: tables.transfer(journal.rows("transfer")),
    **{f"{mesh}, {kind} {amount:g}": _case(mesh, kind, amount) for mesh, kind, amount in CASES},
}
"""Each is empty where its rows are missing."""


def refreshed(text: str, device: str, journal: Journal) -> str:
    """The page with the tables of one device made new; those whose rows are missing stay. KeyError: an unknown name."""

    def table(found: re.Match[str]) -> str:
        opening, where, name, before, closing = found.groups()
        made = TABLES[name](journal) if where == device else ""
        return f"{opening}{made}\n{closing}" if made else f"{opening}{before}{closing}"

    return MARKED.sub(table, text)


def refresh() -> None:
    """docs/tree-study.md from the journals of all devices that are there."""
    text = PAGE.read_text()
    for device in ("cpu", "cuda"):
        text = refreshed(text, device, Journal(f"tree-{device}"))
    PAGE.write_text(text)
