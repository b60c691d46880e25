"""Compilation of kernels with numba, cached on disk; plain Python where numba is switched off.

``LATIN_FMU_COMPILE=0`` in the environment switches compilation off (debugging, comparison of twins).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """``numba.njit(cache=True)`` of the function, or the function itself when compilation is off."""
    if os.environ.get("LATIN_FMU_COMPILE", "1") == "0":
        return function
    from numba import njit

    try:
        return cast(Function, njit(cache=True)(function))
    except RuntimeError:  # no folder to cache in: compile afresh in this process
        return cast(Function, njit(function))
