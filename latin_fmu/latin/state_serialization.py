"""Serialization of states: a tree of plain values and arrays as bytes and back, bit for bit, without pickle."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from ..errors import InputError, Problem

_MAGIC = b"LATIN-STATE-1\n"


def encode(tree: Any, kind: str) -> bytes:
    """Bytes of nested dicts and lists of arrays, numbers, texts and None; ``kind`` identifies the owner."""
    arrays: list[np.ndarray[Any, Any]] = []

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            arrays.append(np.ascontiguousarray(value))
            return {"": [len(arrays) - 1, arrays[-1].dtype.str, list(value.shape)]}
        if isinstance(value, np.generic):
            return plain(np.asarray(value))
        if isinstance(value, dict):
            return {str(key): plain(item) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [plain(item) for item in value]
        if isinstance(value, float):
            return plain(np.asarray(value))  # json text need not keep the last bit
        return value

    head = json.dumps({"kind": kind, "tree": plain(tree)}).encode()
    return b"".join([_MAGIC, len(head).to_bytes(8, "little"), head, *(a.tobytes() for a in arrays)])


def decode(state: bytes, kind: str) -> Any:
    """Tree from the bytes of ``encode``; arrays of one number become floats.

    Raises
    ------
    InputError : other bytes, bytes cut short, or a state of another kind.
    """
    try:
        if state[: len(_MAGIC)] != _MAGIC:
            raise ValueError("not a state written by this version")
        start = len(_MAGIC) + 8
        length = int.from_bytes(state[len(_MAGIC) : start], "little")
        head = json.loads(state[start : start + length])
        if head["kind"] != kind:
            raise ValueError("a state of another scene or of other settings")
        return _rebuilt(head["tree"], state, start + length)
    except (ValueError, KeyError, TypeError, IndexError) as error:
        remedy = "restore only states of the same scene and settings"
        problem = Problem("state", f"cannot be restored: {error}", remedy=remedy)
        raise InputError([problem], "unusable state") from None


def _rebuilt(tree: Any, state: bytes, start: int) -> Any:
    """The tree with its arrays, which begin at byte ``start``."""
    specs: list[tuple[str, list[int]]] = []

    def collect(value: Any) -> None:
        if isinstance(value, dict):
            if "" in value:
                specs.append((value[""][1], value[""][2]))
            else:
                for item in value.values():
                    collect(item)
        elif isinstance(value, list):
            for item in value:
                collect(item)

    collect(tree)
    arrays, at = [], start
    for dtype, shape in specs:
        count = int(np.prod(shape, dtype=np.int64))
        arrays.append(np.frombuffer(state, dtype=dtype, count=count, offset=at).reshape(shape).copy())
        at += arrays[-1].nbytes
    if at != len(state):
        raise ValueError("the length does not fit")

    def build(value: Any) -> Any:
        if isinstance(value, dict):
            if "" in value:
                array = arrays[value[""][0]]
                return float(array) if array.shape == () else array
            return {key: build(item) for key, item in value.items()}
        return [build(item) for item in value] if isinstance(value, list) else value

    return build(tree)
