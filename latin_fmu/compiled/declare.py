"""Decorators of compiled functions, and the call of an entry.

Arguments reach the library in a flat list of slots of 8 bytes: an array is its address followed by its shape, a number
is itself, a named tuple is its fields one after the other. Nothing is copied but the slots.
"""

from __future__ import annotations

import ctypes
import functools
import os
import re
import struct
from collections.abc import Callable, Mapping, Sequence
from ctypes import addressof, byref, c_char
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from . import library

_SCALARS: Final = {"i8": "q", "f8": "d", "b1": "q", "f4": "d"}
_RESULTS: Final = {None: None, "i8": ctypes.c_int64, "b1": ctypes.c_bool, "f8": ctypes.c_double}
_ITEMS: Final = ("i8", "f8", "b1", "f4", "i4", "u4", "u8", "u1")
_ARGUMENT: Final = re.compile(r"\s*(\w+)\s*(?:\[((?:\s*:\s*,)*\s*::1\s*)\])?\s*(?:,|$)")


class MismatchError(TypeError):
    """Arguments that a signature does not describe."""


@dataclass(frozen=True)
class Scalar:
    """A number: ``i8``, ``f8``, ``b1``, or ``f4``."""

    code: str


@dataclass(frozen=True)
class Block:
    """A C-contiguous array of numbers or records."""

    dtype: np.dtype[Any]
    ndim: int


@dataclass(frozen=True)
class Bundle:
    """A named tuple of arrays, numbers and named tuples."""

    cls: type
    fields: tuple[Argument, ...]


Argument = Scalar | Block | Bundle


def fields(cls: type, text: str, **names: Any) -> Bundle:
    """Types of the fields of a named tuple, in the form of a signature without a result."""
    types = arguments_of(text, names)
    if len(types) != len(cls._fields):  # type: ignore[attr-defined]
        raise ValueError(
            f"{cls.__name__} has {len(cls._fields)} fields; the signature has {len(types)}"  # type: ignore[attr-defined]
        )
    return Bundle(cls, types)


def arguments_of(text: str, names: Mapping[str, Any]) -> tuple[Argument, ...]:
    """Arguments from their text; ``names`` maps words to record types and to what ``fields`` gives."""
    arguments: list[Argument] = []
    at, text = 0, text.strip()
    while at < len(text):
        match = _ARGUMENT.match(text, at)
        if match is None or match.end() == at:
            raise ValueError(f"signature {text!r}: cannot be read from {text[at:]!r} on")
        arguments.append(_argument(match[1], match[2], names, text))
        at = match.end()
    return tuple(arguments)


def _argument(word: str, dimensions: str | None, names: Mapping[str, Any], text: str) -> Argument:
    kind = names.get(word)
    if dimensions is not None and isinstance(kind, np.dtype):
        return Block(kind, dimensions.count(",") + 1)
    if dimensions is not None and kind is None and word in _ITEMS:
        return Block(np.dtype(word), dimensions.count(",") + 1)
    if dimensions is None and isinstance(kind, Bundle):
        return kind
    if dimensions is None and kind is None and word in _SCALARS:
        return Scalar(word)
    raise ValueError(
        f"signature {text!r}: {word!r} is unknown; allowed: numbers {', '.join(_SCALARS)}, arrays such as f8[:, ::1] "
        f"of "
        f"{', '.join(_ITEMS)}, and names given as keywords (arrays of records, named tuples)"
    )


class Signature:
    """Arguments and result of an entry.

    Parameters
    ----------
    text : ``"f8[::1], rows[::1], i8 -> i8"``; without an arrow the entry returns nothing.
    names : words of the text that stand for types of records and for named tuples (``fields``).
    """

    def __init__(self, text: str, names: Mapping[str, Any]) -> None:
        before, _, after = text.partition("->")
        self.arguments = arguments_of(before, names)
        self.result = after.strip() or None
        if self.result not in (None, "i8", "f8", "b1"):
            raise ValueError(f"signature {text!r}: result {self.result!r}; allowed: i8, f8, b1, nothing")
        # no padding: every slot has 8 bytes
        self.packed = struct.Struct("=" + "".join(_format(a) for a in self.arguments)).pack

    def pack(self, values: Sequence[Any]) -> bytes:
        """The slots of a call.

        Raises
        ------
        MismatchError : other types, dimensions or strides than those declared.
        """
        slots: list[Any] = []
        _fill(slots, self.arguments, values)
        try:
            return self.packed(*slots)
        except struct.error as error:
            raise MismatchError(str(error)) from error


def _format(argument: Argument) -> str:
    if isinstance(argument, Scalar):
        return _SCALARS[argument.code]
    if isinstance(argument, Block):
        return "q" * (1 + argument.ndim)
    return "".join(_format(a) for a in argument.fields)


def _fill(slots: list[Any], arguments: Sequence[Argument], values: Sequence[Any]) -> None:
    if len(arguments) != len(values):
        raise MismatchError(f"{len(values)} arguments; declared: {len(arguments)}")
    for number, (argument, value) in enumerate(zip(arguments, values, strict=True)):
        if type(argument) is Block:
            if type(value) is not np.ndarray or value.dtype != argument.dtype or value.ndim != argument.ndim:
                raise MismatchError(
                    f"argument {number + 1}: {_kind_of(value)}; declared: {argument.dtype}, {argument.ndim}-D"
                )
            slots.append(address(value))
            slots.extend(value.shape)
        elif type(argument) is Scalar:
            slots.append(value)
        else:
            assert isinstance(argument, Bundle)
            if type(value) is not argument.cls:
                raise MismatchError(f"argument {number + 1}: {_kind_of(value)}; declared: {argument.cls.__name__}")
            _fill(slots, argument.fields, cast(Any, value))


