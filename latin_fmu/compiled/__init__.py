"""Compiled kernels: how they are declared, and where their machine code comes from."""

from __future__ import annotations

from .declare import COMPILES, PLAIN, carray, compiled, entry, kernel, lazy_intrinsic, native, ordered_kernel, share
from .signature import address, fields

__all__ = [
    "COMPILES",
    "PLAIN",
    "address",
    "carray",
    "compiled",
    "entry",
    "fields",
    "kernel",
    "lazy_intrinsic",
    "native",
    "ordered_kernel",
    "share",
]
