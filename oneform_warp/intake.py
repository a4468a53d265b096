"""What the caller gave, brought to the device and checked there: positions and faces in any spelling.

A host needs ten times as long to look for a number that is not finite as a GPU takes to build the whole graph.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from oneform_warp.arrays import read_rows, to_device
from oneform_warp.errors import InputError
from oneform_warp.incidence import check_limits
from oneform_warp.polygons import Faces, as_polygons, out_of_range
from oneform_warp.segments import CHUNK, LANES

__all__ = ["Corners", "Positions", "faces_on", "positions_on"]

NONE = np.iinfo(np.int32).max
"""No row is wrong."""


class Positions(NamedTuple):
    """Finite positions on the device, (V,), and their lowest and highest coordinates."""

    x: wp.array[wp.vec3d]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


class Corners(NamedTuple):
    """Face f has the vertices indices[offsets[f]] to indices[offsets[f + 1]], on the device."""

    indices: wp.array[wp.int32]
    offsets: wp.array[wp.int32]


@wp.kernel(enable_backward=False)
def _widened(
    # In:
    x: wp.array[wp.vec3],
    # Out:
    x_out: wp.array[wp.vec3d],
):
    i = wp.tid()
    x_out[i] = wp.vec3d(x[i])


@wp.kernel(enable_backward=False)
def _survey(
    # In:
    x: wp.array[wp.vec3d],
    chunk: int,
    # Out:
    bad_out: wp.array[wp.int32],
    low_out: wp.array2d[wp.float64],
    high_out: wp.array2d[wp.float64],
):
    k, lane = wp.tid()
    low = wp.vec3d(wp.float64(wp.inf))
    high = wp.vec3d(-wp.float64(wp.inf))
    for i in range(k * chunk + lane, wp.min((k + 1) * chunk, x.shape[0]), wp.block_dim()):
        if not wp.isfinite(x[i]):
            wp.atomic_min(bad_out, 0, i)
        low = wp.min(low, x[i])
        high = wp.max(high, x[i])
    for d in range(wp.static(3)):
        wp.tile_store(low_out[d], wp.tile_min(wp.tile(low[d])), offset=k)
        wp.tile_store(high_out[d], wp.tile_max(wp.tile(high[d])), offset=k)


def positions_on(x: Any, device: Any) -> Positions:
    """NumPy or Warp rows of D = 1, 2 or 3 numbers -> Positions; InputError as for `read_rows`."""
    if isinstance(x, wp.array) and x.ndim == 1 and x.dtype in (wp.vec3, wp.vec3d):
        rows = x.to(device)
        if x.dtype is wp.vec3:
            wide = wp.empty(x.shape[0], dtype=wp.vec3d, device=device)
            wp.launch(_widened, dim=x.shape[0], inputs=[rows], outputs=[wide], device=device)
            rows = wide
    elif isinstance(x, np.ndarray) and x.ndim == 2 and x.shape[1] == 3 and x.dtype.kind == "f":
        rows = to_device(np.ascontiguousarray(x, dtype=np.float64), device)
    else:
        rows = to_device(read_rows(x, None, "x").data, device)
    count = rows.shape[0]
    blocks = -(-count // CHUNK)
    bad = wp.full(1, NONE, dtype=wp.int32, device=device)
    low, high = (wp.zeros((3, max(blocks, 1)), dtype=wp.float64, device=device) for _ in range(2))
    wp.launch_tiled(
        _survey, dim=[blocks], inputs=[rows, CHUNK], outputs=[bad, low, high], block_dim=LANES, device=device
    )
    row = int(bad.numpy()[0])
    if row < NONE:
        raise InputError(
            f"row {row} is {rows[row : row + 1].numpy()[0].tolist()}, not finite",
            where="x",
            fix="remove or repair NaN and infinity",
        )
    return Positions(rows, low.numpy().min(axis=1), high.numpy().max(axis=1))


@wp.kernel(enable_backward=False)
def _narrowed(
    # In:
    faces: wp.array2d[Any],
    vertex_count: int,
    # Out:
    bad_out: wp.array[wp.int32],
    index_out: wp.array[wp.int32],
):
    f, c = wp.tid()
    value = wp.int64(faces[f, c])
    corner = f * faces.shape[1] + c
    if value < wp.int64(0) or value >= wp.int64(vertex_count):
        wp.atomic_min(bad_out, 0, corner)
    index_out[corner] = wp.int32(value)


# Known before the first launch, so that kernels can be compiled ahead.
INTEGERS: dict[Any, Any] = {
    np.dtype(np.int32): wp.int32,
    np.dtype(np.int64): wp.int64,
    np.dtype(np.uint32): wp.uint32,
}
for _integer in INTEGERS.values():
    wp.overload(_narrowed, {"faces": wp.array2d(dtype=_integer)})


@wp.kernel(enable_backward=False)
def _multiples(
    # In:
    of: int,
    # Out:
    value_out: wp.array[wp.int32],
):
    k = wp.tid()
    value_out[k] = of * k


def faces_on(faces: Faces, vertex_count: int, device: Any) -> Corners:
    """Faces in any spelling of `as_polygons`, or a Warp array (F, k) or (F,) of vec3i -> Corners.

    Raises InputError as there.
    """
    table: Any = _table(faces, device)
    if table is None:
        made = as_polygons(faces.numpy() if isinstance(faces, wp.array) else faces, vertex_count)
        indices, offsets = (wp.array(a.astype(np.int32), dtype=wp.int32, device=device) for a in made)
        return Corners(indices, offsets)
    count, corners = table.shape
    check_limits(vertex_count, count * corners // 2)  # a closed mesh has two corners an edge
    bad = wp.full(1, NONE, dtype=wp.int32, device=device)
    indices, offsets = (wp.empty(n, dtype=wp.int32, device=device) for n in (count * corners, count + 1))
    wp.launch(_narrowed, dim=(count, corners), inputs=[table, vertex_count], outputs=[bad, indices], device=device)
    wp.launch(_multiples, dim=count + 1, inputs=[corners], outputs=[offsets], device=device)
    corner = int(bad.numpy()[0])
    if corner < NONE:
        face = corner // corners
        raise out_of_range(int(table[face].numpy()[corner % corners]), face, vertex_count)
    return Corners(indices, offsets)


def _table(faces: Any, device: Any) -> Any:
    """(F, k) integers on the device; None for other spellings."""
    if isinstance(faces, wp.array):
        if faces.ndim == 1 and faces.dtype is wp.vec3i:
            return faces.to(device).view(wp.int32)
        return faces.to(device) if faces.ndim == 2 and faces.dtype in INTEGERS.values() else None
    if isinstance(faces, np.ndarray) and faces.ndim == 2 and faces.size and faces.dtype in INTEGERS:
        return wp.array(np.ascontiguousarray(faces), dtype=INTEGERS[faces.dtype], device=device)
    return None
