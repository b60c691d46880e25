"""Abaqus and CalculiX input as text: keyword cards with their data lines, and the element types."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from .content import DEEPEST, SOLIDS, Array, FileProblems, Index

SHELL: Final = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
"""Shell, membrane, plane and surface elements by number of nodes."""

SOLID_FACES: Final = {
    4: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    6: ((0, 1, 2), (3, 5, 4), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    8: ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
}
"""Corners of the faces S1, S2, ... by number of corners of the element (Abaqus Analysis Guide)."""

_SOLID_NAME = re.compile(r"C3D(\d+)[A-Z]*")
_SHELL_NAME = re.compile(r"(?:CPS|CPE|CPEG|CAX|S|SC?AX|M3D|SFM3D|R3D|DS|STRI)(\d+)[A-Z]*")

Include = Callable[[str], str]
"""Text of a file named by *INCLUDE (MeshError where there is none)."""


@dataclass
class Card:
    """One keyword with its parameters and data lines; ``line`` counts from 1 in the file it stands in."""

    keyword: str
    parameters: dict[str, str]
    line: int
    rows: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)

    def name(self, key: str) -> str:
        """A parameter, empty where it is not given."""
        return self.parameters.get(key, "")

    def tokens(self) -> Iterator[tuple[int, list[str]]]:
        """Line number and the fields of each data line without empty ones at its end."""
        for line, row in zip(self.lines, self.rows, strict=True):
            fields = [item.strip() for item in row.split(",")]
            while fields and not fields[-1]:
                fields.pop()
            yield line, fields


def element_type(name: str) -> tuple[str, int] | None:
    """VTK name and number of nodes of an element type such as C3D8I or CPS6, None for what is neither."""
    name = name.upper()
    if (match := _SOLID_NAME.fullmatch(name)) and int(match[1]) in SOLIDS:
        return SOLIDS[int(match[1])], int(match[1])
    if (match := _SHELL_NAME.fullmatch(name)) is not None:
        count = 6 if name.startswith("STRI65") else int(match[1])  # STRI65: six nodes, five unknowns each
        return (SHELL[count], count) if count in SHELL else None
    return None


def cards(text: str, include: Include, problems: FileProblems, depth: int = 0) -> Iterator[Card]:
    """The cards of a deck in order, those of included files in their place."""
    card: Card | None = None
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("**") or not line.strip():
            continue
        if card is not None and card.keyword.endswith(","):  # a keyword line that goes on
            card.keyword += line.strip()
            continue
        if line.lstrip().startswith("*"):
            if card is not None:
                yield from _complete(card, include, problems, depth)
            card = Card(line.strip(), {}, number)
        elif card is not None:
            card.rows.append(line)
            card.lines.append(number)
        else:
            problems.add("text before the first keyword", None, "a line that starts with *", line=number)
            return
    if card is not None:
        yield from _complete(card, include, problems, depth)


def _complete(card: Card, include: Include, problems: FileProblems, depth: int) -> Iterator[Card]:
    """The card with its keyword line taken apart; for *INCLUDE, the cards of that file."""
    first, *rest = card.keyword.rstrip(",").split(",")
    card.keyword = " ".join(first.lstrip("*").upper().split())
    for item in rest:
        key, _, value = item.partition("=")
        card.parameters[key.strip().upper()] = value.strip().strip('"')
    if card.keyword != "INCLUDE":
        yield card
    elif depth >= DEEPEST:
        problems.add("files include each other too deeply", card.name("INPUT"), f"{DEEPEST} levels", line=card.line)
    else:
        name, outer = card.name("INPUT"), problems.where
        text = include(name)
        problems.where = f"{outer}, in {name}"  # lines are counted in that file now
        yield from cards(text, include, problems, depth + 1)
        problems.where = outer


def nodes_of(card: Card, problems: FileProblems) -> tuple[Index, Array]:
    """Labels (n,) and coordinates (n, 3) of a *NODE card; missing coordinates are 0."""
    labels, coordinates = [], []
    for line, fields in card.tokens():
        try:
            label = int(fields[0])
            values = [float(f.upper().replace("D", "E")) if f else 0.0 for f in fields[1:4]]
        except (ValueError, IndexError):
            problems.add("not a node", card.rows[card.lines.index(line)].strip(), "label, x, y, z", line=line)
            continue
        if not 0 < label < 2**62:
            problems.add("not a node label", label, "a positive whole number", line=line)
            continue
        labels.append(label)
        coordinates.append([*values, 0.0, 0.0, 0.0][:3])
    return np.array(labels, dtype=np.int64), np.array(coordinates, dtype=float).reshape(-1, 3)


def elements_of(card: Card, count: int, problems: FileProblems) -> tuple[Index, Index]:
    """Labels (n,) and node labels (n, count) of an *ELEMENT card; an element may take several data lines."""
    values: list[int] = []
    for line, fields in card.tokens():
        try:
            numbers = [int(f) for f in fields if f]
        except ValueError:
            numbers = [-1]
        if any(not 0 < v < 2**62 for v in numbers):
            problems.add("not an element", ", ".join(fields), "label and nodes, positive whole numbers", line=line)
            return np.zeros(0, dtype=np.int64), np.zeros((0, count), dtype=np.int64)
        values += numbers
    if len(values) % (count + 1):
        problems.add(
            f"elements of type {card.name('TYPE')} take a label and {count} nodes each",
            f"{len(values)} numbers in the block",
            f"a multiple of {count + 1}",
            line=card.line,
        )
        return np.zeros(0, dtype=np.int64), np.zeros((0, count), dtype=np.int64)
    table = np.array(values, dtype=np.int64).reshape(-1, count + 1)
    return table[:, 0], table[:, 1:]
