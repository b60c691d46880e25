"""Columns of numbers from text files, and the units that they may have there.

Columns are separated by a semicolon, a tab, a comma or blanks, whichever the first line of numbers has, in this order
of preference; numbers have a decimal point, or all a decimal comma. Blank lines and lines that start with # do not
count; the lines above the first number are the header. Files are in UTF-8, in UTF-16 or in Latin-1. Text of a file is
quoted in messages only where it heads a column of numbers: a file that is no table may hold anything.
"""

import csv
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import BeforeValidator

from ..errors import did_you_mean
from .fields import refusal
from .unit_texts import DENSITY, names_for, si_unit, unit_size, words_for
from .units import SI, UnitSystem

MAX_FILE_BYTES: Final = 500_000_000
_TWO_COLUMNS = "two columns, time and value, separated by a comma, semicolon, tab or blank"
_LARGEST_FACTOR = 1e300
MULTIPLIED: Final = ("N", "N m", "Pa", "m", "m s-1", "m s-2", "N m-3", "K", "rad s-1", "1")
"""Units (UDUNITS, SI) of what laws multiply, and of their own values."""


def factor(unit: Any, system: UnitSystem = SI) -> float:
    """Factor to the units of a scene of a unit, by its name or the factor itself; 1 for what is none."""
    if isinstance(unit, str):
        base = si_unit(unit)
        size = None
        if base is not None:
            size = unit_size(unit, base)
        if base is None or size is None:
            return 1.0
        return float(size / system.exact_size(base))
    if isinstance(unit, int | float):
        return float(unit)
    return 1.0


def unit_problem(name: str, unit: str) -> str | None:
    """What is wrong with a text as a unit of the dimension of one of SI; None where nothing is."""
    if unit_size(name, unit) is not None:
        return None
    base = si_unit(name)
    if base is None:
        return "unknown unit"
    return f"a unit of {words_for(base)}, not of {words_for(unit)}"


def _check_unit(value: object, *units: str) -> object:
    """A unit by its name, of the dimension of one of these of SI, or a factor."""
    names = ", ".join(names_for(unit) for unit in units)
    if isinstance(value, str):
        if any(unit_size(value, unit) is not None for unit in units):
            return value
        what, remedy = unit_problem(value, units[0]), did_you_mean(value, names.split(", "))
        if len(units) != 1:
            what = "unknown unit"
    else:
        if isinstance(value, int | float) and not isinstance(value, bool) and 0 < abs(value) <= _LARGEST_FACTOR:
            return float(value)
        what, remedy = "not a unit", None
    raise refusal(
        str(what), value=value, allowed=f"{names}, or the factor to the units of the scene, a number", remedy=remedy
    )


def is_column(value: object) -> bool:
    """Whether a value names a column: a text, or a number from 1."""
    if isinstance(value, str):
        return bool(value.strip())
    return type(value) is int and value >= 1


def _check_column(value: object) -> object:
    if is_column(value):
        return value
    raise refusal("not a column", value=value, allowed="the name in the header, or the number of the column, from 1")


Column = Annotated[str | int, BeforeValidator(_check_column)]
TimeUnit = Annotated[str | float, BeforeValidator(lambda value: _check_unit(value, "s"))]
ValueUnit = Annotated[str | float, BeforeValidator(lambda value: _check_unit(value, *MULTIPLIED))]
AccelerationUnit = Annotated[str | float, BeforeValidator(lambda value: _check_unit(value, "m s-2"))]
DensityUnit = Annotated[str | float, BeforeValidator(lambda value: _check_unit(value, DENSITY))]
LengthUnit = Annotated[str | float, BeforeValidator(lambda value: _check_unit(value, "m"))]
SPECTRAL: Final = ("m s-2", "m s-1", "m")
"""Units (UDUNITS) of what shock response spectra are of."""
SpectralUnit = Annotated[str | float, BeforeValidator(lambda value: _check_unit(value, *SPECTRAL))]
SpeedUnit = Annotated[str | float, BeforeValidator(lambda value: _check_unit(value, "m s-1"))]


