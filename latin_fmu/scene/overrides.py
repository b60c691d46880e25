"""Settings of the form ``a.b.c=value`` on top of a scene file.

The path follows the tables and names of the file; a number picks an item of a list
(``substructure.bar.box.elements.2=100``). The value is read as TOML; a bare word is a text. A named
table must exist; a key may be new; whether it is known is checked with the scene."""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from ..errors import Problem, SceneError, did_you_mean, shown
from .describe import path_text
from .fields import NAME_PATTERN

_HEADING = "the settings cannot be applied"
_FORM = "name.key=value, e.g. solver.tolerance=1e-4"


def apply_overrides(data: Mapping[str, Any], overrides: Sequence[str], named: Collection[str]) -> dict[str, Any]:
    """A copy of the scene data with the settings applied in order.

    named : keys whose tables have names. Raises SceneError with every setting that cannot be applied.
    """
    try:
        if overrides:
            changed = copy.deepcopy(dict(data))
        else:
            changed = dict(data)
    except RecursionError:
        raise SceneError([Problem("scene", "nested too deeply")], _HEADING) from None
    problems = [problem for setting in overrides if (problem := _apply(changed, setting, named)) is not None]
    if problems:
        raise SceneError(problems, _HEADING)
    return changed


def with_value(data: Mapping[str, Any], path: str, value: Any, named: Collection[str]) -> dict[str, Any]:
    """A copy of the scene data with the value of one key, ``a.b.c``; errors as for ``apply_overrides``."""
    changed: dict[str, Any] = _lists(data)
    if problem := _set(changed, path.split("."), value, named):
        raise SceneError([problem], _HEADING)
    return changed


