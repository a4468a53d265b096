"""The study's tables and figures from its journal."""

from __future__ import annotations

from bench.tree import tables
from bench.tree.journal import Journal


def main(journal: Journal, figures: bool = True) -> None:
    """Writes bench/results/NAME.md, and the figures into docs/bench/."""
    curve, others = journal.rows("curve"), journal.rows("others")
    parts: list[tuple[str, str]] = []
    if curve:
        for solver in ("multigrid", "Jacobi CG", "plain CG", "Jacobi"):
            parts.append((f"{solver}: residual 1e-5", tables.iterations(curve, solver)))
        parts.append(
            ("multigrid: position error 1e-3 of the box", tables.iterations(curve, "multigrid", "position", 0))
        )
        parts.append(
            ("Jacobi CG: position error 1e-3 of the box", tables.iterations(curve, "Jacobi CG", "position", 0))
        )
        parts.append(("Energies and position errors", tables.energies(curve)))
        parts.append(("What a seed takes", tables.cost(curve)))
        parts.append(("Energies of trees against each other", tables.claims(curve)))
        parts.append(("Energy and iterations", tables.correlation(curve)))
        parts.append(("Theory", tables.theory(curve)))
        for mesh, kind, amount in (
            ("bar:1k", "twist", 90.0),
            ("bar:1k", "bend", 90.0),
            ("bar:10k", "twist", 90.0),
            ("sphere:5", "twist", 90.0),
            ("sphere:5", "noise", 1e-3),
            ("paper/libigl_armadillo.obj", "arm", 90.0),
            ("paper/libigl_armadillo.obj", "twist", 90.0),
            ("sphere:7", "twist", 90.0),
        ):
            parts.append((f"{mesh}, {kind} {amount:g}", tables.one_case(curve, mesh, kind, amount)))
    if others:
        parts.append(("Other algorithms", tables.others(others)))
    if journal.rows("used"):
        parts.append(("The default start", tables.default_start(journal.rows("used"))))
    if journal.rows("transfer"):
        parts.append(("Where to integrate", tables.transfer(journal.rows("transfer"))))
    text = "\n\n".join(f"## {title}\n\n{table}" for title, table in parts if table)
    journal.path.with_suffix(".md").write_text(text + "\n")
    print(text, flush=True)
    if figures:
        # Where the study is measured there need be nothing to draw with.
        from bench.tree.figures import draw

        draw(journal)
