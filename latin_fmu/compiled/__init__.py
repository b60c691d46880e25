"""Compiled kernels: how they are declared, and where their machine code comes from."""

from __future__ import annotations

from .declare import COMPILES, carray, compiled, entry, kernel, lazy_intrinsic, native
from .signature import address, fields

__all__ = [
    "COMPILES",
    "address",
    "carray",
    "compiled",
    "entry",
    "fields",
    "kernel",
    "lazy_intrinsic",
    "native",
]
