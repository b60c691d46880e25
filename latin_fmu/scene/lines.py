"""Where in a scene file a key is written."""

from __future__ import annotations

import re

_HEADER = re.compile(r"\s*\[\s*([^\[\]]+?)\s*\]\s*(#.*)?$")
_KEY = re.compile(r"\s*([A-Za-z0-9_.\"'-]+)\s*=")


def key_lines(text: str) -> dict[str, int]:
    """Line number, from 1, of every table header and key of a TOML text, by dotted path; keys inside inline tables
    stand on the line of the key that holds them and are not listed."""
    found: dict[str, int] = {}
    table = ""
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            table = _plain(header.group(1))
            found.setdefault(table, number)
        elif key := _KEY.match(line):
            path = _plain(key.group(1))
            found.setdefault(f"{table}.{path}" if table else path, number)
    return found


def line_of(lines: dict[str, int], path: str) -> int | None:
    """Line of a key, or of the key or table that holds it; None where neither is written (a default)."""
    if path in lines:
        return lines[path]
    holder, _, key = path.rpartition(".")
    written = bool(holder) and holder in lines and not _is_table(lines, holder) and bool(key)
    return lines[holder] if written else None


def _is_table(lines: dict[str, int], path: str) -> bool:
    """Whether a path has keys of its own on lines of their own."""
    return any(other.startswith(f"{path}.") for other in lines)


def _plain(path: str) -> str:
    return ".".join(part.strip().strip("\"'") for part in path.split("."))