MOST_HEADER_LINES: Final = 200
_LONGEST_NAME = 40  # characters of the name of a column in messages
_MOST_NAMES = 12


@dataclass(frozen=True)
class NumberTable:
    """Columns of a file of numbers.

    Attributes
    ----------
    header : cells of the lines above the numbers. width : number of cells in the first line of numbers.
    places : of the columns, from 0. rows : numbers of every line. decimal_comma : whether they are written with one.
    lines : numbers of the lines of these rows in the file, from 1.
    """

    header: tuple[tuple[str, ...], ...]
    width: int
    places: tuple[int, ...]
    rows: list[tuple[float, ...]]
    decimal_comma: bool
    lines: list[int]


def read_columns(base_dir: Path, name: str, columns: Sequence[str | int] | None = None) -> list[tuple[float, ...]]:
    """The rows of a file of numbers; parameters and refusals as of ``number_table``."""
    return number_table(base_dir, name, columns).rows


def number_table(base_dir: Path, name: str, columns: Sequence[str | int] | None = None) -> NumberTable:
    """Columns of a file of numbers with its header, which ends above the first number in the first of the columns.

    columns : names in the header or numbers from 1; None: the file has two columns.

    Raises the refusal of the field that names the file.
    """
    lines = table_cells(base_dir, name)
    header: list[tuple[str, ...]] = []
    first = None
    for number, cells in lines:
        places = _places(columns, header)
        if places is not None and places[0] < len(cells) and number_in(cells[places[0]]) is not None:
            first = number, cells
            break
        header.append(tuple(cells))
        if len(header) > MOST_HEADER_LINES:
            break
    if first is None:
        return _without_numbers(columns, header)
    places = _check_places(columns, header, first)
    rows, commas, numbers = _rows(chain([first], lines), columns, places)
    return NumberTable(tuple(header), len(first[1]), places, rows, commas, numbers)


def _rows(
    lines: Iterator[tuple[int, list[str]]], columns: Sequence[str | int] | None, places: tuple[int, ...]
) -> tuple[list[tuple[float, ...]], bool, list[int]]:
    """Numbers of every line, whether they have decimal commas, and the numbers of the lines."""
    rows: list[tuple[float, ...]] = []
    read: list[int] = []
    points = commas = False
    if columns is None:
        wanted = _TWO_COLUMNS
    else:
        wanted = f"finite numbers in columns {listed_places(places)}"
    if columns is None:
        many = "two"
    else:
        many = str(len(places))
    for number, cells in lines:
        row = None
        if columns is not None or len(cells) == 2:
            row = _numbers(cells, places)
        if row is None or not all(map(math.isfinite, row)):
            wrong = next((repr(n) for n in row or () if not math.isfinite(n)), None)
            raise refusal(f"line {number} is not {many} finite numbers", value=wrong, allowed=wanted)
        commas = commas or any("," in cells[i] for i in places)
        points = points or any("." in cells[i] for i in places)
        if commas and points:
            what = f"decimal points and decimal commas are mixed (line {number})"
            raise refusal(what, allowed="one of them in all numbers, and no separators of thousands")
        rows.append(row)
        read.append(number)
    return rows, commas, read


def listed_places(places: Sequence[int]) -> str:
    """Numbers of columns, from 1, in words."""
    return ", ".join(str(place + 1) for place in places)


def _places(columns: Sequence[str | int] | None, header: Sequence[Sequence[str]]) -> tuple[int, ...] | None:
    """Numbers of the columns, from 0; None where a name is in no line of the header."""
    if columns is None:
        return 0, 1
    found = [c - 1 if isinstance(c, int) else _place_of(c, header) for c in columns]
    if None in found:
        return None
    return tuple(place for place in found if place is not None)


