"""numba's compiled functions of the kernels, in the process of a build alone.

A kernel names others by their objects (``compiled.declare``: ``Kernel``, ``Intrinsic``), of which numba knows nothing;
here it learns what it is to take them for.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final, cast

import numba
from numba import types
from numba.core.registry import cpu_target
from numba.extending import intrinsic, typeof_impl

from ..compiled.declare import Intrinsic, Kernel

# Sums may be taken in another (fixed) order: without that they are not vectorised.
_ORDERED: Final = {"contract", "nsz"}
_FAST: Final = _ORDERED | {"reassoc"}
# Python calls no kernel by numba: wrappers for that are left out
_OPTIONS: Final[Mapping[str, Any]] = MappingProxyType(
    {"nogil": True, "error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
)


class Dispatchers:
    """Compiled functions, each made when it is first needed."""

    def __init__(self) -> None:
        cast(Any, numba.config).SLP_VECTORIZE = 1  # several sums side by side become one vector
        self._of_kernels: dict[Kernel, Any] = {}
        self._intrinsics: dict[Intrinsic, Any] = {}
        # of a kernel that derives from it (``Entry``), too
        typeof_impl.register(Kernel)(lambda kernel, _context: self.of(kernel)._numba_type_)
        typeof_impl.register(Intrinsic)(lambda later, _context: self._type_of(later))

    def of(self, kernel: Kernel) -> Any:
        """The compiled function of a kernel."""
        if kernel not in self._of_kernels:
            fast = _ORDERED if kernel.ordered else _FAST
            self._of_kernels[kernel] = _by_types(numba.njit(**_OPTIONS, fastmath=fast)(kernel.py_func))
        return self._of_kernels[kernel]

    def forget(self, kernel: Kernel) -> None:
        """Compile a kernel anew where it is needed next: another one that it calls has changed."""
        self._of_kernels.pop(kernel, None)

    def _type_of(self, later: Intrinsic) -> Any:
        if later not in self._intrinsics:
            self._intrinsics[later] = intrinsic(later.define)
        context = cpu_target.typing_context
        context.refresh()  # it may have been made after numba began to compile
        return context.resolve_value_type(self._intrinsics[later])


def _by_types(dispatcher: Any) -> Any:
    """The dispatcher, which compiles for the types of its arguments and not once more for every constant among them."""
    original, unliteral = dispatcher.get_call_template, cast(Any, types.unliteral)

    def template(arguments: Any, keywords: Any) -> Any:
        return original(tuple(unliteral(a) for a in arguments), {k: unliteral(a) for k, a in keywords.items()})

    dispatcher.get_call_template = template
    return dispatcher
