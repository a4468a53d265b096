"""Other algorithms that end in L x = codiff v, small and honest, on this package's solvers; 1-forms and seeds only.

Each gives `Problem`s, so that seeds and solvers are those of the study: ARAP's global step, Poisson mesh editing from
face gradients, Laplacian editing with rotated differential coordinates, Poisson image editing on a grid of pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

import oneform_warp as ow
from bench.tree.cases import Case, Problem, Shape, mesh
from oneform_warp.forms import node_differential
from oneform_warp.solvers.refinement import State
from oneform_warp.tree import SpanningTree, spanning_tree

Floats = NDArray[np.float64]


def _rotations(vectors: Floats) -> Floats:
    from scipy.spatial.transform import Rotation

    matrices: Floats = Rotation.from_rotvec(vectors).as_matrix()
    return matrices


def _on(graph: ow.Graph, rows: Floats) -> wp.array[wp.vec3d]:
    return wp.array(rows, dtype=wp.vec3d, device=graph.device)


@dataclass(frozen=True, eq=False)
class Other(Problem):
    """A problem whose 1-form comes from another algorithm, with a start and a frame before of its own."""

    before: Any = None
    """What the algorithm itself would start from."""
    own_integrand: Any = None
    """The 1-form to integrate along trees, where it is not v."""

    @property
    def integrand(self) -> wp.array[wp.vec3d]:
        return self.v if self.own_integrand is None else self.own_integrand

    @cached_property
    def previous(self) -> wp.array[wp.vec3d]:
        return self.rest if self.before is None else self.before


def _turned(shape: Shape, degrees: float) -> Floats:
    """Rotation vectors per node: a twist about the longest side."""
    return np.radians(degrees) * shape.field[:, None] * np.eye(3)[shape.axis]


# ------------------------------------------------------------------ ARAP


def arap_steps(name: str, degrees: float, steps: int, device: Any) -> Iterator[Other]:
    """The global steps of ARAP with spokes (Sorkine, Alexa 2007), one end held, the other turned in place.

    v_ij = (R_i + R_j) / 2 dx_ij with the best rotations R of the positions before; each step is solved to 1e-12.
    """
    shape = Shape.of(name, "cotangent", device)
    graph, rest = shape.graph, shape.x
    tail, head, mu = graph.tail.numpy(), graph.head.numpy(), graph.mu.numpy()
    dx = rest[head] - rest[tail]
    ends = (shape.field > 1.0 - 1e-9) | shape.pinned
    middle = rest.mean(axis=0)
    turned = np.einsum("nij,nj->ni", _rotations(_turned(shape, degrees)), rest - middle) + middle
    x = np.where(ends[:, None], turned, rest)
    placed = Shape(x.copy(), graph, shape.field, ends, shape.axis)
    known: State | None = None
    for step in range(steps):
        d = x[head] - x[tail]
        pulls = mu[:, None, None] * np.einsum("mi,mj->mij", d, dx)
        cells = np.zeros((graph.node_count, 3, 3))
        np.add.at(cells, tail, pulls)
        np.add.at(cells, head, pulls)
        rotation = _nearest(cells)
        v = np.einsum("mij,mj->mi", (rotation[tail] + rotation[head]) / 2.0, dx)
        case = Case(name, "ARAP step", float(step + 1))
        problem = _problem(case, placed, v, known, before=_on(graph, x))
        known = problem.state
        yield problem
        x = problem.reference.numpy().copy()


def _nearest(matrices: Floats) -> Floats:
    """The rotations nearest to matrices (n, 3, 3)."""
    u, _, vt = np.linalg.svd(matrices)
    flip = np.sign(np.linalg.det(u @ vt))
    u[:, :, 2] *= flip[:, None]
    nearest: Floats = u @ vt
    return nearest


def _problem(case: Case, shape: Shape, v: Floats, known: State | None = None, **extra: Any) -> Other:
    solver = ow.Multigrid(tol=1.0e-12, dtype="float64")
    state = solver.prepare(shape.graph, shape.pinned) if known is None else known
    return Other(case, shape, _on(shape.graph, v), solver, state, **extra)


# ------------------------------------------------------------------ Poisson and Laplacian mesh editing


def poisson_editing(name: str, degrees: float, device: Any) -> Other:
    """Gradients of x on triangles, each turned by its own rotation, then L x = divergence (Yu et al. 2004).

    The divergence of a field of face gradients by cotangents is that of the 1-form with the triangles' shares
    v_ij = sum over the triangles of ij of cot R_f dx_ij / sum of cot.
    """
    shape = Shape.of(name, "cotangent", device)
    graph, x = shape.graph, shape.x
    _, faces = mesh(name)
    corners = graph.node_of[np.asarray(faces, dtype=np.int64)]
    rotation = _rotations(_turned(shape, degrees)[corners].mean(axis=1))
    key = np.sort(np.stack([graph.tail.numpy(), graph.head.numpy()], axis=1), axis=1).astype(np.int64)
    number = key[:, 0] * graph.node_count + key[:, 1]
    by_number = np.argsort(number)
    total, weight = np.zeros((graph.edge_count, 3)), np.zeros(graph.edge_count)
    sign = np.where(graph.tail.numpy() < graph.head.numpy(), 1.0, -1.0)
    for k in range(3):
        a, b, c = corners[:, k], corners[:, (k + 1) % 3], corners[:, (k + 2) % 3]
        low, high = np.minimum(a, b), np.maximum(a, b)
        e = by_number[np.searchsorted(number[by_number], low.astype(np.int64) * graph.node_count + high)]
        p, q = x[a] - x[c], x[b] - x[c]
        area = np.linalg.norm(np.cross(p, q), axis=1)
        # Right and obtuse angles count a little, as the package's weights are clamped from below.
        cotangent = np.maximum(np.einsum("ij,ij->i", p, q) / np.maximum(area, 1e-300), 1e-3)
        np.add.at(total, e, cotangent[:, None] * np.einsum("nij,nj->ni", rotation, x[high] - x[low]))
        np.add.at(weight, e, cotangent)
    v = sign[:, None] * total / np.maximum(weight, 1e-300)[:, None]
    return _problem(Case(name, "Poisson editing", degrees), shape, v)


def laplacian_editing(name: str, degrees: float, device: Any) -> Other:
    """L x = R_i delta_i with delta = L x at rest (Lipman et al. 2004; Sorkine et al. 2004 with given rotations).

    The right-hand side is no codiff of an edge's own vectors: the solver gets the flow down a tree that has it as its
    codiff, and trees integrate v_ij = (R_i + R_j) / 2 dx_ij.
    """
    shape = Shape.of(name, "cotangent", device)
    graph, x = shape.graph, shape.x
    tail, head, mu = graph.tail.numpy(), graph.head.numpy(), graph.mu.numpy()
    rotation = _rotations(_turned(shape, degrees))
    dx = x[head] - x[tail]
    delta = np.zeros_like(x)
    np.add.at(delta, tail, -mu[:, None] * dx)
    np.add.at(delta, head, mu[:, None] * dx)
    wanted = np.einsum("nij,nj->ni", rotation, delta)
    integrand = np.einsum("mij,mj->mi", (rotation[tail] + rotation[head]) / 2.0, dx)
    v = flow(spanning_tree(graph, roots=graph.vertex_at[shape.pinned]), wanted)
    return _problem(Case(name, "Laplacian editing", degrees), shape, v, own_integrand=_on(graph, integrand))


def flow(tree: SpanningTree, wanted: Floats) -> Floats:
    """A 1-form on the tree's edges whose codiff is `wanted` (n, 3) except at the roots: flows of subtrees, over mu."""
    graph = tree.graph
    order, parent, link = (a.numpy() for a in (tree.order, tree.parent, tree.link))
    total = wanted.copy()
    for depth in range(int(tree.depth.max(initial=0)), 0, -1):
        nodes = np.flatnonzero(tree.depth == depth)
        np.add.at(total, parent[nodes], total[nodes])
    child = order[parent[order] >= 0]
    e = np.maximum(link[child], ~link[child])
    v = np.zeros((graph.edge_count, 3))
    # (codiff v)_j = - sum mu v_outgoing: what flows to j along the edge from its parent, run forwards.
    v[e] = np.where(link[child] >= 0, 1.0, -1.0)[:, None] * total[child] / graph.mu.numpy()[e, None]
    return v


