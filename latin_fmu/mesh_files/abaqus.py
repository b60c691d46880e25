"""Meshes of Abaqus and CalculiX decks: parts and instances, element and node sets, surfaces of element faces.

Several ``*NODE`` and ``*ELEMENT`` blocks, sets (lists, ``GENERATE``, sets of sets, nodes of element sets), ``*SURFACE``
of element faces (labels S1 ... S6) or nodes, ``*PART`` / ``*INSTANCE`` with translation and rotation, ``*INCLUDE`` and
``INPUT=``, coordinates in other systems, keywords that make nodes and elements (``abaqus_scope``). Names are compared
without regard to case and keep the spelling of their first use. What else the deck says: ``deck_model.DeckModel``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ..errors import listed
from .abaqus_cards import cards
from .abaqus_deck import NODES_OF, DeckScopes
from .abaqus_scope import Scope
from .content import CORNERS, FLAT, NO_ROWS, Array, FileProblems, Include, Index, MeshContent, pieces, rows_of
from .coordinates import turned
from .deck_card import Card
from .deck_equations import members_of, tied_sets
from .deck_loads import FACES, NAMES_NODES, NAMES_SETS, NODES, is_label, loaded_groups
from .deck_model import DeckModel, numbers
from .middle_nodes import complete, in_vtk_order
from .unused import nodes_in_cells, note

SOLID_FACES: Final = {
    4: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    5: ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
    6: ((0, 1, 2), (3, 5, 4), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    8: ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
}
"""Corners of the faces S1, S2, ... by number of corners of the element (Abaqus Analysis Guide)."""


@dataclass
class _Frame:
    """A scope placed in the model: its nodes and elements as rows of the whole."""

    name: str
    scope: Scope
    node_labels: Index = field(default_factory=lambda: NO_ROWS)
    first_node: int = 0
    element_labels: Index = field(default_factory=lambda: NO_ROWS)
    first_element: int = 0


def read_abaqus(text: str, where: str, include: Include) -> MeshContent:
    """The mesh of a deck.

    Parameters
    ----------
    text : the deck. where : name for messages. include : text of a file that the deck includes.

    Raises
    ------
    MeshError : what is wrong, with line numbers where there are any.
    """
    deck = DeckScopes(where)
    for card in cards(text, include, deck.problems):
        deck.take(card)
    deck.problems.stop()
    return _DeckContent(deck).content()


def _placed(points: Array, card: Card, problems: FileProblems) -> Array:
    """Points of a part moved by the data lines of its *INSTANCE: translated, then turned about an axis a-b."""
    for (i, fields), count in zip(card.tokens(), (3, 7), strict=False):
        values = np.array(numbers([f or "0" for f in fields]) or [])
        if count == 3 and 0 < len(values) <= 3:
            points = points + np.concatenate([values, np.zeros(3 - len(values))])
        elif count == 7 and len(values) == 7 and np.any(values[3:6] != values[:3]):
            points = turned(points, values[:3], values[3:6] - values[:3], math.radians(values[6]))
        else:
            if count == 3:
                allowed = "x, y, z of the translation"
            else:
                allowed = "two points of the axis and an angle: 7 numbers"
            problems.add("not the place of an instance", ", ".join(fields), allowed, line=card.row_place(i))
    return points


class _PlacedDeck:
    """Instances placed, labels resolved to rows."""

    def __init__(self, deck: DeckScopes) -> None:
        self.deck, self.problems = deck, deck.problems
        self.points: list[Array] = []
        self.n_point = self.n_element = 0
        self.kinds: list[str] = []  # of every block of elements
        self.names: list[str] = []  # of its type in the deck
        self.first: list[int] = []  # global number of its first element
        self.cells: list[Index] = []
        self.labels: list[Index] = []  # of the elements of every block
        self.frames = [self._frame("", deck.root, None)]
        instances = deck.instances or [(name, name, Scope(), []) for name in deck.parts]
        for name, part, instance_scope, card in instances:
            if part not in deck.parts and not instance_scope.nodes:
                self.problems.add("an instance of a part that is not there", deck.spelled[part], listed(deck.parts))
                continue
            scope = deck.parts.get(part, Scope()).joined(instance_scope)
            self.frames.append(self._frame(name, scope, card[0] if card else None))
        self.problems.stop()
        self.kind_of = np.repeat(np.arange(len(self.kinds)), [len(c) for c in self.cells]).astype(np.int64)
        self._resolved: dict[tuple[str, str, str], Index] = {}

    def _frame(self, name: str, scope: Scope, card: Card | None) -> _Frame:
        frame = _Frame(name, scope, first_node=self.n_point, first_element=self.n_element)
        if scope.nodes:
            frame.node_labels, points = scope.all_nodes()
            if card is not None:
                points = _placed(points, card, self.problems)
            self.points.append(points)
            self.n_point += len(points)
        every: list[Index] = []
        for block in scope.elements:
            labels, connectivity = block.labels, block.nodes
            rows, there = rows_of(frame.node_labels, connectivity.ravel())
            absent = connectivity.ravel() == 0  # a middle node that the file leaves out
            there |= absent
            if not there.all():
                bad = int(there.argmin())
                self.problems.add(
                    "an element names a node that no *NODE block has",
                    f"node {connectivity.ravel()[bad]} of element {labels[bad // connectivity.shape[1]]}",
                )
                continue
            self.kinds.append(block.kind)
            self.names.append(block.name)
            self.first.append(self.n_element)
            # rows in the table of all instances
            self.cells.append(np.where(absent, -1, rows + frame.first_node).reshape(connectivity.shape))
            self.labels.append(labels)
            self.n_element += len(labels)
            every.append(labels)
        if every:
            frame.element_labels = np.concatenate(every)
        else:
            frame.element_labels = NO_ROWS
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
            if last == NODES_OF:
                rows.append(self._nodes_of(self._other(self._named(instance, frame), "E", text, (*path, key))))
            elif last:
                rows.append(self._range(self._named(instance, frame), kind, int(text), last, step))
            elif text.isascii() and text.isdigit() and len(text) < 19:  # more digits do not fit in 64 bits
                singles.setdefault(instance, []).append(int(text))
            else:
                rows.append(self._other(self._named(instance, frame), kind, text, (*path, key)))
        for instance, labels in singles.items():
            rows.append(self._labelled(self._named(instance, frame), kind, np.array(labels, dtype=np.int64), key))
        self._resolved[memory] = np.unique(np.concatenate(rows))
        return self._resolved[memory]

    def _nodes_of(self, ids: Index) -> Index:
        """Rows of the nodes of elements."""
        blocks = self.kind_of[ids]
        tables = [self.cells[block][ids[blocks == block] - self.first[block]].ravel() for block in np.unique(blocks)]
        nodes = np.unique(np.concatenate([NO_ROWS, *tables]))
        return nodes[nodes >= 0]

    def _named(self, instance: str, default: _Frame) -> _Frame:
        # CalculiX reads decks without instances and does not look at the names of these
        if not instance or len(self.frames) == 1:
            return default
        for frame in self.frames:
            if frame.name == instance:
                return frame
        self.problems.add("no instance of this name", instance, listed(f.name for f in self.frames if f.name))
        return default

    def _labels(self, frame: _Frame, kind: str) -> tuple[Index, int]:
        if kind == "N":
            return (frame.node_labels, frame.first_node)
        return (frame.element_labels, frame.first_element)

    def _range(self, frame: _Frame, kind: str, first: int, last: int, step: int) -> Index:
        labels, start = self._labels(frame, kind)
        chosen = (labels >= first) & (labels <= last) & ((labels - first) % step == 0)
        return np.flatnonzero(chosen) + start

    def _labelled(self, frame: _Frame, kind: str, some: Index, name: str) -> Index:
        """Rows of labels; elements that are ignored (beams, springs) have none."""
        labels, start = self._labels(frame, kind)
        rows, there = rows_of(labels, some)
        if not there.all() and not (kind == "E" and self.deck.skipped):
            if kind == "N":
                what = "node"
            else:
                what = "element"
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
            sets = [self.deck.spelled.get(k, k) for t, k in frame.scope.sets if t == kind]
            self.problems.add("no set of this name", text, listed(sets))
            return NO_ROWS
        return rows


class _DeckContent(_PlacedDeck):
    """The content of a deck."""

    def content(self) -> MeshContent:
        """Everything by rows and names."""
        content = self.deck.content
        if self.points:
            content.points = np.concatenate(self.points)
        else:
            content.points = np.zeros((0, 3))
        content.labels = np.concatenate([NO_ROWS, *(frame.node_labels for frame in self.frames)])
        self.row_in_type = np.zeros(self.n_element, dtype=np.int64)
        for block, (kind, cells) in enumerate(zip(self.kinds, self.cells, strict=True)):
            if kind not in CORNERS:
                continue
            span = slice(self.first[block], self.first[block] + len(cells))
            ordered, order = in_vtk_order(content.points, kind, cells, "Abaqus")
            self.row_in_type[span] = content.add_solids(kind, ordered)
            content.add_type(self.names[block], kind, self.row_in_type[span])
            content.cell_labels[kind] = np.concatenate([content.cell_labels.get(kind, NO_ROWS), self.labels[block]])
            if order != "Abaqus":
                content.said.append(f"the middle nodes of {len(cells)} {kind} cells are in the order of {order}")
        complete(content)
        # every instance is a volume group under its name
        for frame in self.frames[1:]:
            everything = frame.first_element + np.arange(len(frame.element_labels))
            self._add_elements(content, self.deck.spelled[frame.name], everything, surfaces=False)
        for frame in self.frames:
            self._add_sets(content, frame)
        for frame in self.frames:
            for key, items in frame.scope.surfaces.items():
                self._add_surface(content, frame, self.deck.spelled[key], items)
        self._add_loaded(content)
        self._note_skipped(content)
        self.problems.stop()
        content.parts = self._parts(content)
        content.deck = self.deck.model
        content.sections = self._sections(content)
        _split_parts(content, self.deck.model)
        return content

    def _note_skipped(self, content: MeshContent) -> None:
        """Elements that are not read, with how many of their nodes are in cells."""
        for scope, skipped in self.deck.skipped:
            rows = NO_ROWS
            for frame in self.frames:
                # an instance has the nodes of its part
                if scope in (frame.scope, frame.scope.origin):
                    found, there = rows_of(frame.node_labels, skipped.nodes)
                    rows = found[there] + frame.first_node
            note(content, skipped, nodes_in_cells(content, rows), self.problems)

    def _add_held_nodes(self, content: MeshContent) -> None:
        """Nodes that a support or transformation names by their number."""
        held = (support.name for support in self.deck.model.supports if is_label(support.name))
        for text, rows in self._numbered(dict.fromkeys(held)):
            content.add_nodes(f"NODE_{text.rpartition('.')[2]}", rows)

    def _add_nodes_by_number(self, content: MeshContent, name: str, texts: Iterable[str]) -> None:
        """Nodes by their numbers under a name."""
        found = [rows for _, rows in self._numbered(texts)]
        if found:
            content.add_nodes(name, np.concatenate(found))

    def _numbered(self, texts: Iterable[str]) -> Iterator[tuple[str, Index]]:
        """Each number of a node, and its row, (1,); none where it is not there, as CalculiX leaves it out."""
        by_owner: dict[str, list[str]] = {}
        for text in texts:
            by_owner.setdefault(text.rpartition(".")[0].upper(), []).append(text)
        for owner, some in by_owner.items():
            frame = self._named(owner, self.frames[0])
            # all numbers at once: a deck may hold each of its nodes by its number
            labels = np.array([int(text.rpartition(".")[2]) for text in some], dtype=np.int64)
            rows, there = rows_of(frame.node_labels, labels)
            for k, text in enumerate(some):
                yield text, rows[k : k + 1][there[k : k + 1]] + frame.first_node

    def _add_loaded(self, content: MeshContent) -> None:
        """Nodes and faces of elements that loads, supports and outputs name by their numbers, nodes that equations
        join."""
        self._add_held_nodes(content)
        for group in (group for card in self.deck.model.cards for group in loaded_groups(card)):
            if group.kind == NODES and group.members:
                self._add_nodes_by_number(content, group.name, (text for text, _ in group.members))
            for text, label in group.members if group.kind == FACES else ():
                self._add_surface(content, self.frames[0], group.name, [(text, label)])
        for tied in tied_sets(self.deck.model.cards)[0]:
            labels, sets = members_of(tied)
            self._add_nodes_by_number(content, tied.name, labels)
            spelled = {name.upper(): name for name in content.node_sets}
            for name in sets:
                content.add_nodes(tied.name, content.node_sets.get(spelled.get(name.upper(), ""), NO_ROWS))

    def _add_sets(self, content: MeshContent, frame: _Frame) -> None:
        model = self.deck.model
        # sets without a name of the user count where the deck holds them
        used = {
            ("N", name.rpartition(".")[2].upper()) for name in (*model.transforms, *(s.name for s in model.supports))
        }
        used |= {("E", name.rpartition(".")[2].upper()) for name in model.rigid}
        for card in model.cards:
            if card.keyword in NAMES_NODES:
                used |= {("N", card.name(key).rpartition(".")[2].upper()) for key in NAMES_NODES[card.keyword]}
            if card.keyword in NAMES_SETS:
                first = {fields[0].rpartition(".")[2].strip('"').upper() for _, fields in card.tokens() if fields}
                used |= {(kind, name) for kind in "NE" for name in first}
        for kind, key in frame.scope.sets:
            rows = self._find(frame, kind, key)
            name = self.deck.spelled[key]
            if rows is None or not len(rows) or (key in self.deck.internal and (kind, key) not in used):
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
        sections = {self.deck.spelled[f.name]: f.scope.sections for f in self.frames[1:]}
        return sections or {name: [name.upper()] for name in content.volumes}

    def _parts(self, content: MeshContent) -> tuple[str, ...] | None:
        """Instances; without any, the element sets of the solid sections where they cover each cell once."""
        if len(self.frames) > 1:
            named = [self.deck.spelled[f.name] for f in self.frames[1:]]
            return tuple(name for name in named if name in content.volumes)
        sections = [self.deck.spelled[key] for key in dict.fromkeys(self.deck.root.sections)]
        groups = [content.volumes[name] for name in sections if name in content.volumes]
        for kind, cells in content.solids.items():
            if groups:
                rows = np.concatenate([g.get(kind, NO_ROWS) for g in groups])
            else:
                rows = NO_ROWS
            # every cell, and none twice
            if len(rows) != len(cells) or len(np.unique(rows)) != len(rows):
                return None
        return tuple(name for name in sections if name in content.volumes)


def _split_parts(content: MeshContent, model: DeckModel) -> None:
    """Parts in several pieces between which the deck has a contact or tie: a part for each piece."""
    parts = list(content.parts or ())
    pairs = [*model.contacts, *((tie.slave, tie.master) for tie in model.ties)]
    for group in list(parts):
        cells = {kind: content.solids[kind][rows] for kind, rows in content.volumes[group].items()}
        piece_of = pieces(cells)
        count = 1 + max((int(p.max()) for p in piece_of.values() if len(p)), default=0)
        if count == 1 or not any(_joins(content, group, pair) for pair in pairs):
            continue
        names = [f"{group}_{i + 1}" for i in range(count)]
        if any(name in content.volumes for name in names):
            continue
        for kind, rows in content.volumes[group].items():
            for i in np.unique(piece_of[kind]).tolist():
                content.add_volume(names[i], kind, rows[piece_of[kind] == i])
        content.sections.update(dict.fromkeys(names, content.sections.get(group, [])))
        parts[parts.index(group) : parts.index(group) + 1] = names
        content.parts = tuple(parts)
        content.said.append(
            f"the part {group} holds {count} bodies with a contact or tie between them: {listed(names)}"
        )


def _joins(content: MeshContent, group: str, pair: tuple[str, str]) -> bool:
    """Whether both surfaces of a pair lie on one volume group."""
    spelling = {name.upper(): name for name in (*content.node_sets, *content.facets)}
    names = [spelling.get(surface.rpartition(".")[2].upper()) for surface in pair]
    return all(name is not None and content.touching(group, name) for name in names)
