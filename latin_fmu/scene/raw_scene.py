"""Tolerant views of a scene as it was written: whatever has the wrong shape is left out, never an error.

The checks between keys and tables look at these, so that a wrong field somewhere hides none of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from .fields import FACE_PATTERN, split_face

RawTable = Mapping[str, Any]
_DEPTH = 6  # of the deepest table a scene has
_MAX_LEVELS = 50  # far deeper than any scene: stops at endless nesting
_MAX_BITS = 4096  # some 1200 digits; Python prints 4300


def plain(data: Any, depth: int = _DEPTH) -> Any:
    """The data with tables built in Python replaced by dictionaries of what was given."""
    if isinstance(data, BaseModel):
        return data.model_dump(exclude_unset=True)
    if depth > 0 and isinstance(data, Mapping):
        return {key: plain(item, depth - 1) for key, item in data.items()}
    tolist = getattr(data, "tolist", None)
    return tolist() if callable(tolist) else data


def endless_numbers(raw: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Paths of the integers too long to be printed, which no library below could even complain about."""
    if isinstance(raw, int) and raw.bit_length() > _MAX_BITS:
        yield path
    elif len(path) < _MAX_LEVELS and isinstance(raw, Mapping):
        for key, item in raw.items():
            yield from endless_numbers(item, (*path, str(key)))
    elif len(path) < _MAX_LEVELS and isinstance(raw, (list, tuple)):
        for index, item in enumerate(raw):
            yield from endless_numbers(item, (*path, index))


def named_tables(raw: Any, key: str) -> dict[str, RawTable]:
    """The tables [key.NAME] that are tables."""
    group = raw.get(key) if isinstance(raw, Mapping) else None
    if not isinstance(group, Mapping):
        return {}
    return {name: item for name, item in group.items() if isinstance(name, str) and isinstance(item, Mapping)}


def single_table(raw: Any, key: str) -> RawTable:
    """The table [key], empty where it is missing or no table."""
    table = raw.get(key) if isinstance(raw, Mapping) else None
    return table if isinstance(table, Mapping) else {}


def given(table: RawTable, key: str) -> bool:
    """True where the key is written (None, in Python, is the same as not written)."""
    return table.get(key) is not None


def number(table: RawTable, key: str) -> float | None:
    """A finite number, None where the key is missing or anything else."""
    value = table.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        return float(value) if math.isfinite(value) else None
    except OverflowError:  # an int beyond the largest float
        return None


def text_list(value: Any) -> list[str]:
    """A list of texts, empty where it is not one."""
    if isinstance(value, (list, tuple)) and all(isinstance(item, str) for item in value):
        return list(value)
    return []


def parsed_face(value: Any) -> tuple[str, str] | None:
    """Substructure and face name of a well-written face, None for anything else (the ground included)."""
    if isinstance(value, str) and FACE_PATTERN.fullmatch(value):
        return split_face(value)
    return None
