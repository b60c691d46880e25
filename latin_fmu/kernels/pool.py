"""Blocks of memory that arrays are put into one after the other."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .records import LINE

Array = NDArray[np.float64]


class Block:
    """Places in a block of float64 numbers; equal arrays (the same object) are put in once.

    Parameters
    ----------
    start : position of the first number.

    Attributes
    ----------
    size : position behind the last number used.
    """

    def __init__(self, start: int = 0) -> None:
        self.size = start
        self._known: dict[int, tuple[int, Any]] = {}  # position by identity; the arrays are kept alive
        self._waiting: list[tuple[int, NDArray[Any]]] = []

    def reserve(self, size: int) -> int:
        """Position of ``size`` numbers, on a line of the cache."""
        at = self.size
        self.size = at + -(-size // LINE) * LINE
        return at

    def put(self, array: NDArray[Any], kind: type[np.generic] = np.float64) -> int:
        """Position of an array, in numbers of ``kind`` (float64, int64, uint32, float32)."""
        known = self._known.get(id(array))
        if known is not None:
            return known[0]
        packed = np.ascontiguousarray(array, dtype=kind).reshape(-1)
        at = self.reserve(-(-packed.nbytes // 8))
        self._waiting.append((at, packed))
        position = at * (8 // packed.itemsize)
        self._known[id(array)] = position, array
        return position

    def fill(self, target: Array) -> None:
        """Write what was put in since the last time into the block itself."""
        for at, packed in self._waiting:
            target[at : at + -(-packed.nbytes // 8)].view(packed.dtype)[: packed.size] = packed
        self._waiting.clear()


def grown(data: Array, size: int) -> Array:
    """The block with room for ``size`` numbers: itself where it has it, else a copy that has."""
    if size <= len(data):
        return data
    larger = np.zeros(size)
    larger[: len(data)] = data
    return larger
