"""Spanning trees of the graph, and the 0-form that a 1-form has along one: the paper's seed, on the host.

The walks are serial, so they run as one-thread Warp kernels on the CPU: compiled loops, no Python per vertex.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows, to_device, vertex_mask
from oneform_warp.errors import InputError
from oneform_warp.graph import Graph

__all__ = ["SpanningTree", "integrate_tree", "spanning_tree"]


@dataclass(frozen=True, eq=False, repr=False)
class SpanningTree:
    """A tree per component, or one per root, walked from the roots outwards: nodes - roots edges in all."""

    graph: Graph
    order: wp.array[wp.int32]
    """Nodes, each after its parent, (n,), on the CPU."""
    parent: wp.array[wp.int32]
    """The parent of each node, -1 for a root, (n,)."""
    link: wp.array[wp.int32]
    """The edge from the parent: e where it runs to the node, ~e where it runs to the parent, (n,)."""
    depth: NDArray[np.int32]
    """Edges between each node and its root, (n,)."""

    @property
    def edges(self) -> NDArray[np.int64]:
        """The numbers of the tree's edges, (n - roots,), ascending."""
        children = self.parent.numpy() >= 0
        link = self.link.numpy()[children].astype(np.int64)
        return np.sort(np.where(link >= 0, link, ~link))

    @property
    def roots(self) -> NDArray[np.int64]:
        """The roots, one or more for each component, as vertex numbers."""
        nodes = np.flatnonzero(self.parent.numpy() < 0)
        return self.graph.vertex_at[nodes].astype(np.int64)

    def __repr__(self) -> str:
        return f"SpanningTree({len(self.edges)} edges, depth {int(self.depth.max(initial=0))})"


@wp.kernel(enable_backward=False)
def _breadth_first(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    # In:
    roots: wp.array[wp.int32],
    component_roots: wp.array[wp.int32],
    allowed: wp.array[wp.uint8],
    # Out:
    order_out: wp.array[wp.int32],
    parent_out: wp.array[wp.int32],
    link_out: wp.array[wp.int32],
    depth_out: wp.array[wp.int32],
):
    # depth_out comes in as -1 for every node: not seen yet.
    end = int(0)
    at = int(0)
    for c in range(component_roots.shape[0] - 1):
        for k in range(component_roots[c], component_roots[c + 1]):
            order_out[end] = roots[k]
            parent_out[roots[k]] = -1
            depth_out[roots[k]] = 0
            end += 1
        while at < end:
            i = order_out[at]
            at += 1
            for h in range(offsets[i], offsets[i + 1]):
                j = neighbours[h]
                if depth_out[j] < 0 and allowed[wp.max(incident[h], ~incident[h])] != wp.uint8(0):
                    parent_out[j] = i
                    link_out[j] = incident[h]
                    depth_out[j] = depth_out[i] + 1
                    order_out[end] = j
                    end += 1


def _walk(graph: Graph, roots: NDArray[np.int64], allowed: NDArray[np.uint8]) -> SpanningTree:
    """Breadth-first from the roots, at least one per component, along the allowed edges."""
    n = graph.node_count
    component = graph.node_component[roots]
    by_component = np.argsort(component, kind="stable")
    counts = np.bincount(component, minlength=graph.component_count)
    component_roots = np.concatenate([[0], np.cumsum(counts)])
    order, parent, link = (wp.empty(n, dtype=wp.int32, device="cpu") for _ in range(3))
    depth = wp.full(n, -1, dtype=wp.int32, device="cpu")
    table = [a.to("cpu") for a in (graph.offsets, graph.neighbours, graph.incident)]
    start = wp.array(roots[by_component].astype(np.int32), dtype=wp.int32, device="cpu")
    of_component = wp.array(component_roots.astype(np.int32), dtype=wp.int32, device="cpu")
    passable = wp.array(allowed, dtype=wp.uint8, device="cpu")
    wp.launch(
        _breadth_first,
        dim=1,
        inputs=[*table, start, of_component, passable],
        outputs=[order, parent, link, depth],
        device="cpu",
    )
    return SpanningTree(graph, order, parent, link, depth.numpy())


@wp.kernel(enable_backward=False)
def _climb(
    # In:
    leaf: wp.array[wp.int32],
    parent: wp.array[wp.int32],
    depth: wp.array[wp.int32],
    # Out:
    middle_out: wp.array[wp.int32],
):
    c = wp.tid()
    i = leaf[c]
    for _ in range(depth[leaf[c]] / 2):
        i = parent[i]
    middle_out[c] = i


def _centres(graph: Graph) -> NDArray[np.int64]:
    """A node near the middle of each component: halfway between two nodes that are far apart (double sweep)."""
    first, last = graph.component_offsets[:-1], graph.component_offsets[1:] - 1
    anywhere = np.ones(graph.edge_count, dtype=np.uint8)
    one_end = _walk(graph, first, anywhere).order.numpy()[last]
    tree = _walk(graph, one_end, anywhere)
    leaf = wp.array(tree.order.numpy()[last], dtype=wp.int32, device="cpu")
    middle = wp.empty_like(leaf)
    depth = wp.array(tree.depth, dtype=wp.int32, device="cpu")
    wp.launch(_climb, dim=len(first), inputs=[leaf, tree.parent, depth], outputs=[middle], device="cpu")
    return middle.numpy().astype(np.int64)


