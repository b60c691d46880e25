"""Blocks of memory that arrays are put into one after the other."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .records import LINE

Array = NDArray[np.float64]


class Block:
    """Places in a block of float64 numbers; equal arrays (the same object) are put in once until ``fill``.

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
        self._waiting: list[Callable[[Array], None]] = []

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
        self.fill_later(partial(_copy, at, packed))
        position = at * (8 // packed.itemsize)
        self._known[id(array)] = position, array
        return position

    def fill_later(self, write: Callable[[Array], None]) -> None:
        """Let ``fill`` call ``write`` with the block itself, to write to positions that are reserved."""
        self._waiting.append(write)

    def fill(self, target: Array) -> None:
        """Write what was put in since the last time into the block itself; the arrays are no longer kept."""
        for write in self._waiting:
            write(target)
        self._waiting.clear()
        self._known.clear()


def _copy(at: int, packed: NDArray[Any], target: Array) -> None:
    target[at : at + -(-packed.nbytes // 8)].view(packed.dtype)[: packed.size] = packed


def grown(data: Array, size: int) -> Array:
    """The block with room for ``size`` numbers: itself where it has it, else a copy that has, zeros behind it."""
    if size <= len(data):
        return data
    larger = np.zeros(size)
    larger[: len(data)] = data
    return larger
