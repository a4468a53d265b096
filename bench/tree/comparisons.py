"""What the findings say, counted: meshes and tolerances apart, and the best of several starts."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from bench.tree.seeds import BEST
from bench.tree.tables import CLASSES, MIDDLE, Row, Rows, by_case, markdown, spread
from bench.tree.trace import TOLERANCES

PAPER = ("min depth", "maximal", "minimal")
"""The trees of the paper, from the middle of the mesh."""

HANGING = ("held: min depth", "held: maximal", "held: resistance", "held: shortest", "held: AKPW")

LARGE = 500_000
"""Nodes from which meshes are for a GPU."""

COUNTED = ("multigrid", "Jacobi CG")

SMOOTH = CLASSES["rotations and stretches"]


def what_ran(rows: Rows) -> str:
    """Meshes with their cases, starts and counted solves, and the sum of all."""
    lines = []
    for mesh in [*dict.fromkeys(row["mesh"] for row in rows), ""]:
        found = [row for row in rows if not mesh or row["mesh"] == mesh]
        solves = sum(key.endswith(" residual") for row in found for key in row)
        solvers = dict.fromkeys(key.removesuffix(" residual") for row in found for key in row if "residual" in key)
        nodes = f"{found[0]['nodes']:,}" if mesh else ""
        name = mesh.removeprefix("paper/") or "together"
        weights = ", ".join(dict.fromkeys(row["weights"].replace("_", " ") for row in found)) if mesh else ""
        lines.append([name, nodes, weights, ", ".join(solvers) if mesh else "", len(by_case(found)), f"{len(found):,}",
                      f"{solves:,}"])  # fmt: skip
    return markdown(["mesh", "nodes", "weights", "solvers", "cases", "starts", "solves"], lines) if rows else ""


def over_rest(cases: Iterable[dict[str, Row]], seeds: Iterable[str], column: str, tol: int) -> list[float]:
    """Of each case the fewest iterations from one of the seeds, over (multigrid: less) those from rest."""
    found = []
    for case in cases:
        counts = [case[s][column][tol] for s in seeds if s in case and column in case[s]]
        known = [count for count in counts if count is not None]
        rest = case["rest"].get(column, [None] * len(TOLERANCES))[tol]
        if known and rest:
            found.append(min(known) - rest if column.startswith("multigrid") else min(known) / rest)
    return found


def _and_extremes(values: list[float]) -> str:
    return f"{spread(values, 3)}, {min(values):.3g} to {max(values):.3g}" if values else ""


def by_mesh(rows: Rows) -> str:
    """CG on smooth forms, mesh by mesh: iterations over those from rest, of the best that was known only afterwards."""
    lines = []
    for mesh in dict.fromkeys(row["mesh"] for row in rows):
        cases = [case for case in by_case([r for r in rows if r["mesh"] == mesh]).values() if SMOOTH(case["rest"])]
        column = "Jacobi CG residual"
        line = [over_rest(cases, seeds, column, MIDDLE) for seeds in (PAPER, HANGING, ("rings",), ("nested",))]
        if line[0]:
            lines.append([mesh.removeprefix("paper/"), len(line[0]), *map(_and_extremes, line)])
    columns = ["mesh", "cases", "best of the paper's trees", "best of the hanging trees", "rings", "nested"]
    return markdown(columns, lines) if lines else ""


def by_tolerance(rows: Rows) -> str:
    """The best of the paper's trees and of the hanging ones on smooth forms, to each residual."""
    cases = [case for case in by_case(rows).values() if SMOOTH(case["rest"])]
    lines = []
    for solver in ("multigrid", "Jacobi CG", "plain CG"):
        for name, seeds in (("paper's", PAPER), ("hanging", HANGING), ("rings", ("rings",)), ("nested", ("nested",))):
            column = f"{solver} residual"
            line = [_and_extremes(over_rest(cases, seeds, column, tol)) for tol in range(len(TOLERANCES))]
            if line[0]:
                lines.append([solver, name, *line])
    return markdown(["solver", "best of", *(f"{tol:.0e}" for tol in TOLERANCES)], lines) if lines else ""


def by_noise(rows: Rows) -> str:
    """What is saved where v is exact but for noise, by its size in parts of the edges."""
    noisy = [row for row in rows if row["kind"] == "noise"]
    lines = []
    for amount in sorted({row["amount"] for row in noisy}):
        cases = list(by_case([row for row in noisy if row["amount"] == amount]).values())
        line = [f"{amount:g}", len(cases)]
        for solver in COUNTED:
            for seed in ("min depth", "held: min depth", "rings"):
                line.append(spread(over_rest(cases, [seed], f"{solver} residual", MIDDLE)))
        lines.append(line)
    heads = ("from the middle", "hanging", "rings")
    columns = ["noise", "cases", *(f"{solver}: {head}" for solver in COUNTED for head in heads)]
    return markdown(columns, lines) if lines else ""


