"""Supernodal Cholesky factorisation with half solves, interface dofs last."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from ..condensed import CondensedFactor
from .protocol import InterfaceFactor

if TYPE_CHECKING:
    import scipy.sparse as sp
    from numpy.typing import NDArray

    from ..operator_pattern import Analyses

__all__ = ["InterfaceFactor", "interface_factor"]


def interface_factor(
    matrix: sp.csr_array,
    last: NDArray[np.int64],
    rank: NDArray[np.float64] | None = None,
    dtype: Any = np.float64,
    analyses: Analyses | None = None,
) -> InterfaceFactor:
    """Factor of a symmetric positive definite ``matrix`` (n, n), the sorted dofs ``last`` kept for the interface.

    ``rank`` (n,) is the elimination order of the others, ``dtype`` the type the factor is stored in (float64 or
    float32), ``analyses`` those made so far of matrices with this pattern. Where compilation is off
    (``LATIN_FMU_COMPILE=0``) it is SciPy's sparse LU, always in float64.

    Raises
    ------
    SolverError : the matrix is not symmetric positive definite (compiled factor only).
    """
    if os.environ.get("LATIN_FMU_COMPILE", "1") == "0":
        return CondensedFactor(matrix, last, rank)
    from .factor import CholeskyFactor

    return CholeskyFactor(matrix, last, rank, dtype, analyses=analyses)
