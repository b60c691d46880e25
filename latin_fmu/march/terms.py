"""Loads and prescribed motions as the kernels read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Terms:
    """Patterns times histories: sum over t of amplitudes[instant, t] x values on rows (row x members + member)."""

    starts: Index
    rows: Index
    values: Array
    amplitudes: Array

    @classmethod
    def of(cls, patterns: Sequence[tuple[Index, Array]], amplitudes: Sequence[Array]) -> Terms:
        """From (rows, values) per term and its history (n_time,); at least one."""
        starts = np.cumsum([0, *(len(rows) for rows, _ in patterns)])
        rows = np.concatenate([r for r, _ in patterns])
        values = np.concatenate([v for _, v in patterns])
        return cls(starts, rows, values, np.stack(amplitudes, axis=1))
