"""Multifrontal numeric factorisation, one dense front per supernode.

A supernode with w columns and r rows below them owns a panel [L11; L21], (w + r, w) row by row, and passes
U = F22 - L21 L21^T, (r, r), to its parent. A lower triangle by rows is an upper one by columns,
as LAPACK takes it.

The routines of BLAS and LAPACK are SciPy's own. Their addresses are arguments of the kernels (an array of integers),
not constants in them, so that the compiled code can be kept on disk from one process to the next.
"""

from __future__ import annotations

import ctypes
from functools import cache
from importlib import import_module
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import Intrinsic, entry, fields, kernel

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEFT = np.uint8(ord("L"))
RIGHT = np.uint8(ord("R"))
UPPER = np.uint8(ord("U"))
PLAIN, TRANSPOSED = np.uint8(ord("N")), np.uint8(ord("T"))
POTRF, TRSM, SYRK, TRTRI, POTRI, TRMM, SYMM, GEMM = range(8)


@cache
def routines() -> Index:
    """Addresses (8,) of the routines of BLAS and LAPACK that ``POTRF`` ... number."""
    first = ("lapack:dpotrf", "blas:dtrsm", "blas:dsyrk", "lapack:dtrtri", "lapack:dpotri")
    names = (*first, "blas:dtrmm", "blas:dsymm", "blas:dgemm")
    pairs = (name.split(":") for name in names)
    return np.array([_address(f"scipy.linalg.cython_{library}", routine) for library, routine in pairs], dtype=np.int64)


def _address(module: str, name: str) -> int:
    """Address of a function that a Cython module offers to others (a capsule in its ``__pyx_capi__``)."""
    capsule = import_module(module).__pyx_capi__[name]
    name_of, pointer_of = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    pointer_of.restype, pointer_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return int(pointer_of(capsule, name_of(capsule)))


def _fortran(_typing: Any, address: Any, arguments: Any) -> Any:
    """Call the routine at ``address``, everything by reference.

    ``arguments`` is a tuple: uint64 = address of an array, int64 = an integer (passed as C int), uint8 = a letter,
    float64 or float32 = a number.
    """

    from llvmlite import ir
    from numba import types
    from numba.core import cgutils

    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        tools: Any = cgutils
        pointers = []
        for kind, value in zip(tuple(arguments), tools.unpack_tuple(builder, values[1]), strict=True):
            if kind == types.uint64:
                pointers.append(builder.inttoptr(value, tools.voidptr_t))
                continue
            stored = builder.trunc(value, ir.IntType(32)) if kind == types.int64 else value  # int of C
            slot = tools.alloca_once(builder, stored.type)
            builder.store(stored, slot)
            pointers.append(builder.bitcast(slot, tools.voidptr_t))
        shape = ir.FunctionType(ir.VoidType(), [tools.voidptr_t] * len(pointers))
        builder.call(builder.inttoptr(values[0], shape.as_pointer()), pointers)

    return types.void(address, arguments), generate


def _fortran_in_python(address: int, arguments: tuple[Any, ...]) -> None:
    """The same by ctypes; an integer too large for a C int is an address."""
    pointers: list[Any] = []
    for value in arguments:
        if isinstance(value, np.uint8):
            pointers.append(ctypes.byref(ctypes.c_ubyte(int(value))))
        elif isinstance(value, np.float32):
            pointers.append(ctypes.byref(ctypes.c_float(float(value))))
        elif isinstance(value, float):
            pointers.append(ctypes.byref(ctypes.c_double(value)))
        elif value < 1 << 31:
            pointers.append(ctypes.byref(ctypes.c_int(value)))
        else:
            pointers.append(ctypes.c_void_p(value))
    ctypes.CFUNCTYPE(None)(int(address))(*pointers)


fortran: Any = Intrinsic(_fortran, _fortran_in_python)


_TILE = 32


@entry("f8[:, ::1]")
def mirror(matrix: Array) -> None:
    """Copy the lower triangle of a square matrix over the upper one."""
    n = len(matrix)
    for first in range(0, n, _TILE):
        for column in range(0, first + 1, _TILE):  # tile by tile: a whole column does not stay in the cache
            for i in range(first, min(first + _TILE, n)):
                for j in range(column, min(column + _TILE, i)):
                    matrix[j, i] = matrix[i, j]


