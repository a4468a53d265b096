"""Where to integrate along a tree: on the host, with a GPU's copies to and fro, or on the device by pointer jumping."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import warp as wp

import oneform_warp as ow
from bench.tree.cases import Case, Problem, Shape
from bench.tree.measure import seconds
from oneform_warp.forms import node_energy
from oneform_warp.tree import SpanningTree, integrate_nodes, spanning_tree

REPEATS = 5


@wp.kernel(enable_backward=False)
def _steps(
    # In:
    parent: wp.array[wp.int32],
    link: wp.array[wp.int32],
    v: wp.array[wp.vec3d],
    # Out:
    jump_out: wp.array[wp.int32],
    sum_out: wp.array[wp.vec3d],
):
    j = wp.tid()
    if parent[j] < 0:
        jump_out[j] = j
        sum_out[j] = wp.vec3d()
    else:
        e = wp.max(link[j], ~link[j])
        jump_out[j] = parent[j]
        sum_out[j] = wp.where(link[j] >= 0, v[e], -v[e])


@wp.kernel(enable_backward=False)
def _jump(
    # In:
    jump: wp.array[wp.int32],
    total: wp.array[wp.vec3d],
    # Out:
    jump_out: wp.array[wp.int32],
    sum_out: wp.array[wp.vec3d],
):
    j = wp.tid()
    i = jump[j]
    jump_out[j] = jump[i]
    # A root leads to itself, and its sum is zero.
    sum_out[j] = total[j] + total[i]


@wp.kernel(enable_backward=False)
def _arrive(
    # In:
    jump: wp.array[wp.int32],
    total: wp.array[wp.vec3d],
    at_roots: wp.array[wp.vec3d],
    # Out:
    x_out: wp.array[wp.vec3d],
):
    j = wp.tid()
    x_out[j] = at_roots[jump[j]] + total[j]


class Jumping:
    """The integral along a tree on the device, in log2(depth) passes; the tree is copied there once."""

    def __init__(self, tree: SpanningTree, device: Any) -> None:
        self.device = device
        self.parent, self.link = tree.parent.to(device), tree.link.to(device)
        count = tree.parent.shape[0]
        self.jumps = [wp.empty(count, dtype=wp.int32, device=device) for _ in range(2)]
        self.sums = [wp.empty(count, dtype=wp.vec3d, device=device) for _ in range(2)]
        self.passes = int(np.ceil(np.log2(max(int(tree.depth.max()), 1)))) + 1

    def integrate(self, v: wp.array[wp.vec3d], at_roots: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
        """As `integrate_nodes`."""
        count = self.parent.shape[0]
        inputs = [self.parent, self.link, v]
        wp.launch(_steps, dim=count, inputs=inputs, outputs=[self.jumps[0], self.sums[0]], device=self.device)
        for k in range(self.passes):
            here, there = k % 2, 1 - k % 2
            inputs, outputs = [self.jumps[here], self.sums[here]], [self.jumps[there], self.sums[there]]
            wp.launch(_jump, dim=count, inputs=inputs, outputs=outputs, device=self.device)
        last, x = self.passes % 2, wp.empty_like(at_roots)
        inputs = [self.jumps[last], self.sums[last], at_roots]
        wp.launch(_arrive, dim=count, inputs=inputs, outputs=[x], device=self.device)
        return x


def transfer(name: str, device: Any) -> list[dict[str, Any]]:
    """Seconds of each step, on one mesh."""
    problem = Problem.of(Case(name, "twist", 90.0), Shape.of(name, "cotangent", device))
    graph = problem.graph
    tree = spanning_tree(graph, roots=problem.roots)
    jumping = Jumping(tree, device)
    on_host = integrate_nodes(tree, problem.v, problem.rest).numpy()
    on_device = jumping.integrate(problem.v, problem.rest).numpy()
    solver = ow.Multigrid()
    state = solver.prepare(graph, problem.shape.pinned)
    cost = graph.mu.numpy()
    row = {
        "mesh": name,
        "nodes": graph.node_count,
        "depth": int(tree.depth.max()),
        "min depth from the centre s": seconds(partial(spanning_tree, graph), REPEATS),
        "min depth from what is held s": seconds(partial(spanning_tree, graph, roots=problem.roots), REPEATS),
        "tree by a cost s": seconds(partial(spanning_tree, graph, -cost, roots=problem.roots), REPEATS),
        "graph to the host s": seconds(
            lambda: [a.to("cpu") for a in (graph.offsets, graph.neighbours, graph.incident)], REPEATS
        ),
        "v to the host s": seconds(lambda: problem.v.numpy(), REPEATS),
        "x to the device s": seconds(lambda: wp.array(on_host, dtype=wp.vec3d, device=device), REPEATS),
        "integrate on the host, with copies s": seconds(
            lambda: integrate_nodes(tree, problem.v, problem.rest).to(device), REPEATS
        ),
        "tree to the device s": seconds(partial(Jumping, tree, device), REPEATS),
        "integrate on the device s": seconds(partial(jumping.integrate, problem.v, problem.rest), REPEATS),
        "energy s": seconds(partial(node_energy, graph, problem.rest, problem.v), REPEATS),
        "whole multigrid solve s": seconds(partial(solver.solve, state, problem.v, problem.rest), REPEATS),
        "host and device differ by": float(np.abs(on_host - on_device).max()) / problem.shape.diagonal,
    }
    return [row]
