"""Signatures of entries: what they accept, and the flat list of 8-byte slots in which arguments reach the library.

An array is its address followed by its shape, a number is itself, a named tuple is its fields one after the other.
Nothing is copied but the slots.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from ctypes import addressof, c_char
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

_SCALARS: Final = {"i8": "q", "f8": "d", "b1": "q", "f4": "d"}
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
    found = arguments_of(text, names)
    if len(found) != len(cls._fields):  # type: ignore[attr-defined]
        raise ValueError(
            f"{cls.__name__} has {len(cls._fields)} fields; the signature has {len(found)}"  # type: ignore[attr-defined]
        )
    return Bundle(cls, found)


def arguments_of(text: str, names: Mapping[str, Any]) -> tuple[Argument, ...]:
    """Arguments from their text; ``names`` maps words to record types and to what ``fields`` gives."""
    found: list[Argument] = []
    at, text = 0, text.strip()
    while at < len(text):
        match = _ARGUMENT.match(text, at)
        if match is None or match.end() == at:
            raise ValueError(f"signature {text!r}: cannot be read from {text[at:]!r} on")
        found.append(_argument(match[1], match[2], names, text))
        at = match.end()
    return tuple(found)


def _argument(word: str, dimensions: str | None, names: Mapping[str, Any], text: str) -> Argument:
    known = names.get(word)
    if dimensions is not None and isinstance(known, np.dtype):
        return Block(known, dimensions.count(",") + 1)
    if dimensions is not None and known is None and word in _ITEMS:
        return Block(np.dtype(word), dimensions.count(",") + 1)
    if dimensions is None and isinstance(known, Bundle):
        return known
    if dimensions is None and known is None and word in _SCALARS:
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
        self._pack = struct.Struct("=" + "".join(_format(a) for a in self.arguments)).pack

    def pack(self, values: Sequence[Any]) -> bytes:
        """The slots of a call.

        Raises
        ------
        MismatchError : other types, dimensions or strides than those declared.
        """
        slots: list[Any] = []
        _fill(slots, self.arguments, values)
        try:
            return self._pack(*slots)
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
                    f"argument {number + 1}: {_told(value)}; declared: {argument.dtype}, {argument.ndim}-D"
                )
            slots.append(address(value))
            slots.extend(value.shape)
        elif type(argument) is Scalar:
            slots.append(value)
        else:
            assert isinstance(argument, Bundle)
            if type(value) is not argument.cls:
                raise MismatchError(f"argument {number + 1}: {_told(value)}; declared: {argument.cls.__name__}")
            _fill(slots, argument.fields, cast(Any, value))


def _told(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype}, {value.ndim}-D"
    return type(value).__name__


def address(array: NDArray[Any]) -> int:
    """Address of the first number of a C-contiguous array.

    Raises
    ------
    MismatchError : the array is not C-contiguous.
    """
    if not array.flags.c_contiguous:
        raise MismatchError(f"an array of shape {array.shape} is not C-contiguous")
    if array.dtype.fields is None and array.size and array.flags.writeable:
        return addressof(
            c_char.from_buffer(cast(Any, array))
        )  # twice as fast as array.ctypes; no buffers of records, slow
    return int(array.ctypes.data)
