"""Serialization of states: a tree of plain values and arrays as bytes and back, bit for bit, without pickle.

``sealed`` adds a header and a checksum to bytes that leave the process, ``opened`` checks both:

=========  ======================================================================================
bytes      content
=========  ======================================================================================
16         ``LATIN-FMU SEAL`` and the number of the format
32         BLAKE2b of all that follows
8 + 8      lengths of header and payload, unsigned, little-endian
...        header: JSON with kind, version of the package, digest of the scene, machine
...        payload
=========  ======================================================================================
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ..errors import InputError, Problem, SolverError
from ..machine import package_version

_DTYPE: Final = re.compile(r"[<>|][biufcSU]\d{1,4}")
_MAGIC = b"LATIN-STATE-1\n"
_SEAL: Final = b"LATIN-FMU SEAL"
_FORMAT: Final = b"\x00\x01"
_CHECKED: Final = len(_SEAL) + len(_FORMAT) + 32  # first byte that the checksum covers
_FACTS: Final = {
    "kind": ("this is another kind of state", "give a state of this kind"),
    "version": ("written by another version of latin_fmu", "use the version that wrote it"),
    "machine": ("written on another kind of machine", "use a machine like the one that wrote it"),
    "digest": ("a state of another scene or of other settings", "use it with the scene and the settings it is of"),
}


def sealed(payload: bytes, kind: str, digest: str, machine: str = "") -> bytes:
    """The bytes of a state with header and checksum, for ``opened``.

    Parameters
    ----------
    kind : what the state is of, e.g. ``"FMU state"``. digest : of the scene and of the settings that the state needs.
    machine : what must be equal where it is opened, where states depend on the machine.
    """
    facts = {"kind": kind, "version": package_version(), "machine": machine, "digest": digest}
    header = json.dumps(facts).encode()
    lengths = b"".join(len(part).to_bytes(8, "little") for part in (header, payload))
    checksum = hashlib.blake2b(digest_size=32)
    for part in (lengths, header, payload):
        checksum.update(part)
    return b"".join([_SEAL, _FORMAT, checksum.digest(), lengths, header, payload])


def opened(state: bytes, kind: str, digest: str, machine: str = "") -> bytes:
    """Payload of the bytes of ``sealed``.

    Raises
    ------
    SolverError : no such state, another format, damaged (cut, longer, changed), of another kind, version, machine or
        scene; the message names what differs.
    """
    if state[: len(_SEAL)] != _SEAL:
        raise SolverError("the state cannot be used: it does not begin as a state of latin_fmu does")
    if state[len(_SEAL) : len(_SEAL) + len(_FORMAT)] != _FORMAT:
        raise SolverError("the state cannot be used: its format is another one; use the version that wrote it")
    checked = memoryview(state)[_CHECKED:]
    first, second = (int.from_bytes(checked[at : at + 8], "little") for at in (0, 8))  # of header and payload
    checksum = hashlib.blake2b(checked, digest_size=32).digest()
    # before anything of it is interpreted
    if checksum != state[_CHECKED - 32 : _CHECKED] or 16 + first + second != len(checked):
        raise SolverError("the state cannot be used: it is damaged (its checksum does not fit); use an intact copy")
    try:
        facts = dict(json.loads(bytes(checked[16 : 16 + first])))
    except (ValueError, TypeError):
        raise SolverError("the state cannot be used: its header cannot be read; use an intact copy") from None
    expected = {"kind": kind, "version": package_version(), "machine": machine, "digest": digest}
    for name, (what, remedy) in _FACTS.items():
        if facts.get(name) != expected[name]:
            if name == "digest":
                shown = ""
            else:
                shown = f" ({facts.get(name)!r}, here {expected[name]!r})"
            raise SolverError(f"the state cannot be used: {what}{shown}; {remedy}")
    return bytes(checked[16 + first :])


def encode(tree: Any, kind: str) -> bytes:
    """Bytes of nested dicts and lists of arrays, numbers, texts and None; ``kind`` identifies the owner."""
    arrays: list[np.ndarray[Any, Any]] = []
    head = json.dumps({"kind": kind, "tree": _plain(tree, arrays)}).encode()
    return b"".join([_MAGIC, len(head).to_bytes(8, "little"), head, *(a.tobytes() for a in arrays)])


def _plain(value: Any, arrays: list[np.ndarray[Any, Any]]) -> Any:
    """A value for JSON; arrays are appended to ``arrays`` and leave their place, type and shape.

    No function in a function: one that calls itself is a cycle of references, with all the arrays in it.
    """
    if isinstance(value, np.ndarray):
        arrays.append(np.ascontiguousarray(value))
        return {"": [len(arrays) - 1, arrays[-1].dtype.str, list(value.shape)]}
    if isinstance(value, np.generic | float):  # json text need not keep the last bit
        return _plain(np.asarray(value), arrays)
    if isinstance(value, dict):
        return {str(key): _plain(item, arrays) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, arrays) for item in value]
    return value


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
    except (ArithmeticError, AttributeError, LookupError, RecursionError, SyntaxError, TypeError, ValueError) as error:
        remedy = "restore only states of the same scene and settings"
        problem = Problem("state", f"cannot be restored: {error}", remedy=remedy)
        raise InputError([problem], "unusable state") from None


def _rebuilt(tree: Any, state: bytes, start: int) -> Any:
    """The tree with its arrays, which begin at byte ``start``."""
    specs: list[tuple[str, list[int]]] = []
    _collect(tree, specs)
    arrays, at = [], start
    for dtype, shape in specs:
        if not _DTYPE.fullmatch(dtype):
            raise ValueError(f"no type of numbers: {dtype[:20]!r}")
        count = int(np.prod(shape, dtype=np.int64))
        arrays.append(np.frombuffer(state, dtype=dtype, count=count, offset=at).reshape(shape).copy())
        at += arrays[-1].nbytes
    if at != len(state):
        raise ValueError("the length does not fit")

    return _built(tree, arrays)


def _collect(value: Any, specs: list[tuple[str, list[int]]]) -> None:
    """Append type and shape of the arrays of a tree in their order."""
    if isinstance(value, dict):
        if "" in value:
            specs.append((value[""][1], value[""][2]))
        else:
            for item in value.values():
                _collect(item, specs)
    elif isinstance(value, list):
        for item in value:
            _collect(item, specs)


def _built(value: Any, arrays: list[np.ndarray[Any, Any]]) -> Any:
    """The tree with its arrays."""
    if isinstance(value, dict):
        if "" in value:
            array = arrays[value[""][0]]
            if array.shape == ():
                return float(array)
            return array
        return {key: _built(item, arrays) for key, item in value.items()}
    if isinstance(value, list):
        return [_built(item, arrays) for item in value]
    return value


def check_like(tree: Any, template: Any, where: str, free: Sequence[str] = (), optional: Sequence[str] = ()) -> None:
    """Compare a tree that came from outside with one of the same owner.

    Kinds, keys, shapes and types of numbers must be equal, and all numbers finite.

    free : names of entries that are not compared. optional : those of entries that may be None in one of the two.

    Raises
    ------
    InputError : names the first entry that differs.
    """
    name = where.rpartition(".")[2].partition("[")[0]
    if name in optional and (tree is None or template is None):
        if tree is not None:
            check_numbers(tree, where)
    elif isinstance(template, dict):
        if not isinstance(tree, dict) or set(tree) != {str(key) for key in template}:
            raise unlike(where, "other entries than here")
        for key, part in template.items():
            if key not in free:
                check_like(tree[str(key)], part, f"{where}.{key}", free, optional)
    elif isinstance(template, list | tuple):
        if not isinstance(tree, list) or len(tree) != len(template):
            raise unlike(where, "a list of another length")
        for i, (value, part) in enumerate(zip(tree, template, strict=True)):
            check_like(value, part, f"{where}[{i}]", free, optional)
    elif isinstance(template, str):
        if not isinstance(tree, str):
            raise unlike(where, "no text")
    elif tree is not None or template is not None:
        check_numbers(tree, where, None if template is None else np.asarray(template))


def check_numbers(tree: Any, where: str, template: np.ndarray[Any, Any] | None = None) -> None:
    """Whether an entry, or each entry of a list or dict, holds finite numbers; of one shape and type with a template.

    Raises
    ------
    InputError : names the entry.
    """
    if template is None and isinstance(tree, dict | list):
        for key, part in tree.items() if isinstance(tree, dict) else enumerate(tree):
            check_numbers(part, f"{where}.{key}")
        return
    if not isinstance(tree, int | float | np.ndarray):
        raise unlike(where, "no numbers")
    values = np.asarray(tree)
    if template is not None and (values.shape != template.shape or values.dtype.kind != template.dtype.kind):
        raise unlike(where, f"{values.dtype} numbers of shape {values.shape}, here {template.dtype} {template.shape}")
    if values.dtype.kind not in "fiub" or not np.isfinite(values).all():
        raise unlike(where, "a number that is not finite")


def unlike(where: str, what: str) -> InputError:
    """The error of a state that does not fit."""
    remedy = "restore only states of the same scene and settings"
    return InputError([Problem(where, f"cannot be restored: {what}", remedy=remedy)], "unusable state")
