"""A deck of Abaqus or CalculiX taken apart into parts, instances and what belongs to none of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from .abaqus_cards import elements_of, nodes_of
from .abaqus_elements import element_type, fills_volume
from .abaqus_scope import MAKING, ElementBlock, Member, Scope, make_more
from .content import CORNERS, FLAT, FileProblems, MeshContent
from .coordinates import BASIC, CoordinateSystem, cartesian, from_x_axis
from .deck_card import Card
from .deck_model import DeckModel, numbers
from .unused import Skipped

_CHANGES_MESH: Final = {
    "NMAP": "it moves nodes",
    "IMPERFECTION": "it moves nodes",
    "IMPORT": "it uses the mesh of another analysis",
    "SYMMETRIC MODEL GENERATION": "it extends the mesh",
    "REFINE MESH": "it changes the mesh",
}
"""Keywords that change the mesh and are not read."""
_TABLES: Final = ("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", *MAKING)  # whose data lines are read here
NODES_OF: Final = -1
"""In the place of the last label of a member: the nodes of an element set."""


class DeckScopes:
    """A deck taken apart.

    Attributes
    ----------
    root : what belongs to no part. parts : by name in capitals. instances : name, part, the scope of its own, and the
    card with the lines that place it. spelled : names by their capitals. internal : names of sets, in capitals, that
    the user did not give. skipped : elements that are not read, with their scope. model : what else the deck says.
    content : takes what is refused.
    """

    def __init__(self, where: str) -> None:
        self.problems = FileProblems(where)
        self.root = Scope()
        self.parts: dict[str, Scope] = {}
        self.instances: list[tuple[str, str, Scope, list[Card]]] = []
        self.spelled: dict[str, str] = {}
        self.internal: set[str] = set()
        self.skipped: list[tuple[Scope, Skipped]] = []
        self.model = DeckModel()
        self.content = MeshContent(np.zeros((0, 3)))
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
        rows = []
        if keyword not in _TABLES:
            rows = [fields for _, fields in card.tokens()]
        self.model.take(keyword, card.parameters, rows, card.line)
        if keyword in _TABLES:
            # its lines are in the mesh
            self.model.cards.append(Card(keyword, card.parameters, card.where, card.line))
        else:
            self.model.cards.append(card)
        if keyword == "NODE":
            self._nodes(card)
        elif keyword == "SYSTEM":
            self._system(card, rows)
        elif keyword == "ELEMENT":
            self._elements(card)
        elif keyword in ("NSET", "ELSET"):
            self._set(card, keyword[0], card.name(keyword))
        elif keyword == "SURFACE":
            self._surface(card)
        elif keyword in MAKING:
            make_more(self._here, card, self.spell, self.problems)
        elif keyword == "SOLID SECTION":
            self._here.sections.append(self.spell(card.name("ELSET")))
        elif keyword == "PART":
            self._here = self.parts.setdefault(self.spell(card.name("NAME")), Scope())
        elif keyword == "INSTANCE":
            self._here = Scope()
            name, part = self.spell(card.name("NAME")), self.spell(card.name("PART"))
            self.instances.append((name, part, self._here, [card]))
        elif keyword in ("END PART", "END INSTANCE"):
            # cards after the end of a part belong to the assembly
            self._here = self.root
        else:
            self._refuse(card)

    def _refuse(self, card: Card) -> None:
        """Note a keyword that changes the mesh, or preloads what is not read."""
        reason, remedy = _CHANGES_MESH.get(card.keyword), "export the mesh as it is to be computed"
        if card.keyword == "MODEL CHANGE" and card.name("TYPE").upper() == "ELEMENT":
            reason = "it removes or reactivates elements"
        elif card.keyword == "PRE-TENSION SECTION" and card.name("ELEMENT"):
            reason, remedy = "it preloads a beam", "mesh the bolt with solids and write [bolt.NAME] with its force"
        if reason is not None:
            remedy += f'; ignore = ["{card.keyword}"] in the table of the mesh omits it'
            what = f"*{card.keyword} is not read: {reason}"
            problem = self.problems.problem(what, None, None, remedy, card.place)
            self.content.refused.setdefault(card.keyword, problem)

    def _system(self, card: Card, rows: Sequence[Sequence[str]]) -> None:
        """The system of the nodes that follow: an origin, a point of its x axis, one of its plane x y."""
        values = [numbers([text or "0" for text in fields]) for fields in rows[:2]]
        if not rows:
            self._here.system = BASIC
            return
        points: list[float] = []
        if values[0] is not None:
            points = [*values[0], *[0.0] * 6][:6]
        third: Sequence[float] = []
        if len(values) > 1:
            third = values[1] or []
        origin, on_x = np.array(points[:3]), np.array(points[3:])
        system: CoordinateSystem | None = None
        if len(rows[0]) <= 3 and points:
            system = CoordinateSystem("R", origin, np.eye(3))
        elif points and len(third) == 3:
            system = from_x_axis("R", origin, on_x, np.array(third))
        elif points and len(rows) == 1:
            # the z axis stays, and the x axis is projected onto the plane x y
            along = np.array([*(on_x - origin)[:2], 0.0])
            system = from_x_axis("R", origin, origin + along, origin + np.cross([0.0, 0.0, 1.0], along))
        if system is None:
            allowed = "an origin; an origin and a point of the x axis; and one of the plane x y: 3, 6 or 9 numbers"
            self.problems.add("not a coordinate system", ", ".join(rows[0]), allowed, line=card.place)
        else:
            self._here.system = system

    def _nodes(self, card: Card) -> None:
        labels, coordinates = nodes_of(card, self.problems)
        kind = card.name("SYSTEM").upper() or "R"
        if kind not in ("R", "C"):
            remedy = "write the nodes in rectangular or cylindrical coordinates"
            self.problems.add("coordinates of nodes are not read so", f"SYSTEM={kind}", "R or C", remedy, card.place)
            kind = "R"
        self._here.nodes.append((labels, self._here.system.basic(cartesian(kind, coordinates))))
        if card.name("NSET"):
            self._members("N", card.name("NSET"), [("", str(label), 0, 0) for label in labels.tolist()])

    def _elements(self, card: Card) -> None:
        name = card.name("TYPE").upper()
        kind = element_type(name)
        self.model.element_types.setdefault(name, card.place)
        if kind is None:
            if fills_volume(name) or not name:
                problem = self.problems.problem(
                    "element type not known" if name else "elements without a type",
                    f"{len(card.rows)} lines of {name or 'none given'}",
                    "C3D4, C3D5, C3D6, C3D8, C3D10, C3D13, C3D15, C3D20, C3D27 and their variants, shells for faces",
                    f'ignore = ["{name}"] in the table of the mesh leaves them out',
                    card.place,
                )
                self.content.refused.setdefault(name, problem)
            self.skipped.append((self._here, Skipped.of_card(card, name)))
            if name == "DCOUP3D":
                for _, fields in card.tokens():
                    self.model.couplers.setdefault(card.name("ELSET").upper(), fields[-1])
            if card.name("ELSET"):
                # a set of elements that are not read is there, and empty
                self._members("E", card.name("ELSET"), [])
            return
        if kind == ("wedge", 6) and card.rows and card.rows[0].count(",") > 7:
            # gmsh writes wedges of 18 nodes under C3D6
            kind = ("wedge18", 18)
        corners = CORNERS.get(kind[0]) or FLAT[kind[0]]
        labels, connectivity = elements_of(card, kind[1], corners, self.problems)
        self._here.elements.append(ElementBlock(kind[0], name, labels, connectivity))
        if card.name("ELSET"):
            self._members("E", card.name("ELSET"), [("", str(label), 0, 0) for label in labels.tolist()])

    def _members(self, kind: str, name: str, members: list[Member]) -> None:
        self._here.sets.setdefault((kind, self.spell(name)), []).extend(members)

    def _set(self, card: Card, kind: str, name: str) -> None:
        instance = card.name("INSTANCE").upper()
        members: list[Member] = []
        if "INTERNAL" in card.parameters or name.startswith("_"):
            self.internal.add(name.upper())
        if "UNSORTED" in card.parameters:
            self._here.unsorted.add(name.upper())
        if kind == "N" and card.name("ELSET"):
            members.append((instance, card.name("ELSET"), NODES_OF, 0))
        for i, fields in card.tokens():
            if "GENERATE" not in card.parameters:
                members += [(instance, f.strip('"'), 0, 0) for f in fields if f]
                continue
            try:
                # the step is 1 where it is missing, the last is the first
                whole = [int(field) for field in fields[:3]]
                if len(whole) == 1:
                    whole *= 2
                first, last, step = [*whole, 1][:3]
            except (ValueError, IndexError):
                first = last = step = 0
            if not all(0 < number < 2**62 for number in (first, last, step)):
                allowed = "first, last, step > 0"
                self.problems.add("not a range of labels", ", ".join(fields), allowed, line=card.row_place(i))
                continue
            members.append((instance, str(first), last, step))
        self._members(kind, name, members)

    def _surface(self, card: Card) -> None:
        kind = card.name("TYPE").upper()
        if kind not in ("", "ELEMENT", "NODE") or "COMBINE" in card.parameters:
            # surfaces without elements, and those made of others
            self.model.unused["SURFACE"] += 1
            return
        items = self._here.surfaces.setdefault(self.spell(card.name("NAME")), [])
        for _, fields in card.tokens():
            if fields and fields[0]:
                if kind == "NODE":
                    label = "NODE"
                else:
                    if len(fields) > 1:
                        label = fields[1].upper()
                    else:
                        label = ""
                items.append((fields[0].strip('"'), label))
