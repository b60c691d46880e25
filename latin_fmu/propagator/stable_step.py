"""The longest stable step of central differences, from the largest eigenvalues of the lumped system.

Leapfrog with the part R of the damping taken at the old instant is stable while (energy argument, symmetric matrices)

    4 M - 2 dt R - dt^2 K >= 0,    hence for dt^2 w^2 + 2 dt c <= 4,    w^2 = max eig M^-1 K,  c = max eig M^-1 R,

    dt <= (sqrt(c^2 + 4 w^2) - c) / w^2         (2 / w without damping).

Bonded substructures are no stiffer than the stiffest of them (Rayleigh quotient), contact adds nothing.

Eigenvalues cost as much as many steps of a small substructure, and most steps are shorter than they would allow. A
bound on them comes first, for one product with |K| (Gershgorin's theorem for M^-1 K and for M^-1/2 K M^-1/2):

    max eig M^-1 K  <=  max_i sum_j |K_ij| x_j / (m_i x_i),     x = 1 and x = m^-1/2,

which is true for any x > 0. The step it allows is never too long, and 0.69 to 0.91 of the longest one on boxes of
8-node hexahedra (0.77 for cubes with a Poisson's ratio of 0.3); the eigenvalue of the worst element bounds no better.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from ..compiled import entry

Array = NDArray[np.float64]

_DENSE = 60  # dofs up to which all eigenvalues are computed
_PRECISION = 1e-4  # relative, of the eigenvalue
_STEPS, _MOST = 12, 1200  # of the Lanczos process between two looks at the eigenvalue, and in all
_ROUND_OFF = 1e-9

Largest = Callable[[sp.csr_array, Array], float]


class StableStep:
    """Which time steps are stable, s; computed at the first use.

    Parameters
    ----------
    mass : (n,) lumped masses > 0, kg. stiffness : (n, n), N m-1. lagged : (n, n) damping taken at the old instant.
    """

    def __init__(self, mass: Array, stiffness: sp.csr_array, lagged: sp.csr_array | None = None) -> None:
        self._mass = mass
        self._stiffness = stiffness
        self._lagged = lagged

    def allows(self, dt: float) -> bool:
        """Whether a step is stable."""
        return dt <= self.certain or dt <= self.longest * (1 + _ROUND_OFF)  # the cheap bound first

    @cached_property
    def certain(self) -> float:
        """A step that is stable for certain, from the bound."""
        return self._step(eigenvalue_bound)

    @cached_property
    def longest(self) -> float:
        """The longest one (infinite where nothing is stiff)."""
        return self._step(largest_eigenvalue)

    def _step(self, largest: Largest) -> float:
        w2 = largest(self._stiffness, self._mass)
        if self._lagged is None:
            c = 0.0
        else:
            c = max(0.0, largest(self._lagged, self._mass))
        if w2 <= 0.0:
            # damping alone: dt c <= 2
            if c == 0.0:
                return float("inf")
            return 2.0 / c
        return float((np.sqrt(c * c + 4.0 * w2) - c) / w2)


def eigenvalue_bound(matrix: sp.csr_array, mass: Array) -> float:
    """Upper bound of the eigenvalues of M^-1 A, A symmetric (Gershgorin; module docstring)."""
    if not len(mass):
        return 0.0
    size = abs(matrix)
    root = np.sqrt(mass)
    plain = (size @ np.ones(len(mass))) / mass
    scaled = (size @ (1.0 / root)) / root
    return float(min(plain.max(), scaled.max()))  # both are bounds


def largest_eigenvalue(matrix: sp.csr_array, mass: Array) -> float:
    """Upper estimate of the largest eigenvalue of M^-1 A, A symmetric: Ritz value + residual of the Lanczos process
    + 1e-4 of it (the process may stop at an eigenvalue next to the largest), or the bound where it does not
    converge."""
    n = len(mass)
    if n == 0:
        return 0.0
    inverse = 1.0 / np.sqrt(mass)
    if n <= _DENSE:
        return float(la.eigvalsh(inverse[:, None] * matrix.toarray() * inverse)[-1])
    bound = eigenvalue_bound(matrix, mass)
    # a start that is the same in every run and close to no mode
    q = np.cos(1.0 + np.arange(n) * np.sqrt(2.0))
    vectors = np.stack([np.zeros(n), q / np.linalg.norm(q)])
    diagonal, beside = np.zeros(_MOST), np.zeros(_MOST)
    pointers, columns = (matrix.indptr.astype(np.int64, copy=False), matrix.indices.astype(np.int64, copy=False))
    for first in range(0, min(n, _MOST - _STEPS), _STEPS):
        last = first + _STEPS
        _lanczos(pointers, columns, matrix.data, inverse, vectors, diagonal, beside, first, last)
        # residual of the Ritz vector: what leads out of the space times its last component
        value, vector = la.eigh_tridiagonal(
            diagonal[:last], beside[: last - 1], select="i", select_range=(last - 1, last - 1)
        )
        residual = beside[last - 1] * abs(float(vector[-1, 0]))
        if residual <= _PRECISION * abs(float(value[0])):
            return float(min(value[0] + residual + _PRECISION * abs(value[0]), bound))
    return bound


@entry("i8[::1], i8[::1], f8[::1], f8[::1], f8[:, ::1], f8[::1], f8[::1], i8, i8")
def _lanczos(
    pointers: Any,
    columns: Any,
    values: Array,
    inverse: Array,
    vectors: Array,
    diagonal: Array,
    beside: Array,
    first: int,
    last: int,
) -> None:
    """Steps of the Lanczos process on D A D, D = diag(inverse): fills ``diagonal`` and ``beside`` of the tridiagonal
    matrix; ``vectors`` (2, n) are the last two, q_-1 = 0 and q_0 at the start."""
    n = len(inverse)
    scaled, after = np.empty(n), np.empty(n)
    for step in range(first, last):
        if step > 0:
            past = beside[step - 1]
        else:
            past = 0.0
        for i in range(n):
            scaled[i] = inverse[i] * vectors[1, i]
        along = 0.0
        for i in range(n):
            total = 0.0
            for e in range(pointers[i], pointers[i + 1]):
                total += values[e] * scaled[columns[e]]
            after[i] = inverse[i] * total - past * vectors[0, i]
            along += vectors[1, i] * after[i]
        norm = 0.0
        for i in range(n):
            after[i] -= along * vectors[1, i]
            norm += after[i] * after[i]
        norm = np.sqrt(norm)
        diagonal[step], beside[step] = along, norm
        for i in range(n):
            vectors[0, i] = vectors[1, i]
            # an invariant space: all that follows is zero
            vectors[1, i] = after[i] / norm if norm > 0.0 else 0.0
