"""The study's tables, from its journal, as Markdown: medians over cases, and the middle half of them in brackets."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from bench.tree.trace import TOLERANCES

Row = dict[str, Any]
Rows = list[Row]
MIDDLE = TOLERANCES.index(1.0e-5)

CLASSES: dict[str, Callable[[Row], bool]] = {
    "exact": lambda r: r["kind"] == "noise" and r["amount"] == 0.0,
    "noise up to 3e-3": lambda r: r["kind"] == "noise" and 0.0 < r["amount"] < 5e-3,
    "noise of 1e-2 and 1e-1": lambda r: r["kind"] == "noise" and r["amount"] >= 5e-3,
    "rotations and stretches": lambda r: r["kind"] != "noise",
}
"""The kinds of forms that behave differently."""


def spread(values: Sequence[float], digits: int = 2) -> str:
    """Median [quartiles]."""
    if not values:
        return ""
    low, middle, high = (float(np.percentile(values, p)) for p in (25, 50, 75))
    text = f"{middle:.{digits}g}"
    return text if len(values) == 1 else f"{text} [{low:.{digits}g}, {high:.{digits}g}]"


def markdown(columns: Sequence[str], lines: Iterable[Sequence[Any]]) -> str:
    """A table."""
    body = ["| " + " | ".join(str(cell) for cell in line) + " |" for line in lines]
    return "\n".join(["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns), *body])


def by_case(rows: Rows) -> dict[tuple[Any, ...], dict[str, Row]]:
    """Rows by seed of each case."""
    cases: dict[tuple[Any, ...], dict[str, Row]] = defaultdict(dict)
    for row in rows:
        cases[tuple(row.get(k) for k in ("mesh", "kind", "amount", "weights", "degrees"))][row["seed"]] = row
    return cases


def pooled(rows: Rows) -> list[str]:
    """The seeds in their order, the random ones as one."""
    return list(dict.fromkeys("held: random" if r["seed"].startswith("held: random") else r["seed"] for r in rows))


def _of_name(rows: Iterable[Row], name: str) -> Rows:
    return [r for r in rows if r["seed"] == name or (name == "held: random" and r["seed"].startswith(name))]


def _of(seeds: dict[str, Row], name: str) -> Rows:
    return _of_name(seeds.values(), name)


def iterations(rows: Rows, solver: str, goal: str = "residual", tol: int = MIDDLE) -> str:
    """Iterations from each seed, over or beside those from rest, by class of form."""
    column = f"{solver} {goal}"
    rows = [row for row in rows if column in row]
    if not rows:
        return ""
    cases = by_case(rows)
    lines = []
    for name in pooled(rows):
        line = [name]
        for test in CLASSES.values():
            found = []
            for seeds in cases.values():
                rest = seeds["rest"][column][tol]
                for row in _of(seeds, name):
                    count = row[column][tol]
                    if test(row) and count is not None and rest:
                        found.append(count - rest if solver == "multigrid" else count / rest)
            line.append(spread(found))
        lines.append(line)
    numbers = [str(sum(test(seeds["rest"]) for seeds in cases.values())) + " cases" for test in CLASSES.values()]
    return markdown(["seed", *(f"{c}, {n}" for c, n in zip(CLASSES, numbers, strict=True))], lines)


def energies(rows: Rows) -> str:
    """Energy over the least one, and the largest position error in percent of the box, by class of form."""
    cases = by_case(rows)
    lines = []
    for name in pooled(rows):
        line = [name]
        for test in list(CLASSES.values())[1:]:
            found = [row for seeds in cases.values() for row in _of(seeds, name) if test(row)]
            line += [spread([r["energy"] for r in found]), spread([100.0 * r["farthest"] for r in found])]
        lines.append(line)
    columns = [f"{c}: {what}" for c in list(CLASSES)[1:] for what in ("energy", "error / %")]
    return markdown(["seed", *columns], lines) if rows else ""


SMALL = 3000
"""Nodes up to which times are those of launches."""


def cost(rows: Rows) -> str:
    """What a seed takes, in iterations of multigrid and of Jacobi CG on the same graph."""
    lines = []
    for name in pooled(rows):
        line = [name]
        for solver in ("multigrid", "Jacobi CG"):
            of = f"{solver} iteration s"
            chosen = _of_name(rows, name)
            found = [r["seed s"] / r[of] for r in chosen if of in r and r["nodes"] > SMALL]
            line.append(spread(found))
        lines.append(line)
    return markdown(["seed", "multigrid iterations", "Jacobi CG iterations"], lines) if rows else ""


def claims(rows: Rows) -> str:
    """The first findings, with what was counted."""
    lines = []
    for label, better in (("held: resistance", "held: min depth"), ("maximal", "min depth")):
        ratios = defaultdict(list)
        for seeds in by_case(rows).values():
            if label in seeds and better in seeds:
                first, second = (seeds[s]["energy"] - 1.0 for s in (label, better))
                kind = "noise" if seeds[label]["kind"] == "noise" else "rotations and stretches"
                if seeds[label]["exactness"] > 1e-9:
                    ratios[kind].append(second / max(first, 1e-12))
        for kind, found in ratios.items():
            more = f"{sum(r < 1.0 for r in found)} of {len(found)}"
            lines.append([f"energy error of {better} over {label}, {kind}", spread(found), more])
    return markdown(["", "median [quartiles]", "below 1"], lines) if rows else ""


def correlation(rows: Rows) -> str:
    """Does less energy at the start mean fewer iterations? Spearman's rank correlation over the seeds of each case."""
    from scipy.stats import spearmanr

    def alone(row: Row) -> bool:
        hangs = row["seed"].startswith("held") and "sweeps" not in row["seed"]
        return hangs or row["seed"] in ("rest", "min depth", "maximal", "minimal")

    lines = []
    for solver in ("multigrid", "Jacobi CG", "plain CG"):
        column = f"{solver} residual"
        for bars in (True, False):
            line = [solver, "bars" if bars else "other meshes"]
            for some in (False, True):
                found = []
                for seeds in by_case([r for r in rows if r["mesh"].startswith("bar") == bars]).values():
                    chosen = [r for r in seeds.values() if r.get(column, [None] * 3)[MIDDLE] is not None]
                    chosen = [r for r in chosen if not some or (alone(r) and r["kind"] != "noise")]
                    pairs = [(r["energy"], r[column][MIDDLE]) for r in chosen]
                    if len(pairs) > 5 and len({count for _, count in pairs}) > 1:
                        found.append(float(spearmanr(*zip(*pairs, strict=True)).statistic))
                line.append(spread(found))
            lines.append(line)
    columns = ["solver", "", "all seeds", "rotations and stretches: rest and trees alone"]
    return markdown(columns, lines) if rows else ""


