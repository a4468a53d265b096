"""What the error of a tree's estimate should be, from resistances and from the size of the non-exact part.

Let h = v - dx be the non-exact part, x the minimiser, T a tree, and c_e the sum of h around the cycle that the edge e
outside T closes. Along T the estimate misses nothing, on e it misses c_e, so that exactly

    energy of the estimate = sum over e outside T of mu_e |c_e|^2

Were h white noise of variance s^2 / mu_e per edge, |c_e|^2 would be s^2 times the cycle's resistance in the mean, and

    energy of the estimate / least energy = 1 + mean stretch,    stretch_e = mu_e * resistance of T between e's ends

since the least energy is s^2 (m - n + 1) in the mean. Three predictions, from less to more knowledge:
`white` as above; `local`, which has each edge's own |h|^2 with random signs; and `bound`, where all h along a cycle
point the same way, weighed best (Cauchy-Schwarz). Edges between held nodes belong to no cycle, and keep their energy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray

from bench.tree.cases import Problem
from oneform_warp.tree import SpanningTree


@wp.kernel(enable_backward=False)
def _around(
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    parent: wp.array[wp.int32],
    link: wp.array[wp.int32],
    depth: wp.array[wp.int32],
    h: wp.array[wp.vec3d],
    # Out:
    resistance_out: wp.array[wp.float64],
    square_out: wp.array[wp.float64],
    energy_out: wp.array[wp.float64],
    misfit_out: wp.array[wp.vec3d],
):
    e = wp.tid()
    i = tail[e]
    j = head[e]
    resistance = wp.float64(0.0)
    square = wp.float64(0.0)
    energy = wp.float64(0.0)
    total = h[e]
    # To the nearest common ancestor; where the ends hang from different roots, whose places are known, to those.
    while i != j and (parent[i] >= 0 or parent[j] >= 0):
        side = wp.float64(1.0)
        k = i
        if depth[j] > depth[i]:
            side = wp.float64(-1.0)
            k = j
        f = wp.max(link[k], ~link[k])
        own = wp.where(link[k] >= 0, h[f], -h[f])
        total += side * own
        resistance += wp.float64(1.0) / mu[f]
        square += wp.length_sq(h[f])
        energy += mu[f] * wp.length_sq(h[f])
        if side > wp.float64(0.0):
            i = parent[i]
        else:
            j = parent[j]
    resistance_out[e] = resistance
    square_out[e] = square + wp.length_sq(h[e])
    energy_out[e] = energy + mu[e] * wp.length_sq(h[e])
    misfit_out[e] = total


@wp.kernel(enable_backward=False)
def _down(
    # Graph:
    mu: wp.array[wp.float64],
    # In:
    order: wp.array[wp.int32],
    parent: wp.array[wp.int32],
    link: wp.array[wp.int32],
    h: wp.array[wp.vec3d],
    # Out:
    square_out: wp.array[wp.float64],
    resistance_out: wp.array[wp.float64],
):
    for k in range(order.shape[0]):
        j = order[k]
        if parent[j] >= 0:
            e = wp.max(link[j], ~link[j])
            square_out[j] = square_out[parent[j]] + wp.length_sq(h[e])
            resistance_out[j] = resistance_out[parent[j]] + wp.float64(1.0) / mu[e]


@dataclass(frozen=True)
class Prediction:
    """Energies over the least one, position errors (root mean square) over the box's diagonal."""

    stretch: float
    """Mean over the edges outside the tree."""
    white: float
    local: float
    bound: float
    exact: float
    """By the cycles' sums: the same as the energy of the estimate."""
    position: float
    """From |h|^2 along each path with random signs."""
    depth: int
    resistance: float
    """Mean over the nodes, from the root, in parts of the mean 1 / mu."""


def predict(problem: Problem, tree: SpanningTree) -> Prediction:
    """What the theory says of a tree that hangs from the held nodes."""
    graph, h = problem.graph, problem.non_exact
    mu = graph.mu.numpy()
    ends = [graph.tail.to("cpu"), graph.head.to("cpu"), graph.mu.to("cpu")]
    form = wp.array(h, dtype=wp.vec3d, device="cpu")
    depth = wp.array(tree.depth, dtype=wp.int32, device="cpu")
    found = [wp.zeros(graph.edge_count, dtype=wp.float64, device="cpu") for _ in range(3)]
    misfit = wp.zeros(graph.edge_count, dtype=wp.vec3d, device="cpu")
    inputs = [*ends, tree.parent, tree.link, depth, form]
    wp.launch(_around, dim=graph.edge_count, inputs=inputs, outputs=[*found, misfit], device="cpu")
    resistance, square, energy = (a.numpy() for a in found)
    square_to, resistance_to = _to_the_roots(problem, tree, form)
    outside = np.ones(graph.edge_count, dtype=bool)
    outside[tree.edges] = False
    fixed = problem.shape.pinned
    # Between two held nodes nothing is free: their edges close no cycle, and keep what energy they have.
    inside = fixed[graph.tail.numpy()] & fixed[graph.head.numpy()]
    outside &= ~inside
    kept = float((mu * np.einsum("ij,ij->i", h, h))[inside].sum())
    stretch = (mu * resistance)[outside]
    least = max(problem.least, 1e-300)
    free = ~fixed
    return Prediction(
        stretch=float(stretch.mean()),
        white=1.0 + float(stretch.sum() / (outside | inside).sum()),
        local=(float((mu * square)[outside].sum()) + kept) / least,
        bound=(float((mu * (resistance + 1.0 / mu) * energy)[outside].sum()) + kept) / least,
        exact=(float((mu * np.einsum("ij,ij->i", misfit.numpy(), misfit.numpy()))[outside].sum()) + kept) / least,
        position=float(np.sqrt(square_to[free].mean())) / problem.shape.diagonal,
        depth=int(tree.depth.max()),
        resistance=float(resistance_to[free].mean() / np.mean(1.0 / mu)),
    )


def _to_the_roots(problem: Problem, tree: SpanningTree, h: wp.array[wp.vec3d]) -> list[NDArray[np.float64]]:
    """Sums of |h|^2 and of 1 / mu from each node to its root."""
    sums = [wp.zeros(problem.graph.node_count, dtype=wp.float64, device="cpu") for _ in range(2)]
    inputs = [problem.graph.mu.to("cpu"), tree.order, tree.parent, tree.link, h]
    wp.launch(_down, dim=1, inputs=inputs, outputs=sums, device="cpu")
    return [a.numpy() for a in sums]
