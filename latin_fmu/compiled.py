"""Compilation of kernels with numba, cached on disk; their NumPy twins where numba is switched off.

``LATIN_FMU_COMPILE=0`` in the environment switches compilation off (debugging, hosts without a compiler cache).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from typing import Any, Final, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])
COMPILES: Final = os.environ.get("LATIN_FMU_COMPILE", "1") != "0"
if COMPILES:
    from numba import carray
else:
    carray = None


def compiled(twin: Function) -> Callable[[Function], Function]:
    """Decorator: ``numba.njit(cache=True)`` of the function, or its NumPy ``twin`` when compilation is off."""

    def choose(function: Function) -> Function:
        if not COMPILES:
            return twin
        from numba import njit

        try:
            return cast(Function, njit(cache=True)(function))
        except RuntimeError:  # no folder to cache in: compile afresh in this process
            return cast(Function, njit(function))

    return choose


def native(n_integer: int, n_float: int) -> Callable[[Callable[..., None]], Callable[[], int]]:
    """Decorator: address of a function of pointers, ``n_integer`` to int32 and then ``n_float`` to float64.

    Compiled (and cached) at the first request; the address is 0 where compilation is off.
    """

    def declare(function: Callable[..., None]) -> Callable[[], int]:
        @cache
        def made() -> Any:
            from numba import cfunc, types

            pointers = [types.CPointer(types.int32)] * n_integer + [types.CPointer(types.float64)] * n_float
            signature = types.void(*pointers)
            try:
                return cfunc(signature, cache=True)(function)
            except RuntimeError:  # no folder to cache in
                return cfunc(signature)(function)

        return lambda: int(made().address) if COMPILES else 0

    return declare
