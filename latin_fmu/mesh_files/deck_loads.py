"""Nodes and faces of elements that the loads and supports of a deck name by their numbers, as sets with a name.

A line of *CLOAD or *BOUNDARY names a node set or a node, one of *DLOAD an element set or an element and a face of it
(P3). Nodes of one card that are loaded alike are a set ``CLOAD_12``, the line of the card in its name, ``CLOAD_12_2``
where they are loaded in several ways; a single node is ``NODE_7``; the faces P3 of the set ``lid`` are ``lid_P3``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from .deck_card import Card, real

NODES: Final = "nodes"
FACES: Final = "faces"
"""What a set holds."""
ON_NODES: Final = frozenset({"CLOAD", "BOUNDARY"})
ON_FACES: Final = frozenset({"DLOAD"})
"""Keywords whose lines name nodes, and faces of elements."""
NAMES_SETS: Final = ON_NODES | ON_FACES | {"INITIAL CONDITIONS", "TEMPERATURE"}
"""Keywords whose lines begin with a set."""
_REFERENCE: Final = ("REF NODE", "REFNODE", "ROT NODE", "ROTNODE")
NAMES_NODES: Final[Mapping[str, tuple[str, ...]]] = {
    "RIGID BODY": ("NSET", *_REFERENCE),
    "COUPLING": ("SURFACE", *_REFERENCE),
}
"""Parameters of keywords that name sets of nodes."""
WORDS: Final[Mapping[str, tuple[int, ...]]] = {
    "ENCASTRE": (1, 2, 3, 4, 5, 6),
    "PINNED": (1, 2, 3),
    "XSYMM": (1, 5, 6),
    "YSYMM": (2, 4, 6),
    "ZSYMM": (3, 4, 5),
    "XASYMM": (2, 3, 4),
    "YASYMM": (1, 3, 5),
    "ZASYMM": (1, 2, 6),
    "NOWARP": (),
    "NOOVAL": (),
    "NODEFORM": (),
}
"""Degrees of freedom that a word of *BOUNDARY holds (Abaqus Analysis User's Guide, boundary conditions): XSYMM is a
plane of symmetry across x, XASYMM one of antisymmetry."""


_MOST: Final = 99  # no code numbers more at a node


@dataclass(frozen=True)
class LoadedSet:
    """Nodes, or faces of elements, that one card loads or holds alike.

    Attributes
    ----------
    name : of the set in the deck, or that it is given. kind : NODES or FACES. members : numbers and faces of a set that
    the deck does not name, none of one that it does. values : by degree of freedom, or the value under ``P``.
    """

    name: str
    kind: str
    members: tuple[tuple[str, str], ...]
    values: tuple[tuple[str, float], ...]


def loaded_groups(card: Card) -> list[LoadedSet]:
    """What the lines of a card act on; lines that cannot be read, and loads of whole elements, are left out.

    >>> card = Card("CLOAD", {}, "deck.inp", 5, ["3, 1, 10.", "4, 1, 10."], [6, 7], ["deck.inp"] * 2)
    >>> [(group.name, group.members, group.values) for group in loaded_groups(card)]
    [('CLOAD_5', (('3', ''), ('4', '')), (('1', 10.0),))]
    """
    if card.keyword in ON_NODES:
        return _groups_of_nodes(card)
    if card.keyword in ON_FACES:
        return _groups_of_faces(card)
    return []


def is_label(text: str) -> bool:
    """Whether a field is a number of a node or element, also one of an instance."""
    number = text.rpartition(".")[2]
    return number.isascii() and number.isdigit() and len(number) < 19


def degrees(fields: list[str]) -> Iterator[tuple[int, float]]:
    """Degrees of freedom and values of a line of *CLOAD or *BOUNDARY after its first field.

    Raises
    ------
    ValueError : it is none.
    """
    if not fields:
        raise ValueError("a line without a degree of freedom")
    if fields[0].upper() in WORDS:
        yield from ((degree, 0.0) for degree in WORDS[fields[0].upper()])
        return
    first = int(fields[0])
    last = int(fields[1]) if len(fields) > 1 and fields[1] else first
    if not 0 <= first <= last <= _MOST:
        raise ValueError(f"no degrees of freedom: {first} to {last}")
    value = real(fields[2]) if len(fields) > 2 else 0.0
    yield from ((degree, value) for degree in range(first, last + 1))


def _groups_of_nodes(card: Card) -> list[LoadedSet]:
    found: dict[str, dict[str, float]] = {}
    for _, fields in card.tokens():
        try:
            rest = fields[1:]
            # a line of *CLOAD has one degree of freedom and no last one
            if card.keyword == "CLOAD":
                rest = [*rest[:1], "", *rest[1:]]
            values = list(degrees(rest))
        except ValueError:
            continue
        of_target = found.setdefault(fields[0].strip('"'), {})
        for degree, value in values:
            before = 0.0
            # forces on a node add up, the last one of two motions counts
            if card.keyword == "CLOAD":
                before = of_target.get(str(degree), 0.0)
            of_target[str(degree)] = before + value
    named = [LoadedSet(name, NODES, (), tuple(values.items())) for name, values in found.items() if not is_label(name)]
    single = {name: tuple(sorted(values.items())) for name, values in found.items() if is_label(name)}
    return [*named, *_gathered(card, NODES, {(name, ""): values for name, values in single.items()})]


def _groups_of_faces(card: Card) -> list[LoadedSet]:
    groups = []
    single: dict[tuple[str, str], tuple[tuple[str, float], ...]] = {}
    for _, fields in card.tokens():
        word = fields[1].upper() if len(fields) > 1 else ""
        if word[:1] != "P" or not word[1:].isdigit() or len(word) > 2:
            continue
        try:
            value = real(fields[2]) if len(fields) > 2 else 0.0
        except ValueError:
            continue
        target, label = fields[0].strip('"'), f"S{word[1:]}"
        if is_label(target):
            single[target, label] = (("P", value),)
        else:
            groups.append(LoadedSet(f"{target}_{word}", FACES, ((target, label),), (("P", value),)))
    return [*groups, *_gathered(card, FACES, single)]


def _gathered(
    card: Card, kind: str, single: Mapping[tuple[str, str], tuple[tuple[str, float], ...]]
) -> Iterable[LoadedSet]:
    """Members that are loaded alike as sets."""
    alike: dict[tuple[tuple[str, float], ...], list[tuple[str, str]]] = {}
    for member, values in single.items():
        alike.setdefault(values, []).append(member)
    stem = f"{card.keyword}_{card.line}"
    for i, (values, members) in enumerate(alike.items(), 1):
        name = stem
        if kind == NODES and len(members) == 1:
            name = f"NODE_{members[0][0].rpartition('.')[2]}"
        elif len(alike) > 1:
            name = f"{stem}_{i}"
        yield LoadedSet(name, kind, tuple(members), values)
