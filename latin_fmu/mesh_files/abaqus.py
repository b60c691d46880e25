"""Meshes of Abaqus and CalculiX decks: parts and instances, element and node sets, surfaces of element faces.

Several ``*NODE`` and ``*ELEMENT`` blocks, sets (lists, ``GENERATE``, sets of sets), ``*SURFACE`` of element faces
(labels S1 ... S6) or nodes, ``*PART`` / ``*INSTANCE`` with translation and rotation, ``*INCLUDE``. Names are
compared without regard to case and keep the spelling of their first use. What else the deck says: ``deck_model``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ..errors import listed
from .abaqus_cards import SOLID_FACES, Card, Include, cards, element_type, elements_of, nodes_of
from .content import CORNERS, FLAT, Array, FileProblems, Index, MeshContent, rows_of
from .deck_model import DeckModel

_NONE = np.zeros(0, dtype=np.int64)
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
    node_labels: Index = field(default_factory=lambda: _NONE)
    first_node: int = 0
    element_labels: Index = field(default_factory=lambda: _NONE)
    first_element: int = 0


class _Deck:
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
        key = name.strip().upper()
        self.spelled.setdefault(key, name.strip())
        return key

    def take(self, card: Card) -> None:
        """Add the content of a card to its scope."""
        keyword = card.keyword
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
            if name.startswith(("C3D", "SC", "CSS")):
                self.problems.add(
                    "element type not known",
                    name or "none given",
                    "C3D4, C3D6, C3D8, C3D10, C3D15, C3D20 and their variants, shells for faces",
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
    deck = _Deck(where)
    for card in cards(text, include, deck.problems):
        deck.take(card)
    deck.problems.stop()
    return _Model(deck).content()


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


class _Model:
    """Instances placed, labels resolved to rows."""

    def __init__(self, deck: _Deck) -> None:
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
            self.cells.append(rows.reshape(connectivity.shape) + frame.first_node)
            self.n_element += len(labels)
            every.append(labels)
        frame.element_labels = np.concatenate(every) if every else _NONE
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
        if key in path:
            self.problems.add("a set contains itself", self.deck.spelled.get(key, key))
            return _NONE
        rows = [_NONE]
        singles: dict[str, list[int]] = {}
        for instance, text, last, step in members:
            if last:
                rows.append(self._range(self._named(instance, frame), kind, int(text), last, step))
            elif text.isascii() and text.isdigit() and len(text) < 19:
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
        if dot and any(f.name == owner.upper() for f in self.frames):
            frame, text = self._named(owner.upper(), frame), rest
        if text.isascii() and text.isdigit() and len(text) < 19:
            return self._labelled(frame, kind, np.array([int(text)], dtype=np.int64), text)
        rows = self._find(frame, kind, text.upper(), path)
        if rows is None:
            known = [self.deck.spelled.get(k, k) for t, k in frame.scope.sets if t == kind]
            self.problems.add("no set of this name", text, listed(known))
            return _NONE
        return rows

    def content(self) -> MeshContent:
        """Everything by rows and names."""
        points = np.concatenate(self.points) if self.points else np.zeros((0, 3))
        content = MeshContent(points, skipped=dict(self.deck.skipped))
        self.row_in_type = np.zeros(self.n_element, dtype=np.int64)
        for block, (kind, cells) in enumerate(zip(self.kinds, self.cells, strict=True)):
            if kind not in CORNERS:
                continue
            before = content.solids.get(kind)
            start = 0 if before is None else len(before)
            span = slice(self.first[block], self.first[block] + len(cells))
            self.row_in_type[span] = start + np.arange(len(cells))
            content.solids[kind] = cells if before is None else np.concatenate([before, cells])
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
                before = content.node_sets.get(name, _NONE)
                content.node_sets[name] = np.union1d(before, rows)

    def _add_elements(self, content: MeshContent, name: str, ids: Index, surfaces: bool = True) -> None:
        """Elements of a set under its name: solids as a volume group, shells as facets."""
        blocks = self.kind_of[ids]
        for block in np.unique(blocks):
            kind, chosen = self.kinds[block], ids[blocks == block]
            if kind in CORNERS:
                group = content.volumes.setdefault(name, {})
                group[kind] = np.union1d(group.get(kind, _NONE), self.row_in_type[chosen])
            elif surfaces:
                cells = self.cells[block][chosen - self.first[block]]
                content.facets.setdefault(name, []).append(cells[:, : FLAT[kind]])

    def _add_surface(self, content: MeshContent, frame: _Frame, name: str, items: list[tuple[str, str]]) -> None:
        for text, label in items:
            if label == "NODE":
                rows = self._other(frame, "N", text)
                content.node_sets[name] = np.union1d(content.node_sets.get(name, _NONE), rows)
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
        if not label:
            return [cells[:, list(face)] for face in faces]
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
            rows = np.concatenate([g.get(kind, _NONE) for g in groups]) if groups else _NONE
            if len(rows) != len(cells) or len(np.unique(rows)) != len(rows):
                return None
        return tuple(name for name in sections if name in content.volumes)


def _joined(part: _Scope, own: _Scope) -> _Scope:
    """The scope of an instance: what its part has and what it adds."""
    sets = {key: list(members) for key, members in part.sets.items()}
    for key, members in own.sets.items():
        sets.setdefault(key, []).extend(members)
    return _Scope(
        part.nodes + own.nodes,
        part.elements + own.elements,
        sets,
        {**part.surfaces, **own.surfaces},
        part.sections + own.sections,
    )
