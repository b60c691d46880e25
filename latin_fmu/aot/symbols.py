"""Undefined symbols of an object file, against the list of those that the library may need."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from typing import Final

_SYMBOL_TABLE = 2

# What the C library of every target has.
C_LIBRARY: Final = frozenset({"memset", "memcpy", "memmove", "malloc", "free", "abort", "hypot", "log10"})

# What stub.c defines: memory of kernels that allocate, and error paths that are never reached.
STUB: Final = frozenset(
    [
        "NRT_Allocate",
        "NRT_Free",
        "NRT_MemInfo_alloc",
        "NRT_MemInfo_alloc_aligned",
        "NRT_MemInfo_call_dtor",
        "PyErr_SetString",
        "PyExc_RuntimeError",
        "PyObject_Hash",
        "PyTuple_Pack",
        "PyUnicode_FromKindAndData",
    ]
)


class ForbiddenSymbolError(Exception):
    """A kernel needs something that the library does not have."""


def check(content: bytes, allowed: Iterable[str] = C_LIBRARY | STUB) -> None:
    """Compare the undefined symbols of an ELF object to those allowed.

    Raises
    ------
    ForbiddenSymbolError : names them.
    """
    wrong = sorted(set(undefined(content)) - set(allowed))
    if wrong:
        raise ForbiddenSymbolError(
            f"the kernels need {', '.join(wrong)}; allowed: {', '.join(sorted(allowed))}; a kernel raises, prints, "
            "allocates or calls a function of Python or NumPy that has no compiled form in the library"
        )


def undefined(content: bytes) -> Iterator[str]:
    """Names of the undefined symbols of a 64-bit little-endian ELF object.

    Raises
    ------
    ValueError : another kind of file.
    """
    if content[:6] != b"\x7fELF\x02\x01":
        raise ValueError("no 64-bit little-endian ELF object")
    start, size, count = struct.unpack_from("<Q", content, 40)[0], *struct.unpack_from("<HH", content, 58)
    sections = [struct.unpack_from("<IIQQQQIIQQ", content, start + i * size) for i in range(count)]
    for section in sections:
        if section[1] != _SYMBOL_TABLE:
            continue
        offset, length, names = section[4], section[5], sections[section[6]]
        for at in range(offset, offset + length, 24):
            name, _, _, index = struct.unpack_from("<IBBH", content, at)
            if index == 0 and name:
                first = names[4] + name
                yield content[first : content.index(b"\0", first)].decode()
