"""Friction contact by Siconos (libsiconos_numerics 4): non-smooth Gauss-Seidel on a constant matrix.

0 <= u_N perp p_N >= 0 and Coulomb's law at every point, with u = W p + q; components N, t1, t2 of a point in a row.
The library is found by the dynamic linker; Debian and Ubuntu have it as libsiconos-numerics7.
"""

from __future__ import annotations

import ctypes
from ctypes.util import find_library

import numpy as np
from example_tools import Array

MISSING = "Siconos (libsiconos_numerics) is not installed: Debian and Ubuntu have it as libsiconos-numerics7"
_SPARSE_BLOCK, _GAUSS_SEIDEL = 1, 500  # NM_SPARSE_BLOCK, SICONOS_FRICTION_3D_NSGS
_Doubles, _Unsigned = ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_uint)


class _Options(ctypes.Structure):
    """First fields of SolverOptions."""

    _fields_ = [
        ("solver", ctypes.c_int),
        ("is_set", ctypes.c_bool),
        ("n_int", ctypes.c_int),
        ("ints", ctypes.POINTER(ctypes.c_int)),
        ("n_double", ctypes.c_int),
        ("doubles", _Doubles),
    ]


def library() -> ctypes.CDLL | None:
    """The library with its signatures; None where it is not installed."""
    name = find_library("siconos_numerics")
    if name is None:
        return None
    found = ctypes.CDLL(name)
    pointer, number, count = ctypes.c_void_p, ctypes.c_int, ctypes.c_uint
    signatures = {
        "SBCM_new_3x3": (pointer, [count, count, count, _Unsigned, _Unsigned, _Doubles]),
        "SBCM_to_SBM": (pointer, [pointer]),
        "NM_create_from_data": (pointer, [number, number, number, pointer]),
        "frictionContactProblem_new_with_data": (pointer, [number, number, pointer, _Doubles, _Doubles]),
        "solver_options_create": (ctypes.POINTER(_Options), [number]),
        "fc3d_driver": (number, [pointer, _Doubles, _Doubles, ctypes.POINTER(_Options)]),
    }
    for function, (result, arguments) in signatures.items():
        getattr(found, function).restype = result
        getattr(found, function).argtypes = arguments
    return found


class Contacts:
    """Contact points: W (3 n, 3 n), velocity per impulse, kg-1, and friction coefficients mu (n,)."""

    def __init__(self, found: ctypes.CDLL, w: Array, mu: Array, tolerance: float) -> None:
        self._library, n = found, len(mu)
        blocks = w.reshape(n, 3, n, 3).transpose(0, 2, 3, 1)  # column by column
        row, column = np.nonzero(np.abs(blocks).max(axis=(2, 3)))
        # kept: the library points into these arrays; its rows and columns count from 1
        self._row, self._column = (row + 1).astype(np.uint32), (column + 1).astype(np.uint32)
        self._blocks = np.ascontiguousarray(blocks[row, column])
        self.q, self.mu = np.zeros(3 * n), np.ascontiguousarray(mu, dtype=float)
        self.impulse, self._velocity = np.zeros((2, 3 * n))
        listed = found.SBCM_new_3x3(
            n,
            n,
            len(row),
            self._row.ctypes.data_as(_Unsigned),
            self._column.ctypes.data_as(_Unsigned),
            _doubles(self._blocks),
        )
        matrix = found.NM_create_from_data(_SPARSE_BLOCK, 3 * n, 3 * n, found.SBCM_to_SBM(listed))
        self._problem = found.frictionContactProblem_new_with_data(3, n, matrix, _doubles(self.q), _doubles(self.mu))
        self._options = found.solver_options_create(_GAUSS_SEIDEL)
        self._options.contents.doubles[0] = tolerance
        self._options.contents.ints[0] = 10_000

    def solve(self) -> int:
        """``impulse`` (3 n,) for the present ``q``, from the last one; iterations."""
        self._library.fc3d_driver(self._problem, _doubles(self.impulse), _doubles(self._velocity), self._options)
        return int(self._options.contents.ints[1])


def _doubles(values: Array) -> ctypes._Pointer[ctypes.c_double]:
    return values.ctypes.data_as(_Doubles)