def slow(rows: Rows) -> str:
    """Jacobi to 1e-3: in how many cases 10,000 sweeps were enough, and over those from rest where both were."""
    column = "Jacobi residual"
    rows = [row for row in rows if column in row]
    lines = []
    for name in dict.fromkeys(row["seed"] for row in rows):
        line = [name]
        for test in (lambda row: not SMOOTH(row), SMOOTH):
            cases = [case for case in by_case(rows).values() if test(case["rest"])]
            reached = sum(case[name][column][0] is not None for case in cases)
            line += [f"{reached} of {len(cases)}", spread(over_rest(cases, [name], column, 0))]
        lines.append(line)
    columns = ["seed", "noise: reached", "over rest", "rotations and stretches: reached", "over rest"]
    return markdown(columns, lines) if rows else ""


def best_by_energy(rows: Rows) -> str:
    """What it brings to make several starts and to take the one of least energy; and the one of fewest iterations."""
    kinds: dict[str, Callable[[Row], bool]] = {"noise": lambda row: not SMOOTH(row), "smooth": SMOOTH}
    lines = []
    for kind, test in kinds.items():
        cases = [case for case in by_case(rows).values() if test(case["rest"]) and case["rest"]["exactness"] > 1e-9]
        for name, seeds in (
            ("rings alone", ("rings",)),
            ("least energy of 3 trees", ("best of 3 trees",)),
            ("least energy of rest, rings, 3 trees", (BEST,)),
            ("fewest iterations of them", ("rest", "rings", "held: min depth", "held: maximal", "held: resistance")),
        ):
            line = [_and_extremes(over_rest(cases, seeds, f"{s} residual", MIDDLE)) for s in COUNTED]
            lines.append([f"{kind}, {len(cases)} cases", name, *line])
        by_energy = [{"rest": c["rest"], "": min(c["rest"], c["rings"], key=lambda r: r["energy"])} for c in cases]
        line = [_and_extremes(over_rest(by_energy, [""], f"{s} residual", MIDDLE)) for s in COUNTED]
        lines.append([f"{kind}, {len(cases)} cases", "least energy of rest, rings", *line])
        for name, less in (("rings, where of less energy than rest", True), ("rings, where of more", False)):
            chosen = [c for c in cases if (c["rings"]["energy"] < c["rest"]["energy"]) == less]
            line = [_and_extremes(over_rest(chosen, ["rings"], f"{s} residual", MIDDLE)) for s in COUNTED]
            if chosen:
                lines.append([f"{kind}, {len(chosen)} cases", name, *line])
    return markdown(["forms", "start", "multigrid, less than rest", "Jacobi CG, over rest"], lines) if rows else ""


def by_size(rows: Rows) -> str:
    """Multigrid on spheres: iterations to 1e-5 from each seed, and what it took to make it, beside one iteration."""
    rows = [row for row in rows if row["mesh"].startswith("sphere") and row["nodes"] > LARGE]
    cases = by_case(rows)
    names = [
        name for name in dict.fromkeys(row["seed"] for row in rows) if all(name in case for case in cases.values())
    ]
    lines = []
    for name in names:
        found = [case[name] for case in cases.values()]
        known = name in ("rest", "previous")
        lines.append([name, *(f"{row['multigrid residual'][MIDDLE]}{'' if known else ', ' + _time(row['seed s'])}"
                              for row in found)])  # fmt: skip
    lines.append(["one iteration", *(_time(case["rest"]["multigrid iteration s"]) for case in cases.values())])
    heads = [f"{case['rest']['nodes']:,}, {case['rest']['kind']} {case['rest']['amount']:g}" for case in cases.values()]
    return markdown(["seed", *heads], lines) if rows else ""


def _time(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds >= 0.1 else f"{1e3 * seconds:.2g} ms"


def default_and_all_seeds(rows: Rows, used: Rows) -> str:
    """Multigrid in float64 from the start that the default rule took: cases by iterations more than the best seed's."""
    took = {
        tuple(row[k] for k in ("mesh", "kind", "amount", "weights")): "rings" if row["took"] == "rings" else "rest"
        for row in used
        if row["solver"] == "multigrid" and row["start"] == "auto"
    }
    found = [(took[key[:4]], case) for key, case in by_case(rows).items() if key[:4] in took]
    lines = []
    for name, left_out in (("all seeds", ()), ("all but the last frame", ("previous",))):
        for tol, size in enumerate(TOLERANCES):
            counts = [{seed: row["multigrid residual"][tol] for seed, row in case.items()} for _, case in found]
            more = [
                count[start] - min(n for seed, n in count.items() if seed not in left_out)
                for (start, _), count in zip(found, counts, strict=True)
            ]
            lines.append([name, f"{size:.0e}", len(more), *(sum(m == k for m in more) for k in range(5))])
    columns = ["against", "residual", "cases", "0 more", "1 more", "2 more", "3 more", "4 more"]
    return markdown(columns, lines) if found else ""
