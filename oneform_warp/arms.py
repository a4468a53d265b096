"""Arms: by what vectors at rest the rotations of nodes that share a cell pull at each other.

For a cell c of n corners with edges e from each corner k to the next, and g_k = w_k s_k - w_(k-1) s_(k-1):

    a_ij = -1/n sum of g_k over the corners k at j of the cells that i and j share,  a_ii the same at i

The energy is bilinear in rotations and positions up to the squares of edges, and these are its coefficients:

    E(x) = sum_i [ sum_j w_ij/2 (|x_j - x_i|^2 + |s_ij|^2) - 2 tr(R_i^T B_i) ],  B_i = sum_j (x_j - x_i) a_ij^T
    r_i = sum_j [ w_ij (x_j - x_i) + R_j a_ji ] + R_i a_ii                        half of its downhill gradient
"""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from oneform_warp.cells import Cells, Meetings

__all__ = ["Arms"]


@wp.kernel(enable_backward=False)
def _on_corners(
    # Graph:
    edge: wp.array[wp.int32],
    # In:
    form: wp.array[wp.vec3d],
    # Out:
    s_out: wp.array[wp.vec3d],
):
    k = wp.tid()
    e = edge[k]
    s_out[k] = wp.where(e < 0, -form[wp.max(e, ~e)], form[wp.max(e, ~e)])


@wp.func
def bend(offsets: wp.array[wp.int32], weight: wp.array[wp.float64], s: wp.array[wp.vec3d], c: int, k: int) -> wp.vec3d:
    """g_k of the corner k of cell c."""
    before = wp.where(k == offsets[c], offsets[c + 1] - 1, k - 1)
    return weight[k] * s[k] - weight[before] * s[before]


@wp.kernel(enable_backward=False)
def _arms(
    # Graph:
    offsets: wp.array[wp.int32],
    cell: wp.array[wp.int32],
    weight: wp.array[wp.float64],
    pair_offsets: wp.array[wp.int32],
    begin: wp.array[wp.int32],
    own: wp.array[wp.int32],
    beside: wp.array[wp.int32],
    # In:
    s: wp.array[wp.vec3d],
    # Out:
    to_out: wp.array[wp.vec3d],
    from_out: wp.array[wp.vec3d],
    weight_out: wp.array[wp.float64],
    self_out: wp.array[wp.vec3d],
    rest_out: wp.array[wp.float64],
):
    i = wp.tid()
    alone = wp.vec3d()
    rest = wp.float64(0.0)
    for h in range(pair_offsets[i], pair_offsets[i + 1]):
        there = wp.vec3d()
        here = wp.vec3d()
        w = wp.float64(0.0)
        for t in range(begin[h], begin[h + 1]):
            k = own[t]
            l = beside[t]
            c = cell[k]
            n = offsets[c + 1] - offsets[c]
            part = wp.float64(1.0) / wp.float64(n)
            there -= part * bend(offsets, weight, s, c, l)
            g = part * bend(offsets, weight, s, c, k)
            here -= g
            # Each corner of the cell is met n - 1 times.
            alone -= g / wp.float64(n - 1)
            if l == wp.where(k + 1 == offsets[c + 1], offsets[c], k + 1):
                w += weight[k]
                rest += wp.float64(0.5) * weight[k] * wp.length_sq(s[k])
            if k == wp.where(l + 1 == offsets[c + 1], offsets[c], l + 1):
                w += weight[l]
                rest += wp.float64(0.5) * weight[l] * wp.length_sq(s[l])
        to_out[h] = there
        from_out[h] = here
        weight_out[h] = w
    self_out[i] = alone
    rest_out[i] = rest


@dataclass(frozen=True, eq=False)
class Arms:
    """The coefficients for cells with rest edges s, by pairs (i, j) of nodes that meet."""

    cells: Cells
    s: wp.array[wp.vec3d]
    """The rest edge from each corner to the next, (C,)."""
    to: wp.array[wp.vec3d]
    """a_ij, (p,)."""
    back: wp.array[wp.vec3d]
    """a_ji, (p,)."""
    weight: wp.array[wp.float64]
    """w_ij, the weights of edges between i and j, (p,)."""
    own: wp.array[wp.vec3d]
    """a_ii, (n,)."""
    rest: wp.array[wp.float64]
    """sum_j w_ij/2 |s_ij|^2, (n,)."""

    @property
    def meetings(self) -> Meetings:
        """The pairs."""
        return self.cells.meetings

    @classmethod
    def of(cls, cells: Cells, form: wp.array[wp.vec3d]) -> Arms:
        """form: the rest edges, stretched, (m,)."""
        device, count = cells.graph.device, cells.graph.node_count
        s = wp.empty(cells.corners.shape[0], dtype=wp.vec3d, device=device)
        wp.launch(_on_corners, dim=s.shape[0], inputs=[cells.edge, form], outputs=[s], device=device)
        met = cells.meetings
        pairs = met.other.shape[0]
        to, back = (wp.empty(pairs, dtype=wp.vec3d, device=device) for _ in range(2))
        weight = wp.empty(pairs, dtype=wp.float64, device=device)
        own, rest = wp.empty(count, dtype=wp.vec3d, device=device), wp.empty(count, dtype=wp.float64, device=device)
        rings = [cells.offsets, cells.cell, cells.weight, met.offsets, met.begin, met.own, met.beside]
        outputs = [to, back, weight, own, rest]
        wp.launch(_arms, dim=count, inputs=[*rings, s], outputs=outputs, device=device)
        return cls(cells, s, to, back, weight, own, rest)
