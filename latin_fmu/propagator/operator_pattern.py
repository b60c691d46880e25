"""Where the entries of M, C and K stand in the operator of a march, c_M M + c_C C + c_K K.

Found once per pattern; the operator of a time step is then a sum of numbers, without sparse arithmetic.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cholesky.symbolic import Analyses

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class OperatorPattern:
    """Common pattern of square matrices of one size.

    Parameters
    ----------
    matrices : (n, n) each, rows sorted, no entry twice.

    Attributes
    ----------
    analyses : of operators with this pattern. forms : what else is made of the index arrays of the matrices, by the
        ``id`` of one of them, and that array.
    """

    def __init__(self, matrices: Sequence[sp.csr_array]) -> None:
        self._given = list(matrices)
        self.analyses = Analyses()
        self.forms: dict[int, tuple[Any, Any]] = {}

    @cached_property
    def _found(self) -> tuple[sp.csr_array, list[Index | None]]:
        """Matrix of zeros with the common pattern; where the entries of each matrix are, None where they are all."""
        filled = [with_data(m, np.ones(m.nnz)) for m in self._given]
        numbers: sp.csr_array = sum(filled[1:], filled[0])
        numbers.sort_indices()
        numbers.data = np.arange(1.0, numbers.nnz + 1)
        places = [None if m.nnz == numbers.nnz else _picked(numbers, m) for m in filled]
        return with_data(numbers, np.zeros(numbers.nnz)), places

    def sum(self, factors: Sequence[float], matrices: Sequence[sp.csr_array]) -> sp.csr_array:
        """Sum of factors times matrices, which have the patterns of those given at first, in their order."""
        empty, where = self._found
        data = np.zeros(empty.nnz)
        for factor, matrix, places in zip(factors, matrices, where, strict=True):
            if places is None:
                data += factor * matrix.data
            else:
                data[places] += factor * matrix.data
        return with_data(empty, data)


def _picked(numbers: sp.csr_array, pattern: sp.csr_array) -> Index:
    """Where the entries of a pattern are among those of a larger one, which holds 1, 2, 3, ..."""
    found: Index = numbers.multiply(pattern).tocsr().data.astype(np.int64) - 1
    return found


def with_data(matrix: sp.csr_array, data: Array) -> sp.csr_array:
    """A matrix of the same pattern, which it shares: nothing is checked or sorted again."""
    found = copy.copy(matrix)
    found.data = data
    return found
