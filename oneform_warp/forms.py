"""0-forms and 1-forms: differential, codifferential, transform and energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows, to_device
from oneform_warp.errors import InputError
from oneform_warp.graph import Graph
from oneform_warp.rotations import transform_edge
from oneform_warp.segments import launch_chunks, sum_chunks

__all__ = [
    "codifferential",
    "codifferential_at",
    "differential",
    "edge_energy",
    "energy",
    "transform",
    "vertex_areas",
]


@wp.kernel(enable_backward=False)
def _differential(
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    # In:
    x: wp.array[wp.vec3d],
    # Out:
    dx_out: wp.array[wp.vec3d],
):
    e = wp.tid()
    dx_out[e] = x[head[e]] - x[tail[e]]


def node_differential(graph: Graph, x: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
    """dx_ij = x_j - x_i of rows per node, on the device."""
    dx = wp.empty(graph.edge_count, dtype=wp.vec3d, device=graph.device)
    wp.launch(
        _differential,
        dim=graph.edge_count,
        inputs=[graph.tail, graph.head, x],
        outputs=[dx],
        device=graph.device,
    )
    return dx


def differential(graph: Graph, x: Any) -> Any:
    """dx_ij = x_j - x_i on the edges (i, j) of `graph.edges`.

    x: 0-form, (V, D), any unit -> (m, D) of the same dtype and kind of array. Raises InputError for bad rows.
    """
    rows = read_rows(x, graph.vertex_count, "x")
    return rows.like(node_differential(graph, graph.nodes_from(rows.data)).numpy())


@wp.func
def codifferential_at(
    offsets: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    v: wp.array[wp.vec3d],
    i: int,
) -> wp.vec3d:
    """(codiff v)_i = - sum_j mu_ij v_ij at node i."""
    total = wp.vec3d()
    for h in range(offsets[i], offsets[i + 1]):
        e = incident[h]
        if e >= 0:
            total -= mu[e] * v[e]
        else:
            total += mu[~e] * v[~e]
    return total


@wp.kernel(enable_backward=False)
def _codifferential(
    # Graph:
    offsets: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    v: wp.array[wp.vec3d],
    # Out:
    b_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    b_out[i] = codifferential_at(offsets, incident, mu, v, i)


def node_codifferential(graph: Graph, v: wp.array[wp.vec3d]) -> wp.array[wp.vec3d]:
    """(codiff v)_i = - sum_j mu_ij v_ij, rows per node on the device."""
    b = wp.empty(graph.node_count, dtype=wp.vec3d, device=graph.device)
    inputs = [graph.offsets, graph.incident, graph.mu, v]
    wp.launch(_codifferential, dim=graph.node_count, inputs=inputs, outputs=[b], device=graph.device)
    return b


def codifferential(graph: Graph, v: Any) -> Any:
    """(codiff v)_i = - sum_j mu_ij v_ij, the adjoint of d: <dx, v>_mu = <x, codiff v>; the graph's divergence.

    v: 1-form, (m, D) -> (V, D); welded vertices all get the sum of their node.
    """
    rows = read_rows(v, graph.edge_count, "v")
    nodes = node_codifferential(graph, to_device(rows.data, graph.device))
    return rows.like(graph.vertices_from(nodes))


@wp.kernel(enable_backward=False)
def _transform(
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    # In:
    dx: wp.array[wp.vec3d],
    omega: wp.array[wp.vec3d],
    sigma: wp.array[wp.float64],
    # Out:
    v_out: wp.array[wp.vec3d],
):
    e = wp.tid()
    i = tail[e]
    j = head[e]
    v_out[e] = transform_edge(omega[i], omega[j], sigma[i], sigma[j], dx[e])


def node_transform(
    graph: Graph, dx: wp.array[wp.vec3d], omega: wp.array[wp.vec3d], sigma: wp.array[wp.float64]
) -> wp.array[wp.vec3d]:
    """v_ij = sigma_ij R(omega_ij) dx_ij with fields per node, on the device."""
    v = wp.empty(graph.edge_count, dtype=wp.vec3d, device=graph.device)
    inputs = [graph.tail, graph.head, dx, omega, sigma]
    wp.launch(_transform, dim=graph.edge_count, inputs=inputs, outputs=[v], device=graph.device)
    return v


@wp.kernel(enable_backward=False)
def _transformed_differential(
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    # In:
    x: wp.array[wp.vec3d],
    omega: wp.array[wp.vec3d],
    sigma: wp.array[wp.float64],
    # Out:
    v_out: wp.array[wp.vec3d],
):
    e = wp.tid()
    i = tail[e]
    j = head[e]
    v_out[e] = transform_edge(omega[i], omega[j], sigma[i], sigma[j], x[j] - x[i])


def node_transformed_differential(
    graph: Graph, x: wp.array[wp.vec3d], omega: wp.array[wp.vec3d], sigma: wp.array[wp.float64]
) -> wp.array[wp.vec3d]:
    """v_ij = sigma_ij R(omega_ij) (x_j - x_i) with everything per node, on the device."""
    v = wp.empty(graph.edge_count, dtype=wp.vec3d, device=graph.device)
    inputs = [graph.tail, graph.head, x, omega, sigma]
    wp.launch(_transformed_differential, dim=graph.edge_count, inputs=inputs, outputs=[v], device=graph.device)
    return v


def transform(graph: Graph, dx: Any, omega: Any, sigma: Any) -> Any:
    """v_ij = sigma_ij R(omega_ij) dx_ij, omega_ij the mean of its ends' vectors, sigma_ij their geometric mean.

    dx: (m, D); omega: radians, (V, 3) rotation vectors for D = 3, (V,) angles for D = 2, None for D = 1;
    sigma: (V,) > 0 -> (m, D). Antisymmetric by construction.
    """
    rows = read_rows(dx, graph.edge_count, "dx")
    turns, stretch = read_fields(graph, omega, sigma, rows.dimension)
    device = graph.device
    omega_nodes = graph.nodes_from(turns)
    sigma_nodes = wp.array(stretch[graph.vertex_at], dtype=wp.float64, device=device)
    return rows.like(node_transform(graph, to_device(rows.data, device), omega_nodes, sigma_nodes).numpy())


def read_fields(
    graph: Graph, omega: Any, sigma: Any, dimension: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Checked rotation vectors (V, 3) and stretches (V,) from what dimension D calls omega and sigma."""
    vectors = np.zeros((graph.vertex_count, 3))
    if omega is not None:
        rows = read_rows(omega, graph.vertex_count, "omega")
        expected = {1: 0, 2: 1, 3: 3}[dimension]
        if rows.dimension != expected:
            shape = {1: "None, a line has no rotations", 2: "angles (V,)", 3: "rotation vectors (V, 3)"}[dimension]
            raise InputError(
                f"{rows.dimension} numbers per vertex in D = {dimension}", where="omega", fix=f"give {shape}"
            )
        vectors = rows.data if dimension == 3 else np.roll(rows.data, 2, axis=1)
    stretch = np.ones(graph.vertex_count) if sigma is None else read_rows(sigma, graph.vertex_count, "sigma").data[:, 0]
    if not (stretch > 0.0).all():
        vertex = int(np.argmin(stretch > 0.0))
        raise InputError(f"sigma is {stretch[vertex]} at vertex {vertex}", where="sigma", fix="stretch is > 0")
    return vectors, stretch


