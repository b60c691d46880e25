"""Histories from universal files: functions of time in datasets 58, of text or binary.

A dataset stands between lines ``-1`` and begins with its number. Number 58 is a function at a point along an axis,
number 164 names the units of the file (Universal File Formats for Modal Analysis Testing, SDRC; UC-SDRL, University of
Cincinnati).
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .fields import refusal
from .number_files import Column, file_content

Array = NDArray[np.float64]

_BEGINS: Final = re.compile(rb"\s*-1[ \t]*\r?\n[ \t]*\d+")
_ENDS: Final = re.compile(rb"\r?\n? {4}-1[ \t]*(?:\r?\n|$)")
_FIRST: Final = re.compile(rb"\s*58([bB]?)\s*([\d\s]*)$")
_HEAD_LINES: Final = 11  # of dataset 58, before its numbers
_TIME: Final = 17  # type of an abscissa
_RESPONSE: Final = (0, 1)  # types of functions: general, time response
_REAL: Final = {2: ("f4", 13), 4: ("f8", 20)}  # precision and width of numbers by type of data
_COMPLEX: Final = (5, 6)
_SI: Final = {8: "m", 9: "N", 11: "m/s", 12: "m/s2", 13: "N", 15: "Pa"}  # unit by type of data
_DIRECTIONS: Final = ("", "X", "Y", "Z", "RX", "RY", "RZ")
_LONGEST_NAME: Final = 40
_MOST_NAMES: Final = 12
_MOST_VALUES: Final = 100_000_000


@dataclass(frozen=True)
class TimeFunction:
    """A function of time of a universal file.

    Attributes
    ----------
    number : among the functions of time of the file, from 1. name : first line of the dataset, or its point.
    point : node and direction, ``"2 +Z"``. time_unit, unit : as written, empty where the file names none.
    times : (n,). values : (n,).
    """

    number: int
    name: str
    point: str
    time_unit: str
    unit: str
    times: Array
    values: Array


def is_universal(base_dir: Path, name: str) -> bool:
    """Whether a file begins as a universal file does; False where there is no such file."""
    try:
        path = base_dir / name
        if not path.is_file():
            return False
        with path.open("rb") as file:
            return _BEGINS.match(file.read(400)) is not None
    except (OSError, ValueError):
        return False


def universal_history(base_dir: Path, name: str, column: Column | None) -> TimeFunction:
    """The function of time of a universal file.

    column : its number among the functions of time, from 1, or its name, or its point; None: the file has one.

    Raises the refusal of the field that names the file.
    """
    functions: list[TimeFunction] = []
    others = 0
    units = ""
    for number, lines, binary in _datasets(file_content(base_dir, name)):
        if number == 164 and lines:
            units = _units_of_file(lines[0])
        elif number == 58:
            function = _function(len(functions) + 1, lines, binary, units)
            others += function is None
            if function is not None:
                functions += [function]
    names = [f'{f.number} "{f.name[:_LONGEST_NAME]}" at {f.point}' for f in functions[:_MOST_NAMES]]
    listed = ", ".join(names) + (", ..." if len(functions) > _MOST_NAMES else "")
    if not functions:
        if others:
            value = f"{others} functions of something else"
        else:
            value = "no dataset 58"
        raise refusal("the universal file has no function of time", value=value, allowed="dataset 58, time response")
    if column is None and len(functions) > 1:
        what = f"the universal file has {len(functions)} functions of time"
        raise refusal(what, value=listed, remedy="name the one wanted: column = its number, name or point")
    if isinstance(column, int):
        if column > len(functions):
            raise refusal("no such function of time", value=column, allowed=f"1 to {len(functions)}: {listed}")
        return functions[column - 1]
    found = [f for f in functions if column is None or _plain(column) in (_plain(f.name), _plain(f.point))]
    if len(found) != 1:
        if found:
            what = "several functions of time have this name"
        else:
            what = "no function of time of this name"
        raise refusal(what, value=column, allowed=listed, remedy="name it by its number")
    return found[0]


def _plain(text: str) -> str:
    return "".join(text.split()).casefold()


def _datasets(content: bytes) -> Iterator[tuple[int, list[str], bytes | None]]:
    """Number, lines and, of a binary dataset, numbers of every dataset."""
    place = 0

    def line() -> bytes | None:
        nonlocal place
        if place >= len(content):
            return None
        end = content.find(b"\n", place)
        if end < 0:
            end = len(content)
        text = content[place:end].rstrip(b"\r")
        place = end + 1
        return text

    while (text := line()) is not None:
        if text.strip() != b"-1":
            continue
        first = line() or b""
        lines: list[str] = []
        binary = None
        match = _FIRST.match(first)
        if match and match[1]:
            sizes = [int(word) for word in match[2].split()]
            if len(sizes) < 4 or sizes[1] != 2:
                raise refusal("a binary dataset 58 in another format than IEEE", allowed="IEEE numbers")
            lines += [(line() or b"").decode("latin-1") for _ in range(min(sizes[2], _HEAD_LINES))]
            # writers count the values alone where abscissae are between them: the numbers end at the next -1
            last = _ENDS.search(content, min(place + sizes[3], len(content)))
            if last:
                end = last.start()
            else:
                end = len(content)
            binary = (b"<" if sizes[0] == 1 else b">") + content[place:end]
            place = end
        while (text := line()) is not None and text.strip() != b"-1":
            if binary is None:
                lines.append(text.decode("latin-1"))
        if first.split():
            word = first.split()[0]
        else:
            word = b""
        if word.isdigit():
            number = int(word)
        else:
            if match:
                number = 58
            else:
                number = 0
        yield number, lines, binary


def _units_of_file(line: str) -> str:
    """Units of a file in words, "SI" for metre and newton; empty where the dataset does not say."""
    code = line[:10].strip()
    if code == "1":
        return "SI"
    return line[10:30].strip() or f"units of code {code}"


def _function(number: int, lines: list[str], binary: bytes | None, units: str) -> TimeFunction | None:
    """A function of time; None of something else."""
    try:
        kind = int(lines[5][:5])
        node = int(lines[5][41:51] or 0)
        direction = int(lines[5][51:55] or 0)
        data, count, even = (int(lines[6][i : i + 10]) for i in (0, 10, 20))
        first, step = (float(lines[6][i : i + 13].replace("D", "E") or 0) for i in (30, 43))
        abscissa, ordinate = int(lines[7][:10]), int(lines[8][:10])
    except (IndexError, ValueError):
        raise refusal("a damaged dataset 58 in the universal file", value=f"function {number}") from None
    over_time = abscissa == _TIME or (abscissa == 0 and kind != 0)
    if kind not in _RESPONSE or not over_time or data in _COMPLEX:
        return None
    if data not in _REAL or not 2 <= count <= _MOST_VALUES:
        value = f"function of time {number}"
        raise refusal("a damaged dataset 58", value=value, allowed="real numbers, two or more")
    if even:
        values = _numbers(number, lines[_HEAD_LINES:], binary, data, count)
        times: Array = np.asarray(first + step * np.arange(count))
    else:
        numbers = _numbers(number, lines[_HEAD_LINES:], binary, data, 2 * count)
        times = np.asarray(numbers[::2])
        values = numbers[1::2]
    names = [_label(lines[7]), _label(lines[8])]
    time_unit = names[0] or "s"
    if units == "SI":
        units = _SI.get(ordinate, "")
    unit = names[1] or units
    if direction < 0:
        sign = "-"
    else:
        sign = "+"
    if abs(direction) < len(_DIRECTIONS):
        way = _DIRECTIONS[abs(direction)]
    else:
        way = ""
    if way:
        point = f"{node} {sign}{way}"
    else:
        point = str(node)
    title = lines[0].strip()
    return TimeFunction(number, title if title not in ("", "NONE") else point, point, time_unit, unit, times, values)


def _label(line: str) -> str:
    """Unit in the record of an axis; empty where it has none."""
    text = line[47:67].strip()
    if text.upper() in ("", "NONE"):
        return ""
    return text


def _numbers(number: int, lines: list[str], binary: bytes | None, data: int, count: int) -> Array:
    """Numbers of a function, with its abscissae where these are uneven."""
    short = refusal("a function of time with too few numbers, or damaged ones", value=f"function {number}")
    precision, width = _REAL[data]
    if binary is None:
        found = _parsed(lines, width, count)
    else:
        found = _unpacked(binary, precision, count, data)
    if found is None or not np.isfinite(found).all():
        raise short
    return found


def _unpacked(binary: bytes, precision: str, count: int, data: int) -> Array | None:
    order, content = binary[:1].decode(), binary[1:]
    pair = np.dtype([("x", f"{order}f4"), ("y", f"{order}f8")])
    # values of double precision may have abscissae of single precision
    if data == 4 and len(content) == count // 2 * pair.itemsize:
        pairs = np.frombuffer(content, dtype=pair)
        return np.stack([pairs["x"].astype(np.float64), pairs["y"]], axis=1).reshape(-1)
    kind = np.dtype(f"{order}{precision}")
    if len(content) < count * kind.itemsize:
        return None
    return np.frombuffer(content[: count * kind.itemsize], dtype=kind).astype(np.float64)


def _parsed(lines: list[str], width: int, count: int) -> Array | None:
    """Numbers between blanks, or where they touch by the width that they have."""
    try:
        words = " ".join(lines).replace("D", "E").split()
        if len(words) >= count:
            return np.array(words[:count], dtype=np.float64)
    except ValueError:
        pass
    single = 13
    # pairs of double precision: an abscissa of 13 characters and a value of 20
    for widths in ((width,), (single, width)):
        words = [word for line in lines for word in _sliced(line.replace("D", "E").rstrip(), widths)]
        try:
            if len(words) >= count:
                return np.array(words[:count], dtype=np.float64)
        except ValueError:
            continue
    return None


def _sliced(line: str, widths: tuple[int, ...]) -> Iterator[str]:
    place = index = 0
    while place < len(line):
        size = widths[index % len(widths)]
        yield line[place : place + size]
        place += size
        index += 1
