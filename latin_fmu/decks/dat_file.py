"""The printed results of CalculiX, ``.dat``: blocks of a title with set and time, and rows of labels and numbers.

Layout as ``ccx`` 2.20 prints it (measured; CalculiX manual, *NODE PRINT, *EL PRINT, *CONTACT PRINT): a title, a blank
line, rows. Node and element numbers take ten columns, numbers of integration points four, values 14 with seven digits.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..mesh_files.content import Array, Index


@dataclass(frozen=True)
class DatKind:
    """A kind of block.

    Attributes
    ----------
    title : what stands before the set. labels, values : number of columns of each in a row.
    """

    title: str
    labels: int
    values: int


_AT_POINTS: Final = "(elem, integ.pnt.,"
KINDS: Final[Mapping[str, DatKind]] = MappingProxyType(
    {
        "U": DatKind("displacements (vx,vy,vz)", 1, 3),
        "V": DatKind("velocities (vx,vy,vz)", 1, 3),
        "RF": DatKind("forces (fx,fy,fz)", 1, 3),
        "total RF": DatKind("total force (fx,fy,fz)", 0, 3),
        "S": DatKind(f"stresses {_AT_POINTS}sxx,syy,szz,sxy,sxz,syz)", 2, 6),
        "E": DatKind(f"strains {_AT_POINTS}exx,eyy,ezz,exy,exz,eyz)", 2, 6),
        "ME": DatKind(f"mechanical strains {_AT_POINTS}exx,eyy,ezz,exy,exz,eyz)", 2, 6),
        "ENER": DatKind(f"internal energy density {_AT_POINTS}energy)", 2, 1),
        "EVOL": DatKind("volume (element, volume)", 1, 1),
        "total EVOL": DatKind("total volume", 0, 1),
        "ELSE": DatKind("internal energy (element, energy)", 1, 1),
        "total ELSE": DatKind("total internal energy", 0, 1),
        "CF": DatKind("statistics for slave set", 0, 6),
    }
)
"""Kinds of blocks by the word of a deck; ``total`` where they are sums over a set."""
_CONTACT: Final = (
    ("total surface force (fx,fy,fz) and moment about the origin (mx,my,mz)", 6),
    ("center of gravity and mean normal", 6),
    ("moment about the center of gravity(mx,my,mz)", 3),
    ("area,  normal force (+ = tension) and shear force (size)", 3),
)
"""Lines of the statistics of a contact, with the number of their values."""
_TITLE: Final = re.compile(
    r"(?P<title>\S.*?) ?for ?(?:set (?P<target>\S+) and |all contact elements and )?time\s+(?P<time>\S+)$"
)
_SLAVE: Final = re.compile(r"statistics for slave set (\S+), master set (\S+) and time\s+(\S+)$")


@dataclass(frozen=True)
class DatBlock:
    """One block.

    Attributes
    ----------
    kind : of ``KINDS``; the title of a block that is none of them. target : set, in capitals; of a contact
    ``SLAVE/MASTER``. time : of the deck, over all its steps. labels : (n, k) of nodes, or of elements and points.
    values : (n, m); of a contact one row: force (3), moment, place, normal, moment about the place (3 each), area,
    normal and shear force.
    """

    kind: str
    target: str
    time: float
    labels: Index
    values: Array
    local: NDArray[np.bool_] | None = None


def dat_text(blocks: Iterable[DatBlock]) -> str:
    """The file of some blocks."""
    lines: list[str] = []
    for block in blocks:
        if block.kind == "CF":
            lines += _statistics(block)
            continue
        kind = KINDS[block.kind]
        lines += ["", f" {kind.title} for set {block.target} and time {fortran(block.time)}", ""]
        before = " " * (0 if kind.labels else 6)
        marked = np.zeros(len(block.values), dtype=bool) if block.local is None else block.local
        for labels, values, mark in zip(block.labels.tolist(), block.values.tolist(), marked.tolist(), strict=True):
            numbers = "".join(f"{label:{width}d}" for label, width in zip(labels, (10, 4), strict=False))
            lines.append(before + numbers + "".join(f" {value + 0.0:13.6E}" for value in values) + " L" * mark)
    return "\n".join([*lines, ""])


def _statistics(block: DatBlock) -> Iterator[str]:
    """Lines of the statistics of a contact."""
    slave, _, master = block.target.partition("/")
    yield from ("", f" statistics for slave set {slave}, master set {master} and time {fortran(block.time)}", "")
    first = 0
    for title, count in _CONTACT:
        numbers = "".join(f" {value + 0.0:13.6E}" for value in block.values[0, first : first + count].tolist())
        yield from (f"   {title}", "", f"   {numbers}", "")
        first += count


def fortran(value: float) -> str:
    """A number as Fortran's E14.7 writes it.

    >>> fortran(1.0), fortran(-2.5e-7)
    (' 0.1000000E+01', '-0.2500000E-06')
    """
    if value == 0.0:
        return " 0.0000000E+00"
    exponent = math.floor(math.log10(abs(value))) + 1
    digits = f"{abs(value) / 10.0**exponent:.7f}"
    if digits.startswith("1"):
        digits, exponent = "0.1000000", exponent + 1
    return f"{'-' if value < 0.0 else ' '}{digits}E{exponent:+03d}"


def read_dat(text: str) -> list[DatBlock]:
    """The blocks of a file of CalculiX or of ``dat_text``, in order; titles that are not known are kinds of their own.

    >>> [block] = read_dat(" displacements (vx,vy,vz) for set TIP and time  0.1E+01\\n\\n  7  1.0 0.0 -2.0E-01\\n")
    >>> block.kind, block.target, block.time, block.labels.tolist(), block.values.tolist()
    ('U', 'TIP', 1.0, [[7]], [[1.0, 0.0, -0.2]])
    """
    by_title = {"".join(kind.title.split()): word for word, kind in KINDS.items()}
    found: list[DatBlock] = []
    head: tuple[str, str, float] | None = None
    rows: list[list[str]] = []
    for line in [*text.splitlines(), " end for time 0."]:
        whole = _heading(line.strip(), by_title)
        if whole is None:
            words = line.split()
            if head is not None and words and all(_is_number(word) for word in words[: max(1, len(words) - 1)]):
                rows.append(words)
            continue
        if head is not None:
            found.append(_block(head, rows))
        head, rows = whole, []
    return found


def _heading(line: str, by_title: Mapping[str, str]) -> tuple[str, str, float] | None:
    """Kind, set and time of a line that is a title."""
    if match := _SLAVE.match(line):
        return "CF", f"{match[1]}/{match[2]}", float(match[3])
    match = _TITLE.match(line)
    if match is None:
        return None
    title = "".join(match["title"].split())
    return by_title.get(title, match["title"]), match["target"] or "", float(match["time"])


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _block(head: tuple[str, str, float], rows: list[list[str]]) -> DatBlock:
    """A block of rows of words; of unknown kinds the first words without a point are labels."""
    kind, target, time = head
    local = np.array([row[-1] == "L" for row in rows], dtype=bool)
    rows = [[word for word in row if word != "L"] for row in rows]
    if kind in KINDS and kind != "CF":
        # other tables may follow under titles that are none
        rows = [row for row in rows if len(row) == KINDS[kind].labels + KINDS[kind].values]
        local = local[: len(rows)]
    elif len({len(row) for row in rows}) > 1:
        rows = [[word for row in rows for word in row]]
    if kind in KINDS:
        count = KINDS[kind].labels
    else:
        count = 0
        while rows and count < len(rows[0]) and all("." not in row[count] for row in rows):
            count += 1
    labels = np.array([[int(word) for word in row[:count]] for row in rows], dtype=np.int64).reshape(len(rows), count)
    values = np.array([[float(word) for word in row[count:]] for row in rows], dtype=float)
    return DatBlock(kind, target, time, labels, values.reshape(len(rows), -1), local if local.any() else None)