def _place_of(name: str, header: Sequence[Sequence[str]]) -> int | None:
    """Number of the column with a name, from 0, by the last line of the header that has it."""
    line = next((line for line in reversed(header) if name.strip() in line), None)
    if line is None:
        return None
    return line.index(name.strip())


def _check_places(
    columns: Sequence[str | int] | None, header: Sequence[Sequence[str]], first: tuple[int, Sequence[str]]
) -> tuple[int, ...]:
    """Numbers of the columns, from 0; ``first`` : number and cells of the first line of numbers."""
    places = _places(columns, header)
    assert places is not None
    number, width = first[0], len(first[1])
    if columns is None and width > 2:
        # the whole table, so that its names may be quoted
        what = f"line {number} is not two finite numbers: the file has {width} columns"
        remedy = "name the columns (time_column, column)"
        if header and width == 2 * len(header[-1]):
            remedy = "decimal commas between commas cannot be told apart: save with semicolons, or with decimal points"
        raise refusal(what, value=column_names(header, width) or None, allowed=_TWO_COLUMNS, remedy=remedy)
    for column, place in zip(columns or (), places, strict=False):
        if isinstance(column, int) and place >= width:
            raise refusal("no such column", value=column, allowed=f"1 to {width}")
        line = next((line for line in reversed(header) if isinstance(column, str) and column.strip() in line), ())
        if line and line.count(str(column).strip()) > 1:
            what = "several columns have this name"
            raise refusal(what, value=column, allowed=f"the number of the column, 1 to {width}")
    return places


def column_names(header: Sequence[Sequence[str]], width: int) -> str:
    """Names of the columns of a table of a width, with their numbers; empty where its header has none."""
    names = next((line for line in reversed(header) if 1 < len(line) <= width), ())
    shown = [f'{i} "{name[:_LONGEST_NAME]}"' for i, name in enumerate(names, 1) if name]
    return ", ".join([*shown[:_MOST_NAMES], *(["..."] if len(shown) > _MOST_NAMES else [])])


def _without_numbers(columns: Sequence[str | int] | None, header: Sequence[tuple[str, ...]]) -> NumberTable:
    """An empty table, or the reason why a file with lines is none."""
    named = [c for c in columns or () if isinstance(c, str) and _place_of(c, header) is None]
    first = next((i for i, line in enumerate(header) if number_in(line[0]) is not None), None)
    if named and header:
        width = len(header[0 if first is None else first])
        if first is None:
            names = ""
        else:
            names = column_names(header[:first], width)
        what = "no column of this name in the lines above the numbers"
        allowed = f"{names or 'a name there'}, or the number of a column, 1 to {width}"
        raise refusal(what, value=named[0], allowed=allowed)
    if len(header) > 1:
        if columns is None:
            place = "in the first column"
        else:
            place = f"in column {columns[0]}"
        if len(header) > MOST_HEADER_LINES:
            lines = f"the first {MOST_HEADER_LINES} lines"
        else:
            lines = f"{len(header)} lines"
        raise refusal(f"no numbers {place} of {lines}", allowed=_TWO_COLUMNS)
    return NumberTable(tuple(header), 0, (0, 1), [], False, [])


_COMMA: Final = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
_NUMBER_FIRST: Final = re.compile(r"[\"']?[-+\u2212]?[.,]?\d")


def number_in(cell: str) -> float | None:
    """The number of a cell, with a decimal point or a decimal comma; None where it is none."""
    text = cell.replace("\u2212", "-")
    try:
        return float(text)
    except ValueError:
        if _COMMA.fullmatch(text):
            return float(text.replace(",", "."))
        return None


def table_cells(base_dir: Path, name: str) -> Iterator[tuple[int, list[str]]]:
    """Number, from 1, and cells of every line of a table that counts, its header among them.

    Raises the refusal of the field that names the file.
    """
    lines = _lines(file_text(base_dir, name))
    head = list(islice(lines, MOST_HEADER_LINES + 1))
    if head:
        split = _splitter([line for _, line in head])
        for number, line in chain(head, lines):
            yield number, split(line)