def theory(rows: Rows) -> str:
    """Measured over predicted energy and position error of estimates along trees that hang from what is held."""
    rows = [r for r in rows if "theory" in r and r["exactness"] > 1e-9]
    lines = []
    for label, column in (
        ("1 + mean stretch", "white"),
        ("sum of mu times the sum of h^2 around cycles", "local"),
        ("bound, all h of a cycle aligned", "bound"),
        ("sum of mu c^2, exact", "exact"),
    ):
        line = [label]
        for noise in (True, False):
            line.append(spread([r["energy"] / r["theory"][column] for r in rows if (r["kind"] == "noise") == noise]))
        lines.append(line)
    line = ["position error: sum of h^2 to the root"]
    for noise in (True, False):
        line.append(spread([r["rms"] / r["theory"]["position"] for r in rows if (r["kind"] == "noise") == noise]))
    return markdown(["measured over predicted", "noise", "rotations and stretches"], [*lines, line]) if rows else ""


def stretch(rows: Rows) -> str:
    """Mean stretch and depth of the trees that hang from what is held."""
    rows = [r for r in rows if "theory" in r]
    lines = [
        [seed, *(spread([r["theory"][c] for r in rows if r["seed"].startswith(seed)], 3) for c in ("stretch", "depth"))]
        for seed in dict.fromkeys("held: random" if "random" in r["seed"] else r["seed"] for r in rows)
    ]
    return markdown(["tree", "mean stretch", "depth"], lines) if rows else ""


def one_case(rows: Rows, mesh: str, kind: str, amount: float, seeds: Sequence[str]) -> str:
    """Seeds of one case, iterations to the three tolerances of the residual."""
    chosen = [r for r in rows if (r["mesh"], r["kind"], r["amount"], r["weights"]) == (mesh, kind, amount, "cotangent")]
    if not chosen:
        return ""
    names = [s for s in ("multigrid", "Jacobi CG", "plain CG", "Jacobi") if f"{s} residual" in chosen[0]]
    lines = [
        [
            r["seed"],
            f"{r['energy']:.3g}",
            f"{100 * r['farthest']:.2g}",
            *(", ".join(str(k) if k is not None else "-" for k in r.get(f"{n} residual", [])) for n in names),
        ]
        for r in chosen
        if r["seed"] in seeds
    ]
    return markdown(["seed", "energy", "error / %", *names], lines)


