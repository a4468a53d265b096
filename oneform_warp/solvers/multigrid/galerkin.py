"""The Galerkin product P^T A P in two steps, A P by fine rows and P^T (A P) by coarse rows, pattern apart from values.

Every level is a graph Laplacian in difference form: (A x)_i = sum_h w_h (x_i - x_j) + attachment_i x_i. P keeps
constants, so the coarse attachment is P^T of the fine one, exactly zero where nothing is pinned.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from oneform_warp.solvers.multigrid.compact import Rows, compact, insert
from oneform_warp.solvers.multigrid.prolongation import Prolongation
from oneform_warp.solvers.rows import LaplacianRows
from oneform_warp.sorting import scan

__all__ = ["coarse_pattern", "galerkin_values", "product_pattern"]


@wp.kernel(enable_backward=False)
def _product_bounds(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    # In:
    p_offsets: wp.array[wp.int32],
    # Out:
    bound_out: wp.array[wp.int32],
):
    i = wp.tid()
    bound = p_offsets[i + 1] - p_offsets[i]
    for h in range(offsets[i], offsets[i + 1]):
        j = neighbours[h]
        bound += p_offsets[j + 1] - p_offsets[j]
    bound_out[i] = bound


@wp.kernel(enable_backward=False)
def _product_patterns(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    # In:
    p_offsets: wp.array[wp.int32],
    p_columns: wp.array[wp.int32],
    wide_offsets: wp.array[wp.int32],
    # Out:
    wide_out: wp.array[wp.int32],
    count_out: wp.array[wp.int32],
):
    i = wp.tid()
    begin = wide_offsets[i]
    count = int(0)
    for k in range(p_offsets[i], p_offsets[i + 1]):
        count = insert(wide_out, begin, count, p_columns[k])
    for h in range(offsets[i], offsets[i + 1]):
        j = neighbours[h]
        for k in range(p_offsets[j], p_offsets[j + 1]):
            count = insert(wide_out, begin, count, p_columns[k])
    count_out[i] = count


@wp.kernel(enable_backward=False)
def _coarse_bounds(
    # In:
    column_offsets: wp.array[wp.int32],
    row_of: wp.array[wp.int32],
    ap_offsets: wp.array[wp.int32],
    # Out:
    bound_out: wp.array[wp.int32],
):
    c = wp.tid()
    bound = int(0)
    for k in range(column_offsets[c], column_offsets[c + 1]):
        i = row_of[k]
        bound += ap_offsets[i + 1] - ap_offsets[i]
    bound_out[c] = bound


@wp.kernel(enable_backward=False)
def _coarse_patterns(
    # In:
    column_offsets: wp.array[wp.int32],
    row_of: wp.array[wp.int32],
    ap_offsets: wp.array[wp.int32],
    ap_columns: wp.array[wp.int32],
    wide_offsets: wp.array[wp.int32],
    # Out:
    wide_out: wp.array[wp.int32],
    count_out: wp.array[wp.int32],
):
    c = wp.tid()
    count = int(0)
    for k in range(column_offsets[c], column_offsets[c + 1]):
        i = row_of[k]
        for n in range(ap_offsets[i], ap_offsets[i + 1]):
            if ap_columns[n] != c:
                count = insert(wide_out, wide_offsets[c], count, ap_columns[n])
    count_out[c] = count


def product_pattern(rows: LaplacianRows, p: Prolongation) -> Rows:
    """Where A P has entries. As large as A, so it is made when it is needed and not kept."""
    inputs = [rows.offsets, rows.neighbours, p.rows.offsets]
    count = rows.inverse_diagonal.shape[0]
    return _pattern(count, _product_bounds, _product_patterns, inputs, [p.rows.columns], rows.segments.device)


def coarse_pattern(p: Prolongation, product: Rows) -> Rows:
    """Where P^T A P has entries off the diagonal; serves any weights and any pins."""
    inputs = [p.column_offsets, p.row_of, product.offsets]
    return _pattern(p.coarse_count, _coarse_bounds, _coarse_patterns, inputs, [product.columns], p.values.device)


def _pattern(
    count: int, bounds_kernel: wp.Kernel, kernel: wp.Kernel, inputs: list[Any], more: list[Any], device: Any
) -> Rows:
    """Rows of distinct columns: room for the most that there can be, then what is used of it."""
    bounds, counts = (wp.zeros(count + 1, dtype=wp.int32, device=device) for _ in range(2))
    wp.launch(bounds_kernel, dim=count, inputs=inputs, outputs=[bounds], device=device)
    wide_offsets, room = scan(bounds)
    wide = wp.empty(room, dtype=wp.int32, device=device)
    wp.launch(kernel, dim=count, inputs=[*inputs, *more, wide_offsets], outputs=[wide, counts], device=device)
    return compact(wide_offsets, wide, counts, device)


@wp.kernel(enable_backward=False)
def _product_values(
    # Graph:
    offsets: wp.array[wp.int32],
    neighbours: wp.array[wp.int32],
    weight: wp.array[wp.float32],
    attachment: wp.array[wp.float32],
    inverse_diagonal: wp.array[wp.float32],
    # In:
    p_offsets: wp.array[wp.int32],
    p_columns: wp.array[wp.int32],
    p_values: wp.array[wp.float32],
    ap_offsets: wp.array[wp.int32],
    ap_columns: wp.array[wp.int32],
    # Out:
    value_out: wp.array[wp.float32],
    boundary_out: wp.array[wp.float32],
):
    i = wp.tid()
    boundary = wp.float32(0.0)
    begin = ap_offsets[i]
    for n in range(begin, ap_offsets[i + 1]):
        value_out[n] = 0.0
    # A masked row of P is zero: nodes with no inverse diagonal do not move.
    if inverse_diagonal[i] > 0.0:
        diagonal = wp.float32(0.0)
        if attachment.shape[0] > 0:
            boundary = attachment[i]
            diagonal = boundary
        for h in range(offsets[i], offsets[i + 1]):
            j = neighbours[h]
            diagonal += weight[h]
            if inverse_diagonal[j] > 0.0:
                for k in range(p_offsets[j], p_offsets[j + 1]):
                    n = begin
                    while ap_columns[n] != p_columns[k]:
                        n += 1
                    value_out[n] -= weight[h] * p_values[k]
            else:
                boundary += weight[h]
        for k in range(p_offsets[i], p_offsets[i + 1]):
            n = begin
            while ap_columns[n] != p_columns[k]:
                n += 1
            value_out[n] += diagonal * p_values[k]
    boundary_out[i] = boundary


@wp.kernel(enable_backward=False)
def _coarse_values(
    # In:
    inverse_diagonal: wp.array[wp.float32],
    column_offsets: wp.array[wp.int32],
    row_of: wp.array[wp.int32],
    column_values: wp.array[wp.float32],
    ap_offsets: wp.array[wp.int32],
    ap_columns: wp.array[wp.int32],
    ap_values: wp.array[wp.float32],
    boundary: wp.array[wp.float32],
    coarse_offsets: wp.array[wp.int32],
    coarse_columns: wp.array[wp.int32],
    # Out:
    weight_out: wp.array[wp.float32],
    attachment_out: wp.array[wp.float32],
    inverse_diagonal_out: wp.array[wp.float32],
):
    c = wp.tid()
    begin = coarse_offsets[c]
    for n in range(begin, coarse_offsets[c + 1]):
        weight_out[n] = 0.0
    attached = wp.float32(0.0)
    for k in range(column_offsets[c], column_offsets[c + 1]):
        i = row_of[k]
        if inverse_diagonal[i] > 0.0:
            p = column_values[k]
            attached += p * boundary[i]
            for a in range(ap_offsets[i], ap_offsets[i + 1]):
                if ap_columns[a] != c:
                    n = begin
                    while coarse_columns[n] != ap_columns[a]:
                        n += 1
                    weight_out[n] -= p * ap_values[a]
    diagonal = attached
    reach = wp.float32(0.0)
    for n in range(begin, coarse_offsets[c + 1]):
        diagonal += weight_out[n]
        reach += wp.abs(weight_out[n])
    attachment_out[c] = attached
    # Coarse weights may be negative. Half the absolute row sum keeps the spectrum of D^-1 A in [0, 2], by Gershgorin.
    bound = wp.max(diagonal, 0.5 * (diagonal + reach))
    inverse_diagonal_out[c] = wp.where(diagonal > 0.0, 1.0 / bound, 0.0)


def galerkin_values(rows: LaplacianRows, p: Prolongation, product: Rows, coarse_rows: Rows) -> LaplacianRows:
    """P^T A P as rows of the next level, with the rows of P masked where `rows` do not move."""
    device, fine, coarse = rows.segments.device, rows.inverse_diagonal.shape[0], p.coarse_count
    ap = wp.empty(product.count, dtype=wp.float32, device=device)
    boundary = wp.empty(fine, dtype=wp.float32, device=device)
    p_table = [p.rows.offsets, p.rows.columns, p.values]
    ap_table = [product.offsets, product.columns]
    wp.launch(
        _product_values,
        dim=fine,
        inputs=[*rows.arguments(), *p_table, *ap_table],
        outputs=[ap, boundary],
        device=device,
    )
    weight = wp.empty(coarse_rows.count, dtype=wp.float32, device=device)
    attachment, inverse = (wp.empty(coarse, dtype=wp.float32, device=device) for _ in range(2))
    columns = [rows.inverse_diagonal, p.column_offsets, p.row_of, p.column_values]
    wp.launch(
        _coarse_values,
        dim=coarse,
        inputs=[*columns, *ap_table, ap, boundary, coarse_rows.offsets, coarse_rows.columns],
        outputs=[weight, attachment, inverse],
        device=device,
    )
    return LaplacianRows(
        coarse_rows.offsets, coarse_rows.columns, weight, attachment, inverse, 1.0, rows.segments, rows.precision
    )
