"""From a validation error to the problems a user reads: path in the file, value, what is allowed, remedy."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from ..errors import Problem, did_you_mean, shown
from .describe import allowed_text, field_at, tables_at, tags_of

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_LONGEST_KEY, _LONGEST_TABLE = 100, 120  # characters shown of a key, and of the value of a key that is not known
_WHAT: Final = {
    "missing": "this key is missing",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be text",
    "finite_number": "must be a finite number",
    "greater_than": "out of range",
    "greater_than_equal": "out of range",
    "less_than": "out of range",
    "less_than_equal": "out of range",
    "tuple_type": "must be a list",
    "too_long": "has too many values",
    "too_short": "is empty: at least one is needed",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "dict_type": "must be a table",
}


def field_problems(root: type[BaseModel], error: ValidationError, raw: Any) -> list[Problem]:
    """One problem per wrong field; `raw` is what was validated."""
    problems = [_problem(root, detail, raw) for detail in error.errors(include_url=False)]
    return list(dict.fromkeys(problems))


def path_text(path: Sequence[str | int]) -> str:
    """``("interface", "crush", "sides", 1)`` -> ``interface.crush.sides[1]``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
            continue
        key = part if _BARE_KEY.fullmatch(part) and len(part) <= _LONGEST_KEY else shown(part)
        text += f".{key}" if text else key
    return text or "scene"


def _problem(root: type[BaseModel], detail: ErrorDetails, raw: Any) -> Problem:
    location, kind = detail["loc"], detail["type"]
    context = detail.get("ctx", {})
    path = _path_in_file(root, location, raw)
    where, value = path_text(path), shown(detail["input"])
    if kind == "scene_problem":
        given = context["value"]
        text = given if given is None or isinstance(given, str) else shown(given)
        return Problem(where, context["what"], text, context["allowed"], context["remedy"])
    if kind == "extra_forbidden":
        tables = tables_at(root, location[:-1])
        keys = list(dict.fromkeys(key for table in tables for key in table.model_fields))
        remedy = did_you_mean(location[-1], keys)
        if isinstance(detail["input"], Mapping) and len(value) > _LONGEST_TABLE:
            value = f"a table with {len(detail['input'])} keys"
        return Problem(where, "unknown key", value, ", ".join(keys), remedy)
    if kind == "union_tag_not_found":
        tags = tags_of(tables_at(root, location))
        return Problem(
            f"{where}.type" if isinstance(detail["input"], dict) else where,
            "the type is missing" if isinstance(detail["input"], dict) else "must be a table",
            None if isinstance(detail["input"], dict) else value,
            f"a table with type = one of {', '.join(tags)}",
        )
    if kind == "union_tag_invalid":
        tags, tag = tags_of(tables_at(root, location)), _tag(detail["input"])
        return Problem(f"{where}.type", "unknown type", shown(tag), ", ".join(tags), did_you_mean(tag, tags))
    if kind == "literal_error":
        options = re.findall(r"'([^']*)'", context["expected"]) or re.findall(r"\d+", context["expected"])
        return Problem(where, "unknown value", value, ", ".join(options), did_you_mean(detail["input"], options))
    if kind == "missing" and isinstance(location[-1], int):
        return Problem(path_text(path[:-1]), "has too few values", value, allowed_text(field_at(root, location)))
    what = _WHAT.get(kind, detail["msg"])
    if kind == "float_type" and isinstance(detail["input"], int) and not isinstance(detail["input"], bool):
        what = "too large for a number"
    allowed = allowed_text(field_at(root, location), item=isinstance(location[-1], int)) if location else None
    return Problem(where, what, None if kind == "missing" else value, allowed)


def _tag(table: Any) -> Any:
    return table.get("type") if isinstance(table, Mapping) else getattr(table, "type", table)


def _path_in_file(root: type[BaseModel], location: Sequence[str | int], raw: Any) -> list[str | int]:
    """The location without what the user never wrote: tags of the chosen types, markers of keys."""
    path: list[str | int] = []
    here = raw
    for depth, part in enumerate(location):
        tags = tags_of(tables_at(root, location[:depth]))
        if part == "[key]":
            continue
        if isinstance(here, Mapping) and part not in here and here.get("type", part) == part and part in tags:
            continue
        if isinstance(here, str) and here == part:
            continue
        path.append(part)
        if isinstance(here, Mapping):
            here = here.get(part)
        elif isinstance(here, Sequence) and not isinstance(here, str) and isinstance(part, int):
            here = here[part] if part < len(here) else None
        else:
            here = None
    return path
