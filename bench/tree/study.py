"""Runs the study, resumable, and draws its figures: `python -m bench.tree [--full] [--device cuda:0]`.

--sizes: only these meshes. --methods: only these parts of curve, others, used, transfer, figures. The last one draws
what is in the journal; with --full it writes the tables of docs/tree-study.md, too.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from bench.options import Options
from bench.tree import report
from bench.tree.cases import Case, Problem, Shape, deformations
from bench.tree.journal import Journal
from bench.tree.measure import measure
from bench.tree.others import arap_steps, image_editing, laplacian_editing, poisson_editing
from bench.tree.seeds import chosen
from bench.tree.transfer import transfer
from bench.tree.used import used

ITERATIVE = ("multigrid", "Jacobi CG", "plain CG", "Jacobi")


@dataclass(frozen=True)
class Plan:
    """What is done with one mesh: which deformations, solvers and seeds."""

    mesh: str
    level: str
    solvers: tuple[str, ...]
    weights: tuple[str, ...] = ("cotangent",)
    seeds: str = "all"
    """Of `seeds.chosen`."""

    def cases(self) -> Iterator[Case]:
        for weights in self.weights:
            for kind, amount in deformations(self.level if weights == "cotangent" else "some"):
                yield Case(self.mesh, kind, amount, weights)
        if "armadillo" in self.mesh:
            yield Case(self.mesh, "arm", 90.0)

    def solvers_of(self, case: Case) -> tuple[str, ...]:
        """Of Jacobi, which takes thousands of sweeps, and plain CG, much the same as CG with Jacobi, some cases."""
        some = case.kind == "arm" or (case.kind, case.amount) in list(deformations("some"))
        return tuple(name for name in self.solvers if name not in ITERATIVE[2:] or (some and case.weights == ALL[0]))


ALL = ("cotangent", "uniform", "inverse_length")
SHORT = (
    Plan("bar:1k", "some", ITERATIVE[:2]),
    Plan("sphere:4", "some", ITERATIVE[:2], seeds="few"),
)
FULL = (
    Plan("bar:1k", "all", ITERATIVE, ALL),
    Plan("sphere:4", "some", ITERATIVE, ALL),
    Plan("grid:1k", "some", ITERATIVE[:2], ALL),
    Plan("paper/oded_hand_closed.obj", "some", ITERATIVE[:2]),
    Plan("paper/libigl_bunny.off", "some", ITERATIVE[:2]),
    Plan("sphere:5", "all", ITERATIVE[:3]),
    Plan("delaunay:10k", "some", ITERATIVE[:2]),
    Plan("bar:10k", "some", ITERATIVE[:2]),
    Plan("paper/libigl_armadillo.obj", "few", ITERATIVE[:3]),
    Plan("paper/horse.ply", "few", ITERATIVE[:2], seeds="few"),
    Plan("delaunay:100k", "few", ITERATIVE[:1], seeds="few"),
    Plan("bar:100k", "few", ITERATIVE[:2], seeds="few"),
    Plan("sphere:7", "few", ITERATIVE[:2], seeds="few"),
    Plan("delaunay:1M", "few", ITERATIVE[:1], seeds="fewest"),
)
"""An hour on one core: above 50,000 vertices few deformations and seeds, and CG, with its thousand iterations from
each, on bars and spheres only."""

ON_CUDA = (
    Plan("sphere:5", "some", ITERATIVE[:2], seeds="few"),
    Plan("bar:100k", "few", ITERATIVE[:2], seeds="few"),
    Plan("sphere:8", "few", ITERATIVE[:2], seeds="few"),
)
FULL_ON_CUDA = (
    *ON_CUDA,
    Plan("delaunay:1M", "few", ITERATIVE[:1], seeds="few"),
    Plan("sphere:9", "few", ITERATIVE[:1], seeds="fewest"),
    Plan("sphere:10", "few", ITERATIVE[:1], seeds="fewest"),
)
"""Up to 10 million vertices. There making a spanning tree, on the host, is what takes the time."""

REPEATS = 3


def plans(given: Options) -> tuple[Plan, ...]:
    """Of this form, or of the meshes that are named."""
    wanted = FULL if given.full else SHORT
    if given.device.is_cuda:
        wanted = FULL_ON_CUDA if given.full else ON_CUDA
    if not given.sizes:
        return wanted
    known = {plan.mesh: plan for plan in (*FULL, *wanted)}
    return tuple(known.get(size, Plan(size, "some", ITERATIVE[:2])) for size in given.sizes)


def curve(given: Options, journal: Journal) -> None:
    """Every seed and solver on every case."""
    for plan in plans(given):
        each_problem(
            plan,
            given,
            lambda case: journal.has("curve", str(case)),
            lambda problem, plan=plan: journal.once(
                "curve",
                str(problem.case),
                lambda: measure(problem, chosen(plan.seeds), plan.solvers_of(problem.case), REPEATS),
            ),
        )


def each_problem(plan: Plan, given: Options, done: Callable[[Case], bool], work: Callable[[Problem], None]) -> None:
    """The cases of a plan that are not done yet; a shape and its reference's hierarchy are made once."""
    shape: Shape | None = None
    made, known = ("", ""), None
    for case in plan.cases():
        if done(case):
            continue
        wanted = (case.weights, "arm" if case.kind == "arm" else "")
        began = time.perf_counter()
        try:
            if shape is None or wanted != made:
                shape, made, known = (
                    Shape.of(case.mesh, case.weights, given.device, arm=case.kind == "arm"),
                    wanted,
                    None,
                )
        except FileNotFoundError as error:
            print(f"{case}: left out, there is no {error}", flush=True)
            return
        problem = Problem.of(case, shape, known)
        known = problem.state
        work(problem)
        print(f"{case}: {time.perf_counter() - began:.1f} s", flush=True)


