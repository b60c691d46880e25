"""Tolerant views of a scene as it was written: whatever has the wrong shape is left out without an error.

The checks between keys and tables use these views, so that a wrong field does not hide other problems."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from ..errors import Problem, did_you_mean, shown
from .fields import ALL_OF_IT, BOX_FACES, FACE_PATTERN, NAME_PATTERN, entry, split_face

RawTable = Mapping[str, Any]
CENTRAL = "central_difference"
"""Name of the scheme of the explicit propagator."""
_DEPTH = 6  # of the deepest table a scene has
_MAX_LEVELS = 50  # far deeper than any scene: stops at oversized nesting
_MAX_BITS = 4096  # some 1200 digits; Python prints 4300


def plain(data: Any, depth: int = _DEPTH) -> Any:
    """The data with tables built in Python replaced by dictionaries of what was given, their types included."""
    if isinstance(data, BaseModel):  # other keys that were not given stay away
        keys = [key for key in type(data).model_fields if key in data.model_fields_set or key == "type"]
        texts = getattr(data, "_texts", {})
        return {key: plain(texts.get(key, getattr(data, key)), depth) for key in keys}
    if isinstance(data, list | tuple):
        if depth > 0:
            return [plain(item, depth - 1) for item in data]
        return data
    if depth > 0 and isinstance(data, Mapping):
        return {key: plain(item, depth - 1) for key, item in data.items()}
    tolist = getattr(data, "tolist", None)
    if callable(tolist):
        return tolist()
    return data


def oversized_integers(raw: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Paths of the integers that are too long to be printed."""
    if isinstance(raw, int) and raw.bit_length() > _MAX_BITS:
        yield path
    elif len(path) < _MAX_LEVELS and isinstance(raw, Mapping):
        for key, item in raw.items():
            yield from oversized_integers(item, (*path, str(key)))
    elif len(path) < _MAX_LEVELS and isinstance(raw, (list, tuple)):
        for index, item in enumerate(raw):
            yield from oversized_integers(item, (*path, index))


def named_tables(raw: Any, key: str) -> dict[str, RawTable]:
    """The tables [key.NAME] that are tables."""
    group = entry(raw, key)
    if not isinstance(group, Mapping):
        return {}
    return {name: item for name, item in group.items() if isinstance(name, str) and isinstance(item, Mapping)}


def single_table(raw: Any, key: str) -> RawTable:
    """The table [key], empty where it is missing or no table."""
    table = entry(raw, key)
    if isinstance(table, Mapping):
        return table
    return {}


def given(table: RawTable, key: str) -> bool:
    """True where the key is written (None, in Python, is the same as not written)."""
    return table.get(key) is not None


def chosen_type(table: RawTable, key: str) -> str | None:
    """Type that a key chooses, by a bare word or in a table."""
    value = table.get(key)
    if isinstance(value, Mapping):
        chosen = value.get("type")
    else:
        chosen = value
    if isinstance(chosen, str):
        return chosen
    return None


def is_explicit(raw: Any) -> bool:
    """Whether a scene selects central differences, by its scheme or by its propagator."""
    kind = chosen_type(single_table(raw, "solver"), "propagator")
    return kind == "explicit" or chosen_type(single_table(raw, "time"), "scheme") == CENTRAL


def number(table: RawTable, key: str) -> float | None:
    """A finite number, None where the key is missing or anything else."""
    value = table.get(key)
    # true is an int of Python
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        if math.isfinite(value):
            return float(value)
        return None
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


_MAX_LISTED = 12


def unknown_name(where: str, kind: str, name: str, tables: Iterable[str]) -> Problem:
    """The problem of a name that no table has."""
    names = sorted(name for name in tables if NAME_PATTERN.fullmatch(name))
    listed = ", ".join(names[:_MAX_LISTED])
    if len(names) > _MAX_LISTED:
        listed += ", ..."
    return Problem(where, f"no {kind} of this name", shown(name), listed, did_you_mean(name, names))


def reference_problems(raw: Any, where: str, kind: str, name: Any) -> Iterator[Problem]:
    """A name that no table of this kind has, where there are any."""
    tables = named_tables(raw, kind)
    if tables and isinstance(name, str) and name not in tables:
        yield unknown_name(where, kind, name, tables)


def face_problems(raw: Any, where: str, face: Any) -> Iterator[Problem]:
    """What is wrong with the face ``"substructure.face"``; faces of mesh files are checked with the mesh."""
    parsed = parsed_face(face)
    substructures = named_tables(raw, "substructure")
    if parsed is None or not substructures:
        return
    substructure, name = parsed
    if substructure not in substructures:
        faces = [f"{other}.{name}" for other in substructures]
        problem = unknown_name(where, "substructure", substructure, substructures)
        close = did_you_mean(substructure, substructures)
        if close is not None:
            problem = Problem(where, problem.what, shown(face), problem.allowed, did_you_mean(face, faces) or close)
        yield problem
    elif is_box(raw, substructure) and name not in (*BOX_FACES, ALL_OF_IT):
        yield Problem(
            where,
            f"the box {substructure!r} has no face of this name",
            shown(face),
            ", ".join(BOX_FACES),
            did_you_mean(name, BOX_FACES),
        )


def is_box(raw: Any, substructure: str) -> bool:
    """True for a substructure written as a box only."""
    table = named_tables(raw, "substructure").get(substructure, {})
    return given(table, "box") and not given(table, "mesh")


def exactly_one(table: RawTable, where: str, *keys: str) -> Iterator[Problem]:
    """Several of these keys given, or none of them."""
    choice, written = [f"{key!r}" for key in keys], [f"{key!r}" for key in keys if given(table, key)]
    if len(written) != 1:
        what = f"neither {' nor '.join(choice)} is given"
        if written:
            what = f"both {written[0]} and {written[1]} are given"
        yield Problem(where, what, None, f"exactly one of {', '.join(choice[:-1])} and {choice[-1]}")


def moves(value: object) -> bool:
    """Whether a list has a number that is not zero."""
    return isinstance(value, list | tuple) and any(isinstance(v, int | float) and v != 0 for v in value)
