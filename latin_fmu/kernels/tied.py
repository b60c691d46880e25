"""Preconditioner of Newton steps by products: the assembly with the points of its interfaces tied (``krylov``).

Points that stick have the matrix B A^-1 B^T a + e, with A of the bodies over the gain of the scheme, B the jump of
their velocities, a the areas and e the diagonal of sticking components. By the formula of Sherman, Morrison and
Woodbury

    (B A^-1 B^T a + e)^-1 = 1/e - 1/e B (A + B^T a/e B)^-1 B^T a/e

which is a substitution with the factor of one sparse matrix, that of all bodies tied at their points by dashpots a/e
(``latin.tied_bodies``). It is made once for a time step, whatever the state of the points. A solution for few active
points is that with zeros at the others, restricted to them: of the same order as the inverse of their own matrix, as
in substructuring with Dirichlet problems (Farhat, Mandel and Roux 1994). Unknowns whose softness is above z, such as
those across a fast slip, have a diagonal matrix, which takes them apart.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cholesky.substitution import backward_one, forward_one
from ..compiled import kernel
from .active_points import channels_of
from .matrices import add_matrix

Array = NDArray[np.float64]


@kernel
def invert_diagonal(pools: Any, out: Array) -> None:
    """out = 1 / (r_i . z c_i + s_i) for the unknowns that the tied assembly does not precondition, 0 for the others."""
    run, work = pools.run[0], pools.moving
    unknown_of = pools.moving_int[run.unknown_of : run.unknown_of + run.n_place + 1]
    for p in range(run.n_place):
        group, at = pools.groups[pools.fixed_int[run.point_group + p]], pools.fixed_int[run.point_number + p]
        for i in range(unknown_of[p], unknown_of[p + 1]):
            softness, diagonal = work[run.softness + 3 * i + i - unknown_of[p]], 0.0
            for a in range(group.n_component):
                z = pools.fixed[group.z_sum + 2 * at + min(a, 1)]
                diagonal += z * work[run.rows + 3 * i + a] * work[run.columns + 3 * i + a]
            total = diagonal + softness
            out[i] = 1.0 / total if total > 0.0 else 1.0  # nothing at its own point: no scaling
            if run.tied_super > 0 and softness <= diagonal:
                out[i] = 0.0


@kernel
def precondition(pools: Any, y: Array, inverse: Array, out: Array) -> None:
    """out (n,) = P y, with ``inverse`` of ``invert_diagonal``; ``step_f`` and ``step_w`` are scratch."""
    run, work = pools.run[0], pools.moving
    for i in range(len(y)):
        out[i] = inverse[i] * y[i]
    if run.tied_super == 0:
        return
    n, size = run.n_flat, run.tied_n
    x, v = work[run.step_f : run.step_f + n], work[run.step_w : run.step_w + n]
    nodal = work[run.tied_vector : run.tied_vector + size]
    dashpot, area = pools.fixed[run.tied_dashpot : run.tied_dashpot + n], pools.fixed[run.area : run.area + n]
    unknown_of = pools.moving_int[run.unknown_of : run.unknown_of + run.n_place + 1]
    x[:] = 0.0
    v[:] = 0.0
    nodal[:] = 0.0
    for p in range(run.n_place):
        group = pools.groups[pools.fixed_int[run.point_group + p]]
        first, second = channels_of(pools, p)
        for i in range(unknown_of[p], unknown_of[p + 1]):
            for a in range(group.n_component if inverse[i] == 0.0 else 0):
                x[first + a] += work[run.rows + 3 * i + a] * y[i]
        for a in range(group.n_component):
            x[second + a] = -x[first + a]
    for j in range(n):
        x[j] *= dashpot[j]
    add_transposed(pools, n, run.tied_starts, run.tied_columns, run.tied_values, x, nodal)
    through_factor(pools, nodal)
    add_matrix(pools, n, run.tied_starts, run.tied_columns, run.tied_values, 1, nodal, v)
    for p in range(run.n_place):
        group = pools.groups[pools.fixed_int[run.point_group + p]]
        first, second = channels_of(pools, p)
        for i in range(unknown_of[p], unknown_of[p + 1]):
            for a in range(group.n_component if inverse[i] == 0.0 else 0):
                # 1/e of the jump given, and of that of the tied bodies
                change = x[first + a] - dashpot[first + a] * (v[first + a] - v[second + a])
                out[i] += work[run.rows + 3 * i + a] * change / area[first + a]


@kernel
def add_transposed(
    pools: Any, rows: int, starts_at: int, columns_at: int, values_at: int, x: Array, out: Array
) -> None:
    """out (columns,) += A^T x for a matrix in compressed rows."""
    starts = pools.fixed_int[starts_at : starts_at + rows + 1]
    columns = pools.fixed_col[columns_at : columns_at + starts[rows]]
    values = pools.fixed[values_at : values_at + starts[rows]]
    for i in range(rows):
        for e in range(starts[i], starts[i + 1]):
            out[columns[e]] += values[e] * x[i]


@kernel
def through_factor(pools: Any, x: Array) -> None:
    """Solution with the tied assembly, in place, for dofs in elimination order and those of the interfaces alone."""
    run, numbers = pools.run[0], pools.fixed_int
    first = numbers[run.tied_first : run.tied_first + run.tied_super + 1]
    row_start = numbers[run.tied_row_start : run.tied_row_start + run.tied_super + 1]
    rows = numbers[run.tied_rows_below : run.tied_rows_below + row_start[run.tied_super]]
    panel_start = numbers[run.tied_panel_start : run.tied_panel_start + run.tied_super + 1]
    face_start = numbers[run.tied_face_start : run.tied_face_start + run.tied_super]
    panels = pools.fixed_single[run.tied_panels : run.tied_panels + panel_start[run.tied_super]]
    grouped = run.tied_grouped == 1
    forward_one(grouped, False, first, row_start, rows, panel_start, face_start, panels, x)
    backward_one(grouped, False, first, row_start, rows, panel_start, face_start, panels, x)
