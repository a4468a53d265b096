"""cuDSS through nvmath-python, an optional extra: the direct solver on the GPU."""

from __future__ import annotations

import logging
import sys
import weakref
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.errors import InputError
from oneform_warp.graph import Graph
from oneform_warp.solvers.direct.factored import Direct, nothing_to_do
from oneform_warp.solvers.direct.free_matrix import FreeMatrix
from oneform_warp.solvers.direct.packages import require
from oneform_warp.solvers.precision import FLOAT64
from oneform_warp.solvers.refinement import Correction, State, Watch
from oneform_warp.solvers.system import System

__all__ = ["CuDSS"]

LOG = logging.getLogger(__name__)
# nvmath-python warns of what the host part of planning would like; only who asks for this logger hears it.
LOG.addHandler(logging.NullHandler())
LOG.propagate = False


@wp.kernel(enable_backward=False)
def gather_columns(
    # In:
    nodes: wp.array[wp.int32],
    r: wp.array[wp.vec3d],
    # Out:
    b_out: wp.array2d[wp.float64],
):
    k = wp.tid()
    for d in range(3):
        b_out[d, k] = r[nodes[k]][d]


@wp.kernel(enable_backward=False)
def scatter_columns(
    # In:
    nodes: wp.array[wp.int32],
    x: wp.array2d[wp.float64],
    # Out:
    e_out: wp.array[wp.vec3d],
):
    k = wp.tid()
    e_out[nodes[k]] = wp.vec3d(x[0, k], x[1, k], x[2, k])


class _Factors:
    """The factors of one matrix on its device, and the three columns that go through them, allocated once."""

    floor = FLOAT64.floor

    def __init__(self, system: System, matrix: FreeMatrix) -> None:
        self.goals, self.device = system.goals, system.graph.device
        self.scale, self.size = matrix.scale, matrix.size
        self.e = wp.zeros(system.graph.node_count, dtype=wp.vec3d, device=self.device)
        self.nodes = wp.array(matrix.nodes.astype(np.int32), dtype=wp.int32, device=self.device)
        # (3, k): cuDSS takes columns one after the other, which the transpose of this is.
        self.b = wp.zeros((3, matrix.size), dtype=wp.float64, device=self.device)
        if matrix.size:
            with wp.ScopedDevice(self.device):
                self.solver = _planned(matrix, self.b, self.stream)
                self.solver.factorize(stream=self.stream)
            weakref.finalize(self, self.solver.free)

    @property
    def stream(self) -> int:
        """Warp's stream, on which everything is queued: nobody has to wait for anybody."""
        return int(self.device.stream.cuda_stream or 0)

    def correct(self, r: wp.array[wp.vec3d], budget: int, watch: Watch | None) -> Correction:
        """See `refinement.Inner`; the whole correction is one iteration."""
        if not self.size or nothing_to_do(self.goals, watch):
            self.e.zero_()
            return Correction(self.e, self.scale, self.goals.one, lambda: 0)
        launch = {"dim": self.size, "device": self.device}
        with wp.ScopedDevice(self.device):
            wp.launch(gather_columns, inputs=[self.nodes, r], outputs=[self.b], **launch)
            # A new CuPy array (k, 3), its columns one after the other.
            x = self.solver.solve(stream=self.stream)
            wp.launch(scatter_columns, inputs=[self.nodes, wp.from_dlpack(x.T)], outputs=[self.e], **launch)
        return Correction(self.e, self.scale, self.goals.one, lambda: 1)


@dataclass(frozen=True)
class CuDSS(Direct):
    """Sparse Cholesky factors by NVIDIA cuDSS in float64, on a CUDA device: |codiff(v - dx)| <= tol |codiff v|.

    `prepare` plans on the host and factorises on the device; a solve copies nothing through the host. tol: as for CG.
    cuDSS adds in no fixed order: runs agree to rounding, not bit for bit.
    Raises InputError where nvmath-python or CuPy is not installed: pip install 'oneform-warp[cudss]'.
    """

    def __post_init__(self) -> None:
        require("CuDSS", ("nvmath", "cupy"), "cudss")
        super().__post_init__()

    def prepare(self, graph: Graph, pinned: NDArray[np.bool_], attachment: NDArray[np.float64] | None = None) -> State:
        """The factors for these pinned (n,) and attached (n,) nodes; they serve any v and start."""
        if not graph.device.is_cuda:
            raise InputError(
                f"CuDSS cannot solve on {graph.device}",
                where="solver",
                fix="make the graph with device='cuda', or use SuperLU()",
            )
        system = System.of(graph, pinned, attachment)
        return State(system, _Factors(system, FreeMatrix.of(system)))


def _planned(matrix: FreeMatrix, b: wp.array2d[wp.float64], stream: int) -> Any:
    """A planned `nvmath.sparse.advanced.DirectSolver` for the right-hand sides in b, (3, k), read at each solve."""
    import cupy
    from cupyx.scipy.sparse import csr_matrix
    from nvmath.sparse.advanced import (
        DirectSolver,
        DirectSolverMatrixType,
        DirectSolverMatrixViewType,
        DirectSolverOptions,
    )

    # Uploaded by Warp and so on its stream; CuPy sees the same memory and keeps it alive.
    arrays = [
        cupy.asarray(wp.array(values, dtype=dtype, device=b.device))
        for values, dtype in (
            (matrix.upper.data, wp.float64),
            (matrix.upper.indices, wp.int32),
            (matrix.upper.indptr, wp.int32),
        )
    ]
    options = DirectSolverOptions(
        sparse_system_type=DirectSolverMatrixType.SPD,
        sparse_system_view=DirectSolverMatrixViewType.UPPER,
        multithreading_lib=_threading_library(),
        logger=LOG,
    )
    rows = csr_matrix(tuple(arrays), shape=(matrix.size, matrix.size))
    solver = DirectSolver(rows, cupy.asarray(b).T, options=options, stream=stream)
    solver.plan(stream=stream)
    return solver


def _threading_library() -> str | None:
    """The library by which cuDSS plans on several host threads, where its wheel brought one."""
    for folder in sys.path:
        for path in sorted(Path(folder or ".").glob("nvidia/*/lib/libcudss_mtlayer_gomp.so*")):
            return str(path)
    return None
