"""Settings of the form ``a.b.c=value`` on top of a scene file.

The path follows the tables and names of the file; a number picks an item of a list
(``substructure.bar.box.elements.2=100``). The value is read as TOML; a bare word is a text. A named
table must exist; a key may be new; whether it is known is checked with the scene."""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from ..errors import Problem, SceneError, did_you_mean, shown
from .describe import is_named, path_text
from .fields import NAME_PATTERN
from .schema import Scene

_FORM = "name.key=value, e.g. solver.tolerance=1e-4"


def apply_overrides(data: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """A copy of the scene data with the settings applied in order.

    Raises SceneError with every setting that cannot be applied.
    """
    try:
        changed: dict[str, Any] = copy.deepcopy(dict(data)) if overrides else dict(data)
    except RecursionError:
        raise SceneError([Problem("scene", "nested too deeply")], "the settings cannot be applied") from None
    problems = [problem for setting in overrides if (problem := _apply(changed, setting)) is not None]
    if problems:
        raise SceneError(problems, "the settings cannot be applied")
    return changed


def _apply(data: dict[str, Any], setting: str) -> Problem | None:
    path, equals, text = setting.partition("=")
    keys = [key.strip() for key in path.split(".")]
    if not equals or not all(keys):
        return Problem("--set", "not a setting", shown(setting), _FORM)
    where = path_text(keys)
    try:
        value = parse_value(text.strip())
    except ValueError as error:
        return Problem(where, str(error), shown(text), "a TOML value")
    here: Any = data
    for depth, key in enumerate(keys[:-1]):
        # parts of a mesh file, and tables without names, may be made
        step = _entered(here, key, path_text(keys[: depth + 1]), must_exist=depth == 1 and _has_names(data, keys[0]))
        if isinstance(step, Problem):
            return step
        here = step[0]
    return _store(here, keys[-1], value, where)


def _has_names(data: dict[str, Any], key: str) -> bool:
    """Whether the tables under a key must exist; parts of a mesh file need none of their own."""
    field = Scene.model_fields.get(key)
    return field is not None and is_named(field) and not (key == "substructure" and data.get("mesh"))


def _entered(here: Any, key: str, where: str, must_exist: bool) -> tuple[Any] | Problem:
    """The table or list one key down, made where it may be; in a tuple, or what is wrong."""
    if isinstance(here, list):
        index = _index(here, key)
        return (here[index],) if index is not None else _no_item(where, here)
    if not isinstance(here, dict):
        return Problem(where, "this is not a table", shown(here))
    if key not in here:
        if must_exist:
            return Problem(
                where,
                "no table of this name",
                None,
                ", ".join(filter(NAME_PATTERN.fullmatch, here)) or "(none)",
                did_you_mean(key, here),
            )
        here[key] = {}
    elif isinstance(here[key], str):
        here[key] = {"type": here[key]}  # "hht" is short for {type = "hht"}
    return (here[key],)


def _store(here: Any, key: str, value: Any, where: str) -> Problem | None:
    if isinstance(here, dict):
        here[key] = value
        return None
    if isinstance(here, list):
        index = _index(here, key)
        if index is None:
            return _no_item(where, here)
        here[index] = value
        return None
    return Problem(where, "this is not a table", shown(here))


def _index(items: list[Any], key: str) -> int | None:
    return int(key) if key.isascii() and key.isdigit() and len(key) < 10 and int(key) < len(items) else None


def _no_item(where: str, items: list[Any]) -> Problem:
    return Problem(where, "no such item of the list", None, f"0 to {len(items) - 1}")


def parse_value(text: str) -> Any:
    """A TOML value; a bare word is a text. Raises ValueError where it is neither."""
    try:
        parsed = tomllib.loads(f"value = {text}\n")
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except tomllib.TOMLDecodeError:
        # brackets, quotes and line breaks are no bare word
        if not text or text[0] in "[{\"'" or "\n" in text:
            raise ValueError("not a value") from None
        return text
    # the limit of Python on the digits of an integer
    except ValueError:
        raise ValueError("a number with too many digits") from None
    # a line break in the text could begin another key
    if parsed.keys() != {"value"}:
        raise ValueError("more than one value")
    return parsed["value"]


_HEADER = re.compile(r"\s*\[\s*([^\[\]]+?)\s*\]\s*(#.*)?$")
_KEY = re.compile(r"\s*([A-Za-z0-9_.\"'-]+)\s*=")


def key_lines(text: str) -> dict[str, int]:
    """Line number, from 1, of every table header and key of a TOML text, by dotted path; keys inside inline tables
    stand on the line of the key that holds them and are not listed."""
    numbers: dict[str, int] = {}
    table = ""
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            table = _plain(header.group(1))
            numbers.setdefault(table, number)
        elif key := _KEY.match(line):
            path = _plain(key.group(1))
            numbers.setdefault(f"{table}.{path}" if table else path, number)
    return numbers


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
