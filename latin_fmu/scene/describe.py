"""Fields, units, ranges and choices of the scene tables, read from their declarations, for messages and reference; from
a validation error to the problems a user reads: path in the file, value, what is allowed, remedy.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, Literal, get_args, get_origin

import annotated_types
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ..errors import Problem, did_you_mean, shown

_SIGNS: Final = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_LONGEST_KEY, _LONGEST_TABLE = 100, 120  # characters shown of a key, and of the value of a key that is not known
_WHAT: Final = {
    "missing": "this key is missing",
    "float_type": "must be a number",
    "int_type": "must be an integer",
    "int_from_float": "must be an integer",
    "bool_type": "must be true or false",
    "string_type": "must be a string",
    "finite_number": "must be a finite number",
    "greater_than": "out of range",
    "greater_than_equal": "out of range",
    "less_than": "out of range",
    "less_than_equal": "out of range",
    "tuple_type": "must be a list",
    "too_long": "too many values",
    "too_short": "is empty: at least one value is required",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "dict_type": "must be a table",
}


def tables_in(annotation: Any) -> list[type[BaseModel]]:
    """All table classes that appear in a field's annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) is Literal:
        return []
    return list(dict.fromkeys(table for part in get_args(annotation) for table in tables_in(part)))


def tag_of(table: type[BaseModel]) -> str | None:
    """The value of `type` that selects this table, None for a table that needs no choice."""
    field = table.model_fields.get("type")
    if field is None:
        return None
    return str(field.default)


def tags_of(tables: Iterable[type[BaseModel]]) -> list[str]:
    """The values of `type` among which these tables are chosen."""
    return [tag for table in tables if (tag := tag_of(table)) is not None]


def is_named(field: FieldInfo) -> bool:
    """True for a table of tables by name, such as [material.NAME]."""
    return get_origin(field.annotation) is dict


def _walk(root: type[BaseModel], location: Sequence[str | int]) -> tuple[list[type[BaseModel]], FieldInfo | None]:
    tables: list[type[BaseModel]] = [root]
    field: FieldInfo | None = None
    expects_name = False
    for part in location:
        if expects_name:
            expects_name, field = False, None
            continue
        if isinstance(part, int):
            continue
        chosen = [table for table in tables if tag_of(table) == part]
        owner = next((table for table in tables if part in table.model_fields), None)
        # pydantic puts the tag of a union into the location, between its keys
        if len(tables) > 1 and chosen:
            tables = chosen
        elif owner is not None:
            field = owner.model_fields[part]
            tables, expects_name = tables_in(field.annotation), is_named(field)
        else:
            return [], None
    return tables, field


def tables_at(root: type[BaseModel], location: Sequence[str | int]) -> list[type[BaseModel]]:
    """The tables that may stand at an error location (several where a type chooses among them)."""
    return _walk(root, location)[0]


def field_at(root: type[BaseModel], location: Sequence[str | int]) -> FieldInfo | None:
    """The field at an error location, None where there is none."""
    return _walk(root, location)[1]


def unit_of(field: FieldInfo) -> str | None:
    """Unit of a field, None for text, flags and tables."""
    extra = field.json_schema_extra
    if isinstance(extra, dict) and extra.get("unit") is not None:
        return str(extra["unit"])
    return None


def range_of(field: FieldInfo) -> str:
    """Bounds of a number, e.g. ``"> -1, < 0.5"``; empty where it has none."""
    bounds: list[str] = []
    for item in _metadata(field):
        for key, sign in _SIGNS.items():
            limit = getattr(item, key, None)
            if limit is not None and isinstance(item, annotated_types.BaseMetadata):
                # limits of counts: ":g" would write 1e+07
                if abs(limit) < 1e6:
                    bounds.append(f"{sign} {limit:g}")
                else:
                    bounds.append(f"{sign} {limit:d}")
    return ", ".join(dict.fromkeys(bounds))


def _metadata(field: FieldInfo) -> list[Any]:
    metadata = list(field.metadata)
    stack = [field.annotation]
    while stack:
        annotation: Any = stack.pop()
        for item in getattr(annotation, "__metadata__", ()):
            if isinstance(item, FieldInfo):
                metadata += item.metadata
            else:
                metadata += [item]
        if get_origin(annotation) is not Literal:
            stack += [part for part in get_args(annotation) if part is not Ellipsis]
    return metadata


def kind_of(field: FieldInfo) -> str:
    """What to write: number, integer, string, list of 3 numbers, one of "a", "b" ..."""
    return _kind(field.annotation)


