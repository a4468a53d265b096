"""A Warp kernel of your own with the functions of this package inside.

The formulas are Warp functions, so a foreign kernel can call them and store nothing in between: here the strain of a
pose against its fields, normals turned with the surface, frames as matrices, and one step of gradient descent.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import warp as wp
from scipy.spatial.transform import Rotation

import oneform_warp as ow
from meshes import Floats
from oneform_warp.forms import codifferential_at
from oneform_warp.rotations import exponential_map, rotate, transform_edge
from oneform_warp.solvers.system import residual_at
from pictures import report


@wp.kernel(enable_backward=False)
def measure(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    incident: wp.array[wp.int32],
    mu: wp.array[wp.float64],
    # In:
    rest: wp.array[wp.vec3d],
    x: wp.array[wp.vec3d],
    omega: wp.array[wp.vec3d],
    v: wp.array[wp.vec3d],
    # Out:
    strain_out: wp.array[wp.float64],
    normal_out: wp.array[wp.vec3d],
    frame_out: wp.array[wp.mat33d],
    step_out: wp.array[wp.vec3d],
    divergence_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    one = wp.float64(1.0)
    strain = wp.float64(0.0)
    for h in range(offsets[i], offsets[i + 1]):
        j = neighbours[h]
        strain += wp.length(x[j] - x[i] - transform_edge(omega[i], omega[j], one, one, rest[j] - rest[i]))
    strain_out[i] = strain
    normal_out[i] = rotate(omega[i], wp.normalize(rest[i]))
    frame_out[i] = exponential_map(omega[i])
    step_out[i] = x[i] + wp.float64(0.05) * residual_at(offsets, neighbours, incident, mu, x, v, i)
    divergence_out[i] = codifferential_at(offsets, incident, mu, v, i)


def problem() -> tuple[ow.Graph, Floats, Floats, Floats, Floats]:
    """-> graph, a sphere at rest, another pose of it, rotation vectors of up to several turns, and v of the fields."""
    rest, faces = ow.shapes.sphere(level=2)
    rng = np.random.default_rng(0)
    graph = ow.Graph.from_faces(rest, faces)
    omega = 4.0 * rng.standard_normal(rest.shape)
    x = rest + 0.1 * rng.standard_normal(rest.shape)
    return graph, rest, x, omega, ow.transform(graph, ow.differential(graph, rest), omega, None)


def by_kernel() -> list[Floats]:
    """Strain (V,), normals (V, 3), frames (V, 3, 3), step (V, 3) and divergence (V, 3) from one launch."""
    graph, rest, x, omega, v = problem()
    n = graph.node_count
    fields = [graph.nodes_from(values) for values in (rest, x, omega)]
    outputs = [wp.empty(n, dtype=dtype) for dtype in (wp.float64, wp.vec3d, wp.mat33d, wp.vec3d, wp.vec3d)]
    table = [graph.offsets, graph.neighbours, graph.incident, graph.mu]
    wp.launch(measure, dim=n, inputs=[*table, *fields, wp.array(v, dtype=wp.vec3d)], outputs=outputs)
    return [values.numpy()[graph.node_of] for values in outputs]


def by_numpy() -> list[Floats]:
    """The same with NumPy and scipy's rotations."""
    graph, rest, x, omega, _ = problem()
    i, j = graph.edges.T
    mu = graph.mu.numpy()[:, None]
    v = Rotation.from_rotvec((omega[i] + omega[j]) / 2.0).apply(rest[j] - rest[i])
    miss = x[j] - x[i] - v
    strain, residual, divergence = np.zeros(len(x)), np.zeros_like(x), np.zeros_like(x)
    np.add.at(strain, graph.edges, np.linalg.norm(miss, axis=1)[:, None])
    np.add.at(residual, i, mu * miss)
    np.add.at(residual, j, -mu * miss)
    np.add.at(divergence, i, -mu * v)
    np.add.at(divergence, j, mu * v)
    turn = Rotation.from_rotvec(omega)
    normals = turn.apply(rest / np.linalg.norm(rest, axis=1, keepdims=True))
    return [strain, normals, turn.as_matrix(), x + 0.05 * residual, divergence]


def numbers() -> dict[str, float]:
    names = ("strain", "normals", "frames", "descent step", "divergence")
    pairs = zip(names, by_kernel(), by_numpy(), strict=True)
    return {f"{name}: largest difference from NumPy": float(np.abs(a - b).max()) for name, a, b in pairs}


def main(folder: Path | None = None) -> None:
    """Prints the differences; there is nothing to draw."""
    report(numbers())


if __name__ == "__main__":
    main()