def file_text(base_dir: Path, name: str) -> str:
    """Text of a file in UTF-8, UTF-16 or Latin-1.

    Raises the refusal of the field that names the file.
    """
    try:
        return _decoded(file_content(base_dir, name))
    except UnicodeDecodeError:
        raise refusal("not a text file", value=name, allowed=_TWO_COLUMNS) from None


def file_content(base_dir: Path, name: str) -> bytes:
    """Bytes of a file.

    Raises the refusal of the field that names the file.
    """
    try:
        path = base_dir / name
        # reading a pipe may never return
        if path.exists() and not path.is_file():
            raise refusal("not a regular file", value=name, allowed="a file, no device, pipe or folder")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise refusal("the file is too large", value=name, allowed=f"at most {MAX_FILE_BYTES} bytes")
        return path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        if base_dir != Path():
            where = "the scene file"
        else:
            where = "the current folder"
        raise refusal("the file does not exist", value=name, remedy=f"file names are relative to {where}") from None
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and error.strerror:
            reason = error.strerror
        else:
            reason = str(error)
        raise refusal(f"the file cannot be read ({reason})", value=name) from None


_BINARY: Final = frozenset((*range(9), *range(14, 26), *range(27, 32)))  # bytes that no text has


def _decoded(content: bytes) -> str:
    """Text of a file whose encoding is that of its byte order mark, else UTF-8 or, where it is not, Latin-1."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16")
    head = content[:4096]
    # without a mark: every other byte of Latin text is 0
    for odd, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        if len(head) > 3 and head[odd::2].count(0) > 0.9 * (len(head) // 2) and not head[1 - odd :: 2].count(0):
            return content.decode(encoding)
    try:
        # -sig: spreadsheets write a byte order mark
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        if not _BINARY.isdisjoint(content):
            raise
        return content.decode("latin-1")


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Numbers, from 1, and texts of the lines that count."""
    for number, line in enumerate(text.splitlines(), 1):
        # tabs at the end separate cells that are empty
        stripped = line.strip()
        if stripped and not stripped.startswith("#"):
            yield number, line.strip(" ") if "\t" in line else stripped


def _words(text: str) -> list[str]:
    """Cells between blanks; a unit in brackets belongs to the name before it."""
    if "[" in text or "(" in text:
        return _WORDS.findall(text)
    return text.split()


def _splitter(lines: Sequence[str]) -> Any:
    """Function from a line to its cells, by the separator that the first line of numbers has; empty cells at the end
    are left out."""
    line = next((line for line in lines if _NUMBER_FIRST.match(line)), lines[0])
    separator = next((s for s in ";\t," if s in line), None)
    between = line.split()
    # numbers with decimal commas, separated by blanks
    if separator == "," and len(between) > 1 and all(number_in(cell) is not None for cell in between):
        separator = None
    if separator is None:
        return _words
    pattern = re.compile(rf"\s*{separator}\s*")
    if separator == "\t":
        pattern = re.compile(r" *\t *")

    def cells(text: str) -> list[str]:
        if '"' in text:
            found = next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])
        else:
            found = pattern.split(text)
        texts = [cell.strip("\"' ") for cell in found]
        while len(texts) > 1 and not texts[-1]:
            texts.pop()
        return texts

    return cells


_WORDS: Final = re.compile(r"\S+(?:\s+[\[(][^\])]*[\])])?")


def _numbers(cells: Sequence[str], chosen: Sequence[int]) -> tuple[float, ...] | None:
    try:
        return tuple(float(cells[i]) for i in chosen)
    except (ValueError, IndexError):
        found = [number_in(cells[i]) if i < len(cells) else None for i in chosen]
        if None in found:
            return None
        return tuple(number for number in found if number is not None)