def others(rows: Rows) -> str:
    """Iterations to 1e-5 of the residual in the other algorithms: multigrid, and Jacobi CG."""
    names = pooled(rows)
    lines = []
    groups: dict[tuple[Any, ...], Rows] = defaultdict(list)
    for row in rows:
        step = "later steps" if row["kind"] == "ARAP step" and row["amount"] > 1 else ""
        groups[row["mesh"], row["kind"], step or "first step" if "ARAP" in row["kind"] else "",
               row.get("degrees", row["amount"])].append(row)  # fmt: skip
    for (mesh, kind, step, amount), found in groups.items():
        for solver in ("multigrid", "Jacobi CG"):
            column = f"{solver} residual"
            if column not in found[0]:
                continue
            line = [f"{kind} {step}".strip(), mesh, f"{amount:g}", solver]
            for name in names:
                counts = [r[column][MIDDLE] for r in found if r["seed"] == name and r[column][MIDDLE] is not None]
                line.append(f"{statistics.median(counts):g}" if counts else "-")
            lines.append(line)
    return markdown(["algorithm", "mesh", "degrees, side", "solver", *names], lines) if rows else ""


Starts = dict[str, Row]


def _by_solver(rows: Rows) -> dict[str, dict[tuple[Any, ...], Starts]]:
    """Rows by start, of each case, of each solver."""
    found: dict[str, dict[tuple[Any, ...], Starts]] = defaultdict(lambda: defaultdict(dict))
    for row in rows:
        found[row["solver"]][row["mesh"], row["kind"], row["amount"], row["weights"]][row["start"]] = row
    return found


def _more(starts: Starts) -> int:
    """Iterations from `auto` more than from the best start."""
    return int(starts["auto"]["iterations"]) - min(int(r["iterations"]) for r in starts.values())


def _slower(starts: Starts, start: str = "auto") -> float:
    """Time of start and solve over that of the best."""
    return float(starts[start]["seconds"]) / min(float(r["seconds"]) for r in starts.values())


WITHIN = 1.15


def _part(ratios: Sequence[float]) -> str:
    return f"{sum(r <= WITHIN for r in ratios)}, {100 * np.mean([r <= WITHIN for r in ratios]):.0f} %"


def default_start(rows: Rows) -> str:
    """The default rule against the best start of each case."""
    lines = []
    for solver, cases in _by_solver(rows).items():
        more = [_more(starts) for starts in cases.values()]
        time, rest = ([_slower(starts, s) for starts in cases.values()] for s in ("auto", "rest"))
        lines.append([solver, len(cases), spread([float(m) for m in more]), max(more), sum(m <= 2 for m in more),
                      f"{spread(time, 3)}, {max(time):.2f} at most", _part(time), _part(rest)])  # fmt: skip
    columns = ["solver", "cases", "iterations more than the best", "most", "at most 2 more", "time over the best",
               f"within {WITHIN}", f"rest alone: within {WITHIN}"]  # fmt: skip
    return markdown(columns, lines) if lines else ""


def worst_starts(rows: Rows) -> str:
    """The cases where it is further from the best: multigrid 2 iterations, CG and Jacobi 1.15 times the time."""
    lines = []
    for solver, cases in _by_solver(rows).items():
        for (mesh, kind, amount, weights), starts in cases.items():
            off = _more(starts) > 2 if solver == "multigrid" else _slower(starts) > WITHIN
            if off:
                best = min(starts.values(), key=lambda row: row["iterations" if solver == "multigrid" else "seconds"])
                lines.append([solver, mesh.removeprefix("paper/"), f"{kind} {amount:g}", weights.replace("_", " "),
                              _more(starts), f"{_slower(starts):.2f}", best["start"]])  # fmt: skip
    columns = ["solver", "mesh", "form", "weights", "iterations more", "time over the best", "best"]
    return markdown(columns, lines) if rows else ""


def transfer(rows: Rows) -> str:
    """Milliseconds of each step."""
    names = [c for c in rows[0] if c.endswith(" s")] if rows else []
    lines = [[n.removesuffix(" s"), *(f"{1e3 * r[n]:.3g}" for r in rows)] for n in names]
    return "" if not rows else markdown(["milliseconds", *(f"{r['mesh']}, {r['nodes']:,}" for r in rows)], lines)
