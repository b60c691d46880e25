"""Compilation of kernels with numba, cached on disk; their NumPy twins where numba is switched off.

``LATIN_FMU_COMPILE=0`` in the environment switches compilation off (debugging, hosts without a compiler cache).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])
COMPILES: Final = os.environ.get("LATIN_FMU_COMPILE", "1") != "0"


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
