"""The ARAP energy of cells: best rotations, what they ask of the edges, and how far the positions are from it.

    E(x) = sum over cells c of 1/n_c sum over its corners i and edges e of w_ce |d_e - R_i s_e|^2,  d = dx, s at rest

With R the best rotations this is the energy that spokes-and-rims ARAP minimises, by 1/3 on triangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from oneform_warp.arms import Arms
from oneform_warp.cells import Cells
from oneform_warp.forms import form_size
from oneform_warp.procrustes import nearest_rotation
from oneform_warp.segments import launch_chunks
from oneform_warp.smoothness import Smoothness, among_neighbours
from oneform_warp.solvers import State

__all__ = ["CellEnergy", "Fit"]


@wp.kernel(enable_backward=False)
def _fitted(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    offsets: wp.array[wp.int32],
    other: wp.array[wp.int32],
    weight: wp.array[wp.float64],
    arm: wp.array[wp.vec3d],
    rest: wp.array[wp.float64],
    edge_offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    x: wp.array[wp.vec3d],
    old: wp.array[wp.mat33d],
    given: wp.array[wp.int32],
    smooth: wp.float64,
    planar: int,
    # Out:
    rotation_out: wp.array[wp.mat33d],
    energy_out: wp.array[wp.vec3d],
):
    chunk, lane = wp.tid()
    energy = wp.float64(0.0)
    for i in range(chunk_offsets[chunk] + lane, chunk_offsets[chunk + 1], wp.block_dim()):
        b = wp.mat33d()
        squares = wp.float64(0.0)
        here = x[i]
        for h in range(offsets[i], offsets[i + 1]):
            d = x[other[h]] - here
            b += wp.outer(d, arm[h])
            squares += weight[h] * wp.length_sq(d)
        rotation = old[i]
        if given[i] == 0:
            asked = b
            if smooth > wp.float64(0.0):
                asked = among_neighbours(edge_offsets, neighbours, incident, mu, smooth, old, b, i)
            if planar != 0:
                # Half a turn about an axis in the plane would be a reflection of it.
                asked[2, 2] += wp.float64(2.0) * wp.sqrt(wp.ddot(asked, asked))
            rotation = nearest_rotation(asked, rotation)
        rotation_out[i] = rotation
        energy += wp.float64(0.5) * squares + rest[i] - wp.float64(2.0) * wp.ddot(rotation, b)
    wp.tile_store(energy_out, wp.tile_sum(wp.tile(wp.vec3d(energy), preserve_type=True)), offset=chunk)


@wp.kernel(enable_backward=False)
def _residual(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    offsets: wp.array[wp.int32],
    other: wp.array[wp.int32],
    weight: wp.array[wp.float64],
    arm: wp.array[wp.vec3d],
    own: wp.array[wp.vec3d],
    # In:
    pinned: wp.array[wp.int32],
    attachment: wp.array[wp.float64],
    target: wp.array[wp.vec3d],
    x: wp.array[wp.vec3d],
    rotation: wp.array[wp.mat33d],
    # Out:
    r_out: wp.array[wp.vec3d],
    square_out: wp.array[wp.vec3d],
    attached_out: wp.array[wp.vec3d],
):
    chunk, lane = wp.tid()
    square = wp.vec3d()
    attached = wp.float64(0.0)
    for i in range(chunk_offsets[chunk] + lane, chunk_offsets[chunk + 1], wp.block_dim()):
        r = wp.vec3d()
        if pinned[i] == 0:
            here = x[i]
            r = rotation[i] * own[i]
            for h in range(offsets[i], offsets[i + 1]):
                j = other[h]
                r += weight[h] * (x[j] - here) + rotation[j] * arm[h]
            if attachment.shape[0] > 0:
                gap = target[i] - here
                r += attachment[i] * gap
                attached += attachment[i] * wp.length_sq(gap)
        r_out[i] = r
        square += wp.cw_mul(r, r)
    wp.tile_store(square_out, wp.tile_sum(wp.tile(square, preserve_type=True)), offset=chunk)
    wp.tile_store(attached_out, wp.tile_sum(wp.tile(wp.vec3d(attached), preserve_type=True)), offset=chunk)


@wp.func
def mean_rotation(corners: wp.array[wp.int32], rotation: wp.array[wp.mat33d], begin: int, end: int) -> wp.mat33d:
    """The mean matrix of a cell's corners: unlike a mean of vectors it has no seam at 180 degrees."""
    total = wp.mat33d()
    for k in range(begin, end):
        total += rotation[corners[k]]
    return (wp.float64(1.0) / wp.float64(end - begin)) * total


@wp.kernel(enable_backward=False)
def _form(
    # Graph:
    along_offsets: wp.array[wp.int32],
    along: wp.array[wp.int32],
    cell: wp.array[wp.int32],
    offsets: wp.array[wp.int32],
    corners: wp.array[wp.int32],
    edge: wp.array[wp.int32],
    weight: wp.array[wp.float64],
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    s: wp.array[wp.vec3d],
    x: wp.array[wp.vec3d],
    rotation: wp.array[wp.mat33d],
    # Out:
    v_out: wp.array[wp.vec3d],
):
    e = wp.tid()
    wanted = wp.vec3d()
    total = wp.float64(0.0)
    for h in range(along_offsets[e], along_offsets[e + 1]):
        k = along[h]
        c = cell[k]
        w = weight[k]
        wanted += wp.where(edge[k] < 0, -w, w) * (mean_rotation(corners, rotation, offsets[c], offsets[c + 1]) * s[k])
        total += w
    d = x[head[e]] - x[tail[e]]
    v_out[e] = d + (wp.float64(1.0) / mu[e]) * (wanted - total * d)


