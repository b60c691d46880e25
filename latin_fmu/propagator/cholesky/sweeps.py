"""Forward and backward substitution through the panels [L11^-1; L21] of a factor, row by row.

Vectors are in elimination order, the interface last. One member: loops that read each panel once. Several: BLAS.
Four rows at a time are faster from cache, one after the other from memory (the processor fetches ahead).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...compiled import entry
from .kernels import PLAIN, RIGHT, TRANSPOSED, UPPER, fortran

Array = NDArray[np.float64]
Index = NDArray[np.int64]


_PATTERN: Final = "i8[::1], i8[::1], i8[::1], i8[::1]"


@entry(*(f"b1, {_PATTERN}, {real}[::1], i8[::1], f8[::1], f8[::1]" for real in ("f8", "f4")))
def forward_one(
    grouped: bool,
    first: Index,
    row_start: Index,
    rows: Index,
    panel_start: Index,
    panels: Any,
    order: Index,
    b: Array,
    x: Array,
) -> None:
    """x (n,) = [L^-1 b_I ; b_G - L_GI L^-1 b_I] for b (n,) by dofs; ``grouped``: four rows of a panel at a time."""
    for i in range(len(order)):
        x[i] = b[order[i]]
    for s in range(len(first) - 1):
        xs = x[first[s] : first[s + 1]]
        own = rows[row_start[s] : row_start[s + 1]]
        panel = panels[panel_start[s] : panel_start[s + 1]]
        width, below = len(xs), len(own)
        for i in range(width - 1, -1, -1):
            line = panel[i * width : i * width + i + 1]
            total = 0.0
            for j in range(i + 1):
                total += line[j] * xs[j]
            xs[i] = total
        at = width * width
        i = 0
        while grouped and i + 4 <= below:
            l0, l1 = panel[at : at + width], panel[at + width : at + 2 * width]
            l2, l3 = panel[at + 2 * width : at + 3 * width], panel[at + 3 * width : at + 4 * width]
            t0 = t1 = t2 = t3 = 0.0
            for j in range(width):
                value = xs[j]
                t0 += l0[j] * value
                t1 += l1[j] * value
                t2 += l2[j] * value
                t3 += l3[j] * value
            x[own[i]] -= t0
            x[own[i + 1]] -= t1
            x[own[i + 2]] -= t2
            x[own[i + 3]] -= t3
            at += 4 * width
            i += 4
        while i < below:
            line = panel[at : at + width]
            total = 0.0
            for j in range(width):
                total += line[j] * xs[j]
            x[own[i]] -= total
            at += width
            i += 1


@entry(
    *(f"b1, {_PATTERN}, {real}[::1], i8[::1], f8[::1], f8[::1], f8[::1], f8[::1]" for real in ("f8", "f4"))
)
def backward_one(
    grouped: bool,
    first: Index,
    row_start: Index,
    rows: Index,
    panel_start: Index,
    panels: Any,
    order: Index,
    y: Array,
    x_last: Array,
    x: Array,
    out: Array,
) -> None:
    """out (n,) by dofs: L^T x_I = y - L_GI^T x_G, x_G = x_last; x (n,) is scratch."""
    n_super = len(first) - 1
    x[: len(y)] = y
    x[len(y) :] = x_last
    for s in range(n_super - 1, -1, -1):
        xs = x[first[s] : first[s + 1]]
        own = rows[row_start[s] : row_start[s + 1]]
        panel = panels[panel_start[s] : panel_start[s + 1]]
        width, below = len(xs), len(own)
        at = width * width
        i = 0
        while grouped and i + 4 <= below:
            l0, l1 = panel[at : at + width], panel[at + width : at + 2 * width]
            l2, l3 = panel[at + 2 * width : at + 3 * width], panel[at + 3 * width : at + 4 * width]
            a0, a1, a2, a3 = x[own[i]], x[own[i + 1]], x[own[i + 2]], x[own[i + 3]]
            for j in range(width):
                xs[j] -= (l0[j] * a0 + l1[j] * a1) + (l2[j] * a2 + l3[j] * a3)
            at += 4 * width
            i += 4
        while i < below:
            line = panel[at : at + width]
            a0 = x[own[i]]
            for j in range(width):
                xs[j] -= line[j] * a0
            at += width
            i += 1
        for i in range(width):
            line = panel[i * width : i * width + i + 1]
            a0 = xs[i]
            xs[i] = 0.0
            for j in range(i + 1):
                xs[j] += line[j] * a0
    for i in range(len(order)):
        out[order[i]] = x[i]


@entry(
    *(
        f"i8[::1], {real}, {_PATTERN}, {real}[::1], i8[::1], f8[:, ::1], {real}[:, ::1], {real}[:, ::1]"
        for real in ("f8", "f4")
    )
)
def forward_many(
    routines: Index, one: Any, first: Index, row_start: Index, rows: Index, panel_start: Index, panels: Any,
    order: Index, b: Array, x: Any, scratch: Any,
) -> None:  # fmt: skip
    """As ``forward_one`` for b, x (n, m); scratch (most rows of a panel, m), ``one`` the number 1 of that type."""
    n, m = b.shape
    zero = one - one
    for i in range(n):
        for j in range(m):
            x[i, j] = b[order[i], j]
    for s in range(len(first) - 1):
        own = rows[row_start[s] : row_start[s + 1]]
        width, below = first[s + 1] - first[s], len(own)
        xs = x[first[s] :].ctypes.data
        panel = panels[panel_start[s] :].ctypes.data
        bottom = panels[panel_start[s] + width * width :].ctypes.data
        fortran(routines[4], (RIGHT, UPPER, PLAIN, PLAIN, m, width, one, panel, width, xs, m))
        if below > 0:
            fortran(
                routines[5],
                (PLAIN, PLAIN, m, below, width, one, xs, m, bottom, width, zero, scratch.ctypes.data, m),
            )
        for i in range(below):
            for j in range(m):
                x[own[i], j] -= scratch[i, j]


@entry(
    *(
        f"i8[::1], {real}, {_PATTERN}, {real}[::1], i8[::1], {real}[:, ::1], f8[:, ::1], {real}[:, ::1], "
        f"{real}[:, ::1], f8[:, ::1]"
        for real in ("f8", "f4")
    )
)
def backward_many(
    routines: Index, one: Any, first: Index, row_start: Index, rows: Index, panel_start: Index, panels: Any,
    order: Index, y: Any, x_last: Array, x: Any, scratch: Any, out: Array,
) -> None:  # fmt: skip
    """As ``backward_one`` for y (n_interior, m), x_last (n_last, m) and out (n, m)."""
    n_interior, m = y.shape
    for i in range(n_interior):
        for j in range(m):
            x[i, j] = y[i, j]
    for i in range(len(x_last)):
        for j in range(m):
            x[n_interior + i, j] = x_last[i, j]
    for s in range(len(first) - 2, -1, -1):
        own = rows[row_start[s] : row_start[s + 1]]
        width, below = first[s + 1] - first[s], len(own)
        xs = x[first[s] :].ctypes.data
        panel = panels[panel_start[s] :].ctypes.data
        bottom = panels[panel_start[s] + width * width :].ctypes.data
        for i in range(below):
            for j in range(m):
                scratch[i, j] = x[own[i], j]
        if below > 0:
            fortran(
                routines[5],
                (PLAIN, TRANSPOSED, m, width, below, -one, scratch.ctypes.data, m, bottom, width, one, xs, m),
            )
        fortran(routines[4], (RIGHT, UPPER, TRANSPOSED, PLAIN, m, width, one, panel, width, xs, m))
    for i in range(len(order)):
        for j in range(m):
            out[order[i], j] = x[i, j]
