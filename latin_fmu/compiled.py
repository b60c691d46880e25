"""Compilation of kernels with numba, kept on disk; their NumPy twins where numba is switched off.

``LATIN_FMU_COMPILE=0`` in the environment switches compilation off (debugging, hosts without a compiler cache).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final, TypeVar, cast

from .kernel_store import keep, store_of

Function = TypeVar("Function", bound=Callable[..., Any])
COMPILES: Final = os.environ.get("LATIN_FMU_COMPILE", "1") != "0"
carray: Any = getattr(import_module("numba"), "carray", None) if COMPILES else None


def compiled(twin: Function) -> Callable[[Function], Function]:
    """Decorator: ``numba.njit`` of the function, kept on disk, or its NumPy ``twin`` when compilation is off."""

    def choose(function: Function) -> Function:
        return jitted(function) if COMPILES else twin

    return choose


def jitted(function: Function, nogil: bool = False, fastmath: bool | set[str] = False) -> Function:
    """``numba.njit`` of a function: compiled once, then read from disk.

    The code is kept in the folder of ``kernel_store``: where numba keeps it a kernel would not notice that another one
    which it calls has changed, and inside an FMU the path is new at every extraction.

    Kernels are inlined into those that call them: a call that is left may reach one copy of the other kernel in the
    process that compiles and another in those that read from disk, with sums in another order.
    """
    from numba import njit

    store = store_of(Path(__file__).parent)
    if store is not None:
        made = njit(nogil=nogil, fastmath=fastmath, forceinline=True)(function)
        if keep(made, store):
            return cast(Function, made)
    try:
        return cast(Function, njit(cache=True, nogil=nogil, fastmath=fastmath, forceinline=True)(function))
    except RuntimeError:  # no folder to keep it in: compile afresh in this process
        return cast(Function, njit(nogil=nogil, fastmath=fastmath, forceinline=True)(function))


def native(n_integer: int, n_float: int) -> Callable[[Callable[..., None]], Callable[[], int]]:
    """Decorator: address of a function of pointers, ``n_integer`` to int32 and then ``n_float`` to float64.

    Compiled (and cached) at the first request; the address is 0 where compilation is off.
    """

    def declare(function: Callable[..., None]) -> Callable[[], int]:
        @cache
        def made() -> Any:
            from numba.core.ccallback import CFunc

            types: Any = import_module("numba.types")
            pointers = [types.CPointer(types.int32)] * n_integer + [types.CPointer(types.float64)] * n_float
            found = CFunc(function, (tuple(pointers), types.void), locals={}, options={})
            store = store_of(Path(__file__).parent)
            if store is None or not keep(found, store):
                with suppress(RuntimeError):  # no folder to keep it in
                    found.enable_caching()
            found.compile()
            return found

        return lambda: int(made().address) if COMPILES else 0

    return declare


_FAST = {"reassoc", "contract", "nsz"}


PLAIN = os.environ.get("KERNELS_PLAIN") == "1"


def kernel(function: Function) -> Function:
    if PLAIN:
        return function
    from numba import njit
    return cast(Function, njit(nogil=True, fastmath=_FAST, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)(function))


def ordered_kernel(function: Function) -> Function:
    if PLAIN:
        return function
    import numba
    numba.config.SLP_VECTORIZE = 1
    return cast(Function, numba.njit(nogil=True, fastmath={"contract", "nsz"}, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)(function))


def entry(*signatures: str, **types: Any) -> Callable[[Function], Function]:
    def declare(function: Function) -> Function:
        if PLAIN:
            return function
        import numba
        numba.config.SLP_VECTORIZE = 1
        made = numba.njit(nogil=True, fastmath=_FAST, error_model="numpy")(function)
        store = store_of(Path(__file__).parent)
        if store is not None:
            keep(made, store)
        return made
    return declare


def fields(*a: Any, **k: Any) -> None:
    return None