@entry("i8[::1], f8[:, ::1] -> i8")
def invert(routines: Index, matrix: Array) -> int:
    """Inverse of a positive definite matrix from its lower triangle, in its place; 0, or 1 + the row where a pivot
    is not positive."""
    n = len(matrix)
    if n == 0:
        return 0
    info = np.zeros(1, dtype=np.int32)  # a C int of LAPACK
    fortran(routines[POTRF], (UPPER, n, matrix.ctypes.data, n, info.ctypes.data))
    if info[0] != 0:
        return int(info[0])
    fortran(routines[POTRI], (UPPER, n, matrix.ctypes.data, n, info.ctypes.data))
    mirror(matrix)
    return int(info[0])


OUTSIDE_PATTERN = -2


@kernel
def _extend(panel: Array, width: int, below: int, rows: Index, child: Array, update: Array, where: Index) -> None:
    """Add the update (k, k) of a child with these rows to the front of its parent."""
    k = len(rows)
    local = np.empty(k, dtype=np.int64)
    split = 0  # rows of the child that are columns of the parent
    for i in range(k):
        # rows of the child ascend: those that are columns of the parent come first
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
    # upper by columns: L11 stands in the lower triangle by rows
    fortran(routines[POTRF], (UPPER, width, top, width, info.ctypes.data))
    if info[0] != 0:
        return
    if below > 0:
        fortran(routines[TRSM], (LEFT, UPPER, TRANSPOSED, PLAIN, width, below, one, top, width, bottom, width))
        fortran(routines[SYRK], (UPPER, TRANSPOSED, below, width, -one, bottom, width, one, update.ctypes.data, below))
    # last, since TRSM takes L11: substitutions multiply by L11^-1, where they would wait for each division
    fortran(routines[TRTRI], (UPPER, PLAIN, width, top, width, info.ctypes.data))


@kernel
def _interface_part(
    pointers: Index, neighbours: Index, values: Array, order: Index, position: Index, n_interior: int, schur: Array
) -> None:
    """Add the entries between interface dofs to the lower triangle of ``schur``."""
    for j in range(n_interior, len(order)):
        for place in range(pointers[order[j]], pointers[order[j] + 1]):
            i = position[neighbours[place]]
            if n_interior <= i <= j:
                schur[j - n_interior, i - n_interior] += values[place]


@kernel
def _gather(
    pointers: Index,
    neighbours: Index,
    values: Array,
    order: Index,
    position: Index,
    begin: int,
    end: int,
    where: Index,
    panel: Array,
) -> bool:
    """Add the columns ``begin`` to ``end`` of the matrix to their panel; False where an entry has no place in it."""
    width = end - begin
    for j in range(begin, end):
        for place in range(pointers[order[j]], pointers[order[j] + 1]):
            i = position[neighbours[place]]
            # the matrix holds both triangles, and its row stands for its column: each coupling is taken once
            if i >= j:
                # an entry that the analysis did not see, which would be written over another place of the panel
                if where[i] < 0:
                    return False
                panel[where[i] * width + j - begin] += values[place]
    return True


@kernel
def _store(panel: Array, width: int, below: int, stored: Any) -> None:
    """Copy a panel, zeros above the diagonal."""
    # the zeros are read: ``selected_inverse`` multiplies whole blocks L11^-1
    for i in range(width + below):
        for j in range(width):
            stored[i * width + j] = panel[i * width + j] if j <= i else 0.0


@kernel
def _clear_front(begin: int, width: int, indices: Index, panel: Array, update: Array, where: Index) -> None:
    """Zeros in the front of a supernode, the lower triangle of its update alone, and the places of its rows in it."""
    below = len(indices)
    panel[:] = 0.0
    for i in range(below):
        for j in range(i + 1):
            update[i * below + j] = 0.0
    for i in range(width):
        where[begin + i] = i
    for i in range(below):
        where[indices[i]] = width + i


@kernel
def _add_to_schur(indices: Index, n_interior: int, update: Array, schur: Array) -> None:
    """Add the update of a root of the elimination tree to the lower triangle of ``schur``."""
    below = len(indices)
    for i in range(below):
        for j in range(i + 1):
            schur[indices[i] - n_interior, indices[j] - n_interior] += update[i * below + j]


@kernel
def _move_down(below: int, update: Array, base: int, stack: Array) -> None:
    """Copy the lower triangle of an update to the place ``base`` of the stack, where those of its children were."""
    for i in range(below):
        for j in range(i + 1):
            stack[base + i * below + j] = update[i * below + j]


