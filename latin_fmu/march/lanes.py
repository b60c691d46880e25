"""Products on the vectors of eight members at once, one member per lane of the processor's vectors.

A tile holds eight members side by side, (n, 8) numbers; members that are missing are zeros. The loops are written for
the compiler's back end as operations on vectors of eight numbers: from scalar code, or with the number of members left
open, it makes none. Where the processor's vectors are shorter, the back end takes several.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, kernel, lazy_intrinsic

Array = NDArray[np.float64]

LANES: Final = 8
TILED: Final = 3
"""From so many members on a tile costs less than one member after the other."""

SPARE: Final = 4
"""Vectors that a tile of scratch has beyond those of the dofs."""


class _Module:
    """A module that is imported when something of it is needed: the compiler's are needed to compile only."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self._name), name)


_types, _tools, _ir = _Module("numba.types"), _Module("numba.core.cgutils"), _Module("llvmlite.ir")
_FUSED: Final = ("contract",)


def _vector() -> Any:
    return _ir.VectorType(_ir.DoubleType(), LANES)


def _integer(value: int) -> Any:
    return _ir.Constant(_ir.IntType(64), value)


def _at(builder: Any, address: Any, position: Any, size: int, kind: Any) -> Any:
    """Pointer to item ``position`` of the items of ``size`` bytes from an address on."""
    return builder.inttoptr(builder.add(address, builder.mul(position, _integer(size))), kind.as_pointer())


def _load(builder: Any, address: Any, position: Any) -> Any:
    """Vector ``position`` of a tile."""
    return builder.load(_at(builder, address, position, 8 * LANES, _vector()), align=8)


def _store(builder: Any, value: Any, address: Any, position: Any) -> None:
    builder.store(value, _at(builder, address, position, 8 * LANES, _vector()), align=8)


def _spread(builder: Any, number: Any) -> Any:
    """The vector that has this number in every lane."""
    undefined = _ir.Constant(_vector(), _ir.Undefined)
    first = builder.insert_element(undefined, number, _ir.Constant(_ir.IntType(32), 0))
    return builder.shuffle_vector(
        first, undefined, _ir.Constant(_ir.VectorType(_ir.IntType(32), LANES), [0] * LANES)
    )


def _add_product(builder: Any, total: Any, number: Any, vector: Any) -> Any:
    """total + number x vector."""
    return builder.fadd(total, builder.fmul(_spread(builder, number), vector, flags=_FUSED), flags=_FUSED)