def _kind_of(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{'an array' if type(value) is np.ndarray else type(value).__name__} of {value.dtype}, {value.ndim}-D"
    return type(value).__name__


def address(array: NDArray[Any]) -> int:
    """Address of the first number of a C-contiguous array.

    Raises
    ------
    MismatchError : the array is not C-contiguous.
    """
    if not array.flags.c_contiguous:
        raise MismatchError(f"an array of shape {array.shape} is not C-contiguous")
    # ``from_buffer`` takes no array that is empty or read-only
    if array.dtype.fields is None and array.size and array.flags.writeable:
        return addressof(
            c_char.from_buffer(cast(Any, array))
        )  # twice as fast as array.ctypes; no buffers of records, slow
    return int(array.ctypes.data)


Function = TypeVar("Function", bound=Callable[..., Any])
PLAIN: Final = os.environ.get("LATIN_FMU_COMPILE") == "setup"
"""Whether the kernels of a run (``latin_fmu.kernels``) are plain Python functions, to be followed by a debugger: a
thousand times slower. Those of the set-up stay compiled where the library fits, and are plain Python elsewhere."""


class Kernel:
    """A function that is compiled as a part of the entries that call it.

    Attributes
    ----------
    py_func : the Python function. ordered : whether sums stay in the order in which they are written. shared : whether
    its machine code is to exist once in the library.
    """

    shared = False

    def __init__(self, function: Callable[..., Any], ordered: bool = False) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self.ordered = function, ordered

    def __call__(self, *arguments: Any) -> Any:
        """The same in Python, for kernels that tests or a debugger run there."""
        return self.py_func(*arguments)


def _library() -> ctypes.CDLL | None:
    """The library; None where kernels are plain Python and none fits."""
    return library.loaded() if PLAIN else library.needed()


def _call_of(shared: ctypes.CDLL, symbol: str) -> Callable[[bytes, Any], int]:
    """An entry: status from the slots of the arguments and a pointer to the result."""
    shape = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_char_p, ctypes.c_void_p)
    return shape((symbol, shared))


class Entry(Kernel):
    """A kernel that Python calls: in the library that was compiled ahead of time.

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
        handle = _library()
        if handle is None:
            return []
        return [
            (signature.pack, _call_of(handle, f"{self.symbol}_{number}"), _RESULTS[signature.result])
            for number, signature in enumerate(self.signatures)
        ]

    def __call__(self, *arguments: Any) -> Any:
        """Call the library.

        Raises
        ------
        KernelsError : there is no library that fits. MismatchError : no signature describes the arguments.
        """
        if not self._calls:
            return self.py_func(*arguments)
        wrong = []
        for pack, call, result in self._calls:
            try:
                slots = pack(arguments)
            except MismatchError as error:
                wrong.append(str(error))
                continue
            out = None if result is None else result()
            # an allocation that failed: kernels raise nothing else
            if status := call(slots, None if out is None else byref(out)):
                raise MemoryError(f"{self.symbol}: no memory for its work arrays (status {status})")
            return None if out is None else out.value
        raise MismatchError(f"{self.symbol}: {'; or '.join(wrong)}")

    def bound(self, first: Any) -> Callable[..., Any]:
        """The entry with its first argument given, see ``bound``."""
        handle = _library()
        if handle is None or len(self.signatures) != 1:
            return functools.partial(self, first)
        signature, prefix = self.signatures[0], list[Any]()
        # addresses of the first argument, once
        _fill(prefix, signature.arguments[:1], (first,))
        call, result = _call_of(handle, f"{self.symbol}_0"), _RESULTS[signature.result]

        # the default argument keeps the arrays alive as long as the addresses are used
        def call_with(*rest: Any, _kept: Any = first) -> Any:
            out = None if result is None else result()
            if status := call(signature.packed(*prefix, *rest), None if out is None else byref(out)):
                raise MemoryError(f"{self.symbol}: no memory for its work arrays (status {status})")
            return None if out is None else out.value

        return call_with


def bound(function: Callable[..., Any], first: Any) -> Callable[..., Any]:
    """An entry with its first argument given, for many calls: addresses are read once, the other arguments are numbers.

    The arrays in ``first`` are kept alive and must not be resized.
    """
    return function.bound(first) if isinstance(function, Entry) else functools.partial(function, first)


class Intrinsic:
    """A function that kernels call and whose code the build is given as instructions of LLVM.

    Attributes
    ----------
    define : what ``numba.extending.intrinsic`` takes; it imports what it needs of numba itself. in_python : the same
    for kernels that are run in Python.
    """

    def __init__(self, define: Callable[..., Any], in_python: Callable[..., Any]) -> None:
        self.define, self.in_python = define, in_python

    def __call__(self, *arguments: Any) -> Any:
        """The same in Python."""
        return self.in_python(*arguments)


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
    return PLAIN and _module(function).startswith(("kernels.", "laws.", "cholesky.substitution"))


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