@kernel
def _widest(first: Index, row_start: Index) -> int:
    """Numbers of the largest panel."""
    widest = 0
    for s in range(len(first) - 1):
        widest = max(widest, (first[s + 1] - first[s]) * (first[s + 1] - first[s] + row_start[s + 1] - row_start[s]))
    return int(widest)


class MatrixRows(NamedTuple):
    """A sparse matrix by rows: entries of row i at ``pointers[i]`` to ``pointers[i + 1]``, with their columns."""

    pointers: Index
    neighbours: Index
    values: Array


class Supernodes(NamedTuple):
    """Columns of supernode s from ``first[s]`` to ``first[s + 1]``, its rows below them from ``row_start[s]`` on in
    ``rows``, its panel from ``panel_start[s]`` on in the numbers of the factor."""

    first: Index
    row_start: Index
    rows: Index
    panel_start: Index


SUPERNODES: Final = fields(Supernodes, ", ".join(["i8[::1]"] * 4))
_MATRIX: Final = fields(MatrixRows, "i8[::1], i8[::1], f8[::1]")
_PATTERN: Final = "i8[::1], matrix, i8[::1], i8[::1], nodes, i8[::1], b1[::1]"


@entry(
    f"{_PATTERN}, i8, f8[::1], f8[:, ::1] -> i8",
    f"{_PATTERN}, i8, f4[::1], f8[:, ::1] -> i8",
    matrix=_MATRIX,
    nodes=SUPERNODES,
)
def factorise(
    routines: Index,
    matrix: MatrixRows,
    order: Index,
    position: Index,
    nodes: Supernodes,
    n_children: Index,
    is_root: NDArray[np.bool_],
    stack_size: int,
    panels: Any,
    schur: Array,
) -> int:
    """Fill ``panels`` (flat, float64 or float32) and the lower triangle of ``schur`` (zero on entry).

    ``order, position`` : position -> dof and its inverse. Returns -1, the position of a pivot that is not positive, or
    ``OUTSIDE_PATTERN``.
    """
    pointers = matrix.pointers
    neighbours = matrix.neighbours
    values = matrix.values
    first = nodes.first
    row_start = nodes.row_start
    rows = nodes.rows
    panel_start = nodes.panel_start
    n_super = len(first) - 1
    n_interior = first[n_super]
    _interface_part(pointers, neighbours, values, order, position, n_interior, schur)
    work = np.empty(_widest(first, row_start))
    stack = np.empty(stack_size)
    where = np.full(len(order), -1, dtype=np.int64)
    waiting = np.empty(n_super, dtype=np.int64)  # supernodes whose updates are on the stack
    offset = np.empty(n_super, dtype=np.int64)
    info = np.zeros(1, dtype=np.int32)
    n_waiting, top = 0, 0
    for s in range(n_super):
        begin, end = first[s], first[s + 1]
        indices = rows[row_start[s] : row_start[s + 1]]
        width, below = end - begin, len(indices)
        panel = work[: (width + below) * width]
        # behind the updates of the children, which are still read: moved onto their place below
        update = stack[top : top + below * below]
        _clear_front(begin, width, indices, panel, update, where)
        if not _gather(pointers, neighbours, values, order, position, begin, end, where, panel):
            return OUTSIDE_PATTERN
        base = top
        for _ in range(n_children[s]):
            n_waiting -= 1
            child = waiting[n_waiting]
            # children were stacked in postorder: the last one popped lies lowest
            base = offset[child]
            theirs = rows[row_start[child] : row_start[child + 1]]
            _extend(panel, width, below, theirs, stack[base : base + len(theirs) ** 2], update, where)
        _eliminate(routines, panel, width, below, update, info)
        if info[0] != 0:
            return int(begin + info[0] - 1)
        _store(panel, width, below, panels[panel_start[s] : panel_start[s + 1]])
        if is_root[s]:
            _add_to_schur(indices, n_interior, update, schur)
        elif below > 0:
            if base < top:
                _move_down(below, update, base, stack)
            waiting[n_waiting] = s
            offset[s] = base
            n_waiting += 1
            top = base + below * below
        if is_root[s]:
            top = base
        # its own places alone: to clear all of ``where`` would cost n per supernode
        where[begin:end] = -1
        for i in range(below):
            where[indices[i]] = -1
    return -1
