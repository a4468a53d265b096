"""Heat that has spread along a graph, known to some digits everywhere, however little of it has arrived.

    (L + a / t) u = a / t at the sources        after the time t, with the areas a

It falls by exp(-distance / sqrt(t)), over hundreds of decades. CG and its like know it down to a part of its largest
value only; sweeps that put each node to the mean of its surroundings add only numbers >= 0, and lose no digit anywhere.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from oneform_warp.graph import Graph

__all__ = ["LEAST", "heat"]

LEAST = 1.0e-280
"""What is below has lost its digits to float64's range."""

SWEEPS = 128
"""Between two looks from the host; heat gets on by a third of an edge in each."""

SETTLED = 0.01
"""What heat may still change by, relative to itself, over so many sweeps: its direction is all that is wanted."""

MAX_SWEEPS = 10_000
"""Enough for 3,000 edges in a row."""


@wp.kernel(enable_backward=False)
def _sweep(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    rate: wp.array[wp.float64],
    source: wp.array[wp.vec3d],
    u: wp.array[wp.vec3d],
    # Out:
    u_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    total = rate[i] * source[i]
    diagonal = rate[i]
    for h in range(offsets[i], offsets[i + 1]):
        w = mu[wp.max(incident[h], ~incident[h])]
        total += w * u[neighbours[h]]
        diagonal += w
    if diagonal > wp.float64(0.0):
        total /= diagonal
    u_out[i] = total


def heat(
    graph: Graph, rate: wp.array[wp.float64], source: wp.array[wp.vec3d], least: float = LEAST
) -> wp.array[wp.vec3d]:
    """The u >= 0 with (L + rate) u = rate source, columns by themselves, everything per node.

    rate: a / t >= 0, (n,); source: 1 or 0 in each column, (n,); what is below `least` need not be right.
    """
    u, other = wp.zeros_like(source), wp.empty_like(source)
    rows = [graph.offsets, graph.neighbours, graph.incident, graph.mu, rate, source]
    before = np.zeros((graph.node_count, 3))
    for sweep in range(1, MAX_SWEEPS + 1):
        wp.launch(_sweep, dim=graph.node_count, inputs=[*rows, u], outputs=[other], device=u.device)
        u, other = other, u
        if sweep % SWEEPS == 0:
            now = u.numpy().copy()
            if (now - before <= SETTLED * now)[now > least].all():
                break
            before = now
    return u
