"""Columns of numbers from text files, and the units that they may have there.

Columns are separated by a semicolon, a tab, a comma or blanks, whichever the first line has, in this order of
preference. Blank lines and lines that start with # do not count; one header is allowed. Text of a file is never quoted:
a file that is no table may hold anything.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final

from pydantic import BeforeValidator

from ..errors import did_you_mean
from .fields import refusal
from .units import INCH, POUND, SI, UnitSystem

MAX_FILE_BYTES: Final = 500_000_000
_TWO_COLUMNS = "two columns, time and value, separated by a comma, semicolon, tab or blank"
_LARGEST_FACTOR = 1e300

GRAVITY: Final = 9.80665
UNITS: Final[Mapping[str, Mapping[str, float]]] = MappingProxyType(
    {
        "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
        "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "MN": 1e6, "lbf": POUND, "kip": 1e3 * POUND},
        "Pa": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "bar": 1e5, "psi": POUND / INCH**2},
        "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": INCH, "ft": 12 * INCH},
        "m s-1": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1 / 3.6, "in/s": INCH, "ft/s": 12 * INCH},
        "m s-2": {"m/s2": 1.0, "mm/s2": 1e-3, "g": GRAVITY, "in/s2": INCH, "ft/s2": 12 * INCH},
        "N m-3": {"N/m3": 1.0, "kN/m3": 1e3, "N/mm3": 1e9},
        "K": {"K": 1.0},
        "1": {"1": 1.0, "%": 1e-2},
    }
)
"""Factors to SI by the unit in SI, then by the name in a scene."""
QUANTITIES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "s": "a time",
        "N": "a force",
        "Pa": "a pressure",
        "m": "a displacement",
        "m s-1": "a velocity",
        "m s-2": "an acceleration",
        "N m-3": "a force per volume",
        "K": "a change of temperature",
        "1": "a pure number",
    }
)
"""What has a unit, in words."""
TIME_UNITS: Final = tuple(UNITS["s"])
VALUE_UNITS: Final = tuple(name for unit, names in UNITS.items() if unit != "s" for name in names)


def si_unit(name: str) -> str | None:
    """Unit in SI of a unit by its name; None for a name that no unit has."""
    return next((unit for unit, names in UNITS.items() if name in names), None)


def factor(unit: Any, system: UnitSystem = SI) -> float:
    """Factor to the units of a scene of a unit, by its name or the factor itself; 1 for what is none."""
    if isinstance(unit, str):
        known = si_unit(unit)
        # names are those of SI: into the units of the scene
        return 1.0 if known is None else UNITS[known][unit] / system.size(known)
    return float(unit) if isinstance(unit, int | float) else 1.0


def _check_unit(value: object, names: Sequence[str]) -> object:
    if isinstance(value, str) and value in names:
        return value
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 < abs(value) <= _LARGEST_FACTOR:
        return float(value)
    remedy = did_you_mean(value, names) if isinstance(value, str) else None
    what = "unknown unit" if isinstance(value, str) else "not a unit"
    raise refusal(
        what,
        value=value,
        allowed=f"{', '.join(names)}, or the factor to the units of the scene, a number",
        remedy=remedy,
    )


def is_column(value: object) -> bool:
    """Whether a value names a column: a text, or a number from 1."""
    return bool(value.strip()) if isinstance(value, str) else type(value) is int and value >= 1


def _check_column(value: object) -> object:
    if is_column(value):
        return value
    raise refusal("not a column", value=value, allowed="the name in the header, or the number of the column, from 1")


Column = Annotated[str | int, BeforeValidator(_check_column)]
TimeUnit = Annotated[str | float, BeforeValidator(lambda value: _check_unit(value, TIME_UNITS))]
ValueUnit = Annotated[str | float, BeforeValidator(lambda value: _check_unit(value, VALUE_UNITS))]
LengthUnit = Annotated[str | float, BeforeValidator(lambda value: _check_unit(value, tuple(UNITS["m"])))]
SpeedUnit = Annotated[str | float, BeforeValidator(lambda value: _check_unit(value, tuple(UNITS["m s-1"])))]


def read_columns(base_dir: Path, name: str, columns: Sequence[str | int] | None = None) -> list[tuple[float, ...]]:
    """The rows of a file of numbers.

    columns : names in the header or numbers from 1; None: the file has two columns.

    Raises the refusal of the field that names the file.
    """
    lines = table_cells(base_dir, name)
    first = next(lines, None)
    if first is None:
        return []
    header = first[1]
    chosen = range(2) if columns is None else [_place(column, header) for column in columns]
    wanted = _TWO_COLUMNS if columns is None else f"finite numbers in {len(columns)} columns of {len(header)}"
    rows = []
    for number, cells in chain([first], lines):
        # two cells without chosen columns: a third would be ambiguous
        row = _numbers(cells, chosen) if columns is not None or len(cells) == 2 else None
        if row is None and number == first[0]:
            continue  # the header
        if row is None or not all(map(math.isfinite, row)):
            wrong = next((repr(n) for n in row or () if not math.isfinite(n)), None)
            many = "two" if columns is None else str(len(columns))
            remedy = "name the columns" if columns is None and len(cells) > 2 else None
            raise refusal(f"line {number} is not {many} finite numbers", value=wrong, allowed=wanted, remedy=remedy)
        rows.append(row)
    return rows


def table_cells(base_dir: Path, name: str) -> Iterator[tuple[int, list[str]]]:
    """Number, from 1, and cells of every line of a table that counts, its header among them.

    Raises the refusal of the field that names the file.
    """
    lines = _lines(_text(base_dir, name))
    if (first := next(lines, None)) is not None:
        split = _splitter(first[1])
        for number, line in chain([first], lines):
            yield number, split(line)


def _text(base_dir: Path, name: str) -> str:
    try:
        path = base_dir / name
        # reading a pipe may never return
        if path.exists() and not path.is_file():
            raise refusal("not a regular file", value=name, allowed="a file, no device, pipe or folder")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise refusal("the file is too large", value=name, allowed=f"at most {MAX_FILE_BYTES} bytes")
        # -sig: spreadsheets write a byte order mark
        return path.read_text(encoding="utf-8-sig")
    except (FileNotFoundError, NotADirectoryError):
        where = "the scene file" if base_dir != Path() else "the current folder"
        raise refusal("the file does not exist", value=name, remedy=f"file names are relative to {where}") from None
    except UnicodeDecodeError:
        raise refusal("not a text file", value=name, allowed=_TWO_COLUMNS) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise refusal(f"the file cannot be read ({reason})", value=name) from None


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Numbers, from 1, and texts of the lines that count."""
    for number, line in enumerate(text.splitlines(), 1):
        stripped = line.strip()
        if stripped and not stripped.startswith("#"):
            yield number, stripped


def _splitter(line: str) -> Any:
    """Function from a line to its cells, by the separator that the line has."""
    separator = next((s for s in ";\t," if s in line), None)
    if separator is None:
        return str.split
    pattern = re.compile(rf"\s*{separator}\s*" if separator != "\t" else r" *\t *")
    return lambda text: [cell.strip("\"' ") for cell in pattern.split(text)]


def _place(column: str | int, header: Sequence[str]) -> int:
    """Number of a column, from 0."""
    if isinstance(column, int):
        if column > len(header):
            raise refusal("no such column", value=column, allowed=f"1 to {len(header)}")
        return column - 1
    if column.strip() not in header:
        what = "no column of this name in the first line of the file"
        raise refusal(what, value=column, allowed=f"a name there, or the number of a column, 1 to {len(header)}")
    return header.index(column.strip())


def _numbers(cells: Sequence[str], chosen: Sequence[int]) -> tuple[float, ...] | None:
    try:
        return tuple(float(cells[i]) for i in chosen)
    except (ValueError, IndexError):
        return None