def _sums(rows: int) -> Any:
    """Intrinsic: vectors 0 ... rows - 1 of the tile ``out`` = A x for so many rows of A, (rows, count), one after the
    other in memory ``stride`` numbers apart, x a tile of ``count`` vectors (``out`` may lie in it)."""

    def typed(_context: Any, values: Any, stride: Any, count: Any, x: Any, out: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            values, stride, count, x, out = arguments
            totals = [_tools.alloca_once(builder, _vector()) for _ in range(rows)]
            for total in totals:
                builder.store(_ir.Constant(_vector(), [0.0] * LANES), total)
            with _tools.for_range(builder, count) as loop:
                vector = _load(builder, x, loop.index)
                for r, total in enumerate(totals):
                    item = builder.add(loop.index, builder.mul(stride, _integer(r)))
                    number = builder.load(_at(builder, values, item, 8, _ir.DoubleType()))
                    builder.store(_add_product(builder, builder.load(total), number, vector), total)
            for r, total in enumerate(totals):
                _store(builder, builder.load(total), out, _integer(r))
            return context.get_dummy_value()

        return _types.void(values, stride, count, x, out), generate

    return lazy_intrinsic(typed)


def _additions(rows: int) -> Any:
    """Intrinsic: x -= A^T a for so many rows of A (as in ``_sums``), a the first ``rows`` vectors of a tile, x a tile
    of ``count`` vectors."""

    def typed(_context: Any, values: Any, stride: Any, count: Any, a: Any, x: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            values, stride, count, a, x = arguments
            own = [builder.fneg(_load(builder, a, _integer(r))) for r in range(rows)]
            with _tools.for_range(builder, count) as loop:
                total = _load(builder, x, loop.index)
                for r, vector in enumerate(own):
                    item = builder.add(loop.index, builder.mul(stride, _integer(r)))
                    total = _add_product(
                        builder, total, builder.load(_at(builder, values, item, 8, _ir.DoubleType())), vector
                    )
                _store(builder, total, x, loop.index)
            return context.get_dummy_value()

        return _types.void(values, stride, count, a, x), generate

    return lazy_intrinsic(typed)


def _sparse(_context: Any, values: Any, columns: Any, count: Any, x: Any, out: Any) -> Any:
    """Vector 0 of the tile ``out`` = sum over e of values[e] x the vector columns[e] (uint32) of the tile x."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        values, columns, count, x, out = arguments
        total = _tools.alloca_once(builder, _vector())
        builder.store(_ir.Constant(_vector(), [0.0] * LANES), total)
        with _tools.for_range(builder, count) as loop:
            column = builder.zext(
                builder.load(_at(builder, columns, loop.index, 4, _ir.IntType(32))), _ir.IntType(64)
            )
            number = builder.load(_at(builder, values, loop.index, 8, _ir.DoubleType()))
            vector = _load(builder, x, column)
            builder.store(_add_product(builder, builder.load(total), number, vector), total)
        _store(builder, builder.load(total), out, _integer(0))
        return context.get_dummy_value()

    return _types.void(values, columns, count, x, out), generate


_sparse_sum = lazy_intrinsic(_sparse)
_sum_1, _sum_4 = _sums(1), _sums(4)
_add_1, _add_4 = _additions(1), _additions(4)


@entry("i8 -> i8")
def padded(m: int) -> int:
    """Numbers per row of a vector of m members in tiles, m where it is not kept in tiles."""
    return m if m < TILED else (m + LANES - 1) // LANES * LANES


@kernel
def gather(n: int, m: int, first: int, rows: Any, x: Array, tile: Array) -> None:
    """Members from ``first`` on of x (n m,), its rows in the order ``rows`` (n,), into a tile (n, 8) flat."""
    lanes = min(m - first, LANES)
    for i in range(n):
        at = rows[i] * m + first
        for j in range(lanes):
            tile[i * LANES + j] = x[at + j]
        for j in range(lanes, LANES):
            tile[i * LANES + j] = 0.0


@kernel
def sparse_product(
    n: int, starts: Any, columns: int, values: int, factor: float, m: int, x: Array, out: Array, tile: Array
) -> None:
    """out += factor A x for A (n, n) in compressed rows (columns, values by their addresses); tile (n + 1, 8) flat."""
    base = tile.ctypes.data
    for first in range(0, m, LANES):
        lanes = min(m - first, LANES)
        for i in range(n):
            for j in range(lanes):
                tile[i * LANES + j] = x[i * m + first + j]
        row = tile[n * LANES : (n + 1) * LANES]
        for i in range(n):
            _sparse_sum(
                values + 8 * starts[i],
                columns + 4 * starts[i],
                starts[i + 1] - starts[i],
                base,
                base + 8 * LANES * n,
            )
            for j in range(lanes):
                out[i * m + first + j] += factor * row[j]


@kernel
def dense_product(n: int, matrix: int, m: int, x: Array, out: Array, tile: Array) -> None:
    """out = A x for A (n, n) by its address; tile (n + 4, 8) flat."""
    base = tile.ctypes.data
    rest = base + 8 * LANES * n
    answer = tile[n * LANES : (n + SPARE) * LANES]
    for first in range(0, m, LANES):
        lanes = min(m - first, LANES)
        for i in range(n):
            for j in range(lanes):
                tile[i * LANES + j] = x[i * m + first + j]
        i = 0
        while i < n:
            together = 4 if i + 4 <= n else 1
            if together == 4:
                _sum_4(matrix + 8 * n * i, n, n, base, rest)
            else:
                _sum_1(matrix + 8 * n * i, n, n, base, rest)
            for r in range(together):
                for j in range(lanes):
                    out[(i + r) * m + first + j] = answer[r * LANES + j]
            i += together


@kernel
def forward_tile(
    first: Any, row_start: Any, rows: Any, panel_start: Any, panels: int, x: Array, tail: Array
) -> None:
    """As ``cholesky.sweeps.forward_one`` for a tile x (n, 8) in elimination order, in place; tail (4, 8) flat."""
    base, rest = x.ctypes.data, tail.ctypes.data
    for s in range(len(first) - 1):
        width, below = first[s + 1] - first[s], row_start[s + 1] - row_start[s]
        own, panel = base + 8 * LANES * first[s], panels + 8 * panel_start[s]
        for i in range(width - 1, -1, -1):
            _sum_1(panel + 8 * width * i, width, i + 1, own, own + 8 * LANES * i)
        at, i = panel + 8 * width * width, row_start[s]
        last = i + below
        while i < last:
            together = 4 if i + 4 <= last else 1
            if together == 4:
                _sum_4(at, width, width, own, rest)
            else:
                _sum_1(at, width, width, own, rest)
            for r in range(together):
                line = x[rows[i + r] * LANES : rows[i + r] * LANES + LANES]
                for j in range(LANES):
                    line[j] -= tail[r * LANES + j]
            at += 8 * width * together
            i += together


@kernel
def backward_tile(
    first: Any, row_start: Any, rows: Any, panel_start: Any, panels: int, x: Array, tail: Array
) -> None:
    """As ``cholesky.sweeps.backward_one`` for a tile x (n, 8) in elimination order, in place; tail (4, 8) flat."""
    base, rest = x.ctypes.data, tail.ctypes.data
    for s in range(len(first) - 2, -1, -1):
        width, below = first[s + 1] - first[s], row_start[s + 1] - row_start[s]
        own, panel = base + 8 * LANES * first[s], panels + 8 * panel_start[s]
        at, i = panel + 8 * width * width, row_start[s]
        last = i + below
        while i < last:
            together = 4 if i + 4 <= last else 1
            for r in range(together):
                line = x[rows[i + r] * LANES : rows[i + r] * LANES + LANES]
                for j in range(LANES):
                    tail[r * LANES + j] = line[j]
            if together == 4:
                _add_4(at, width, width, rest, own)
            else:
                _add_1(at, width, width, rest, own)
            at += 8 * width * together
            i += together
        for i in range(width):  # L11^-T in place: row i of L11^-1 brings x_i to the rows above and to itself
            line = x[(first[s] + i) * LANES : (first[s] + i + 1) * LANES]
            for j in range(LANES):
                tail[j] = -line[j]
                line[j] = 0.0
            _add_1(panel + 8 * width * i, width, i + 1, rest, own)
