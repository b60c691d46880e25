"""A card of an Abaqus or CalculiX deck: a keyword with its parameters and data lines, and where they stand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field


@dataclass(frozen=True)
class FileLine:
    """A line of a file, from 1."""

    where: str
    line: int


@dataclass
class Card:
    """One keyword with its parameters and data lines.

    Attributes
    ----------
    keyword : in capitals. parameters : by name in capitals. where, line : file and line of the keyword, from 1.
    rows : data lines as written. lines, files : line and file of each of them.
    """

    keyword: str
    parameters: dict[str, str]
    where: str
    line: int
    rows: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    files: list[str] = field(default_factory=list)

    def name(self, key: str) -> str:
        """A parameter, empty where it is not given."""
        return self.parameters.get(key, "")

    @property
    def place(self) -> FileLine:
        """Where the keyword stands."""
        return FileLine(self.where, self.line)

    def row_place(self, i: int) -> FileLine:
        """Where data line ``i`` stands."""
        return FileLine(self.files[i], self.lines[i])

    def add(self, row: str, where: str, line: int) -> None:
        """Append a data line."""
        self.rows.append(row)
        self.files.append(where)
        self.lines.append(line)

    def tokens(self) -> Iterator[tuple[int, list[str]]]:
        """Number, from 0, and the fields of each data line without empty ones at its end."""
        for i, row in enumerate(self.rows):
            fields = [item.strip() for item in row.split(",")]
            while fields and not fields[-1]:
                fields.pop()
            yield i, fields


def real(field: str) -> float:
    """Number of a field as Fortran writes it, 0 where it is empty."""
    if field:
        return float(field.upper().replace("D", "E"))
    return 0.0
