"""Cards of Abaqus and CalculiX decks: keywords with their parameters and data lines, also those of other files."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from .content import Array, FileProblems, Include, Index
from .deck_card import Card, real

_DATA: Final = frozenset(
    {
        *("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "SYSTEM", "NGEN", "NFILL", "ELGEN", "NCOPY", "INSTANCE"),
        *("ELASTIC", "DENSITY", "TIE", "BOUNDARY", "TRANSFORM", "CONTACT PAIR"),
        *("AMPLITUDE", "CLOAD", "DLOAD", "DSLOAD", "TEMPERATURE", "INITIAL CONDITIONS"),
    }
)
"""Keywords whose data lines are read, from another file, too (INPUT=)."""
_OF_TWO_WORDS: Final = {
    words.replace(" ", ""): words
    for words in (
        *("END STEP", "SOLID SECTION", "CONTACT PAIR", "SURFACE INTERACTION", "SURFACE BEHAVIOR", "INITIAL CONDITIONS"),
        *("NODE PRINT", "EL PRINT", "CONTACT PRINT", "NODE FILE", "EL FILE", "CONTACT FILE", "NODE OUTPUT"),
        *("PRE-TENSION SECTION", "RIGID BODY", "TIME POINTS", "END PART", "END ASSEMBLY", "END INSTANCE"),
    )
}
"""Keywords that CalculiX also reads without their blank."""


def cards(text: str, include: Include, problems: FileProblems) -> Iterator[Card]:
    """The cards of a deck in order; lines of included files stand in the place of their *INCLUDE, in the middle of the
    data lines of a card, too."""
    card: Card | None = None
    for line, number in _lines(text, include, problems, 0):
        if line.startswith("*"):
            if card is not None:
                yield _with_input(card, include, problems)
            card = _card(line, problems.where, number)
        elif card is not None:
            card.add(line, problems.where, number)
        else:
            problems.add("text before the first keyword", None, "a line that starts with *", line=number)
            return
    if card is not None:
        yield _with_input(card, include, problems)


def is_abaqus(text: str) -> bool:
    """Whether a text is a deck of Abaqus or CalculiX: its first lines are comments, then a keyword that one has."""
    lines = [line.strip().upper() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("**")]
    if lines:
        word = lines[0].lstrip("*").split(",")[0].strip()
    else:
        word = ""
    return bool(lines) and lines[0].startswith("*") and word in (*_DATA, "HEADING", "PART", "INCLUDE", "PREPRINT")


def _lines(text: str, include: Include, problems: FileProblems, depth: int) -> Iterator[tuple[str, int]]:
    """Keyword lines, each whole, and data lines with their numbers, without comments."""
    keyword, start = "", 0
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        if not line or line.startswith("**"):
            continue
        if keyword:  # a keyword line that goes on
            keyword += line
        elif line.startswith("*"):
            keyword, start = line, number
        else:
            yield raw, number
            continue
        if not keyword.endswith(","):
            yield from _keyword_line(keyword, start, include, problems, depth)
            keyword = ""
    if keyword:
        yield from _keyword_line(keyword, start, include, problems, depth)


def _keyword_line(
    line: str, number: int, include: Include, problems: FileProblems, depth: int
) -> Iterator[tuple[str, int]]:
    """A keyword line; for *INCLUDE, the lines of that file."""
    card = _card(line, problems.where, number)
    if card.keyword != "INCLUDE":
        yield line, number
        return
    with problems.included(card.name("INPUT"), include, depth, number) as text:
        yield from _lines(text, include, problems, depth + 1)


def _card(line: str, where: str, number: int) -> Card:
    """A keyword line taken apart."""
    first, *rest = line.rstrip(",").split(",")
    parameters = {}
    for item in rest:
        key, _, value = item.partition("=")
        parameters[key.strip().upper()] = value.strip().strip('"')
    keyword = " ".join(first.lstrip("*").upper().split())
    return Card(_OF_TWO_WORDS.get(keyword, keyword), parameters, where, number)


def _with_input(card: Card, include: Include, problems: FileProblems) -> Card:
    """The card with the data lines of the file that its parameter INPUT names, before its own."""
    if card.keyword not in _DATA or "INPUT" not in card.parameters:
        return card
    whole = Card(card.keyword, card.parameters, card.where, card.line)
    name = card.name("INPUT")
    with problems.included(name, include, 0, card.line) as text:
        for number, raw in enumerate(text.splitlines(), 1):
            line = raw.strip()
            if line.startswith("*") and not line.startswith("**"):
                problems.add("a file of data lines holds a keyword", line, "data lines alone", line=number)
            elif line and not line.startswith("*"):
                whole.add(raw, problems.where, number)
    for row, where, line_number in zip(card.rows, card.files, card.lines, strict=True):
        whole.add(row, where, line_number)
    return whole


def nodes_of(card: Card, problems: FileProblems) -> tuple[Index, Array]:
    """Labels (n,) and coordinates (n, 3) of a *NODE card as written; missing coordinates are 0."""
    labels, coordinates = [], []
    for i, fields in card.tokens():
        try:
            label = int(fields[0])
            values = [real(f) for f in fields[1:4]]
        except (ValueError, IndexError):
            problems.add("not a node", card.rows[i].strip(), "label, x, y, z", line=card.row_place(i))
            continue
        # sums and differences of labels stay within 64 bits
        if not 0 < label < 2**62:
            problems.add("not a node label", label, "a positive integer", line=card.row_place(i))
            continue
        labels.append(label)
        coordinates.append([*values, 0.0, 0.0, 0.0][:3])  # planar parts, too
    return np.array(labels, dtype=np.int64), np.array(coordinates, dtype=float).reshape(-1, 3)


def elements_of(card: Card, count: int, corners: int, problems: FileProblems) -> tuple[Index, Index]:
    """Labels (n,) and node labels (n, count) of an *ELEMENT card.

    An element begins on a line of its own and may take several. A middle node may be 0: it is not there. ``corners`` :
    number of nodes that have to be there.
    """
    none = np.zeros(0, dtype=np.int64), np.zeros((0, count), dtype=np.int64)
    values: list[list[int]] = []
    element: list[int] = []
    i = 0
    for i, fields in card.tokens():
        try:
            numbers = [int(f or "0") for f in fields]
        except ValueError:
            numbers = [-1]
        if any(not 0 <= v < 2**62 for v in numbers):
            allowed = "label and nodes, positive integers"
            problems.add("not an element", ", ".join(fields), allowed, line=card.row_place(i))
            return none
        element += numbers
        if len(element) > count + 1:
            break
        if len(element) == count + 1:
            values.append(element)
            element = []
    if element:
        kind = card.name("TYPE")
        what = f"elements of type {kind} take a label and {count} nodes each, every element on lines of its own"
        # the line after which there are too many of them, or the last one
        problems.add(what, f"{len(element)} numbers", f"{count + 1} numbers", line=card.row_place(i))
        return none
    table = np.array(values, dtype=np.int64).reshape(-1, count + 1)
    missing = (table[:, : corners + 1] == 0).any(axis=1)
    if missing.any():
        allowed = "label and corners, positive integers"
        problems.add("not an element", ", ".join(map(str, values[int(missing.argmax())])), allowed, line=card.place)
        return none
    return table[:, 0], table[:, 1:]
