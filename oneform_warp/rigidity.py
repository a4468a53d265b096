"""How far positions are from rotating each cell rigidly: the ARAP energy of a whole mesh, with its best rotations.

Written in NumPy and apart from the refinement, so that all methods are scored by something that minimises none of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

__all__ = ["half_cotangents", "rigidity", "rims_energy", "spokes_energy"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def rims_energy(x: Floats, y: Floats, triangles: Integers, node: Integers, weight: Floats) -> float:
    """E = 1/3 sum over i, over triangles t around i, over edges e of t, of w_te |y_e - R_i x_e|^2: spokes and rims.

    x, y: (V, 3); node: the node of each vertex (V,); weight: half cotangents (T, 3). A third of what libigl's
    ARAP_ENERGY_TYPE_SPOKES_AND_RIMS minimises, so that an edge counts once; in squared units of x.
    """
    following = np.roll(triangles, -1, axis=1)
    return rigidity(node[triangles], x[following] - x[triangles], y[following] - y[triangles], weight)


def spokes_energy(x: Floats, y: Floats, edges: Integers, node: Integers, mu: Floats) -> float:
    """E = 1/2 sum over i, over edges e at i, of mu_e |y_e - R_i x_e|^2: spokes. edges: (m, 2) vertices; mu: (m,)."""
    tail, head = edges[:, :1], edges[:, 1:]
    return rigidity(node[edges], x[head] - x[tail], y[head] - y[tail], mu[:, None])


def rigidity(corners: Integers, s: Floats, d: Floats, weight: Floats) -> float:
    """min over R of the sum over cells of 1/k sum over its k corners i and its edges e of w_e |d_e - R_i s_e|^2.

    corners: (cells, k) nodes; s, d: (cells, edges, 3) at rest and now; weight: (cells, edges), of any sign.
    """
    if not corners.size:
        return 0.0
    covariance = np.einsum("ce,cei,cej->cij", weight, d, s)
    rotation = _best_rotations(_around(corners) @ covariance.reshape(-1, 9))
    total = 0.0
    for corner in corners.T:
        misfit = d - np.einsum("cij,cej->cei", rotation[corner], s)
        total += float(np.einsum("ce,cei,cei->", weight, misfit, misfit))
    return total / corners.shape[1]


def _around(corners: Integers) -> csr_array:
    """Sums over the cells around each node, (nodes, cells)."""
    count, k = corners.shape
    cells = np.repeat(np.arange(count), k)
    return csr_array((np.ones(count * k), (corners.ravel(), cells)), shape=(int(corners.max()) + 1, count))


def _best_rotations(covariance: Floats) -> Floats:
    """R with the largest tr(R^T B), det R = 1, (n, 3, 3)."""
    u, _, v = np.linalg.svd(covariance.reshape(-1, 3, 3))
    u[:, :, 2] *= np.where(np.linalg.det(u) * np.linalg.det(v) < 0.0, -1.0, 1.0)[:, None]
    return np.asarray(u @ v)


def half_cotangents(x: Floats, triangles: Integers) -> Floats:
    """Half the cotangent that faces the edge from each corner to the next, (T, 3), unclamped; none may be flat."""
    halves = np.zeros(triangles.shape)
    for k in range(3):
        apex = x[triangles[:, (k + 2) % 3]]
        a, b = x[triangles[:, k]] - apex, x[triangles[:, (k + 1) % 3]] - apex
        twice = np.linalg.norm(np.cross(a, b), axis=1)
        halves[:, k] = 0.5 * np.einsum("ij,ij->i", a, b) / twice
    return halves
