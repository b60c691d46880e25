"""The reference of the scene file, generated from the tables themselves, and its JSON schema."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from .describe import allowed_text, is_named, tables_in, tag_of
from .reference_text import CONVENTIONS, EXAMPLE, INTRODUCTION
from .schema import Scene
from .toml_text import toml_value

_WIDTH = 110
_INDENT = " " * 8


def reference_text() -> str:
    """Every table and key of a scene with kind, range, unit, default and meaning; conventions; an example."""
    top = "\n".join(
        line
        for key, field in Scene.model_fields.items()
        if not tables_in(field.annotation)
        for line in _field_lines(key, field)
    )
    parts = [_title("Scene file"), INTRODUCTION, "Top of the file", top]
    for key, field in Scene.model_fields.items():
        if tables := tables_in(field.annotation):
            need = "required" if field.is_required() else "optional"
            parts.append(_title(f"[{key}.NAME] ({need})" if is_named(field) else f"[{key}] ({need})"))
            parts += [_table_text(table) for table in tables]
    for key, tables in _inner_tables().items():
        parts.append(_title(f"{key} = {{...}}"))
        parts += [_table_text(table) for table in tables]
    parts += [_title("Conventions"), CONVENTIONS, _title("Example"), EXAMPLE]
    return "\n\n".join(part.rstrip("\n") for part in parts) + "\n"


def reference_schema() -> dict[str, Any]:
    """JSON schema of a scene (units under "unit"); it does not hold the checks between tables."""
    return Scene.model_json_schema()


def _title(text: str) -> str:
    return f"{text}\n{'=' * len(text)}"


def _inner_tables() -> dict[str, list[type[BaseModel]]]:
    """Tables inside tables, by the key that holds them, in the order met."""
    found: dict[str, list[type[BaseModel]]] = {}
    waiting = [table for field in Scene.model_fields.values() for table in tables_in(field.annotation)]
    while waiting:
        for key, field in waiting.pop(0).model_fields.items():
            tables = tables_in(field.annotation)
            if tables and key not in found:
                found[key] = tables
                waiting += tables
    return found


def _table_text(table: type[BaseModel]) -> str:
    tag = tag_of(table)
    meaning = textwrap.fill(" ".join((table.__doc__ or "").split()), _WIDTH)
    lines = [f'type = "{tag}"', textwrap.indent(meaning, "    ")] if tag is not None else [meaning]
    for name, field in table.model_fields.items():
        if tag is None or name != "type":
            lines += _field_lines(name, field)
    return "\n".join(lines)


def _field_lines(name: str, field: FieldInfo) -> Iterator[str]:
    text = f"{name}: {allowed_text(field)}; {_default_text(field)}"
    yield textwrap.fill(text, _WIDTH, initial_indent=" " * 4, subsequent_indent=" " * 12, break_long_words=False)
    yield textwrap.fill(field.description or "", _WIDTH, initial_indent=_INDENT, subsequent_indent=_INDENT)


def _default_text(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True, validated_data={})
    if default is None or default is PydanticUndefined or default in ((), {}, ""):
        return "optional"
    if isinstance(default, BaseModel):
        return f"default {toml_value(default.model_dump(exclude_none=True))}" if tag_of(type(default)) else "optional"
    return f"default {toml_value(default)}"
