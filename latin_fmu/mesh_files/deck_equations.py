"""Nodes of a deck that move alike, or along a plane: what its *EQUATION and *MPC cards say, as sets with a name.

Two terms a u_i(n) - a u_i(m) = 0 tie one component of two nodes, or of a node set and a node; nodes that such equations
join, one by one, are one set, ``EQUATION_12``, the line of the card in its name, ``EQUATION_12_2`` where there are
several. Terms of one node alone, a_1 u_1 + a_2 u_2 + a_3 u_3 = 0, hold it along their direction.
``*MPC`` of the type PLANE keeps nodes in the plane of its first three.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from .deck_card import Card, real
from .deck_loads import is_label

EQUATIONS: Final = ("EQUATION", "MPC")
"""Keywords that this module reads."""
_SAME: Final = 1e-6  # of coefficients that a deck writes in seven digits
_AXES: Final = ("1", "2", "3")


@dataclass(frozen=True)
class TiedSet:
    """Nodes that one or more cards join.

    Attributes
    ----------
    name : of the set. card : the first that does. kind : "alike", components are the same at all nodes; "held", no
    motion along ``direction``; "plane", nodes stay in a plane. axes : components that are alike, from 0. members : node
    numbers and names of sets. direction : of a held one.
    """

    name: str
    card: Card
    kind: str
    axes: tuple[int, ...]
    members: tuple[str, ...]
    direction: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class UnreadEquation:
    """An equation that is none of these: card, number of its line, what it is, its terms."""

    card: Card
    row: int
    what: str
    terms: str


@dataclass(frozen=True)
class _Term:
    member: str
    axis: int
    factor: float


def tied_sets(cards: Iterable[Card]) -> tuple[list[TiedSet], list[UnreadEquation]]:
    """Sets of nodes that the cards of a deck join, and the equations that are none of these.

    >>> card = Card("EQUATION", {}, "deck.inp", 7, ["2", "4, 3, 1., 9, 3, -1.", "2", "5,3,1.,9,3,-1."], [8, 9, 10, 11])
    >>> [(tied.name, tied.axes, tied.members) for tied in tied_sets([card])[0]]
    [('EQUATION_7', (2,), ('4', '5', '9'))]
    """
    unread: list[UnreadEquation] = []
    joined: list[_Joined] = [_Joined(), _Joined(), _Joined()]
    held: dict[tuple[float, ...], tuple[Card, dict[str, None]]] = {}
    planes: list[TiedSet] = []
    for card in cards:
        if card.keyword == "MPC":
            planes += _planes(card, unread)
        if card.keyword != "EQUATION":
            continue
        for row, terms in _equations(card, unread):
            axes = {term.axis for term in terms}
            members = {term.member for term in terms}
            factors = [term.factor for term in terms]
            if len(members) == 1:
                of_member = held.setdefault(_direction(terms), (card, {}))[1]
                of_member.update(dict.fromkeys(members))
            elif len(terms) == 2 and len(axes) == 1 and abs(sum(factors)) <= _SAME * max(map(abs, factors)):
                joined[axes.pop()].join(card, terms[0].member, terms[1].member)
            else:
                what = "an equation of other terms than u_i of two nodes, with opposite factors, or those of one node"
                unread.append(UnreadEquation(card, row, what, _shown(terms)))
    return [*_alike(joined), *_held(held), *planes], unread


def members_of(tied: TiedSet) -> tuple[list[str], list[str]]:
    """Node numbers, and names of sets, among the members."""
    return [m for m in tied.members if is_label(m)], [m for m in tied.members if not is_label(m)]


class _Joined:
    """Nodes by the group that equations join them to, along one axis."""

    def __init__(self) -> None:
        self.group: dict[str, dict[str, None]] = {}
        self.first: dict[int, Card] = {}

    def join(self, card: Card, one: str, other: str) -> None:
        """Both are in one group."""
        a = self.group.setdefault(one, {one: None})
        b = self.group.setdefault(other, {other: None})
        if a is not b:
            a.update(b)
            self.group.update(dict.fromkeys(b, a))
        # an entry of a group that was merged into another one is not looked up again
        self.first.setdefault(id(a), self.first.pop(id(b), card))


def _alike(joined: list[_Joined]) -> Iterator[TiedSet]:
    """Groups of the same nodes along several axes as one."""
    found: dict[tuple[str, ...], tuple[Card, list[int]]] = {}
    for axis, of_axis in enumerate(joined):
        for group in {id(group): group for group in of_axis.group.values()}.values():
            members = tuple(sorted(group, key=lambda m: (not is_label(m), int(m) if m.isdigit() else 0, m)))
            found.setdefault(members, (of_axis.first[id(group)], []))[1].append(axis)
    named: dict[int, int] = {}
    lines = [card.line for card, _ in found.values()]
    for members, (card, axes) in found.items():
        named[card.line] = named.get(card.line, 0) + 1
        name = f"EQUATION_{card.line}"
        if lines.count(card.line) > 1:
            name += f"_{named[card.line]}"
        yield TiedSet(name, card, "alike", tuple(axes), members)


def _held(held: dict[tuple[float, ...], tuple[Card, dict[str, None]]]) -> Iterator[TiedSet]:
    for i, (direction, (card, members)) in enumerate(held.items(), 1):
        x, y, z = direction
        yield TiedSet(f"EQUATION_{card.line}_HELD_{i}", card, "held", (), tuple(members), (x, y, z))


def _direction(terms: list[_Term]) -> tuple[float, ...]:
    """Unit direction of the terms of one node, its first component that is not 0 positive."""
    vector = np.zeros(3)
    for term in terms:
        vector[term.axis] += term.factor
    vector /= np.linalg.norm(vector) or 1.0
    large = np.flatnonzero(np.abs(vector) > _SAME)
    if len(large) and vector[large[0]] < 0.0:
        vector = -vector
    return tuple(float(f"{x:.7g}") + 0.0 for x in vector)


def _equations(card: Card, unread: list[UnreadEquation]) -> Iterator[tuple[int, list[_Term]]]:
    """Row and terms of each equation of a card: a line with their number, then four of them a line."""
    count, row, terms = 0, 0, list[_Term]()
    for i, fields in card.tokens():
        try:
            if count == 0:
                count, row, terms = int(fields[0]), i, []
                if count < 1:
                    raise ValueError
                continue
            for at in range(0, len(fields), 3):
                member, axis = fields[at].strip('"'), fields[at + 1]
                if axis not in _AXES:
                    raise ValueError
                terms.append(_Term(member, int(axis) - 1, real(fields[at + 2])))
        except (ValueError, IndexError):
            what = "a line that is no number of terms, or no terms of a node, a component 1 to 3 and a factor"
            unread.append(UnreadEquation(card, i, what, ", ".join(fields)))
            return
        if len(terms) >= count:
            if len(terms) == count and all(term.factor for term in terms):
                yield row, terms
            else:
                unread.append(UnreadEquation(card, row, "terms without a factor, or too many", _shown(terms)))
            count = 0
    if count:
        unread.append(UnreadEquation(card, row, "an equation without all its terms", _shown(terms)))


def _planes(card: Card, unread: list[UnreadEquation]) -> Iterator[TiedSet]:
    """Nodes of each PLANE of *MPC."""
    rows = [(i, fields) for i, fields in card.tokens() if fields]
    i = 0
    while i < len(rows):
        row, fields = rows[i]
        kind, members = fields[0].upper(), [member.strip('"') for member in fields[1:]]
        i += 1
        # a line that does not begin with a word goes on with the nodes of the one above
        while i < len(rows) and (is_label(rows[i][1][0]) or rows[i][1][0] == "0"):
            members += rows[i][1]
            i += 1
        if kind == "PLANE" and members:
            suffix = f"_{i}" * (len(rows) > 1)
            kept = tuple(member for member in members if member != "0")
            yield TiedSet(f"MPC_{card.line}{suffix}", card, "plane", (), kept)
        else:
            unread.append(UnreadEquation(card, row, _WHY_NOT.get(kind, _OTHER), ", ".join(fields[:4])))


_OTHER: Final = "PLANE alone is translated"
_WHY_NOT: Final = {
    "STRAIGHT": "nodes on a line that may turn are none of a scene",
    "BEAM": "a distance of two nodes that stays is none of a scene; a spring is an elastic one",
    "DIST": "a distance of two nodes that stays is none of a scene; a spring is an elastic one",
    "MEANROT": "a mean rotation alone that is held or moved is none of a scene, [port.NAME] moves a face",
}


def _shown(terms: list[_Term]) -> str:
    return ", ".join(f"{term.member}, {term.axis + 1}, {term.factor:g}" for term in terms[:4])