@wp.kernel(enable_backward=False)
def _squares(
    chunk_offsets: wp.array[wp.int32],
    # In:
    r: wp.array[wp.vec3d],
    # Out:
    square_out: wp.array[wp.vec3d],
):
    chunk, lane = wp.tid()
    square = wp.vec3d()
    for i in range(chunk_offsets[chunk] + lane, chunk_offsets[chunk + 1], wp.block_dim()):
        square += wp.cw_mul(r[i], r[i])
    wp.tile_store(square_out, wp.tile_sum(wp.tile(square, preserve_type=True)), offset=chunk)


@dataclass(frozen=True, eq=False)
class Fit:
    """Positions with the rotations that fit them best."""

    x: wp.array[wp.vec3d]
    rotation: wp.array[wp.mat33d]
    r: wp.array[wp.vec3d]
    """Half the negative gradient of E at the free nodes, zero at pinned ones."""
    energy: float


class CellEnergy:
    """E(x) on cells with rest edges s, plus what pulls softly: sum w_i |x_i - t_i|^2 of attached nodes, constraints."""

    def __init__(
        self,
        cells: Cells,
        form: wp.array[wp.vec3d],
        state: State,
        target: wp.array[wp.vec3d],
        given: wp.array[wp.int32],
        *,
        planar: bool = False,
        smoothness: Smoothness | None = None,
    ) -> None:
        """form: the rest edges, stretched, (m,). target: (n,), used where nodes are attached. given: 1 where rotations
        are not to change, (n,). planar: D = 2.
        """
        self.given, self.planar = given, planar
        self.cells, self.state, self.target, self.smoothness = cells, state, target, smoothness
        self.arms = Arms.of(cells, form)
        self.size = form_size(cells.graph, form)
        """sum mu |s|^2, what the energy is compared with."""
        self._energies = cells.segments.partials()
        self._attached = cells.graph.segments.partials()
        self.square = cells.graph.segments.partials()
        """|r|^2 of the last fit, partial sums."""
        self.none = cells.graph.segments.partials()
        """Zeros in the same shape."""

    def fit(self, x: wp.array[wp.vec3d], old: wp.array[wp.mat33d]) -> Fit:
        """The best rotations at x and what follows from them; `old` decides where they are open."""
        arms, met, graph = self.arms, self.arms.meetings, self.cells.graph
        rotation, r = self._rotations(x, old), wp.empty_like(x)
        if self.smoothness is not None:
            # Each has its neighbours' last ones beside it, and once is not enough for what depends on them.
            rotation = self._rotations(x, rotation)
        system = self.state.system
        launch_chunks(
            _residual,
            graph.segments,
            [
                *(met.offsets, met.other, arms.weight, arms.back, arms.own),
                *(system.pinned, system.attachment, self.target, x, rotation),
            ],
            [r, self.square, self._attached],
        )
        energy = float(self._energies.numpy()[:, 0].sum())
        if system.attachment.shape[0]:
            energy += float(self._attached.numpy()[:, 0].sum())
        if self.smoothness is not None:
            energy += self.smoothness.energy(rotation)
        if self.state.pulls:
            energy += self.state.soft_energy(x)
            self.state.add_soft_pull(x, r)
            launch_chunks(_squares, graph.segments, [r], [self.square])
        return Fit(x, rotation, r, energy)

    def _rotations(self, x: wp.array[wp.vec3d], old: wp.array[wp.mat33d]) -> wp.array[wp.mat33d]:
        """The best ones at x among neighbours as in `old`, and the partial sums of E."""
        arms, met, graph = self.arms, self.arms.meetings, self.cells.graph
        rotation = wp.empty_like(old)
        rings = [met.offsets, met.other, arms.weight, arms.to, arms.rest]
        edges = [graph.offsets, graph.neighbours, graph.incident, graph.mu]
        smooth = 0.0 if self.smoothness is None else self.smoothness.scale
        inputs = [*rings, *edges, x, old, self.given, smooth, int(self.planar)]
        launch_chunks(_fitted, self.cells.segments, inputs, [rotation, self._energies])
        return rotation

    def form(self, fit: Fit) -> wp.array[wp.vec3d]:
        """The 1-form (m,) whose integral lowers E: v_e = d_e + sum over its cells of w_ce / mu_e (mean(R) s_e - d_e).

        That is the mean of mean(R) s_e where the w_ce sum to mu_e.
        """
        cells, graph = self.cells, self.cells.graph
        v = wp.empty(graph.edge_count, dtype=wp.vec3d, device=graph.device)
        rings = [*cells.along, cells.cell, cells.offsets, cells.corners, cells.edge, cells.weight]
        inputs = [*rings, graph.tail, graph.head, graph.mu, self.arms.s, fit.x, fit.rotation]
        wp.launch(_form, dim=v.shape[0], inputs=inputs, outputs=[v], device=v.device)
        return v
