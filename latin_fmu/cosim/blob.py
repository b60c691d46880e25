"""Named arrays and byte strings as one versioned block of bytes, without pickle.

Layout: magic (4), version (u32), length of the header (u32), header (JSON: name, type, shape of each part), the
parts one after the other in little-endian order, SHA-256 of all that (32). Bit-exact on both ways.
"""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, Problem

MAGIC, VERSION = b"LFMU", 1
_PREFIX = struct.Struct("<4sII")
_DIGEST = 32
_TYPES = ("<f8", "<i8", "<i4", "|i1", "|u1", "|b1")

Part = NDArray[np.generic] | bytes


class StateError(InputError):
    """A saved state cannot be used here."""


def encode(parts: Mapping[str, Part]) -> bytes:
    """One block of bytes; equal parts give equal bytes."""
    header, bodies = [], []
    for name, part in parts.items():
        if isinstance(part, bytes):
            header.append([name, "bytes", [len(part)]])
            bodies.append(part)
        else:
            array = np.ascontiguousarray(part).reshape(part.shape)
            kind = array.dtype.newbyteorder("<").str
            assert kind in _TYPES, f"{name}: type {kind} has no place in a saved state"
            header.append([name, kind, list(array.shape)])
            bodies.append(array.astype(kind, copy=False).tobytes())
    text = json.dumps(header, separators=(",", ":")).encode()
    block = _PREFIX.pack(MAGIC, VERSION, len(text)) + text + b"".join(bodies)
    return block + hashlib.sha256(block).digest()


def decode(block: bytes) -> dict[str, Part]:
    """The parts of a block.

    Raises
    ------
    StateError : not such a block, of another version, or damaged.
    """
    if len(block) < _PREFIX.size + _DIGEST:
        raise _unusable("too short to be a saved state", f"{len(block)} bytes")
    magic, version, length = _PREFIX.unpack_from(block)
    if magic != MAGIC:
        raise _unusable("not a saved state of this program", repr(magic))
    if version != VERSION:
        raise _unusable("written by another version", str(version), str(VERSION))
    if hashlib.sha256(block[:-_DIGEST]).digest() != block[-_DIGEST:]:
        raise _unusable("damaged: the checksum differs")
    start = _PREFIX.size + length
    parts: dict[str, Part] = {}
    for name, kind, shape in json.loads(block[_PREFIX.size : start]):
        count = int(np.prod(shape, dtype=np.int64))
        if kind == "bytes":
            parts[name] = block[start : start + count]
            start += count
        else:
            array = np.frombuffer(block, dtype=kind, count=count, offset=start).reshape(shape).copy()
            parts[name] = array
            start += array.nbytes
    return parts


def _unusable(what: str, value: str | None = None, allowed: str | None = None) -> StateError:
    problem = Problem("state", what, value, allowed, "use a state saved by the same FMU or session")
    return StateError([problem], "the saved state cannot be restored")
