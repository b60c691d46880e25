"""Fields, units, ranges and choices of the scene tables, read from their declarations, for messages and reference."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, Final, Literal, get_args, get_origin

import annotated_types
from pydantic import BaseModel
from pydantic.fields import FieldInfo

_SIGNS: Final = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


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
    return None if field is None else str(field.default)


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
    unit = extra.get("unit") if isinstance(extra, dict) else None
    return str(unit) if unit is not None else None


def range_of(field: FieldInfo) -> str:
    """Bounds of a number, e.g. ``"> -1, < 0.5"``; empty where it has none."""
    bounds: list[str] = []
    for item in _metadata(field):
        for key, sign in _SIGNS.items():
            limit = getattr(item, key, None)
            if limit is not None and isinstance(item, annotated_types.BaseMetadata):
                bounds.append(f"{sign} {limit:g}" if abs(limit) < 1e6 else f"{sign} {limit:d}")
    return ", ".join(dict.fromkeys(bounds))


def _metadata(field: FieldInfo) -> list[Any]:
    metadata = list(field.metadata)
    stack = [field.annotation]
    while stack:
        annotation: Any = stack.pop()
        for item in getattr(annotation, "__metadata__", ()):
            metadata += item.metadata if isinstance(item, FieldInfo) else [item]
        if get_origin(annotation) is not Literal:
            stack += [part for part in get_args(annotation) if part is not Ellipsis]
    return metadata


def kind_of(field: FieldInfo) -> str:
    """What to write: number, whole number, text, list of 3 numbers, one of "a", "b" ..."""
    return _kind(field.annotation)


def _kind(annotation: Any) -> str:
    simple = {float: "number", int: "whole number", str: "text", bool: "true or false"}
    if annotation in simple:
        return simple[annotation]
    parts = [part for part in get_args(annotation) if part is not type(None)]
    if get_origin(annotation) is dict:
        return "tables by name"
    if tables := tables_in(annotation):
        tags = tags_of(tables)
        return f"table, type = {' | '.join(tags)}" if tags else "table"
    if get_origin(annotation) is Literal:
        return " | ".join(f'"{part}"' if isinstance(part, str) else str(part) for part in parts)
    if get_origin(annotation) is tuple:
        item = _kind(parts[0])
        if item.startswith("list of"):
            item = f"lists{item.removeprefix('list')}"
        elif not item.startswith('"'):
            item = f"{item}s"
        return f"list of {item}" if parts[-1] is Ellipsis else f"list of {len(parts)} {item}"
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
    return f"{text} [{unit}]" if unit not in (None, "1") else text


def _one_item(kind: re.Match[str]) -> str:
    return f"list {kind[2]}" if kind[2] else kind[4]
