"""Entries of the bulk data of Nastran decks: free, small and large fields, continuation lines, INCLUDE."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

from .content import FileLine, FileProblems, Include

_EXPONENT = re.compile(r"(?<=[0-9.])([+-])")
_HM_NAME = re.compile(r'\$HMNAME\s+PROP\s+(\d+)\s*"([^"]+)"')
_ANSA_NAME = re.compile(r"\$ANSA_NAME_COMMENT;(\d+);P(?:SOLID|SHELL);([^;]+);?")
_STARTS: Final = (
    re.compile(
        r"(?:GRID|CTETRA|CHEXA|CPENTA|CPYRAM|CQUAD4|CTRIA3|CORD[12][RCS]|PSOLID|PSHELL|MAT1|PARAM|SPC1?|RBE[23]|CONM2)"
        r"\*?[\s,]"
    ),
    re.compile(r"(?:SOL\s+\d|CEND\b|BEGIN[\s,]+BULK|NASTRAN\s|ASSIGN\s|ID\s+\S)"),
)
"""First words of lines that only a Nastran deck has."""
REMEDY: Final = "let the preprocessor write the entries one by one"


@dataclass
class BulkEntry:
    """One entry: its name and fields, with the line it starts on."""

    fields: list[str]
    place: FileLine

    @property
    def name(self) -> str:
        """Name of the entry, in capitals."""
        return self.fields[0]

    def text(self, i: int) -> str:
        """Field ``i``, empty where there is none; the name is field 0."""
        if i < len(self.fields):
            return self.fields[i]
        return ""

    def whole(self, i: int) -> int:
        """Field ``i`` as a whole number, 0 where it is blank."""
        return int(self.text(i) or 0)

    def number(self, i: int) -> float:
        """Field ``i`` as a number, 0 where it is blank."""
        return number(self.text(i))


@dataclass
class Entries:
    """Entries of a deck in order, and the names that comments of preprocessors give to properties."""

    problems: FileProblems
    items: list[BulkEntry] = field(default_factory=list)
    names: dict[int, str] = field(default_factory=dict)
    _waiting: dict[str, BulkEntry] = field(default_factory=dict)

    def read(self, text: str, include: Include, depth: int = 0) -> None:
        """Add the entries of a text."""
        # a continuation without a mark belongs to the entry before it, in this file
        entry: BulkEntry | None = None
        for line_number, raw in _bulk_lines(text):
            if raw[:1] == "$":
                self._name(raw)
                continue
            # columns count after tabs
            line = raw.split("$")[0].rstrip().expandtabs(8)
            word = line.upper()
            if not line:
                continue
            if word.startswith("ENDDATA"):
                break
            if word.startswith("INCLUDE"):
                name = line[7:].strip().strip("'\"")
                with self.problems.included(name, include, depth, line_number) as inner:
                    self.read(inner, include, depth + 1)
                entry = None
            elif word.startswith("BEGIN"):
                what = "superelements are not read"
                self.problems.add(what, line, "one section BEGIN BULK", "export the whole model", line_number)
                break
            elif line[0] in "=*" and _is_copy(line):
                what = "an entry made of the one before it is not read"
                self.problems.add(what, line, None, REMEDY, line_number)
            else:
                entry = self._line(line, entry, line_number)

    def _name(self, comment: str) -> None:
        """Take the name of a property from a comment of a preprocessor."""
        for pattern in (_HM_NAME, _ANSA_NAME):
            if match := pattern.match(comment):
                # within 64 bits
                self.names[int(match[1][:18])] = match[2].strip()

    def _line(self, line: str, entry: BulkEntry | None, line_number: int) -> BulkEntry | None:
        """Take a line: the entry that goes on after it."""
        fields, after = _fields(line)
        # a continuation begins with a mark, a blank or, in free form, an empty field
        if line[0] in "+* ,":
            mark = fields[0].strip("+* ")
            if mark:
                entry = self._waiting.pop(mark, entry)
            if entry is None:
                return None
            entry.fields.extend(fields[1:])
        else:
            # meshio 5.3 writes CTETRA_ and CHEXA_ for quadratic cells
            entry = BulkEntry([fields[0].upper().rstrip("*_"), *fields[1:]], FileLine(self.problems.where, line_number))
            self.items.append(entry)
        if after:
            self._waiting[after] = entry
        return entry


def is_nastran(text: str) -> bool:
    """Whether a text is the deck of a Nastran: of the first lines that are no comments, one has a word of it."""
    lines = [line.upper() for line in text[:20_000].splitlines() if line.strip() and line[0] not in "$*#"]
    return any(start.match(line) for line in lines[:200] for start in _STARTS)


def _bulk_lines(text: str) -> list[tuple[int, str]]:
    """Numbered lines of the bulk data: all of them where the deck has no BEGIN BULK."""
    lines = list(enumerate(text.splitlines(), 1))
    for index, (_, line) in enumerate(lines):
        if line[:5].upper() == "BEGIN" and " ".join(line.upper().replace(",", " ").split()).startswith("BEGIN BULK"):
            return lines[index + 1 :]
    return lines


def _is_copy(line: str) -> bool:
    """Whether a line repeats the entry before it (``=``, ``*1``), and is no continuation in large fields."""
    if "," in line:
        first = line.split(",")[0].strip()
    else:
        first = line[:8].strip()
    return first.startswith("=")


def _fields(line: str) -> tuple[list[str], str]:
    """The fields of a line, name or mark of continuation first, and the mark with which it goes on."""
    if "," in line:
        fields = [f.strip() for f in line.split(",")]
        if fields[0].endswith("*"):
            count = 5
        else:
            count = 9
        if len(fields) > count:
            after = fields[count]
        else:
            after = ""
        return [*fields, *[""] * count][:count], after.strip("+* ")
    first = line[:8].strip()
    # large fields are marked by a star, on continuations in the first column
    if first.endswith("*") or line[:1] == "*":
        width = 16
    else:
        width = 8
    if width == 16:
        count = 4
    else:
        count = 8
    fields = [first, *(line[8 + i * width : 8 + (i + 1) * width].strip() for i in range(count))]
    return fields, line[72:80].strip("+* ")


def label_of(value: int) -> int:
    """A label, which is above 0 and within 64 bits, sums and differences, too (ValueError else)."""
    if not 0 < value < 2**62:
        raise ValueError("not a label")
    return value


def number(text: str) -> float:
    """A number as Nastran writes it: ``1.5-3`` is 1.5e-3, ``1.D0`` is 1; 0 for a blank field."""
    if not text:
        return 0.0
    try:
        return float(text)
    except ValueError:
        # an exponent without E: a sign after a digit or point; with one, the sign alone first, so that it is found
        # alike
        return float(_EXPONENT.sub(r"e\1", text.upper().replace("D", "E").replace("E+", "+").replace("E-", "-")))
