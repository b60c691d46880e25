"""Changes of input at random: of text with its numbers and sections, of bytes, of nested tables, of zip archives."""

from __future__ import annotations

import copy
import io
import re
import struct
import warnings
import zipfile
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

Rng = np.random.Generator
Change = Callable[[bytes, Rng], bytes]

_NUMBER = re.compile(rb"(?<![A-Za-z_])-?\d+(?:\.\d*)?(?:[eEdD][+-]?\d+)?")
NUMBERS = (
    b"0",
    b"1",
    b"-1",
    b"2",
    b"-2147483649",
    b"4294967295",
    b"9999999999",
    b"99999999999999999999",
    b"9" * 5000,
    b"nan",
    b"inf",
    b"-inf",
    b"1e400",
    b"-1e400",
    b"1e300",
    b"1e-320",
    b"1e38",
    b"0.5",
    b"0x10",
    b"1_0",
    b"",
    b"-",
    b"1 2",
    b"1,2",
    "\N{ARABIC-INDIC DIGIT THREE}".encode(),
    "\N{SUPERSCRIPT TWO}".encode(),
)
PIECES = (
    b"",
    b"\n",
    b"\r",
    b"\n\n\n",
    b"\0",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    "\N{EURO SIGN}\N{GRINNING FACE}".encode(),
    b"\x1b[31m",
    b"[",
    b"]",
    b"[[",
    b"{",
    b"}",
    b'"',
    b"'",
    b'"""',
    b"=",
    b",",
    b";",
    b"#",
    b"*",
    b"$",
    b"<",
    b">",
    b"&",
    b"<!--",
    b"..",
    b"/",
    b"%s%n",
    b"true",
    b"x" * 300,
    b" " * 300,
    b"[" * 3000,
)


def _pick(rng: Rng, items: Sequence[Any]) -> Any:
    return items[int(rng.integers(len(items)))]


def _few(rng: Rng) -> int:
    return int(rng.choice([1, 1, 1, 1, 2, 3]))  # one change mostly: two together are refused for the first of them


def _span(rng: Rng, size: int, longest: int) -> tuple[int, int]:
    start = int(rng.integers(size + 1))
    return start, min(size, start + int(rng.integers(longest)))


def _cut(content: bytes, rng: Rng) -> bytes:
    return content[: int(rng.integers(len(content) + 1))]


def _overwrite(content: bytes, rng: Rng, pieces: Sequence[bytes] = PIECES) -> bytes:
    start, stop = _span(rng, len(content), 12)
    return content[:start] + _pick(rng, pieces) + content[stop:]


def _numbers(content: bytes) -> list[re.Match[bytes]]:
    return list(_NUMBER.finditer(content[:50_000]))


def _other_number(content: bytes, rng: Rng) -> bytes:
    if not (matches := _numbers(content)):
        return content
    hit = _pick(rng, matches)
    return content[: hit.start()] + _pick(rng, NUMBERS) + content[hit.end() :]


def _swapped_numbers(content: bytes, rng: Rng) -> bytes:
    if not (matches := _numbers(content)):
        return content
    first, second = sorted((_pick(rng, matches) for _ in range(2)), key=lambda m: m.start())
    if first.start() == second.start():
        return content
    middle = content[first.end() : second.start()]
    return content[: first.start()] + second[0] + middle + first[0] + content[second.end() :]


def _lines(content: bytes, rng: Rng) -> bytes:
    """Lines dropped, repeated, moved, cut short or joined."""
    lines = content.split(b"\n")
    first, last = _span(rng, len(lines), 6)
    block, kind = lines[first:last], int(rng.integers(5))
    if kind == 0:
        lines[first:last] = []
    elif kind == 1:
        lines[first:last] = block * int(rng.integers(2, 5))
    elif kind == 2:
        del lines[first:last]
        at = int(rng.integers(len(lines) + 1))
        lines[at:at] = block
    elif kind == 3:
        lines[first:last] = [line[: int(rng.integers(len(line) + 1))] for line in block]
    else:
        lines[first:last] = [b" ".join(block)]
    return b"\n".join(lines)


def _sections(content: bytes, rng: Rng) -> bytes:
    """A section, from one keyword line to another, repeated, dropped or put elsewhere."""
    starts = [m.start() for m in re.finditer(rb"(?m)^[$*\[<A-Z]", content)]
    if len(starts) < 2:
        return content
    first, second = sorted(_pick(rng, starts) for _ in range(2))
    section, rest = content[first:second], content[:first] + content[second:]
    at = int(rng.integers(len(rest) + 1))
    return _pick(
        rng, [rest, content + section, rest[:first] + section * 2 + rest[first:], rest[:at] + section + rest[at:]]
    )


_TEXT: tuple[Change, ...] = (
    _cut,
    _overwrite,
    _overwrite,
    _other_number,
    _other_number,
    _swapped_numbers,
    _lines,
    _sections,
)


def text(content: bytes, rng: Rng) -> bytes:
    """One change of a text or a few, most of them of a number, a line or a section."""
    for _ in range(_few(rng)):
        content = _pick(rng, _TEXT)(content, rng)
    return content


_WORDS = (0, 1, 0xFF, 0x7FFFFFFF, 0xFFFFFFFF, 0x7FF0000000000000, 0x7FF8000000000001, 0xFFFFFFFFFFFFFFFF, 1 << 40)


def _bits(content: bytes, rng: Rng) -> bytes:
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 4))):
        if data:
            data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
    return bytes(data)


