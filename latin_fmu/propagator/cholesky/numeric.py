"""Multifrontal numeric factorisation, one dense front per supernode.

A supernode with w columns and r rows below them owns a panel [L11; L21], (w + r, w) row by row, and passes
U = F22 - L21 L21^T, (r, r), to its parent. Row-major lower triangles are what LAPACK sees as upper ones.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ...compiled import entry, kernel
from .kernels import LEFT, PLAIN, TRANSPOSED, UPPER, fortran

Array = NDArray[np.float64]
Index = NDArray[np.int64]

OUTSIDE_PATTERN = -2


@kernel
def _extend(panel: Array, width: int, below: int, rows: Index, child: Array, update: Array, where: Index) -> None:
    """Add the update (k, k) of a child with these rows to the front of its parent."""
    k = len(rows)
    local = np.empty(k, dtype=np.int64)
    split = 0  # rows of the child that are columns of the parent
    for i in range(k):
        local[i] = where[rows[i]]
        if local[i] < width:
            split = i + 1
    for i in range(k):
        row = child[i * k : i * k + i + 1]
        into = panel[local[i] * width : (local[i] + 1) * width]
        for j in range(min(split, i + 1)):
            into[local[j]] += row[j]
        if local[i] >= width:
            start = (local[i] - width) * below
            rest = update[start : start + below]
            for j in range(split, i + 1):
                rest[local[j] - width] += row[j]


@kernel
def _eliminate(routines: Index, panel: Array, width: int, below: int, update: Array, info: Any) -> None:
    """Panel -> [L11^-1; L21], update -= L21 L21^T; info[0] = 1 + column where a pivot is not positive, or 0."""
    one = 1.0
    top, bottom = panel.ctypes.data, panel[width * width :].ctypes.data
    fortran(routines[0], (UPPER, width, top, width, info.ctypes.data))
    if info[0] != 0:
        return
    if below > 0:
        fortran(routines[1], (LEFT, UPPER, TRANSPOSED, PLAIN, width, below, one, top, width, bottom, width))
        fortran(routines[2], (UPPER, TRANSPOSED, below, width, -one, bottom, width, one, update.ctypes.data, below))
    fortran(routines[3], (UPPER, PLAIN, width, top, width, info.ctypes.data))


_PATTERN: Final = ", ".join(["i8[::1]"] * 3 + ["f8[::1]"] + ["i8[::1]"] * 7 + ["b1[::1]"])


@entry(f"{_PATTERN}, i8, f8[::1], f8[:, ::1] -> i8", f"{_PATTERN}, i8, f4[::1], f8[:, ::1] -> i8")
def factorise(
    routines: Index,
    pointers: Index,
    neighbours: Index,
    values: Array,
    order: Index,
    position: Index,
    first: Index,
    row_start: Index,
    rows: Index,
    panel_start: Index,
    n_children: Index,
    is_root: NDArray[np.bool_],
    stack_size: int,
    panels: Any,
    schur: Array,
) -> int:
    """Fill ``panels`` (flat, float64 or float32) and the lower triangle of ``schur`` (zero on entry).

    ``pointers, neighbours, values`` : the matrix by rows. ``order, position`` : position -> dof and its inverse.
    Returns -1, the position of a pivot that is not positive, or ``OUTSIDE_PATTERN``.
    """
    n_super = len(first) - 1
    n_interior = first[n_super]
    for j in range(n_interior, len(order)):
        for place in range(pointers[order[j]], pointers[order[j] + 1]):
            i = position[neighbours[place]]
            if n_interior <= i <= j:
                schur[j - n_interior, i - n_interior] += values[place]
    widest = 0
    for s in range(n_super):
        widest = max(widest, (first[s + 1] - first[s]) * (first[s + 1] - first[s] + row_start[s + 1] - row_start[s]))
    work = np.empty(widest)
    stack = np.empty(stack_size)
    where = np.full(len(order), -1, dtype=np.int64)
    waiting = np.empty(n_super, dtype=np.int64)  # supernodes whose updates are on the stack
    offset = np.empty(n_super, dtype=np.int64)
    info = np.zeros(1, dtype=np.int32)
    n_waiting, top = 0, 0
    for s in range(n_super):
        begin, end = first[s], first[s + 1]
        own = rows[row_start[s] : row_start[s + 1]]
        width, below = end - begin, len(own)
        panel = work[: (width + below) * width]
        panel[:] = 0.0
        update = stack[top : top + below * below]
        for i in range(below):  # its lower triangle is all that is ever looked at
            for j in range(i + 1):
                update[i * below + j] = 0.0
        for i in range(width):
            where[begin + i] = i
        for i in range(below):
            where[own[i]] = width + i
        for j in range(begin, end):
            for place in range(pointers[order[j]], pointers[order[j] + 1]):
                i = position[neighbours[place]]
                if i >= j:
                    if where[i] < 0:
                        return OUTSIDE_PATTERN
                    panel[where[i] * width + j - begin] += values[place]
        base = top
        for _ in range(n_children[s]):
            n_waiting -= 1
            child = waiting[n_waiting]
            base = offset[child]
            theirs = rows[row_start[child] : row_start[child + 1]]
            _extend(panel, width, below, theirs, stack[base : base + len(theirs) ** 2], update, where)
        _eliminate(routines, panel, width, below, update, info)
        if info[0] != 0:
            return int(begin + info[0] - 1)
        stored = panels[panel_start[s] : panel_start[s + 1]]
        for i in range(width + below):
            for j in range(width):
                stored[i * width + j] = panel[i * width + j] if j <= i else 0.0
        if is_root[s]:
            for i in range(below):
                for j in range(i + 1):
                    schur[own[i] - n_interior, own[j] - n_interior] += update[i * below + j]
        elif below > 0:
            if base < top:
                for i in range(below):
                    for j in range(i + 1):
                        stack[base + i * below + j] = update[i * below + j]
            waiting[n_waiting] = s
            offset[s] = base
            n_waiting += 1
            top = base + below * below
        if is_root[s]:
            top = base
        where[begin:end] = -1
        for i in range(below):
            where[own[i]] = -1
    return -1
