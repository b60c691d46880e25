"""Compiled kernels: how they are declared, and where their machine code comes from.

A kernel is a Python function of numbers, arrays and named tuples that the build can compile::

    ROW = np.dtype([("start", np.int64), ("area", np.float64)])
    LIMITS = fields(Limits, "f8, i8")                 # a named tuple: one type a field

    @kernel                                           # called from other kernels only
    def add(x, y): ...

    @entry("rows[::1], f8[:, ::1], Limits, i8, b1 -> i8", rows=ROW, Limits=LIMITS)
    def march(rows, states, limits, n, last): ...     # called from Python, and from other kernels

Numbers are ``i8``, ``f8``, ``b1`` (and ``f4``); arrays are C-contiguous, of numbers or of records, and reach the
kernel without a copy. An entry returns one number or nothing, and fills arrays of its caller. With several signatures
the first that fits is taken. A call costs 2 to 7 us. The Python function is ``march.py_func``.

Entries come from the library of the wheel (``library``; built by ``latin_fmu.aot``). Where it does not fit, their call
is an error that says how to make one; ``LATIN_FMU_COMPILE=setup`` in the environment runs kernels as plain Python, for
a debugger. Modules of kernels import neither numba nor SciPy when they are loaded: a run does without the one, the
build without the other. Kernels allocate nothing, raise nothing and touch no Python object: the build fails by name on
a symbol that the library would lack.
"""

from __future__ import annotations

from .declare import PLAIN, Intrinsic, bound, entry, fields, kernel, ordered_kernel, share

__all__ = ["PLAIN", "Intrinsic", "bound", "entry", "fields", "kernel", "ordered_kernel", "share"]
