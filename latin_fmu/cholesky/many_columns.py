"""Solutions for many right-hand sides at once, on a face or everywhere, by matrix products.

The substitutions of ``substitution`` with the columns of the right-hand sides side by side: the products with the
blocks L11^-1 and L21 of a panel are those of BLAS, so that a panel is read once for all columns.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, kernel
from .numeric import GEMM, PLAIN, RIGHT, TRANSPOSED, TRMM, UPPER, fortran

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MANY: Final = 24
"""Number of columns from which on products cost less than tiles of eight."""


@kernel
def _block(panels: Any, start: int, width: int, c: int, below: int, panel: Array) -> None:
    """Copy [L11^-1; L21] of a supernode, from its row and column c on, to ``panel``, (width - c + below, width - c)."""
    used = width - c
    for i in range(used + below):
        at, to = start + (c + i) * width + c, i * used
        for j in range(used):
            panel[to + j] = panels[at + j]


_PATTERN: Final = ", ".join(["i8[::1]"] * 6)


@entry(f"{_PATTERN}, f8[::1], i8, f8[::1], f8[::1], f8[::1]", f"{_PATTERN}, f4[::1], i8, f8[::1], f8[::1], f8[::1]")
def solve_on_face(
    routines: Index,
    first: Index,
    row_start: Index,
    rows: Index,
    panel_start: Index,
    face_start: Index,
    panels: Any,
    m: int,
    x: Array,
    panel: Array,
    work: Array,
) -> None:
    """Forward and backward substitution of x (n, m) in elimination order, zero but on the face, for the values on it.

    Dofs behind the last supernode (``last`` of ``CholeskyFactor``) are held: their rows are left with what the forward
    substitution makes of them, which the backward one takes for zero.

    panel, work : scratch, of the size of the largest panel, and of ``m`` times the most rows below one.
    """
    # x by rows is x^T (m, n) by columns, as BLAS takes it: products with blocks come from the right
    one = 1.0
    zero = 0.0
    block = panel.ctypes.data
    gathered, n_interior = work.ctypes.data, first[len(first) - 1]
    for s in range(len(first) - 1):
        width, c = first[s + 1] - first[s], face_start[s]
        if c >= width:
            continue
        indices, used = rows[row_start[s] : row_start[s + 1]], width - c
        below, xs = len(indices), x[m * (first[s] + c) :].ctypes.data
        _block(panels, panel_start[s], width, c, below, panel)
        # (L11^-1 x)^T = x^T L11^-T; a lower triangle by rows is an upper one by columns
        fortran(routines[TRMM], (RIGHT, UPPER, PLAIN, PLAIN, m, used, one, block, used, xs, m))
        if below > 0:
            b = panel[used * used :].ctypes.data
            fortran(routines[GEMM], (PLAIN, PLAIN, m, below, used, one, xs, m, b, used, zero, gathered, m))
        for i in range(below):
            to, part = x[m * indices[i] : m * indices[i] + m], work[m * i : m * i + m]
            for j in range(m):
                to[j] -= part[j]
    for s in range(len(first) - 2, -1, -1):
        width, c = first[s + 1] - first[s], face_start[s]
        if c >= width:
            continue
        indices, used = rows[row_start[s] : row_start[s + 1]], width - c
        below, xs = len(indices), x[m * (first[s] + c) :].ctypes.data
        _block(panels, panel_start[s], width, c, below, panel)
        # a copy, since the rows below one supernode are not side by side in x
        for i in range(below):
            if indices[i] < n_interior:
                work[m * i : m * i + m] = x[m * indices[i] : m * indices[i] + m]
            else:
                work[m * i : m * i + m] = 0.0
        if below > 0:
            b = panel[used * used :].ctypes.data
            # before the product with L11^-T: x := L11^-T (x - L21^T x_below)
            fortran(routines[GEMM], (PLAIN, TRANSPOSED, m, used, below, -one, gathered, m, b, used, one, xs, m))
        fortran(routines[TRMM], (RIGHT, UPPER, TRANSPOSED, PLAIN, m, used, one, block, used, xs, m))
