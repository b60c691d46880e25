"""Nodes, elements and sets of one part of an Abaqus deck, and the keywords that make more of them.

*NGEN (straight lines), *NFILL, *NCOPY (SHIFT), *ELGEN and *ELCOPY are read by the rules of the Abaqus Keywords Guide;
other ways of making nodes are refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from .content import NO_ROWS, Array, FileProblems, Index, rows_of
from .coordinates import BASIC, CoordinateSystem, turned
from .deck_card import Card, real

MAKING: Final = ("NGEN", "NFILL", "NCOPY", "ELGEN", "ELCOPY")
"""Keywords that make nodes or elements out of others."""
_MOST: Final = 5_000_000  # nodes or elements that one line may make
_REMEDY: Final = "write the nodes and elements themselves (a preprocessor exports them)"
Member = tuple[str, str, int, int]
"""Of a set: instance, label or name, last label and step of a range; both 0 for one label or name."""


@dataclass(frozen=True, eq=False)
class ElementBlock:
    """Elements of one type.

    Attributes
    ----------
    kind : VTK type. name : type as the deck writes it, in capitals. labels : (n,). nodes : labels (n, n_node).
    """

    kind: str
    name: str
    labels: Index
    nodes: Index


@dataclass(eq=False)
class Scope:
    """Content between *PART and *END PART, *INSTANCE and *END INSTANCE, or outside of them.

    Attributes
    ----------
    nodes : labels (n,) and coordinates (n, 3) of each block; a label given again replaces the node. elements : in
    blocks of one type. sets : members by kind, "N" or "E", and name in
    capitals. surfaces : (set or label, face) by name. sections : element sets of solid sections. unsorted : node sets,
    in capitals, whose nodes count in the order of the file. system : in which
    coordinates of nodes are given. origin : of an instance, the scope of its part.
    """

    nodes: list[tuple[Index, Array]] = field(default_factory=list)
    elements: list[ElementBlock] = field(default_factory=list)
    sets: dict[tuple[str, str], list[Member]] = field(default_factory=dict)
    surfaces: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    sections: list[str] = field(default_factory=list)
    unsorted: set[str] = field(default_factory=set)
    system: CoordinateSystem = BASIC
    origin: Scope | None = None

    def all_nodes(self) -> tuple[Index, Array]:
        """Labels, ascending, and coordinates of the nodes so far."""
        if not self.nodes:
            return NO_ROWS, np.zeros((0, 3))
        labels = np.concatenate([n[0] for n in self.nodes])
        points = np.concatenate([n[1] for n in self.nodes])
        # unique takes the first of equal ones: of the reversed list, the last one given
        unique, last = np.unique(labels[::-1], return_index=True)
        return unique, points[::-1][last]

    def labels_in(self, kind: str, name: str, path: tuple[str, ...] = ()) -> Index:
        """Labels, ascending, in a set of this scope so far; none for a set that is not there."""
        found = [NO_ROWS]
        if kind == "N":
            every = self.all_nodes()[0]
        else:
            every = np.concatenate([NO_ROWS, *(block.labels for block in self.elements)])
        for _, text, last, step in self.sets.get((kind, name.upper()), []) if name.upper() not in path else []:
            if last:
                first = int(text)
                found.append(every[(every >= first) & (every <= last) & ((every - first) % step == 0)])
            elif text.isascii() and text.isdigit() and len(text) < 19:
                found.append(np.array([int(text)], dtype=np.int64))
            else:
                found.append(self.labels_in(kind, text, (*path, name.upper())))
        return np.unique(np.concatenate(found))

    def joined(self, addition: Scope) -> Scope:
        """The scope of an instance: what its part has, and the ``addition`` of the instance."""
        sets = {key: list(members) for key, members in self.sets.items()}
        # a set of the instance adds to that of the part, a surface replaces it
        for key, members in addition.sets.items():
            sets.setdefault(key, []).extend(members)
        return Scope(
            self.nodes + addition.nodes,
            self.elements + addition.elements,
            sets,
            {**self.surfaces, **addition.surfaces},
            self.sections + addition.sections,
            origin=self,
        )


class _RefusedError(Exception):
    """A line that is not read, with the reason."""


def make_more(scope: Scope, card: Card, spell: Callable[[str], str], problems: FileProblems) -> None:
    """Add the nodes or elements that a card of ``MAKING`` makes; ``spell`` : the name of a set in capitals."""
    make = {"NGEN": _ngen, "NFILL": _nfill, "ELGEN": _elgen}.get(card.keyword)
    try:
        if make is None:
            if card.keyword == "NCOPY":
                labels = _ncopy(scope, card)
            else:
                labels = _elcopy(scope, card)
        else:
            labels = [
                label for i, fields in card.tokens() for label in _of_line(make, scope, card, i, fields, problems)
            ]
    except (_RefusedError, ValueError) as error:
        if isinstance(error, _RefusedError):
            why = str(error)
        else:
            why = "a parameter is missing or no number"
        problems.add(f"*{card.keyword} is not read so: {why}", None, None, _REMEDY, card.place)
        return
    if card.keyword.startswith("EL"):
        kind = "E"
    else:
        kind = "N"
    for key in ("NSET", "ELSET", "NEW SET"):
        if card.name(key):
            members = [("", str(label), 0, 0) for label in labels]
            scope.sets.setdefault((kind, spell(card.name(key))), []).extend(members)


_Maker = Callable[[Scope, Card, list[str]], list[int]]


def _of_line(make: _Maker, scope: Scope, card: Card, i: int, fields: list[str], problems: FileProblems) -> list[int]:
    try:
        return make(scope, card, fields)
    except (_RefusedError, ValueError, IndexError) as error:
        if isinstance(error, _RefusedError):
            why = str(error)
        else:
            why = "not numbers as it takes them"
        problems.add(
            f"a line of *{card.keyword} is not read: {why}", ", ".join(fields), None, _REMEDY, card.row_place(i)
        )
        return []


def _counted(fields: list[str], defaults: tuple[int, ...]) -> list[int]:
    """Whole numbers, the default for those that are left out."""
    padded = [*fields, *[""] * len(defaults)][: len(defaults)]
    return [_whole(text) if text else default for text, default in zip(padded, defaults, strict=True)]


def _whole(text: str) -> int:
    """A whole number whose sums and products with others stay within 64 bits."""
    value = int(text)
    if abs(value) >= 2**31:
        raise _RefusedError("a number is too large")
    return value


def _ngen(scope: Scope, card: Card, fields: list[str]) -> list[int]:
    """Nodes between two, evenly on a straight line."""
    for key in ("LINE", "SYSTEM"):
        if card.name(key).upper() not in ("", "RC"):
            raise _RefusedError(f"{key}={card.name(key)}, straight lines alone are")
    first, last = _whole(fields[0]), _whole(fields[1])
    step = _counted(fields[2:3], (1,))[0]
    if step == 0 or (last - first) % step or (last - first) // step < 1 or (last - first) // step > _MOST:
        raise _RefusedError("the increment does not lead from the first node to the last")
    ends = _points(scope, np.array([first, last]))
    inner = np.arange(first + step, last, step, dtype=np.int64)
    share = (inner - first)[:, None] / (last - first)
    scope.nodes.append((inner, (1.0 - share) * ends[0] + share * ends[1]))
    return [first, *inner.tolist(), last]


def _nfill(scope: Scope, card: Card, fields: list[str]) -> list[int]:
    """Rows of nodes between two sets, evenly from each node of the first to its partner in the second."""
    if any(key in card.parameters for key in ("SINGULAR", "TWO STEP")) or float(card.name("BIAS") or 1.0) != 1.0:
        raise _RefusedError("even intervals between two sets of equal size alone are")
    if any(name.upper() in scope.unsorted for name in fields[:2]):
        raise _RefusedError("a set that is UNSORTED")
    first, last = (scope.labels_in("N", name) for name in fields[:2])
    count, step = _counted(fields[2:], (1, 1))
    if not len(first) or len(first) != len(last):
        raise _RefusedError(f"sets of {len(first)} and {len(last)} nodes")
    if not 0 < count <= _MOST // len(first):
        raise _RefusedError("the number of intervals")
    start, end = _points(scope, first), _points(scope, last)
    labels = [first, last]
    for i in range(1, count):
        share = i / count
        scope.nodes.append((first + i * step, (1.0 - share) * start + share * end))
        labels.append(first + i * step)
    return [int(label) for label in np.concatenate(labels)]


def _ncopy(scope: Scope, card: Card) -> list[int]:
    """Nodes of a set once more, moved and turned, their labels shifted; ``MULTIPLE`` times in a row."""
    if "SHIFT" not in card.parameters:
        raise _RefusedError("SHIFT alone is, neither REFLECT nor POLE")
    change, times = _whole(card.name("CHANGE NUMBER")), _whole(card.name("MULTIPLE") or "1")
    labels = scope.labels_in("N", card.name("OLD SET"))
    if not len(labels) or not 0 < times <= _MOST // len(labels):
        raise _RefusedError(f"OLD SET={card.name('OLD SET')} has {len(labels)} nodes")
    lines = [[real(f) for f in fields] for _, fields in card.tokens()]
    moved, turn = (np.array([*line, *[0.0] * 7][:7]) for line in [*lines, [], []][:2])
    points, copied = _points(scope, labels), []
    for i in range(1, times + 1):
        points = points + moved[:3]
        if turn[6]:
            if not np.any(turn[3:6] != turn[:3]):
                raise _RefusedError("the axis of the rotation has no direction")
            points = turned(points, turn[:3], turn[3:6] - turn[:3], math.radians(turn[6]))
        scope.nodes.append((labels + i * change, points))
        copied += (labels + i * change).tolist()
    return copied


def _elgen(scope: Scope, _: Card, fields: list[str]) -> list[int]:
    """An element repeated in a row, the row in a layer, the layer in a block, with labels and nodes in steps."""
    master = _whole(fields[0])
    # number, step of nodes, step of elements; three times
    steps = _counted(fields[1:10], (1, 1, 1) * 3)
    counts = steps[::3]
    of_nodes = steps[1::3]
    of_elements = steps[2::3]
    if min(counts) < 1 or math.prod(counts) > _MOST:
        raise _RefusedError("the numbers of elements")
    block, nodes = _element(scope, master)
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1).reshape(-1, 3)[1:]
    labels = master + grid @ np.array(of_elements)
    # a middle node that is not there stays so
    cells = np.where(nodes > 0, nodes + (grid @ np.array(of_nodes))[:, None], 0)
    scope.elements.append(ElementBlock(block.kind, block.name, labels, cells))
    return [master, *labels.tolist()]


def _elcopy(scope: Scope, card: Card) -> list[int]:
    """Elements of a set once more, their labels and nodes shifted."""
    if "REFLECT" in card.parameters:
        raise _RefusedError("REFLECT")
    of_elements, of_nodes = _whole(card.name("ELEMENT SHIFT")), _whole(card.name("SHIFT NODES"))
    wanted = scope.labels_in("E", card.name("OLD SET"))
    copied: list[int] = []
    for block in list(scope.elements):
        chosen = np.isin(block.labels, wanted)
        if chosen.any():
            nodes, labels = block.nodes[chosen], block.labels[chosen] + of_elements
            shifted = np.where(nodes > 0, nodes + of_nodes, 0)
            scope.elements.append(ElementBlock(block.kind, block.name, labels, shifted))
            copied += labels.tolist()
    if not copied:
        raise _RefusedError(f"OLD SET={card.name('OLD SET')} has no elements")
    return copied


def _points(scope: Scope, labels: Index) -> Array:
    all_labels, points = scope.all_nodes()
    rows, there = rows_of(all_labels, labels)
    if not there.all():
        raise _RefusedError(f"no node {labels[there.argmin()]} before this line")
    return points[rows]


def _element(scope: Scope, label: int) -> tuple[ElementBlock, Index]:
    """Block and nodes of an element."""
    for block in reversed(scope.elements):
        found = np.flatnonzero(block.labels == label)
        if len(found):
            return block, block.nodes[found[0]]
    raise _RefusedError(f"no element {label} before this line")
