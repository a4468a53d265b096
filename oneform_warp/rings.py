"""The integral of a 1-form ring by ring: each node takes the mean over all its neighbours in the ring before.

The walk is serial, so it runs as a one-thread Warp kernel on the CPU, as those along trees do.
"""

from __future__ import annotations

import warp as wp

from oneform_warp.replay import Replay
from oneform_warp.tree import SpanningTree

__all__ = ["Rings", "integrate_rings"]


@wp.kernel(enable_backward=False)
def _integrate_rings(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    order: wp.array[wp.int32],
    depth: wp.array[wp.int32],
    v: wp.array[wp.vec3d],
    # Out:
    x_out: wp.array[wp.vec3d],
):
    # x_out comes in with the values at the roots, and at first elsewhere: only the change is summed up.
    for k in range(order.shape[0]):
        j = order[k]
        change = wp.vec3d()
        weight = wp.float64(0.0)
        for h in range(offsets[j], offsets[j + 1]):
            i = neighbours[h]
            if depth[i] < depth[j]:
                e = wp.max(incident[h], ~incident[h])
                there = wp.where(incident[h] < 0, v[e], -v[e])
                # In this order nothing is left where nothing changes.
                change += mu[e] * ((x_out[i] - x_out[j]) + there)
                weight += mu[e]
        if weight > wp.float64(0.0):
            x_out[j] = x_out[j] + change / weight


class Rings:
    """The rings around the roots of a tree of least depth, kept to be integrated over again; the graph is not."""

    def __init__(self, tree: SpanningTree) -> None:
        graph = tree.graph
        table = [a.to("cpu") for a in (graph.offsets, graph.neighbours, graph.incident, graph.mu)]
        nothing = wp.empty(0, dtype=wp.vec3d, device="cpu")
        inputs = [*table, tree.order, wp.array(tree.depth, dtype=wp.int32, device="cpu"), nothing]
        launch = wp.launch(_integrate_rings, dim=1, inputs=inputs, outputs=[nothing], device="cpu", record_cmd=True)
        self._walk = Replay(launch, ["v", "x_out"], keep=inputs)

    def integrate(self, v: wp.array[wp.vec3d], at_roots: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
        """See `integrate_rings`."""
        x = wp.clone(at_roots, device="cpu")
        # Named, so that a copy lives until the walk is done.
        here = v.to("cpu")
        self._walk(here, x)
        return x


def integrate_rings(tree: SpanningTree, v: wp.array[wp.vec3d], at_roots: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
    """x_j = the mean by mu of x_i + v_ij over all neighbours i nearer to a root than j; rows per node, on the CPU.

    tree: of least depth. All ways out of the ring before count, and not one as along a tree: less energy by half.
    """
    return Rings(tree).integrate(v, at_roots)
