"""Writing a scene as TOML: the standard library reads TOML but does not write it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def toml_text(data: Mapping[str, Any]) -> str:
    """TOML of a scene: plain values first, then [table] and [table.name]; deeper tables stay inline."""
    blocks = ["\n".join(_line(key, value) for key, value in data.items() if not isinstance(value, Mapping))]
    for key, value in data.items():
        if not isinstance(value, Mapping):
            continue
        if value and all(isinstance(item, Mapping) for item in value.values()) and key not in _SINGLE:
            blocks += [_block(f"{key}.{name}", table) for name, table in value.items()]
        elif value:
            blocks.append(_block(key, value))
    return "\n\n".join(blocks) + "\n"


_SINGLE = ("time", "solver", "output", "accuracy")


def _block(header: str, table: Mapping[str, Any]) -> str:
    return "\n".join([f"[{header}]", *(_line(key, value) for key, value in table.items())])


def _line(key: str, value: Any) -> str:
    return f"{key} = {toml_value(value)}"


def toml_value(value: Any) -> str:
    """One value on one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, str):
        # JSON and TOML escape alike, but for DEL, which JSON leaves as it is
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{" + ", ".join(_line(key, item) for key, item in value.items()) + "}"
    return "[" + ", ".join(toml_value(item) for item in value) + "]"
