"""The study's plots, from its journal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt

from bench.plots import PLOTS, keep_small
from bench.table import RESULTS
from bench.tree.journal import Journal
from bench.tree.rule import WORTHWHILE
from bench.tree.tables import MIDDLE, Rows

COLOURS = {
    "rest": "black",
    "zero": "0.6",
    "min depth": "tab:orange",
    "maximal": "tab:red",
    "held: min depth": "tab:olive",
    "held: resistance": "tab:brown",
    "held: min depth + 64 sweeps": "tab:cyan",
    "rings": "tab:blue",
    "coarse graph": "tab:pink",
    "nested": "tab:purple",
    "previous": "tab:green",
}
"""The seeds that are drawn."""


def _panels(count: int, height: float = 3.3) -> tuple[Any, Any]:
    figure, panels = plt.subplots(1, count, figsize=(0.6 + 3.6 * count, height), squeeze=False)
    return figure, panels[0]


def _legend(figure: Any, panel: Any, columns: int = 4) -> None:
    handles, labels = panel.get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=6, ncol=columns, loc="lower center")
    figure.subplots_adjust(bottom=0.3, wspace=0.3)


def noise(rows: Rows) -> Any:
    """Iterations to a residual of 1e-5 by how far the form is from exact, one mesh."""
    mesh = next((m for m in ("sphere:5", "sphere:4", "bar:1k") if any(r["mesh"] == m for r in rows)), None)
    rows = [r for r in rows if r["mesh"] == mesh and r["weights"] == "cotangent" and r["kind"] in ("noise", "twist")]
    figure, panels = _panels(2)
    for panel, solver in zip(panels, ("multigrid", "Jacobi CG"), strict=True):
        for seed, colour in COLOURS.items():
            found = sorted((r["amount"], r[f"{solver} residual"][MIDDLE]) for r in rows
                           if r["seed"] == seed and r["kind"] == "noise" and r["amount"] > 0.0)  # fmt: skip
            if found:
                panel.plot(*zip(*found, strict=True), ".-", color=colour, label=seed, linewidth=1.0)
        panel.set(xscale="log", xlabel="noise, parts of the edges' length", title=f"{solver}, {mesh}")
        panel.set_ylabel("iterations to 1e-5")
    _legend(figure, panels[0], 6)
    return figure


def energy(rows: Rows) -> Any:
    """Does a start's energy predict its iterations? A point per seed and case, both over those of rest."""
    rest = {(r["mesh"], r["kind"], r["amount"], r["weights"]): r for r in rows if r["seed"] == "rest"}
    figure, panels = _panels(2)
    for panel, solver in zip(panels, ("multigrid", "Jacobi CG"), strict=True):
        for seed, colour in COLOURS.items():
            points = []
            for r in rows:
                base = rest[r["mesh"], r["kind"], r["amount"], r["weights"]]
                column = f"{solver} residual"
                if r["seed"] != seed or column not in r or r["exactness"] < 1e-9 or not base[column][MIDDLE]:
                    continue
                count = r[column][MIDDLE]
                if count is not None:
                    points.append((r["energy"] / base["energy"], count / base[column][MIDDLE]))
            if points and seed != "rest":
                panel.plot(*zip(*points, strict=True), ".", color=colour, label=seed, markersize=3)
        panel.axhline(1.0, color="black", linewidth=0.6)
        panel.axvline(1.0, color="black", linewidth=0.6)
        panel.set(xscale="log", xlabel="energy of the start / that of rest", ylabel="iterations / those from rest")
        panel.set_title(solver)
    _legend(figure, panels[0], 5)
    return figure


def theory(rows: Rows) -> Any:
    """Predicted against measured energy of trees' estimates."""
    rows = [r for r in rows if "theory" in r and r["exactness"] > 1e-9]
    figure, panels = _panels(3)
    kinds = {"noise": "tab:blue", "twist": "tab:orange", "bend": "tab:red", "stretch": "tab:green", "arm": "black"}
    columns = {"white": "1 + mean stretch", "local": "sum of mu |h|² around cycles", "bound": "bound: all h aligned"}
    for panel, (column, title) in zip(panels, columns.items(), strict=True):
        ends = [1.0, 1e5]
        panel.plot(ends, ends, color="black", linewidth=0.6)
        for kind, colour in kinds.items():
            points = [(r["theory"][column], r["energy"]) for r in rows if r["kind"] == kind]
            if points:
                panel.plot(*zip(*points, strict=True), ".", color=colour, label=kind, markersize=3)
        panel.set(xscale="log", yscale="log", xlabel="predicted energy / least", ylabel="measured energy / least")
        panel.set_title(title, fontsize=9)
    panels[0].legend(fontsize=6)
    return figure