def _lists(value: Any) -> Any:
    """A copy of tables, with lists in the place of tuples, so that items can be set."""
    if isinstance(value, dict):
        return {key: _lists(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_lists(item) for item in value]
    return value


def _apply(data: dict[str, Any], setting: str, named: Collection[str]) -> Problem | None:
    path, equals, text = setting.partition("=")
    keys = [key.strip() for key in path.split(".")]
    if not equals or not all(keys):
        return Problem("--set", "not a setting", shown(setting), _FORM)
    try:
        value = parse_value(text.strip())
    except ValueError as error:
        return Problem(path_text(keys), str(error), shown(text), "a TOML value")
    return _set(data, keys, value, named)


def _set(data: dict[str, Any], keys: Sequence[str], value: Any, named: Collection[str]) -> Problem | None:
    # parts of a mesh file need no tables of their own
    has_names = keys[0] in named and not (keys[0] == "substructure" and data.get("mesh"))
    here: Any = data
    for depth, key in enumerate(keys[:-1]):
        # parts of a mesh file, and tables without names, may be made
        step = _entered(here, key, path_text(keys[: depth + 1]), must_exist=depth == 1 and has_names)
        if isinstance(step, Problem):
            return step
        here = step[0]
    return _store(here, keys[-1], value, path_text(keys))


def _entered(here: Any, key: str, where: str, must_exist: bool) -> tuple[Any] | Problem:
    """The table or list one key down, made where it may be; in a tuple, or what is wrong."""
    if isinstance(here, list):
        index = _index(here, key)
        if index is not None:
            return (here[index],)
        return _no_item(where, here)
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


_READING = (
    *("file", "columns", "column", "time_column", "unit", "value_unit", "time_unit", "length_unit"),
    *("start", "shift", "gaps"),
)
_FILLED = ("times", "values", "points", "x", "y", "header_units", "read_as")
"""Keys that say how a file is read, and those that are filled from it."""


def _store(here: Any, key: str, value: Any, where: str) -> Problem | None:
    if isinstance(here, dict):
        here[key] = value
        for filled in _FILLED if "file" in here and key in _READING else ():  # in a scene that has been read
            here.pop(filled, None)
        return None
    if isinstance(here, list):
        index = _index(here, key)
        if index is None:
            return _no_item(where, here)
        here[index] = value
        return None
    return Problem(where, "this is not a table", shown(here))


def _index(items: Sequence[Any], key: str) -> int | None:
    # isascii: other scripts have digits, too; ten digits are no item of a list
    if key.isascii() and key.isdigit() and len(key) < 10 and int(key) < len(items):
        return int(key)
    return None


def _no_item(where: str, items: list[Any]) -> Problem:
    return Problem(where, "no such item of the list", None, f"0 to {len(items) - 1}")


def number_at(data: Mapping[str, Any], path: str) -> float | None:
    """The number under the path of a key in the data of a scene, ``a.b.c``; None where there is none.

    >>> number_at({"load": {"pull": {"traction": [0.0, 2]}}}, "load.pull.traction.1")
    2.0
    """
    here = _at(data, path)
    if isinstance(here, int | float) and not isinstance(here, bool):
        return float(here)
    return None


def _at(data: Mapping[str, Any], path: str) -> object:
    here: object = data
    for key in path.split("."):
        if isinstance(here, Mapping):
            here = here.get(key)
        elif isinstance(here, list | tuple) and (index := _index(here, key)) is not None:
            here = here[index]
        else:
            return None
    return here


def no_number(where: str, data: Mapping[str, Any], path: str) -> Problem:
    """The problem where ``number_at`` finds none under a path in the data of a scene."""
    found, named = _at(data, path), path if path not in where else None
    if isinstance(found, list | tuple):
        items = f"{path}.0 to {path}.{len(found) - 1}"
        return Problem(where, "a list of numbers, not one of them", named, items, "name one item")
    if isinstance(found, str):
        return Problem(where, "no number under this name", named or shown(found), "a number", "give the key a number")
    allowed = "a number of the scene, as in --set, e.g. interface.joint.friction_coefficient"
    remedy = "write the key in full; if the scene omits it, add it (a measured gap as a number)"
    return Problem(where, "no number under this name", named, allowed, remedy)


def text_with_numbers(text: str, numbers: Mapping[str, float], named: Collection[str]) -> str | None:
    """A TOML text with other numbers by their paths, everything else as it is written; None where one of them does not
    stand there as ``key = number`` or ``key = "number unit"``."""
    lines = text.splitlines(keepends=True)
    where = key_lines(text)
    wanted = tomllib.loads(text)
    for path, number in numbers.items():
        line, key = line_of(where, path), path.rpartition(".")[2]
        if line is None:
            return None
        written = rf"(?<![\w.-]){re.escape(key)}\s*=\s*(?:[-+]?[0-9][0-9_.eE+-]*|\"[^\"]*\"|'[^']*')"
        lines[line - 1], count = re.subn(written, f"{key} = {number!r}", lines[line - 1])
        if count != 1:
            return None
        wanted = with_value(wanted, path, number, named)
    new_text = "".join(lines)
    # a text or comment may look like the key: the new text is read and compared
    if tomllib.loads(new_text) == wanted:
        return new_text
    return None


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


_PART = r"""(?:[\w-]+|"[^"]*"|'[^']*')"""
_PATH = rf"({_PART}(?:\s*\.\s*{_PART})*)"
_HEADER = re.compile(rf"(?:\s+(?=\[\s*[A-Za-z_]))?\[\s*{_PATH}\s*\]\s*(?:#.*)?$")  # rows of a list are indented, too
_KEY = re.compile(rf"\s*{_PATH}\s*=")


def key_lines(text: str) -> dict[str, int]:
    """Line number, from 1, of every table header and key of a TOML text, by dotted path; keys inside inline tables
    stand on the line of the key that holds them, and lists of tables have no path: they are not listed."""
    numbers: dict[str, int] = {}
    table: str | None = ""
    within = False
    for number, line in enumerate(text.splitlines(), 1):
        in_text, odd = within, sum(line.count(quotes) for quotes in ('"""', "'''")) % 2 == 1
        within = within != odd  # a text of several lines begins or ends
        if in_text:
            continue
        if header := _HEADER.match(line):
            table = _plain(header[1])
            numbers.setdefault(table, number)
        elif line.startswith("["):
            table = None
        elif table is not None and (key := _KEY.match(line)):
            numbers.setdefault(f"{table}.{_plain(key[1])}".lstrip("."), number)
    return numbers


def line_of(lines: dict[str, int], path: str) -> int | None:
    """Line of a key, or of the key or table that holds it; None where neither is written (a default)."""
    if path in lines:
        return lines[path]
    holder, _, key = path.rpartition(".")
    written = bool(holder) and holder in lines and not _is_table(lines, holder) and bool(key)
    if written:
        return lines[holder]
    return None


def _is_table(lines: dict[str, int], path: str) -> bool:
    """Whether a path has keys of its own on lines of their own."""
    return any(other.startswith(f"{path}.") for other in lines)


def _plain(path: str) -> str:
    return ".".join(part.strip().strip("\"'") for part in path.split("."))
