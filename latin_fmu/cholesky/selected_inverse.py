"""Entries of the inverse of a matrix on the pattern of its Cholesky factor, from the roots of the tree downwards.

A supernode with columns J and rows R below them, L_JJ and L_RJ its panel, B = L_RJ L_JJ^-1: with the block Z_RR of the
inverse, which lies in the front of the parent,

    Z_RJ = -Z_RR B,    Z_JJ = L_JJ^-T L_JJ^-1 + B^T Z_RR B

(K. Takahashi, J. Fagan, M.-S. Chen, "Formation of a sparse bus impedance matrix and its application to short circuit
study", *8th PICA Conference*, 1973; here block by block, on the part of the tree that belongs to the face). The cost is
about twice that of the factorisation.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, kernel
from .numeric import GEMM, LEFT, PLAIN, RIGHT, SUPERNODES, SYMM, TRANSPOSED, TRMM, UPPER, Supernodes, fortran, routines
from .symbolic import Symbolic

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def selected_inverse(shape: Symbolic, panels: NDArray[Any], starts: Index, rows: Index) -> Array:
    """Entries of the inverse of a factorised matrix in pairs of positions in elimination order.

    Parameters
    ----------
    shape, panels : pattern and numbers of the factor. starts : (n + 1,) first pair of each position.
    rows : the others, not before it; both on the face, and coupled by the pattern of the matrix.

    Returns
    -------
    (n_pair,) entries; 0 for pairs outside the pattern of the factor.
    """
    width, below = np.diff(shape.first), np.diff(shape.row_start)
    parent = np.full(len(width), -1, dtype=np.int64)
    linked = np.flatnonzero(below > 0)
    # the first row below a supernode lies in its parent
    parent[linked] = np.searchsorted(shape.first, shape.rows[shape.row_start[linked]], side="right") - 1
    active = shape.face_start < width
    children = np.bincount(parent[active & (parent >= 0)], minlength=len(width)).astype(np.int64)
    out = np.zeros(len(rows))
    # only rows from the first column for the face on
    sizes = (width - shape.face_start + below)[active]
    _selected_inverse(
        routines(),
        Supernodes(shape.first, shape.row_start, shape.rows, shape.panel_start),
        shape.face_start,
        parent,
        children,
        _stack_size(width + below, parent, children.copy(), active),
        int((sizes**2).max(initial=0)),
        int(((width + below) * width)[active].max(initial=0)),
        panels,
        starts,
        rows,
        out,
    )
    return out


def _stack_size(sizes: Index, parent: Index, waiting: Index, active: NDArray[np.bool_]) -> int:
    """Largest number of entries of the fronts that are kept for their children; ``waiting`` is used up."""
    entries = largest = 0
    has_children = waiting > 0
    # reverse postorder, as the kernel: the front of the parent is the last one kept
    for s in np.flatnonzero(active)[::-1].tolist():
        above = parent[s]
        if above >= 0:
            waiting[above] -= 1
            entries -= int(sizes[above]) ** 2 if waiting[above] == 0 else 0
        entries += int(sizes[s]) ** 2 if has_children[s] else 0
        largest = max(largest, entries)
    return largest


@kernel
def _inherit(
    front: Array, size: int, begin: int, width: int, above: Index, indices: Index, into: Array, used: int
) -> None:
    """Copy the block of the rows ``indices`` from the front (size, size) of the parent, whose columns are ``width``
    from ``begin`` on and whose rows are ``above``, behind the ``used`` first rows and columns of ``into``."""
    n = used + len(indices)
    local = np.empty(len(indices), dtype=np.int64)
    k = 0
    for i in range(len(indices)):
        if indices[i] < begin + width:
            local[i] = indices[i] - begin
            continue
        # both lists ascend: one pass
        while above[k] < indices[i]:
            k += 1
        local[i] = width + k
    for i in range(len(indices)):
        line = front[local[i] * size : (local[i] + 1) * size]
        to = into[(used + i) * n + used : (used + i + 1) * n]
        for j in range(len(indices)):
            to[j] = line[local[j]]


@kernel
def _extend_front(routines: Index, panel: Array, used: int, below: int, front: Array, work: Array) -> None:
    """Fill the first ``used`` rows and columns of a front whose other block is known; the panel [L11^-1; L21], (used +
    below, used), is overwritten."""
    n = used + below
    one = 1.0
    zero = 0.0
    top = panel.ctypes.data
    block, product = work[: used * used], work[used * used :]
    corner = block.ctypes.data
    # Z_RR = 0 so far: L11^-T L11^-1, the upper factor by columns being L11^-T
    fortran(routines[GEMM], (PLAIN, TRANSPOSED, used, used, used, one, top, used, top, used, zero, corner, used))
    if below > 0:
        b, z = panel[used * used :].ctypes.data, front[used * n + used :].ctypes.data
        p = product.ctypes.data
        # L21 by rows is L21^T by columns: b = L11^-T L21^T = B^T
        fortran(routines[TRMM], (LEFT, UPPER, PLAIN, PLAIN, used, below, one, top, used, b, used))
        # p = B^T Z_RR, whose transpose with the sign turned is Z_RJ
        fortran(routines[SYMM], (RIGHT, UPPER, used, below, one, z, n, b, used, zero, p, used))
        fortran(routines[GEMM], (PLAIN, TRANSPOSED, used, used, below, one, b, used, p, used, one, corner, used))
    for i in range(used):
        for j in range(used):
            front[i * n + j] = block[i * used + j]
    for i in range(below):
        for j in range(used):
            value = -product[i * used + j]
            front[(used + i) * n + j] = value
            front[j * n + used + i] = value


_ENTRY: Final = ", ".join(["i8[::1], nodes"] + ["i8[::1]"] * 3 + ["i8"] * 3)
_PAIRS: Final = "i8[::1], i8[::1], f8[::1]"


@entry(f"{_ENTRY}, f8[::1], {_PAIRS}", f"{_ENTRY}, f4[::1], {_PAIRS}", nodes=SUPERNODES)
def _selected_inverse(
    routines: Index,
    nodes: Supernodes,
    face_start: Index,
    parent: Index,
    children: Index,
    stack_size: int,
    front_size: int,
    panel_size: int,
    panels: Any,
    starts: Index,
    pairs: Index,
    out: Array,
) -> None:
    """Fill ``out``; the fronts of supernodes with ``children`` left stay on a stack of ``stack_size`` numbers, and
    ``front_size`` and ``panel_size`` are the largest sizes of a front and of a panel."""
    first = nodes.first
    row_start = nodes.row_start
    rows = nodes.rows
    panel_start = nodes.panel_start
    stack, front = np.empty(stack_size), np.empty(front_size)
    panel, work = np.empty(panel_size), np.empty(panel_size)
    rest = children.copy()
    top = 0
    # from the roots down: a front takes over entries from that of its parent
    for s in range(len(first) - 2, -1, -1):
        width, c = first[s + 1] - first[s], face_start[s]
        if c >= width:
            continue
        indices, used = rows[row_start[s] : row_start[s + 1]], width - c
        below, begin = len(indices), first[s] + c
        n = used + below
        p = parent[s]
        if p >= 0:
            above = rows[row_start[p] : row_start[p + 1]]
            # the whole width: a supernode with a child on the face is used from its first column on
            size = first[p + 1] - first[p] + len(above)
            parent_front = stack[top - size * size : top]
            _inherit(parent_front, size, first[p], first[p + 1] - first[p], above, indices, front, used)
            rest[p] -= 1
            if rest[p] == 0:
                top -= size * size
        for i in range(n):
            at = panel_start[s] + (c + i) * width + c
            for j in range(used):
                panel[i * used + j] = panels[at + j]
        _extend_front(routines, panel, used, below, front, work)
        for j in range(used):
            for e in range(starts[begin + j], starts[begin + j + 1]):
                i = pairs[e] - begin
                if i >= used:
                    k = np.searchsorted(indices, pairs[e])
                    i = used + k if k < below and indices[k] == pairs[e] else -1  # no row of the front: 0 stays
                if i >= 0:
                    out[e] = front[i * n + j]
        if children[s] > 0:
            stack[top : top + n * n] = front[: n * n]
            top += n * n