@wp.kernel(enable_backward=False)
def _areas(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    x: wp.array[wp.vec3d],
    # Out:
    area_out: wp.array[wp.float64],
):
    i = wp.tid()
    area = wp.float64(0.0)
    for h in range(offsets[i], offsets[i + 1]):
        area += mu[wp.max(incident[h], ~incident[h])] * wp.length_sq(x[neighbours[h]] - x[i])
    area_out[i] = area / wp.float64(4.0)


def vertex_areas(graph: Graph, x: wp.array[wp.vec3d]) -> NDArray[np.float64]:
    """a_i = 1/4 sum_j mu_ij |x_j - x_i|^2 per node: the Voronoi area where mu are cotangents."""
    area = wp.empty(graph.node_count, dtype=wp.float64, device=graph.device)
    inputs = [graph.offsets, graph.neighbours, graph.incident, graph.mu, x]
    wp.launch(_areas, dim=graph.node_count, inputs=inputs, outputs=[area], device=graph.device)
    return area.numpy()


@wp.kernel(enable_backward=False)
def _energies(
    chunk_offsets: wp.array[wp.int32],
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    x: wp.array[wp.vec3d],
    v: wp.array[wp.vec3d],
    # Out:
    energy_out: wp.array[wp.vec3d],
):
    k, lane = wp.tid()
    energy = wp.vec3d()
    for e in range(chunk_offsets[k] + lane, chunk_offsets[k + 1], wp.block_dim()):
        misfit = x[head[e]] - x[tail[e]] - v[e]
        energy += mu[e] * wp.vec3d(wp.length_sq(misfit), wp.length_sq(v[e]), wp.float64(0.0))
    wp.tile_store(energy_out, wp.tile_sum(wp.tile(energy, preserve_type=True)), offset=k)


def node_energy(graph: Graph, x: wp.array[wp.vec3d], v: wp.array[wp.vec3d]) -> tuple[float, float]:
    """phi(x) = sum mu_ij |x_j - x_i - v_ij|^2 of rows per node, and sum mu_ij |v_ij|^2; summed on the device."""
    edges = graph.edge_segments
    partial = edges.partials()
    launch_chunks(_energies, edges, [graph.tail, graph.head, graph.mu, x, v], [partial])
    phi, size, _ = sum_chunks(edges, partial, edges.zeros()).numpy()[0]
    return float(phi), float(size)


def form_size(graph: Graph, v: wp.array[wp.vec3d]) -> float:
    """Sum mu_ij |v_ij|^2 of a 1-form on the device."""
    return node_energy(graph, wp.zeros(graph.node_count, dtype=wp.vec3d, device=graph.device), v)[1]


def edge_energy(graph: Graph, x: Any, v: Any) -> NDArray[np.float64]:
    """mu_ij |x_j - x_i - v_ij|^2 of every edge, (m,) float64. x: (V, D); v: (m, D)."""
    rows = read_rows(x, graph.vertex_count, "x")
    form = read_rows(v, graph.edge_count, "v")
    difference = node_differential(graph, graph.nodes_from(rows.data)).numpy() - form.data
    return graph.mu.numpy() * np.einsum("ij,ij->i", difference, difference)


def energy(graph: Graph, x: Any, v: Any) -> float:
    """phi(x) = sum over the edges of mu_ij |x_j - x_i - v_ij|^2. x: (V, D); v: (m, D)."""
    rows = read_rows(x, graph.vertex_count, "x")
    form = read_rows(v, graph.edge_count, "v")
    return node_energy(graph, graph.nodes_from(rows.data), to_device(form.data, graph.device))[0]
