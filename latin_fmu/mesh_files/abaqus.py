"""Meshes of Abaqus and CalculiX decks: parts and instances, element and node sets, surfaces of element faces.

Several ``*NODE`` and ``*ELEMENT`` blocks, sets (lists, ``GENERATE``, sets of sets), ``*SURFACE`` of element faces
(labels S1 ... S6) or nodes, ``*PART`` / ``*INSTANCE`` with translation and rotation, ``*INCLUDE``. Names are compared
without regard to case and keep the spelling of their first use. What else the deck says: ``content.DeckModel``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ..errors import listed
from .content import (
    CORNERS,
    FLAT,
    NO_ROWS,
    SHELLS,
    SOLIDS,
    Array,
    DeckModel,
    FileProblems,
    Include,
    Index,
    MeshContent,
    rows_of,
)

SOLID_FACES: Final = {
    4: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    5: ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
    6: ((0, 1, 2), (3, 5, 4), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    8: ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
}
"""Corners of the faces S1, S2, ... by number of corners of the element (Abaqus Analysis Guide)."""

_SOLID_NAME = re.compile(r"C3D(\d+)[A-Z]*")
_SHELL_NAME = re.compile(r"(?:CPS|CPE|CPEG|CAX|S|SC?AX|M3D|SFM3D|R3D|DS|STRI)(\d+)[A-Z]*")


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
        return (SHELLS[count], count) if count in SHELLS else None
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
            # keyword and parameters stay one text until the line is whole: the next line may go on with it
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
        return
    with problems.included(card.name("INPUT"), include, depth, card.line) as text:
        yield from cards(text, include, problems, depth + 1)


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
        # sums and differences of labels stay within 64 bits
        if not 0 < label < 2**62:
            problems.add("not a node label", label, "a positive whole number", line=line)
            continue
        labels.append(label)
        coordinates.append([*values, 0.0, 0.0, 0.0][:3])  # planar parts, too
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
        # lines are not counted: nodes may go on in any number of them
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


# -- the deck taken apart ------------------------------------------------------------------------------------------
_TABLES = ("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE")  # whose data lines are read here


@dataclass
class _Scope:
    """Content between *PART and *END PART, *INSTANCE and *END INSTANCE, or outside of them."""

    nodes: list[tuple[Index, Array]] = field(default_factory=list)
    elements: list[tuple[str, Index, Index]] = field(default_factory=list)
    # (kind "N" | "E", name in capitals) -> members: (instance, label or name, last, step) with last = step = 0 for one
    sets: dict[tuple[str, str], list[tuple[str, str, int, int]]] = field(default_factory=dict)
    surfaces: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    sections: list[str] = field(default_factory=list)


@dataclass
class _Frame:
    """A scope placed in the model: its nodes and elements as rows of the whole."""

    name: str
    scope: _Scope
    node_labels: Index = field(default_factory=lambda: NO_ROWS)
    first_node: int = 0
    element_labels: Index = field(default_factory=lambda: NO_ROWS)
    first_element: int = 0


class _DeckScopes:
    """A deck taken apart: scopes by name, instances, spelling of names."""

    def __init__(self, where: str) -> None:
        self.problems = FileProblems(where)
        self.root = _Scope()
        self.parts: dict[str, _Scope] = {}
        self.instances: list[tuple[str, str, _Scope, list[Card]]] = []  # name, part, its own scope, placing lines
        self.spelled: dict[str, str] = {}
        self.internal: set[str] = set()
        self.skipped: dict[str, int] = {}
        self.model = DeckModel()
        self._here = self.root

    def spell(self, name: str) -> str:
        """The name in capitals, its first spelling remembered."""
        # names of a deck know no case; the scene is written in the first spelling
        key = name.strip().upper()
        self.spelled.setdefault(key, name.strip())
        return key

    def take(self, card: Card) -> None:
        """Add the content of a card to its scope."""
        keyword = card.keyword
        # long tables are read as numbers elsewhere: here they would be split into words
        rows = [] if keyword in _TABLES else [fields for _, fields in card.tokens()]
        self.model.take(keyword, card.parameters, rows)
        if keyword == "NODE":
            self._nodes(card)
        elif keyword == "ELEMENT":
            self._elements(card)
        elif keyword in ("NSET", "ELSET"):
            self._set(card, keyword[0], card.name(keyword))
        elif keyword == "SURFACE":
            self._surface(card)
        elif keyword == "SOLID SECTION":
            self._here.sections.append(self.spell(card.name("ELSET")))
        elif keyword == "PART":
            self._here = self.parts.setdefault(self.spell(card.name("NAME")), _Scope())
        elif keyword == "INSTANCE":
            self._here = _Scope()
            name, part = self.spell(card.name("NAME")), self.spell(card.name("PART"))
            self.instances.append((name, part, self._here, [card]))
        elif keyword in ("END PART", "END INSTANCE"):
            # cards after the end of a part belong to the assembly
            self._here = self.root

    def _nodes(self, card: Card) -> None:
        labels, coordinates = nodes_of(card, self.problems)
        self._here.nodes.append((labels, coordinates))
        if card.name("NSET"):
            self._members("N", card.name("NSET"), [("", str(label), 0, 0) for label in labels.tolist()])

    def _elements(self, card: Card) -> None:
        kind = element_type(card.name("TYPE"))
        if kind is None:
            name = card.name("TYPE").upper()
            # a volume that is not known is a problem; beams, masses and others are left out
            if name.startswith(("C3D", "SC", "CSS")):
                self.problems.add(
                    "element type not known",
                    name or "none given",
                    "C3D4, C3D5, C3D6, C3D8, C3D10, C3D15, C3D20 and their variants, shells for faces",
                    line=card.line,
                )
            self.skipped[name] = self.skipped.get(name, 0) + len(card.rows)
            return
        labels, connectivity = elements_of(card, kind[1], self.problems)
        self._here.elements.append((kind[0], labels, connectivity))
        if card.name("ELSET"):
            self._members("E", card.name("ELSET"), [("", str(label), 0, 0) for label in labels.tolist()])

    def _members(self, kind: str, name: str, members: list[tuple[str, str, int, int]]) -> None:
        self._here.sets.setdefault((kind, self.spell(name)), []).extend(members)

    def _set(self, card: Card, kind: str, name: str) -> None:
        instance = card.name("INSTANCE").upper()
        members: list[tuple[str, str, int, int]] = []
        if "INTERNAL" in card.parameters or name.startswith("_"):
            self.internal.add(name.upper())
        for line, fields in card.tokens():
            if "GENERATE" not in card.parameters:
                members += [(instance, f, 0, 0) for f in fields if f]
                continue
            try:
                # the step is 1 where it is missing, the last is the first
                first, last, step = (*map(int, fields[:3]), 1)[:3] if len(fields) > 1 else (int(fields[0]),) * 2 + (1,)
            except (ValueError, IndexError):
                first = last = step = 0
            if not all(0 < number < 2**62 for number in (first, last, step)):
                self.problems.add("not a range of labels", ", ".join(fields), "first, last, step > 0", line=line)
                continue
            members.append((instance, str(first), last, step))
        self._members(kind, name, members)

    def _surface(self, card: Card) -> None:
        key = self.spell(card.name("NAME"))
        nodal = card.name("TYPE").upper() == "NODE"
        items = self._here.surfaces.setdefault(key, [])
        for _, fields in card.tokens():
            if fields and fields[0]:
                items.append((fields[0], "NODE" if nodal else fields[1].upper() if len(fields) > 1 else ""))


def read_abaqus(text: str, where: str, include: Include) -> MeshContent:
    """The mesh of a deck.

    Parameters
    ----------
    text : the deck. where : name for messages. include : text of a file that the deck includes.

    Raises
    ------
    MeshError : what is wrong, with line numbers where there are any.
    """
    deck = _DeckScopes(where)
    for card in cards(text, include, deck.problems):
        deck.take(card)
    deck.problems.stop()
    return _PlacedDeck(deck).content()


def _placed(points: Array, card: Card, problems: FileProblems) -> Array:
    """Points of a part moved by the data lines of its *INSTANCE: translated, then turned about an axis a-b."""
    for (line, fields), count in zip(card.tokens(), (3, 7), strict=False):
        try:
            values = np.array([float(f.upper().replace("D", "E")) if f else 0.0 for f in fields])
        except ValueError:
            values = np.zeros(0)
        if count == 3 and 0 < len(values) <= 3:
            points = points + np.concatenate([values, np.zeros(3 - len(values))])
        elif count == 7 and len(values) == 7 and np.any(values[3:6] != values[:3]):
            with np.errstate(all="ignore"):  # absurd numbers make nodes that are not finite, refused later
                points = _turned(points, values[:3], values[3:6] - values[:3], math.radians(values[6]))
        else:
            allowed = "x, y, z of the translation" if count == 3 else "two points of the axis and an angle: 7 numbers"
            problems.add("not the place of an instance", ", ".join(fields), allowed, line=line)
    return points


def _turned(points: Array, origin: Array, axis: Array, angle: float) -> Array:
    """Rotation by ``angle`` (rad) about the axis through ``origin`` (Rodrigues)."""
    k = axis / np.linalg.norm(axis)
    r = points - origin
    along = np.outer(r @ k, k)
    turned: Array = origin + along + math.cos(angle) * (r - along) + math.sin(angle) * np.cross(k, r)
    return turned


class _PlacedDeck:
    """Instances placed, labels resolved to rows."""

    def __init__(self, deck: _DeckScopes) -> None:
        self.deck, self.problems = deck, deck.problems
        self.points: list[Array] = []
        self.n_point = self.n_element = 0
        self.kinds: list[str] = []  # of every block of elements
        self.first: list[int] = []  # global number of its first element
        self.cells: list[Index] = []
        self.frames = [self._frame("", deck.root, None)]
        instances = deck.instances or [(name, name, _Scope(), []) for name in deck.parts]
        for name, part, own, card in instances:
            if part not in deck.parts and not own.nodes:
                self.problems.add("an instance of a part that is not there", deck.spelled[part], listed(deck.parts))
                continue
            scope = _joined(deck.parts.get(part, _Scope()), own)
            self.frames.append(self._frame(name, scope, card[0] if card else None))
        self.problems.stop()
        self.kind_of = np.repeat(np.arange(len(self.kinds)), [len(c) for c in self.cells]).astype(np.int64)
        self._resolved: dict[tuple[str, str, str], Index] = {}

    def _frame(self, name: str, scope: _Scope, card: Card | None) -> _Frame:
        frame = _Frame(name, scope, first_node=self.n_point, first_element=self.n_element)
        if scope.nodes:
            labels = np.concatenate([n[0] for n in scope.nodes])
            points = np.concatenate([n[1] for n in scope.nodes])
            # unique takes the first of equal ones: of the reversed list, the last one given
            unique, last = np.unique(labels[::-1], return_index=True)  # a label given again replaces the node
            frame.node_labels, points = unique, points[::-1][last]
            self.points.append(points if card is None else _placed(points, card, self.problems))
            self.n_point += len(unique)
        every: list[Index] = []
        for kind, labels, connectivity in scope.elements:
            rows, there = rows_of(frame.node_labels, connectivity.ravel())
            if not there.all():
                bad = int(there.argmin())
                self.problems.add(
                    "an element names a node that no *NODE block has",
                    f"node {connectivity.ravel()[bad]} of element {labels[bad // connectivity.shape[1]]}",
                )
                continue
            self.kinds.append(kind)
            self.first.append(self.n_element)
            # rows in the table of all instances
            self.cells.append(rows.reshape(connectivity.shape) + frame.first_node)
            self.n_element += len(labels)
            every.append(labels)
        frame.element_labels = np.concatenate(every) if every else NO_ROWS
        values, counts = np.unique(frame.element_labels, return_counts=True)
        if (counts > 1).any():
            self.problems.add("two elements have the same label", int(values[counts.argmax()]))
        return frame

    def _find(self, frame: _Frame, kind: str, key: str, path: tuple[str, ...] = ()) -> Index | None:
        """Rows of the members of a set, None where the frame has no set of this name."""
        memory = (frame.name, kind, key)
        if memory in self._resolved:
            return self._resolved[memory]
        members = frame.scope.sets.get((kind, key))
        if members is None:
            return None
        # checked before the set is read: a set of sets that leads back to itself would not end
        if key in path:
            self.problems.add("a set contains itself", self.deck.spelled.get(key, key))
            return NO_ROWS
        rows = [NO_ROWS]
        singles: dict[str, list[int]] = {}
        for instance, text, last, step in members:
            if last:
                rows.append(self._range(self._named(instance, frame), kind, int(text), last, step))
            elif text.isascii() and text.isdigit() and len(text) < 19:  # more digits do not fit in 64 bits
                singles.setdefault(instance, []).append(int(text))
            else:
                rows.append(self._other(self._named(instance, frame), kind, text, (*path, key)))
        for instance, labels in singles.items():
            rows.append(self._labelled(self._named(instance, frame), kind, np.array(labels, dtype=np.int64), key))
        self._resolved[memory] = np.unique(np.concatenate(rows))
        return self._resolved[memory]

    def _named(self, instance: str, default: _Frame) -> _Frame:
        if not instance:
            return default
        for frame in self.frames:
            if frame.name == instance:
                return frame
        self.problems.add("no instance of this name", instance, listed(f.name for f in self.frames if f.name))
        return default

    def _labels(self, frame: _Frame, kind: str) -> tuple[Index, int]:
        return (frame.node_labels, frame.first_node) if kind == "N" else (frame.element_labels, frame.first_element)

    def _range(self, frame: _Frame, kind: str, first: int, last: int, step: int) -> Index:
        labels, start = self._labels(frame, kind)
        chosen = (labels >= first) & (labels <= last) & ((labels - first) % step == 0)
        return np.flatnonzero(chosen) + start

    def _labelled(self, frame: _Frame, kind: str, some: Index, name: str) -> Index:
        """Rows of labels; elements that are ignored (beams, springs) have none."""
        labels, start = self._labels(frame, kind)
        rows, there = rows_of(labels, some)
        if not there.all() and not (kind == "E" and self.deck.skipped):
            what = "node" if kind == "N" else "element"
            missing = int(some[~there][0])
            self.problems.add(
                f"a set names an {what} that is not there".replace("an node", "a node"),
                f"{missing} in {self.deck.spelled.get(name, name)}",
            )
        return rows[there] + start

    def _other(self, frame: _Frame, kind: str, text: str, path: tuple[str, ...] = ()) -> Index:
        """Members of the set, or of ``INSTANCE.SET`` or ``INSTANCE.label``, that another set contains."""
        owner, dot, rest = text.rpartition(".")
        # names may have dots of their own
        if dot and any(f.name == owner.upper() for f in self.frames):
            frame, text = self._named(owner.upper(), frame), rest
        if text.isascii() and text.isdigit() and len(text) < 19:
            return self._labelled(frame, kind, np.array([int(text)], dtype=np.int64), text)
        rows = self._find(frame, kind, text.upper(), path)
        if rows is None:
            known = [self.deck.spelled.get(k, k) for t, k in frame.scope.sets if t == kind]
            self.problems.add("no set of this name", text, listed(known))
            return NO_ROWS
        return rows

    def content(self) -> MeshContent:
        """Everything by rows and names."""
        points = np.concatenate(self.points) if self.points else np.zeros((0, 3))
        content = MeshContent(points, skipped=dict(self.deck.skipped))
        self.row_in_type = np.zeros(self.n_element, dtype=np.int64)
        for block, (kind, cells) in enumerate(zip(self.kinds, self.cells, strict=True)):
            if kind not in CORNERS:
                continue
            span = slice(self.first[block], self.first[block] + len(cells))
            self.row_in_type[span] = content.add_solids(kind, cells)
        # every instance is a volume group under its name
        for frame in self.frames[1:]:
            everything = frame.first_element + np.arange(len(frame.element_labels))
            self._add_elements(content, self.deck.spelled[frame.name], everything, surfaces=False)
        for frame in self.frames:
            self._add_sets(content, frame)
        for frame in self.frames:
            for key, items in frame.scope.surfaces.items():
                self._add_surface(content, frame, self.deck.spelled[key], items)
        self.problems.stop()
        content.parts = self._parts(content)
        content.deck = self.deck.model
        content.sections = self._sections(content)
        return content

    def _add_sets(self, content: MeshContent, frame: _Frame) -> None:
        for kind, key in frame.scope.sets:
            rows = self._find(frame, kind, key)
            name = self.deck.spelled[key]
            if rows is None or not len(rows) or key in self.deck.internal:
                continue
            if kind == "E":
                self._add_elements(content, name, rows)
            else:
                content.add_nodes(name, rows)

    def _add_elements(self, content: MeshContent, name: str, ids: Index, surfaces: bool = True) -> None:
        """Elements of a set under its name: solids as a volume group, shells as facets."""
        blocks = self.kind_of[ids]
        for block in np.unique(blocks):
            kind, chosen = self.kinds[block], ids[blocks == block]
            if kind in CORNERS:
                content.add_volume(name, kind, self.row_in_type[chosen])
            elif surfaces:
                content.add_facets(name, kind, self.cells[block][chosen - self.first[block]])

    def _add_surface(self, content: MeshContent, frame: _Frame, name: str, items: list[tuple[str, str]]) -> None:
        for text, label in items:
            if label == "NODE":
                content.add_nodes(name, self._other(frame, "N", text))
                continue
            ids = self._other(frame, "E", text)
            blocks = self.kind_of[ids]
            for block in np.unique(blocks):
                cells = self.cells[block][ids[blocks == block] - self.first[block]]
                content.facets.setdefault(name, []).extend(self._sides(self.kinds[block], cells, label, name))

    def _sides(self, kind: str, cells: Index, label: str, name: str) -> list[Index]:
        """Corners of one face of each cell; without a label, of all faces (those inside the body are dropped later)."""
        if kind in FLAT:
            return [cells[:, : FLAT[kind]]]
        faces = SOLID_FACES[CORNERS[kind]]
        # the skin of the elements
        if not label:
            return [cells[:, list(face)] for face in faces]
        # S and a number of at most three digits, so that int stays small
        if label[:1] != "S" or not label[1:].isdigit() or not 1 <= int(label[1:4]) <= len(faces):
            self.problems.add(f"the surface {name} names a face that a {kind} has not", label, f"S1 to S{len(faces)}")
            return []
        return [cells[:, list(faces[int(label[1:4]) - 1])]]

    def _sections(self, content: MeshContent) -> dict[str, list[str]]:
        """Element sets of the solid sections of every volume group, in capitals."""
        own = {self.deck.spelled[f.name]: f.scope.sections for f in self.frames[1:]}
        return own or {name: [name.upper()] for name in content.volumes}

    def _parts(self, content: MeshContent) -> tuple[str, ...] | None:
        """Instances; without any, the element sets of the solid sections where they cover each cell once."""
        if len(self.frames) > 1:
            named = [self.deck.spelled[f.name] for f in self.frames[1:]]
            return tuple(name for name in named if name in content.volumes)
        sections = [self.deck.spelled[key] for key in dict.fromkeys(self.deck.root.sections)]
        groups = [content.volumes[name] for name in sections if name in content.volumes]
        for kind, cells in content.solids.items():
            rows = np.concatenate([g.get(kind, NO_ROWS) for g in groups]) if groups else NO_ROWS
            # every cell, and none twice
            if len(rows) != len(cells) or len(np.unique(rows)) != len(rows):
                return None
        return tuple(name for name in sections if name in content.volumes)


def _joined(part: _Scope, own: _Scope) -> _Scope:
    """The scope of an instance: what its part has and what it adds."""
    sets = {key: list(members) for key, members in part.sets.items()}
    # a set of the instance adds to that of the part, a surface replaces it
    for key, members in own.sets.items():
        sets.setdefault(key, []).extend(members)
    return _Scope(
        part.nodes + own.nodes,
        part.elements + own.elements,
        sets,
        {**part.surfaces, **own.surfaces},
        part.sections + own.sections,
    )
