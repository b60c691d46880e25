"""Compilation of the kernels of the factor, and calls of BLAS and LAPACK from inside them.

The routines are SciPy's own. Their addresses are arguments of the kernels (an array of integers), not constants in
them, so that the compiled code can be kept on disk from one process to the next.
"""

from __future__ import annotations

import ctypes
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiled import lazy_intrinsic

LEFT, RIGHT, UPPER = np.uint8(ord("L")), np.uint8(ord("R")), np.uint8(ord("U"))
PLAIN, TRANSPOSED = np.uint8(ord("N")), np.uint8(ord("T"))


@cache
def routines(dtype: np.dtype[Any]) -> NDArray[np.int64]:
    """Addresses (7,) of potrf, trsm, syrk, trtri, trmm, gemm, potri for float64 or float32."""
    letter = "s" if dtype == np.float32 else "d"
    names = ("lapack:potrf", "blas:trsm", "blas:syrk", "lapack:trtri", "blas:trmm", "blas:gemm", "lapack:potri")
    found = []
    for name in names:
        library, routine = name.split(":")
        found.append(_address(f"scipy.linalg.cython_{library}", letter + routine))
    return np.array(found, dtype=np.int64)


def _address(module: str, name: str) -> int:
    """Address of a function that a Cython module offers to others (a capsule in its ``__pyx_capi__``)."""
    capsule = import_module(module).__pyx_capi__[name]
    name_of, pointer_of = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    pointer_of.restype, pointer_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return int(pointer_of(capsule, name_of(capsule)))


def _fortran(_typing: Any, address: Any, arguments: Any) -> Any:
    """Call the routine at ``address``, everything by reference.

    ``arguments`` is a tuple: uint64 = address of an array, int64 = an integer (passed as C int), uint8 = a letter,
    float64 or float32 = a number.
    """

    from llvmlite import ir
    from numba import types
    from numba.core import cgutils

    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        tools: Any = cgutils
        pointers = []
        for kind, value in zip(tuple(arguments), tools.unpack_tuple(builder, values[1]), strict=True):
            if kind == types.uint64:
                pointers.append(builder.inttoptr(value, tools.voidptr_t))
                continue
            stored = builder.trunc(value, ir.IntType(32)) if kind == types.int64 else value
            slot = tools.alloca_once(builder, stored.type)
            builder.store(stored, slot)
            pointers.append(builder.bitcast(slot, tools.voidptr_t))
        shape = ir.FunctionType(ir.VoidType(), [tools.voidptr_t] * len(pointers))
        builder.call(builder.inttoptr(values[0], shape.as_pointer()), pointers)

    return types.void(address, arguments), generate


def _fortran_in_python(address: int, arguments: tuple[Any, ...]) -> None:
    """The same by ctypes; an integer too large for a C int is an address."""
    pointers: list[Any] = []
    for value in arguments:
        if isinstance(value, np.uint8):
            pointers.append(ctypes.byref(ctypes.c_ubyte(int(value))))
        elif isinstance(value, np.float32):
            pointers.append(ctypes.byref(ctypes.c_float(float(value))))
        elif isinstance(value, float):
            pointers.append(ctypes.byref(ctypes.c_double(value)))
        elif value < 1 << 31:
            pointers.append(ctypes.byref(ctypes.c_int(value)))
        else:
            pointers.append(ctypes.c_void_p(value))
    ctypes.CFUNCTYPE(None)(int(address))(*pointers)


fortran: Any = lazy_intrinsic(_fortran, _fortran_in_python)
