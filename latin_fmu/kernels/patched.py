"""Products with dense symmetric matrices in patches (``propagator.patches``).

They are computed in the precision of their scratch. In single precision twice as many numbers fit a register, and those
of the matrix are taken as they are: half of the time of a product in the cache.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import Intrinsic, kernel
from .products import packed_product, two_norms

Array = NDArray[np.float64]


def _memory(_context: Any, block: Any, numbers: Any) -> Any:
    from numba import types

    kind: Any = types.Array(numbers.dtype, 1, "C")

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        from numba.np import arrayobj

        arrays: Any = arrayobj
        whole = arrays.make_array(signature.args[0])(context, builder, values[0])
        view = arrays.make_array(kind)(context, builder)
        size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        width, bytes_of = (context.get_constant(types.intp, n) for n in (8 // size, size))
        count = builder.mul(builder.extract_value(whole.shape, 0), width)
        data = builder.bitcast(whole.data, view.data.type)
        arrays.populate_array(view, data, shape=[count], strides=[bytes_of], itemsize=bytes_of, meminfo=None)
        return view._getvalue()

    return kind(block, numbers), generate


memory_for: Any = Intrinsic(_memory, lambda block, numbers: block.view(numbers.dtype))
"""Memory of an array of float64 as one of numbers of the kind of another array: ``memory_for(block, numbers)``."""


@kernel
def project(size: int, rank: int, basis: Any, x: Array, out: Array) -> None:
    """out (rank,) = U x for U (rank, size)."""
    for k in range(rank):
        line = basis[k * size : (k + 1) * size]
        total = line[0] * x[0]  # of the kind of both
        for j in range(1, size):
            total += line[j] * x[j]
        out[k] = total


@kernel
def patched_product(header: Any, numbers: Any, x: Array, out: Array, scratch: Array) -> None:
    """out (n,) = A x in the precision of scratch (4 n,); ``header`` and ``numbers`` as ``Patches`` has them."""
    count = header[0]
    n = header[1]
    rank = header[2]
    first, ranks = header[3 : 4 + count], header[4 + count : 4 + 2 * count]
    order = header[4 + 2 * count : 4 + 2 * count + n]
    placed, answer = scratch[:n], scratch[n : 2 * n]
    shares, between = scratch[2 * n : 2 * n + rank], scratch[3 * n : 3 * n + rank]
    for i in range(n):
        placed[i] = x[order[i]]
    at, r = 0, 0
    for p in range(count):
        size, values = first[p + 1] - first[p], placed[first[p] : first[p + 1]]
        packed_product(size, numbers[at:], values, answer[first[p] : first[p + 1]])
        at += size * (size + 1) // 2
        project(size, ranks[p], numbers[at:], values, shares[r:])
        at += ranks[p] * size
        r += ranks[p]
    packed_product(rank, numbers[at:], shares, between)
    at, r = 0, 0
    for p in range(count):
        size, into = first[p + 1] - first[p], answer[first[p] : first[p + 1]]
        at += size * (size + 1) // 2
        for k in range(ranks[p]):
            line, share = numbers[at + k * size : at + (k + 1) * size], between[r + k]
            for j in range(size):
                into[j] += share * line[j]
        at += ranks[p] * size
        r += ranks[p]
    for i in range(n):
        out[order[i]] = answer[i]


@kernel
def patched_norms(header: Any, numbers: Any, x: Array, pairs: int, scratch: Array, sums: Array) -> None:
    """x_0 A x_0, x_1 A x_1 and x_1 A x_0 of pairs of rows x_0, x_1 of x (2 pairs, n), into ``sums`` (3 pairs,), in the
    precision of scratch (4 pairs n,). Each patch is taken for all pairs while it is in the cache."""
    count = header[0]
    n = header[1]
    rank = header[2]
    first, ranks = header[3 : 4 + count], header[4 + count : 4 + 2 * count]
    order = header[4 + 2 * count : 4 + 2 * count + n]
    placed, shares = scratch[: 2 * pairs * n], scratch[2 * pairs * n : 2 * pairs * (n + rank)]
    sums[: 3 * pairs] = 0.0
    at, r = 0, 0
    for p in range(count):
        low, size = first[p], first[p + 1] - first[p]
        values, bases = placed[2 * pairs * low : 2 * pairs * (low + size)], at + size * (size + 1) // 2
        for k in range(2 * pairs):
            for i in range(size):
                values[k * size + i] = x[k * n + order[low + i]]
            project(size, ranks[p], numbers[bases:], values[k * size : (k + 1) * size], shares[k * rank + r :])
        for k in range(pairs):
            _add_two_norms(size, numbers[at:], values[2 * k * size :], sums[3 * k :])
        at = bases + ranks[p] * size
        r += ranks[p]
    for k in range(pairs):
        _add_two_norms(rank, numbers[at:], shares[2 * k * rank :], sums[3 * k :])


@kernel
def _add_two_norms(n: int, a: Any, x: Array, sums: Array) -> None:
    """Add ``two_norms`` of a packed matrix to sums (3,)."""
    one, two, both = two_norms(n, a, x)
    sums[0] += one
    sums[1] += two
    sums[2] += both