def _word(content: bytes, rng: Rng) -> bytes:
    """Four or eight bytes become another number: counts, offsets, values."""
    size = 4 if rng.random() < 0.5 else 8
    at = int(rng.integers(max(1, len(content) - size + 1)))
    order = "little" if rng.random() < 0.7 else "big"
    value = _pick(rng, _WORDS) % (1 << (8 * size))
    return content[:at] + value.to_bytes(size, order) + content[at + size :]


def _moved(content: bytes, rng: Rng) -> bytes:
    start, stop = _span(rng, len(content), 200)
    at = int(rng.integers(len(content) + 1))
    return content[:at] + content[start:stop] + content[at:]


_BINARY: tuple[Change, ...] = (_cut, _bits, _bits, _word, _word, _moved, _overwrite)


def binary(content: bytes, rng: Rng) -> bytes:
    """One change of bytes or a few."""
    for _ in range(_few(rng)):
        content = _pick(rng, _BINARY)(content, rng)
    return content


def either(content: bytes, rng: Rng) -> bytes:
    """Changes of text or of bytes: of text mostly where the file is one."""
    plain = b"\0" not in content
    return (text if rng.random() < (0.9 if plain else 0.3) else binary)(content, rng)


VALUES: tuple[Any, ...] = (
    None,
    True,
    0,
    -1,
    10**30,
    10**400,
    0.0,
    -0.0,
    1e308,
    5e-324,
    float("nan"),
    float("inf"),
    "",
    "x",
    "..",
    "a\0b",
    "\N{GRINNING FACE}",
    "whole",
    "input",
    [],
    {},
    [[]],
    {"": 0},
    {"type": "x"},
    [1, "a", None],
    b"bytes",
)


def places(data: Any) -> Iterator[tuple[Any, Any]]:
    """Every (container, key) of nested tables and lists."""
    for key, item in list(data.items() if isinstance(data, dict) else enumerate(data)):
        yield data, key
        if isinstance(item, dict | list):
            yield from places(item)


def _nested(depth: int) -> Any:
    value: Any = 0
    for _ in range(depth):
        value = {"a": value}
    return value


def tables(data: dict[str, Any], rng: Rng) -> dict[str, Any]:
    """An item of nested tables, or a few, removed, renamed, exchanged or of another type."""
    data = copy.deepcopy(data)
    for _ in range(_few(rng)):
        spots = list(places(data))
        if not spots:
            break
        (container, key), (other, other_key) = _pick(rng, spots), _pick(rng, spots)
        kind = int(rng.integers(8))
        if kind < 3:
            container[key] = copy.deepcopy(_pick(rng, VALUES))
        elif kind == 3:
            container[key] = copy.deepcopy(other[other_key])
        elif kind == 4:
            del container[key]
        elif kind == 5:
            container[key] = [container[key]]
        elif kind == 6 and isinstance(container, dict):
            container[_pick(rng, ["type", "x", "", str(other_key)])] = container.pop(key)
        elif isinstance(container[key], int | float):
            container[key] = container[key] * _pick(rng, [-1, 0, 1e-12, 1e12, 0.5, 3])
    if rng.random() < 0.02:
        container, key = _pick(rng, list(places(data)) or [(data, "x")])
        container[key] = _nested(3000)
    return data


def members(content: bytes) -> dict[str, bytes]:
    """Members of an archive by name."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(members: Sequence[tuple[str, bytes]], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    """An archive of members, whose names may repeat."""
    target = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(target, "w", compression) as archive:
        warnings.simplefilter("ignore")  # duplicate names are the point
        for name, content in members:
            archive.writestr(zipfile.ZipInfo(name), content)
    return target.getvalue()


def _headers(content: bytes, rng: Rng) -> bytes:
    """Fields of the central directory: flags (encryption), method, sums, sizes, offsets."""
    starts = [m.start() for m in re.finditer(b"PK\x01\x02", content)]
    if not starts:
        return content
    at = _pick(rng, starts) + _pick(rng, [6, 8, 10, 16, 20, 24, 28, 30, 34, 42])
    return (
        content[:at]
        + struct.pack("<I", _pick(rng, [0, 1, 0xFFFFFFFF, 0x10000000, 99]))[: 4 if at % 2 else 2]
        + content[at + 2 :]
    )


NAMES = (
    "../../evil",
    "/tmp/evil",
    "..\\evil",
    "C:\\evil",
    "a/../../evil",
    "evil\0x",
    "\N{GRINNING FACE}",
    "",
    "x" * 300,
)
BOMB = bytes(200_000_000)


def member(name: str, content: bytes, rng: Rng) -> bytes:
    """A member of an archive: text by its suffix, bytes otherwise."""
    return (text if name.endswith((".xml", ".json", ".toml", ".txt", ".py", ".html")) else binary)(content, rng)


def archive(part: Callable[[str, bytes, Rng], bytes]) -> Change:
    """Changes of a zip archive: members missing, doubled, renamed, changed by ``part``, huge; bytes of the archive."""

    def change(content: bytes, rng: Rng) -> bytes:
        kind = int(rng.integers(8))
        if kind == 0:
            return binary(content, rng)
        if kind == 1:
            return _headers(content, rng)
        inner = list(members(content).items())
        where = 0 if rng.random() < 0.4 else int(rng.integers(len(inner)))
        name, inside = inner[where]
        if kind == 2:
            del inner[where]
        elif kind == 3:
            inner.append((name, part(name, inside, rng)))
        elif kind == 4:
            inner[where] = (_pick(rng, NAMES) if rng.random() < 0.7 else name.upper(), inside)
        elif kind == 5 and rng.random() < 0.05:  # a second to compress
            inner[where] = (name, BOMB)
        else:
            inner[where] = (name, part(name, inside, rng))
        return packed(inner, zipfile.ZIP_DEFLATED if rng.random() < 0.7 else zipfile.ZIP_STORED)

    return change