# ------------------------------------------------------------------ images


def image(side: int, seed: int) -> Floats:
    """A picture (side, side, 3) of smooth noise of all sizes in 0..1, and some edges."""
    rng = np.random.default_rng(seed)
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.rfftfreq(side), indexing="ij"))
    frequency[0, 0] = np.inf
    spectrum = rng.normal(size=(2, *frequency.shape, 3)) / frequency[None, :, :, None] ** 1.6
    picture = np.fft.irfft2(spectrum[0] + 1j * spectrum[1], s=(side, side), axes=(0, 1))
    picture = (picture - picture.min()) / np.ptp(picture)
    row, column = np.indices((side, side)) / side
    picture[np.hypot(row - 0.5, column - 0.5) < 0.25] *= 0.5
    return np.asarray(picture)


def image_editing(side: int, mixed: bool, device: Any) -> Other:
    """Seamless cloning (Perez et al. 2003): one picture's gradients, the other's values at the border.

    mixed: of each edge the larger gradient of the two, which no picture has; else the clone's own, which is exact.
    """
    graph = ow.Graph.from_grid((side, side), device=device)
    target, source = (image(side, seed).reshape(-1, 3)[graph.vertex_at] for seed in (1, 2))
    row, column = np.divmod(graph.vertex_at, side)
    border = (row == 0) | (column == 0) | (row == side - 1) | (column == side - 1)
    shape = Shape(target, graph, np.zeros(len(target)), border, 0)
    v = node_differential(graph, _on(graph, source)).numpy()
    if mixed:
        own = node_differential(graph, shape.rest).numpy()
        stronger = np.linalg.norm(own, axis=1) > np.linalg.norm(v, axis=1)
        v[stronger] = own[stronger]
    kind = "mixed cloning" if mixed else "cloning"
    return _problem(Case(f"image:{side}", kind, float(side), "uniform"), shape, v, before=_cut(shape, source))


def _cut(shape: Shape, source: Floats) -> wp.array[wp.vec3d]:
    """The source as it is, with the target's border."""
    return _on(shape.graph, np.where(shape.pinned[:, None], shape.x, source))