OTHER_SEEDS = (
    "zero",
    "rest",
    "min depth",
    "held: min depth",
    "held: maximal",
    "held: resistance",
    "held: min depth + 16 sweeps",
    "rings",
    "nested",
    "previous",
)


def others(given: Options, journal: Journal) -> None:
    """ARAP, Poisson and Laplacian editing, images."""
    device = given.device
    meshes, sides = ["sphere:4"], [64, 128]
    if device.is_cuda:
        meshes, sides = ["sphere:6"], [256, 1024, 4096] if given.full else [256, 1024]
    elif given.full:
        meshes, sides = ["sphere:4", "sphere:5", "bar:10k"], [64, 256, 1024]
    seeds = [seed for seed in chosen() if seed.name in OTHER_SEEDS]

    def measured(problem: Problem) -> list[dict[str, Any]]:
        names = ITERATIVE[:2] if problem.graph.node_count < 200_000 else ITERATIVE[:1]
        rows = measure(problem, seeds, names, REPEATS)
        print(f"{problem.case}", flush=True)
        return rows

    for name in meshes:
        for degrees in (10.0, 90.0) if given.full else (90.0,):
            if not journal.has("others", f"{name}, ARAP {degrees:g}"):
                steps = [measured(problem) for problem in arap_steps(name, degrees, 5 if given.full else 3, device)]
                rows = [{**row, "degrees": degrees} for step in steps for row in step]
                journal.once("others", f"{name}, ARAP {degrees:g}", lambda rows=rows: rows)
            for editing in (poisson_editing, laplacian_editing):
                key = f"{name}, {editing.__name__} {degrees:g}"
                journal.once("others", key, lambda e=editing, n=name, d=degrees: measured(e(n, d, device)))
    for side in sides:
        for mixed in (False, True):
            key = f"image:{side}, {'mixed' if mixed else 'plain'}"
            journal.once("others", key, lambda s=side, m=mixed: measured(image_editing(s, m, device)))


def used_too(given: Options, journal: Journal) -> None:
    """The default rule of the package against every other start of it, with the package's own solvers."""
    for plan in plans(given):
        if plan.seeds == "fewest":
            continue
        each_problem(
            plan,
            given,
            lambda case: journal.has("used", str(case)),
            lambda problem, plan=plan: journal.once(
                "used", str(problem.case), lambda: used(problem, plan.solvers_of(problem.case))
            ),
        )


def transfers(given: Options, journal: Journal) -> None:
    """Host-side trees against integration on the device."""
    meshes = ["sphere:7", "sphere:8"] if given.device.is_cuda else ["sphere:6"]
    meshes += ["sphere:9"] if given.device.is_cuda and given.full else []
    for name in meshes:
        journal.once("transfer", name, lambda name=name: transfer(name, given.device))


PARTS: dict[str, Callable[[Options, Journal], None]] = {
    "curve": curve,
    "others": others,
    "used": used_too,
    "transfer": transfers,
}


def main(given: Options) -> None:
    """The parts in turn; what is in the journal already is not done again."""
    where = "cuda" if given.device.is_cuda else "cpu"
    form = "" if given.full or given.device.is_cuda else "_short"
    journal = Journal(f"tree{form}-{where}")
    named = [word for word in given.methods if word in (*PARTS, "figures")]
    for name, part in PARTS.items():
        if not named or name in named:
            part(given, journal)
    report.main(journal, full=given.full, figures=not named or "figures" in named)
