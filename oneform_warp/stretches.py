"""Stretches that differ by direction: symmetric positive tensors S, kept and smoothed as log S, six numbers a node.

    v_ij = R(omega_ij) exp((log S_i + log S_j) / 2) dx_ij

The three numbers of the diagonal, xx yy zz, and the three beside it, yz zx xy, are a vector each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.graph import Graph
from oneform_warp.rotations import rotate

__all__ = ["LogStretch", "exponential_times", "log_tensor", "read_stretch", "six_numbers"]

Floats = NDArray[np.float64]

BESIDE = ((1, 2), (2, 0), (0, 1))
"""Rows and columns of the numbers beside the diagonal."""

SYMMETRIC = 1.0e-9
"""By how much of its size a tensor may miss being symmetric: what came of a product of float64 matrices passes."""


@wp.func
def exponential_times(diagonal: wp.vec3d, beside: wp.vec3d, d: wp.vec3d) -> wp.vec3d:
    """exp(A) d of the symmetric A with xx yy zz on its diagonal and yz zx xy beside it; A = 0 returns d bit for bit.

    By the mean stretch and the series of what is left, in as many equal parts as keep each part below 1.
    """
    mean = (diagonal[0] + diagonal[1] + diagonal[2]) / wp.float64(3.0)
    a = wp.mat33d(
        diagonal[0] - mean, beside[2], beside[1],
        beside[2], diagonal[1] - mean, beside[0],
        beside[1], beside[0], diagonal[2] - mean,
    )  # fmt: skip
    parts = int(wp.ceil(wp.sqrt(wp.ddot(a, a))))
    result = wp.exp(mean) * d
    for _p in range(parts):
        term = result
        # 1 / 18! is below float64's rounding.
        for n in range(1, 19):
            term = (a * term) / (wp.float64(n) * wp.float64(parts))
            result += term
    return result


@wp.kernel(enable_backward=False)
def _transform(
    # Graph:
    tail: wp.array[wp.int32],
    head: wp.array[wp.int32],
    # In:
    x: wp.array[wp.vec3d],
    omega: wp.array[wp.vec3d],
    diagonal: wp.array[wp.vec3d],
    beside: wp.array[wp.vec3d],
    # Out:
    v_out: wp.array[wp.vec3d],
):
    e = wp.tid()
    i = tail[e]
    j = head[e]
    half = wp.float64(0.5)
    stretched = exponential_times(half * (diagonal[i] + diagonal[j]), half * (beside[i] + beside[j]), x[j] - x[i])
    v_out[e] = rotate(half * (omega[i] + omega[j]), stretched)


@wp.kernel(enable_backward=False)
def _mean_factor(
    # In:
    diagonal: wp.array[wp.vec3d],
    dimension: int,
    # Out:
    sigma_out: wp.array[wp.float64],
):
    i = wp.tid()
    total = wp.float64(0.0)
    for d in range(dimension):
        total += diagonal[i][d]
    sigma_out[i] = wp.exp(total / wp.float64(dimension))


@dataclass(frozen=True, eq=False)
class LogStretch:
    """Log S at each node, on the graph's device."""

    diagonal: wp.array[wp.vec3d]
    """xx, yy, zz, (n,)."""
    beside: wp.array[wp.vec3d]
    """yz, zx, xy, (n,)."""

    @classmethod
    def of(cls, graph: Graph, stretch: Floats) -> LogStretch:
        """From checked tensors per vertex, (V, 3, 3)."""
        factors, axes = np.linalg.eigh(stretch)
        logarithm = np.einsum("vik,vk,vjk->vij", axes, np.log(factors), axes)
        return cls(*(graph.nodes_from(np.ascontiguousarray(each)) for each in six_numbers(logarithm)))

    def sigma(self, dimension: int) -> wp.array[wp.float64]:
        """The geometric mean of the D factors, det(S)^(1/D), (n,)."""
        count, device = self.diagonal.shape[0], self.diagonal.device
        sigma = wp.empty(count, dtype=wp.float64, device=device)
        wp.launch(_mean_factor, dim=count, inputs=[self.diagonal, dimension], outputs=[sigma], device=device)
        return sigma

    def transformed_differential(
        self, graph: Graph, x: wp.array[wp.vec3d], omega: wp.array[wp.vec3d]
    ) -> wp.array[wp.vec3d]:
        """v_ij = R(omega_ij) exp((log S_i + log S_j) / 2) (x_j - x_i), everything per node, on the device."""
        v = wp.empty(graph.edge_count, dtype=wp.vec3d, device=graph.device)
        inputs = [graph.tail, graph.head, x, omega, self.diagonal, self.beside]
        wp.launch(_transform, dim=graph.edge_count, inputs=inputs, outputs=[v], device=graph.device)
        return v

    def tensors(self, graph: Graph) -> Floats:
        """S per vertex on the host, (V, 3, 3)."""
        diagonal, beside = (graph.vertices_from(each) for each in (self.diagonal, self.beside))
        logarithm = np.zeros((len(diagonal), 3, 3))
        logarithm[:, range(3), range(3)] = diagonal
        for k, (i, j) in enumerate(BESIDE):
            logarithm[:, i, j] = logarithm[:, j, i] = beside[:, k]
        logs, axes = np.linalg.eigh(logarithm)
        return np.asarray(np.einsum("vik,vk,vjk->vij", axes, np.exp(logs), axes))


def six_numbers(tensors: Floats) -> tuple[Floats, Floats]:
    """xx yy zz, and yz zx xy, of symmetric tensors (k, 3, 3): (k, 3) each."""
    return tensors[:, range(3), range(3)], np.stack([tensors[:, i, j] for i, j in BESIDE], axis=1)


def log_tensor(stretch: Any, frame: Floats | None) -> Floats:
    """Log S = F diag(log s) F^T of a factor, or of three along the columns of the frame F; (3, 3), 0 for None."""
    factors = np.log(np.broadcast_to(1.0 if stretch is None else stretch, 3).astype(np.float64))
    if frame is None or (factors == factors[0]).all():
        return np.diag(factors)
    return np.asarray((frame * factors) @ frame.T)


def read_stretch(stretch: Any, vertex_count: int, dimension: int) -> Floats:
    """Checked tensors (V, 3, 3) from (V, D, D); InputError unless they are symmetric and positive."""
    tensors = np.asarray(stretch, dtype=np.float64)
    if tensors.shape != (vertex_count, dimension, dimension):
        shape = f"({vertex_count}, {dimension}, {dimension})"
        raise InputError(f"tensors of shape {tensors.shape}", where="stretch", fix=f"give {shape}, one for each vertex")
    whole = np.broadcast_to(np.eye(3), (vertex_count, 3, 3)).copy()
    whole[:, :dimension, :dimension] = tensors
    size = np.abs(whole).max(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        skew = np.abs(whole - np.swapaxes(whole, 1, 2)).max(axis=(1, 2))
        proper = np.isfinite(size) & (skew <= SYMMETRIC * size)
    proper[proper] = np.linalg.eigvalsh(whole[proper])[:, 0] > 0.0
    if not proper.all():
        vertex = int(np.argmin(proper))
        fix = "give symmetric tensors with factors > 0"
        raise InputError(f"the stretch of vertex {vertex} is no such tensor", where="stretch", fix=fix)
    return whole