def position(rows: Rows) -> Any:
    """Predicted against measured position error of trees' estimates, and the error by the angle."""
    trees = [r for r in rows if "theory" in r and r["exactness"] > 1e-9]
    figure, panels = _panels(2)
    for kind, colour in (("noise", "tab:blue"), ("smooth", "tab:orange")):
        points = [(r["theory"]["position"], r["rms"]) for r in trees if (r["kind"] == "noise") == (kind == "noise")]
        if points:
            panels[0].plot(*zip(*points, strict=True), ".", color=colour, markersize=3, label=kind)
    ends = [1e-5, 1.0]
    panels[0].plot(ends, ends, color="black", linewidth=0.6)
    panels[0].set(xscale="log", yscale="log", xlabel="predicted", ylabel="measured", title="position error, rms / box")
    panels[0].legend(fontsize=6)
    mesh = "sphere:5" if any(r["mesh"] == "sphere:5" for r in rows) else "bar:1k"
    for seed, colour in COLOURS.items():
        found = sorted((r["amount"], 100.0 * r["farthest"]) for r in rows if r["seed"] == seed and r["mesh"] == mesh
                       and r["kind"] == "twist" and r["weights"] == "cotangent")  # fmt: skip
        if found:
            panels[1].plot(*zip(*found, strict=True), ".-", color=colour, label=seed, linewidth=1.0)
    panels[1].set(xscale="log", yscale="log", xlabel="degrees", ylabel="largest error / % of the box")
    panels[1].set_title(f"twisted {mesh}")
    panels[1].legend(fontsize=5)
    return figure


def rule(rows: Rows) -> Any:
    """What the default rule predicts, against the energy of the estimate."""
    seen = {(r["mesh"], r["kind"], r["amount"], r["weights"]): r for r in rows}.values()
    figure, panels = _panels(2)
    for kind, colour in (("noise", "tab:blue"), ("smooth", "tab:orange")):
        found = [r for r in seen if (r["kind"] == "noise") == (kind == "noise") and r["q"] > 1e-20]
        if found:
            panels[0].plot([r["predicted"] for r in found], [r["rings"] for r in found], ".", color=colour, label=kind)
            panels[1].plot([r["q"] for r in found], [r["rho"] for r in found], ".", color=colour)
    ends = [1e-7, 1e2]
    panels[0].plot(ends, ends, color="black", linewidth=0.6)
    for line in (panels[0].axvline, panels[0].axhline):
        line(WORTHWHILE, color="tab:red", linewidth=0.8)
    panels[0].set(xscale="log", yscale="log", xlabel="predicted: 10 q, or 4 n q", ylabel="integral over rings")
    panels[0].set_title("energy, over that of rest", fontsize=10)
    panels[0].legend(fontsize=6)
    panels[1].axhline(0.25, color="tab:red", linewidth=0.8)
    panels[1].set(xscale="log", xlabel="q", ylabel="rho", title="noise and what is smooth")
    return figure


def others(rows: Rows) -> Any:
    """ARAP's steps, and images by their side."""
    figure, panels = _panels(3)
    steps = [r for r in rows if r["kind"] == "ARAP step" and r.get("degrees") == 90.0]
    mesh = next((m for m in ("sphere:5", "sphere:4", "sphere:6") if any(r["mesh"] == m for r in steps)), "")
    for seed, colour in COLOURS.items():
        for panel, solver in zip(panels, ("multigrid", "Jacobi CG"), strict=False):
            found = sorted((r["amount"], r[f"{solver} residual"][MIDDLE]) for r in steps
                           if r["mesh"] == mesh and r["seed"] == seed and f"{solver} residual" in r)  # fmt: skip
            if found:
                panel.plot(*zip(*found, strict=True), ".-", color=colour, label=seed, linewidth=1.0)
                panel.set(xlabel="step", ylabel="iterations to 1e-5", title=f"ARAP, {mesh}, {solver}")
        sides = sorted((r["amount"], r["multigrid residual"][MIDDLE]) for r in rows
                       if r["kind"] == "mixed cloning" and r["seed"] == seed)  # fmt: skip
        if sides:
            panels[2].plot(*zip(*sides, strict=True), ".-", color=colour, label=seed, linewidth=1.0)
    panels[2].set(xscale="log", xlabel="side in pixels", title="image cloning, mixed gradients, multigrid")
    for panel in panels:
        panel.title.set_fontsize(8)
    _legend(figure, panels[0], 5)
    return figure


DRAW: dict[str, tuple[str, Callable[[Rows], Any]]] = {
    "noise": ("curve", noise),
    "energy": ("curve", energy),
    "theory": ("curve", theory),
    "position": ("curve", position),
    "rule": ("used", rule),
    "others": ("others", others),
}


def draw(journal: Journal) -> None:
    """A PNG per figure whose rows are there, into docs/bench/; of the short form beside its results."""
    folder = RESULTS if "_short" in journal.path.stem else PLOTS
    for name, (part, figure_of) in DRAW.items():
        rows = journal.rows(part)
        if not rows:
            continue
        figure = figure_of(rows)
        if not figure.texts and not figure.legends:
            figure.tight_layout()
        path = folder / f"{journal.path.stem}-{name}.png"
        keep_small(figure, path)
        plt.close(figure)
        print(path, flush=True)
