"""A digest behind the content of a file, by which damage is noticed.

The arrays of a netCDF file have checksums, its structure and single numbers have none: a changed byte there gives other
numbers without an error. Readers of HDF5 take no notice of bytes behind the end that the file states, and tools that
write a file anew drop them; a file without a digest is therefore taken as it is.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import BinaryIO, Final

_MARK: Final = b"LATIN-FMU DIGEST"
_SIZE: Final = 32
_BLOCK: Final = 1 << 20
_MOST: Final = 2_000_000_000
"""Bytes of a file that is checked: a second or two; larger ones rely on the checksums of their arrays."""


def add_digest(path: Path) -> None:
    """Append the mark and the BLAKE2b of all bytes before it to a file."""
    with path.open("r+b") as file:
        size = file.seek(0, os.SEEK_END)
        digest = _digest(file, size)
        file.seek(size)
        file.write(_MARK + digest)


def is_damaged(path: Path) -> bool:
    """Whether a file has a digest that does not fit it."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END) - len(_MARK) - _SIZE
        if not 0 <= size <= _MOST:
            return False
        file.seek(size)
        mark, digest = file.read(len(_MARK)), file.read(_SIZE)
        return mark == _MARK and _digest(file, size) != digest


def _digest(file: BinaryIO, size: int) -> bytes:
    """BLAKE2b of the first bytes of a file."""
    digest = hashlib.blake2b(digest_size=_SIZE)
    file.seek(0)
    while block := file.read(min(_BLOCK, size - file.tell())):
        digest.update(block)
    return digest.digest()
