"""Decorators of compiled functions, and the call of an entry."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from ctypes import byref
from functools import cached_property
from typing import Any, Final, TypeVar, cast

from . import library, with_numba
from .signature import MismatchError, Signature

Function = TypeVar("Function", bound=Callable[..., Any])
_CHOICE: Final = os.environ.get("LATIN_FMU_COMPILE", "1")
COMPILES: Final = _CHOICE != "0"
PLAIN: Final = _CHOICE in ("0", "setup")
"""Whether the kernels of a run (``latin_fmu.kernels``) are plain Python functions, to be followed by a debugger: a
thousand times slower. With ``LATIN_FMU_COMPILE=setup`` those of the set-up stay compiled."""


class Kernel:
    """A function that is compiled as a part of the entries that call it.

    Attributes
    ----------
    py_func : the Python function. shared : whether its machine code is to exist once in the library.
    """

    shared = False

    def __init__(self, function: Callable[..., Any], ordered: bool = False) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self._ordered = function, ordered

    @cached_property
    def dispatcher(self) -> Any:
        """numba's compiled function, made when it is first needed."""
        return with_numba.dispatcher(self.py_func, self._ordered)

    @property
    def _numba_type_(self) -> Any:
        """What numba takes this object for where another kernel calls it."""
        return self.dispatcher._numba_type_

    def __call__(self, *arguments: Any) -> Any:
        """Compiled by numba: of use to tests, and where there is no library."""
        return self.dispatcher(*arguments)


class Entry(Kernel):
    """A kernel that Python calls: in the library that was compiled with the wheel, or by numba.

    Attributes
    ----------
    signatures : what it accepts. symbol : its name in the library, with the number of the signature behind it.
    """

    def __init__(self, function: Callable[..., Any], signatures: tuple[Signature, ...]) -> None:
        super().__init__(function)
        self.signatures = signatures
        self.symbol = f"{_module(function).replace('.', '_')}_{function.__name__}"

    @cached_property
    def _calls(self) -> list[tuple[Callable[..., bytes], Callable[..., int], Any]]:
        known = library.loaded()
        if known is None:
            return []
        return [
            (signature.pack, library.call_of(known, f"{self.symbol}_{number}"), library.RESULTS[signature.result])
            for number, signature in enumerate(self.signatures)
        ]

    def __call__(self, *arguments: Any) -> Any:
        """Call the library; numba where there is none, or where no signature fits."""
        for pack, call, result in self._calls:
            try:
                slots = pack(arguments)
            except MismatchError:
                continue
            out = None if result is None else result()
            if status := call(slots, None if out is None else byref(out)):
                raise MemoryError(f"{self.symbol}: no memory for its work arrays (status {status})")
            return None if out is None else out.value
        return self.dispatcher(*arguments)


class Later:
    """An object of numba that kernels name, made when numba compiles: modules of kernels do not import numba."""

    def __init__(self, make: Callable[[], Any], in_python: Callable[..., Any] | None = None) -> None:
        self._make, self.in_python = make, in_python

    def __call__(self, *arguments: Any) -> Any:
        """The same in Python, for kernels that tests run there."""
        if self.in_python is None:
            raise TypeError("this function exists in compiled kernels only")
        return self.in_python(*arguments)

    @cached_property
    def made(self) -> Any:
        """The object."""
        return self._make()

    @property
    def _numba_type_(self) -> Any:
        from numba.core.registry import cpu_target

        made, context = self.made, cpu_target.typing_context
        context.refresh()  # it may have been made after numba began to compile
        return context.resolve_value_type(made)


def lazy_intrinsic(define: Callable[..., Any], in_python: Callable[..., Any] | None = None) -> Any:
    """Decorator: ``numba.extending.intrinsic`` of a function that imports what it needs of numba itself; ``in_python``
    does the same where a kernel is run uncompiled."""

    def make() -> Any:
        from numba.extending import intrinsic

        return cast(Any, intrinsic)(define)

    return Later(make, in_python)


def kernel(function: Function) -> Function:
    """Decorator: a function called from other kernels."""
    return function if _stays_plain(function) else cast(Function, Kernel(function))


def ordered_kernel(function: Function) -> Function:
    """Decorator: the same with sums taken in the order in which they are written: loops over them are not vectorised,
    several sums side by side are."""
    return function if _stays_plain(function) else cast(Function, Kernel(function, ordered=True))


def share(*kernels: Any) -> None:
    """Mark kernels that several others call: they keep one body of machine code in the library. Inlined, the same sums
    could be taken in another order by each of the callers."""
    for function in kernels:
        if isinstance(function, Kernel):
            function.shared = True


def _stays_plain(function: Callable[..., Any]) -> bool:
    return PLAIN and _module(function).startswith(("kernels.", "cholesky.substitution"))


def entry(*signatures: str, **names: Any) -> Callable[[Function], Function]:
    """Decorator: a kernel that Python calls too; see the package's docstring."""

    def declare(function: Function) -> Function:
        if _stays_plain(function):
            return function
        return cast(Function, Entry(function, tuple(Signature(text, names) for text in signatures)))

    return declare


def _module(function: Callable[..., Any]) -> str:
    """Module of a function below the package, whatever the package is called."""
    return function.__module__.removeprefix(f"{__package__.rsplit('.', 1)[0]}.")
