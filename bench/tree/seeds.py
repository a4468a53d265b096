"""Where a solve can start from: each seed makes positions per node from a problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.tree.cases import Problem
from bench.tree.hierarchy_seeds import coarsest, nested
from bench.tree.low_stretch import akpw, shortest_paths
from oneform_warp.forms import node_differential, node_energy
from oneform_warp.rings import integrate_rings
from oneform_warp.solvers.jacobi import Jacobi
from oneform_warp.tree import SpanningTree, integrate_nodes, spanning_tree

Positions = Any


@dataclass(frozen=True)
class Seed:
    """A way to start, and what the study has to know about it."""

    name: str
    make: Callable[[Problem], Positions]
    """-> rows per node, the held nodes at rest."""
    tree: Callable[[Problem], SpanningTree] | None = None
    """The tree that it integrates along."""
    sweeps: int = 0
    """Passes over the rows after the tree, each about an iteration of Jacobi."""


def _cost(problem: Problem) -> NDArray[np.float64]:
    """The paper's edge energy mu |dx - v|^2 at rest."""
    graph = problem.graph
    change = node_differential(graph, problem.rest).numpy() - problem.v.numpy()
    cost: NDArray[np.float64] = graph.mu.numpy() * np.einsum("ij,ij->i", change, change)
    return cost


def _resistance(problem: Problem) -> NDArray[np.float64]:
    resistance: NDArray[np.float64] = 1.0 / problem.graph.mu.numpy()
    return resistance


def _random(number: int) -> Callable[[Problem], SpanningTree]:
    def tree(problem: Problem) -> SpanningTree:
        cost = np.random.default_rng(number).random(problem.graph.edge_count)
        return spanning_tree(problem.graph, cost, roots=problem.roots)

    return tree


def along(problem: Problem, tree: SpanningTree) -> Positions:
    """The rest pose plus the integral of v - dx along a tree: what does not change is not rounded."""
    graph = problem.graph
    return problem.held(integrate_nodes(tree, problem.integrand, problem.rest).to(graph.device))


def _by(name: str, tree: Callable[[Problem], SpanningTree]) -> Seed:
    return Seed(name, lambda problem: along(problem, tree(problem)), tree)


def _central(problem: Problem) -> SpanningTree:
    return spanning_tree(problem.graph)


def _hanging(problem: Problem) -> SpanningTree:
    return spanning_tree(problem.graph, roots=problem.roots)


def smoothed(problem: Problem, x: Positions, sweeps: int) -> Positions:
    """Damped Jacobi sweeps."""
    smoother = Jacobi(tol=0.0, max_iterations=sweeps)
    return smoother.solve(smoother.prepare(problem.graph, problem.shape.pinned), problem.v, x).x


def _swept(count: int) -> Seed:
    return Seed(
        f"held: min depth + {count} sweeps",
        lambda problem: smoothed(problem, along(problem, _hanging(problem)), count),
        sweeps=count,
    )


def rings(problem: Problem) -> Positions:
    """From the held nodes outwards, each node the mu-mean of x_i + v_ij over all neighbours of the ring before."""
    return problem.held(integrate_rings(_hanging(problem), problem.integrand, problem.rest))


def mean_of_trees(problem: Problem, count: int = 8) -> Positions:
    """The mean of the integrals along random trees: their errors partly cancel."""
    return problem.held(np.mean([along(problem, _random(k)(problem)).numpy() for k in range(count)], axis=0))


SEVERAL = (
    lambda problem: along(problem, _hanging(problem)),
    lambda problem: along(problem, spanning_tree(problem.graph, -_cost(problem), roots=problem.roots)),
    lambda problem: along(problem, spanning_tree(problem.graph, _resistance(problem), roots=problem.roots)),
)
"""Hanging trees of different kinds: of least depth, the paper's maximal one, by resistance."""


def _best(*makers: Callable[[Problem], Positions]) -> Callable[[Problem], Positions]:
    """Of several starts the one of least energy; all are made."""

    def make(problem: Problem) -> Positions:
        return min((maker(problem) for maker in makers), key=lambda x: node_energy(problem.graph, x, problem.v)[0])

    return make


BEST = "best of rest, rings, 3 trees"
REST = Seed("rest", lambda problem: problem.rest)
SEEDS: tuple[Seed, ...] = (
    Seed("zero", lambda problem: problem.held(np.zeros_like(problem.shape.x))),
    REST,
    _by("min depth", _central),
    _by("maximal", lambda p: spanning_tree(p.graph, -_cost(p))),
    _by("minimal", lambda p: spanning_tree(p.graph, _cost(p))),
    _by("held: min depth", _hanging),
    _by("held: maximal", lambda p: spanning_tree(p.graph, -_cost(p), roots=p.roots)),
    _by("held: resistance", lambda p: spanning_tree(p.graph, _resistance(p), roots=p.roots)),
    _by("held: shortest", lambda p: shortest_paths(p.graph, _resistance(p), p.roots)),
    _by("held: AKPW", lambda p: akpw(p.graph, _resistance(p), p.roots)),
    *(_by(f"held: random {k}", _random(k)) for k in range(3)),
    *(_swept(count) for count in (4, 16, 64)),
    Seed("rings", rings),
    Seed("8 random trees", mean_of_trees),
    Seed("best of 3 trees", _best(*SEVERAL)),
    Seed(BEST, _best(lambda problem: problem.rest, rings, *SEVERAL)),
    Seed("coarse graph", coarsest),
    Seed("nested", nested),
    Seed("previous", lambda problem: problem.previous),
)

FEW = (
    "zero",
    "rest",
    "min depth",
    "maximal",
    "held: min depth",
    "held: resistance",
    "rings",
    BEST,
    "nested",
    "previous",
)
"""Those for large meshes."""

FEWEST = ("zero", "rest", "held: min depth", "rings", "nested", "previous")
"""Those for millions of vertices, where sorting edges for a tree takes longer than everything else."""


def chosen(how_many: str = "all") -> list[Seed]:
    """All seeds, few, or fewest."""
    names = {"all": [seed.name for seed in SEEDS], "few": FEW, "fewest": FEWEST}[how_many]
    return [seed for seed in SEEDS if seed.name in names]
