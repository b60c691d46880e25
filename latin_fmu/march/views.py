"""Arrays inside kernels from the addresses in a table, so that one call serves any number of substructures.

Whoever fills a table keeps the arrays alive and contiguous; the kernels never write outside the sizes given there.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import carray, kernel, lazy_intrinsic


def _pointer_to(code: str) -> Any:
    """Intrinsic from an address (int64) to a pointer to numbers of a numba type."""

    def typed(_typing: Any, address: Any) -> Any:
        types: Any = import_module("numba.types")

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.inttoptr(values[0], context.get_value_type(signature.return_type))

        return types.CPointer(getattr(types, code))(address), generate

    return lazy_intrinsic(typed)


_float64 = _pointer_to("float64")
_int64, _uint32 = _pointer_to("int64"), _pointer_to("uint32")


@kernel
def floats(address: int, n: int) -> Any:
    """The (n,) float64 array at an address."""
    return carray(_float64(address), (n,))


@kernel
def table_of_floats(address: int, rows: int, columns: int) -> Any:
    """The (rows, columns) float64 array at an address."""
    return carray(_float64(address), (rows, columns))


@kernel
def integers(address: int, n: int) -> Any:
    """The (n,) int64 array at an address."""
    return carray(_int64(address), (n,))


@kernel
def indices(address: int, n: int) -> Any:
    """The (n,) uint32 array at an address (unsigned: no test for negative indices in the inner loops)."""
    return carray(_uint32(address), (n,))


def address(array: NDArray[Any]) -> int:
    """Address of a contiguous array.

    Raises
    ------
    ValueError : the array is not contiguous (its rows would not be where a kernel looks for them).
    """
    if not array.flags.c_contiguous:
        raise ValueError(f"an array of shape {array.shape} is not contiguous; make a contiguous copy first")
    return int(array.__array_interface__["data"][0])


def record(fields: list[str]) -> np.dtype[Any]:
    """Type of a table row of integers (sizes and addresses)."""
    return np.dtype([(name, np.int64) for name in fields])