@wp.kernel(enable_backward=False)
def _kruskal(
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    # In:
    by_cost: wp.array[wp.int32],
    # Out:
    set_out: wp.array[wp.int32],
    chosen_out: wp.array[wp.uint8],
):
    for k in range(by_cost.shape[0]):
        e = by_cost[k]
        i = tail[e]
        j = head[e]
        # Find with path halving: set_out leads from each node towards the name of its set.
        while set_out[i] != i:
            set_out[i] = set_out[set_out[i]]
            i = set_out[i]
        while set_out[j] != j:
            set_out[j] = set_out[set_out[j]]
            j = set_out[j]
        if i != j:
            set_out[wp.max(i, j)] = wp.min(i, j)
            chosen_out[e] = wp.uint8(1)


def _minimal_edges(graph: Graph, cost: NDArray[np.float64], roots: NDArray[np.int64]) -> NDArray[np.uint8]:
    """1 for the edges of the spanning forest of least total cost, ties by edge number (Kruskal).

    The roots of a component are joined before any edge is.
    """
    together = np.arange(graph.node_count, dtype=np.int32)
    first = np.full(graph.component_count, graph.node_count, dtype=np.int32)
    np.minimum.at(first, graph.node_component[roots], roots.astype(np.int32))
    together[roots] = first[graph.node_component[roots]]
    by_cost = wp.array(np.argsort(cost, kind="stable").astype(np.int32), dtype=wp.int32, device="cpu")
    sets = wp.array(together, dtype=wp.int32, device="cpu")
    chosen = wp.zeros(graph.edge_count, dtype=wp.uint8, device="cpu")
    ends = [graph.tail.to("cpu"), graph.head.to("cpu")]
    wp.launch(_kruskal, dim=1, inputs=[*ends, by_cost], outputs=[sets, chosen], device="cpu")
    return chosen.numpy()


def spanning_tree(graph: Graph, cost: Any = None, *, roots: Any = None) -> SpanningTree:
    """The spanning tree of least total cost; without a cost, of least depth from a root near the graph's centre.

    cost: (m,), any finite sign. The paper's maximal tree is the least one of
    `-edge_energy(graph, x, v)`, its minimal tree that of `edge_energy(graph, x, v)`. Ties go by edge number.
    roots: vertices, by index or mask, where x is known: a tree hangs from each of them, and together they span;
    a component without any has its centre. Raises InputError for a bad cost or roots out of range.
    """
    chosen = _centres(graph) if roots is None else _roots(graph, vertex_mask(roots, graph.vertex_count, "roots"))
    if cost is None:
        return _walk(graph, chosen, np.ones(graph.edge_count, dtype=np.uint8))
    values = np.asarray(cost, dtype=np.float64)
    if values.shape != (graph.edge_count,) or not np.isfinite(values).all():
        raise InputError(
            f"a cost of shape {values.shape} for {graph.edge_count} edges, or not finite",
            where="cost",
            fix=f"give {graph.edge_count} finite numbers",
        )
    return _walk(graph, chosen, _minimal_edges(graph, values, chosen))


def _roots(graph: Graph, vertices: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The nodes of chosen vertices, and the centre of each component that has none."""
    nodes = np.unique(graph.node_of[vertices].astype(np.int64))
    without = np.bincount(graph.node_component[nodes], minlength=graph.component_count) == 0
    if not without.any():
        return nodes
    return np.concatenate([nodes, _centres(graph)[without]])


@wp.kernel(enable_backward=False)
def _integrate(
    # In:
    order: wp.array[wp.int32],
    parent: wp.array[wp.int32],
    link: wp.array[wp.int32],
    v: wp.array[wp.vec3d],
    # Out:
    x_out: wp.array[wp.vec3d],
):
    # x_out comes in with the values at the roots.
    for k in range(order.shape[0]):
        j = order[k]
        if parent[j] >= 0:
            if link[j] >= 0:
                x_out[j] = x_out[parent[j]] + v[link[j]]
            else:
                x_out[j] = x_out[parent[j]] - v[~link[j]]


def integrate_nodes(tree: SpanningTree, v: wp.array[wp.vec3d], at_roots: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
    """x with x_j = x_i + v_ij along the tree, from rows per node whose values at the roots are kept; on the CPU."""
    x = wp.clone(at_roots, device="cpu")
    wp.launch(_integrate, dim=1, inputs=[tree.order, tree.parent, tree.link, v.to("cpu")], outputs=[x], device="cpu")
    return x


def integrate_tree(tree: SpanningTree, v: Any) -> Any:
    """x with x_j = x_i + v_ij on every edge of the tree, zero at the roots; integrate(dx) = x up to a translation.

    v: 1-form, (m, D) on `graph.edges` -> (V, D) of the same dtype and kind of array.
    """
    graph = tree.graph
    form = read_rows(v, graph.edge_count, "v")
    zero = wp.zeros(graph.node_count, dtype=wp.vec3d, device="cpu")
    x = integrate_nodes(tree, to_device(form.data, "cpu"), zero)
    return form.like(graph.vertices_from(x))