def _kind(annotation: Any) -> str:
    simple = {float: "number", int: "integer", str: "string", bool: "true or false"}
    if annotation in simple:
        return simple[annotation]
    parts = [part for part in get_args(annotation) if part is not type(None)]
    if get_origin(annotation) is dict:
        return "tables by name"
    if get_origin(annotation) is Mapping:
        return f"by name: {_kind(parts[1])}"
    if tables := tables_in(annotation):
        tags = tags_of(tables)
        if tags:
            return f"table, type = {' | '.join(tags)}"
        return "table"
    if get_origin(annotation) is Literal:
        return " | ".join(f'"{part}"' if isinstance(part, str) else str(part) for part in parts)
    if get_origin(annotation) is tuple:
        item = _kind(parts[0])
        if item.startswith("list of"):
            item = f"lists{item.removeprefix('list')}"
        elif not item.startswith('"'):
            item = " | ".join(f"{kind}s" for kind in item.split(" | "))
        if parts[-1] is Ellipsis:
            return f"list of {item}"
        return f"list of {len(parts)} {item}"
    if hasattr(annotation, "__metadata__"):
        return _kind(parts[0])
    return " | ".join(dict.fromkeys(_kind(part) for part in parts))


def allowed_text(field: FieldInfo | None, item: bool = False) -> str | None:
    """Kind, range and unit of a field (or of an item of a list) in a few words."""
    if field is None:
        return None
    kind = kind_of(field)
    if item:
        kind = re.sub(r"^list of (\d+ )?lists (.*)$|^list of (\d+ )?(.*?)s?$", _one_item, kind)
    text = ", ".join(part for part in (kind, range_of(field)) if part)
    unit = unit_of(field)
    if unit not in (None, "1"):
        return f"{text} [{unit}]"
    return text


def _one_item(kind: re.Match[str]) -> str:
    if kind[2]:
        return f"list {kind[2]}"
    return kind[4].replace("s | ", " | ")


def unit_at(root: type[BaseModel], path: str) -> str | None:
    """UDUNITS unit of the key under a dotted path, a number in it an item of a list; None where none is declared."""
    field = field_at(root, [int(part) if part.isdecimal() else part for part in path.split(".")])
    if field is None:
        return None
    return unit_of(field)


def validation_problems(root: type[BaseModel], error: ValidationError, raw: Any) -> list[Problem]:
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
        if _BARE_KEY.fullmatch(part) and len(part) <= _LONGEST_KEY:
            key = part
        else:
            key = shown(part)
        if text:
            text += f".{key}"
        else:
            text += key
    return text or "scene"


def _problem(root: type[BaseModel], detail: ErrorDetails, raw: Any) -> Problem:
    location, kind = detail["loc"], detail["type"]
    context = detail.get("ctx", {})
    path = _path_in_file(root, location, raw)
    where, value = path_text(path), shown(detail["input"])
    if kind == "scene_problem":
        wrong = context["value"]
        if wrong is None or isinstance(wrong, str):
            text = wrong
        else:
            text = shown(wrong)
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
        allowed = f"a table with type = one of {', '.join(tags)}"
        if isinstance(detail["input"], dict):
            return Problem(f"{where}.type", "the type is missing", None, allowed)
        return Problem(where, "must be a table", value, allowed)
    if kind == "union_tag_invalid":
        tags, tag = tags_of(tables_at(root, location)), _tag(detail["input"])
        return Problem(f"{where}.type", "unknown type", shown(tag), ", ".join(tags), did_you_mean(tag, tags))
    if kind == "literal_error":
        # pydantic has them in its text alone
        options = re.findall(r"'([^']*)'", context["expected"]) or re.findall(r"\d+", context["expected"])
        return Problem(where, "unknown value", value, ", ".join(options), did_you_mean(detail["input"], options))
    if kind == "missing" and isinstance(location[-1], int):
        return Problem(path_text(path[:-1]), "too few values", value, allowed_text(field_at(root, location)))
    what = _WHAT.get(kind, detail["msg"])
    if kind == "float_type" and isinstance(detail["input"], int) and not isinstance(detail["input"], bool):
        what = "number out of range"
    if not location:
        return Problem(where, what, value)
    wanted = allowed_text(field_at(root, location), item=isinstance(location[-1], int))
    if kind == "missing":
        return Problem(where, what, None, wanted)
    return Problem(where, what, value, wanted)


def _tag(table: Any) -> Any:
    if isinstance(table, Mapping):
        return table.get("type")
    return getattr(table, "type", table)


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
            if part < len(here):
                here = here[part]
            else:
                here = None
        else:
            here = None
    return path
