"""What a deck becomes while its cards are read: tables of a scene, loads and motions over its steps, uses of cards.

Every card is used, left out with its consequence, or refused with its line: each translator records one of these.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from ..errors import Problem
from ..mesh_files.content import Array, Index, MeshContent
from ..mesh_files.deck_card import Card, FileLine, real
from ..mesh_files.deck_equations import TiedSet, UnreadEquation
from ..mesh_files.deck_model import DeckModel
from ..mesh_files.deck_scene import faces_of, parts_with, rows_of_set
from ..scene.substructures import part_name
from .histories import Amplitude, DeckHistory, DeckQuantity, DeckStep, Setting

USED: Final = "used"
LEFT_OUT: Final = "left out"


@dataclass(frozen=True)
class CardUse:
    """A line of the summary.

    Attributes
    ----------
    verdict : USED or LEFT_OUT. keyword : of the card, in capitals. place : where it stands. text : what becomes of it.
    """

    verdict: str
    keyword: str
    place: FileLine
    text: str


@dataclass
class SectionBolt:
    """A pre-tension section: name of its table, the node whose first degree of freedom tightens it, and the sign of a
    number there that does."""

    name: str
    node: str
    card: Card
    sign: float


BODY: Final = "body"
RIGID: Final = "rigid"
MEAN: Final = "mean"
ALIKE: Final = "alike"
SHARED: Final = "shared"
"""Kinds: a rigid part, a rigid face, the mean motion of a face, nodes with the same displacement along some axes, nodes
that share a force evenly."""


@dataclass(frozen=True)
class ReferenceNode:
    """Nodes that follow one motion, and the node that stands for it.

    Attributes
    ----------
    name : of its tables. card : of it. kind : see ``BODY`` and its like. part, face : whose nodes they are;
    "*" is the whole part. axes : translations that are coupled, from 0. rotations : those that the motion has, from 0.
    point : (3,) place of the node, None where there is none.
    """

    name: str
    card: Card
    kind: str
    part: str
    face: str
    axes: tuple[int, ...]
    rotations: tuple[int, ...]
    point: tuple[float, float, float] | None

    @property
    def key(self) -> str:
        """What loads and motions of the node are of: no set of a deck has this name."""
        return f"{self.card.keyword} {self.card.line} {self.name}"

    @property
    def place(self) -> str:
        """The face in a scene."""
        return f"{self.part}.{self.face}"


@dataclass(frozen=True)
class PrintRequest:
    """What one card prints.

    Attributes
    ----------
    keyword : of the card. words : quantities that are printed. target : set, in capitals, or SLAVE/MASTER. totals : NO,
    YES, ONLY. local : along the axes of *TRANSFORM.
    """

    keyword: str
    words: tuple[str, ...]
    target: str
    totals: str
    local: bool


@dataclass
class Translation:
    """A deck and the scene that it becomes.

    Attributes
    ----------
    content : mesh, names and cards of the deck. parts : names of substructures by volume group. steps : of the deck, in
    order. problems : reasons why it is refused. uses : lines of the summary. tables : of the scene, by kind and name.
    material_keys : constants of materials, in capitals, that the mesh reader does not take. histories : of loads and
    motions. amplitudes, interactions : by name in capitals. bolts : by the number of their node. reference_nodes : in
    order. references : by row of their nodes, and the motion that the first degree of freedom there is, from 0.
    coupling : *COUPLING whose card below is not read yet. tied : sets of nodes that equations join, once they are read.
    initial : temperature by node set. prints : requests by step that makes them. frequencies : of output by step.
    single : node sets that are no faces. sensors : their names by rows of nodes. pairs : surfaces ``SLAVE/MASTER`` by
    interface. orientations :
    axes by name in capitals. section_axes : names of orientations of the sections of each material. material,
    interaction : that the cards are of. number : of the present step, 0 before the first.
    """

    content: MeshContent
    parts: Mapping[str, str]
    steps: list[DeckStep]
    problems: list[Problem] = field(default_factory=list)
    uses: list[CardUse] = field(default_factory=list)
    tables: dict[str, dict[str, Any]] = field(default_factory=dict)
    material_keys: dict[str, dict[str, Any]] = field(default_factory=dict)
    histories: dict[DeckQuantity, DeckHistory] = field(default_factory=dict)
    amplitudes: dict[str, Amplitude] = field(default_factory=dict)
    interactions: dict[str, dict[str, Any]] = field(default_factory=dict)
    bolts: dict[str, SectionBolt] = field(default_factory=dict)
    reference_nodes: list[ReferenceNode] = field(default_factory=list)
    references: dict[int, tuple[ReferenceNode, int]] = field(default_factory=dict)
    coupling: Card | None = None
    tied: tuple[list[TiedSet], list[UnreadEquation]] | None = None
    initial: dict[str, float] = field(default_factory=dict)
    prints: dict[int, list[PrintRequest]] = field(default_factory=dict)
    frequencies: dict[int, int] = field(default_factory=dict)
    single: set[str] = field(default_factory=set)
    sensors: dict[int, str] = field(default_factory=dict)
    pairs: dict[str, str] = field(default_factory=dict)
    orientations: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    section_axes: dict[str, set[str]] = field(default_factory=dict)
    material: str = ""
    interaction: str = ""
    number: int = 0
    _names: dict[bytes, str] = field(default_factory=dict)

    @property
    def model(self) -> DeckModel:
        """What the deck says beyond its mesh."""
        assert self.content.deck is not None
        return self.content.deck

    @property
    def inertia(self) -> bool:
        """Whether a step of the deck is dynamic."""
        return any(step.dynamic for step in self.steps)

    def sections_turned(self, material: str) -> int:
        """Number of the sections of a material, in capitals, that name an ORIENTATION."""
        sections = [card for card in self.model.cards if card.keyword == "SOLID SECTION"]
        return sum(bool(card.name("ORIENTATION")) for card in sections if card.name("MATERIAL").upper() == material)

    @property
    def step(self) -> DeckStep | None:
        """The step that is being read; None before the first."""
        return self.steps[self.number - 1] if self.number else None

    # -- what is used --------------------------------------------------------------------------------------------
    def used(self, card: Card, text: str) -> None:
        """A card becomes a part of the scene."""
        self.uses.append(CardUse(USED, card.keyword, card.place, text))

    def left_out(self, card: Card, consequence: str) -> None:
        """A card is left out, with what that changes."""
        self.uses.append(CardUse(LEFT_OUT, card.keyword, card.place, consequence))

    def refuse(
        self, card: Card, what: str, value: str | None = None, remedy: str | None = None, row: int | None = None
    ) -> None:
        """A card, or a data line of it, without which the scene would be another one."""
        place = card.place if row is None else card.row_place(row)
        where = f"{place.where}, line {place.line}"
        problem = Problem(where, f"*{card.keyword}: {what}", value, None, remedy)
        if problem not in self.problems:
            self.problems.append(problem)

    def refuse_parameters(self, card: Card, allowed: Iterable[str]) -> bool:
        """Refuse parameters of a card that are not known; whether there is any."""
        unknown = [key for key in card.parameters if key not in allowed]
        for key in unknown:
            self.refuse(card, "a parameter that is not translated", f"{key}={card.name(key)}".rstrip("="))
        return bool(unknown)

    # -- what a name is ------------------------------------------------------------------------------------------
    def points_of(self, name: str) -> Array:
        """Places (n, 3) of the nodes of a set."""
        return self.content.points[self.rows(name)]

    def rows(self, name: str) -> Index:
        """Rows of the nodes of a set, or of a node by its number."""
        return rows_of_set(self.content, name)

    def faces(self, surface: str) -> list[str]:
        """``part.face`` on each part that a surface lies on."""
        return faces_of(self.content, self.parts, surface)

    def parts_of_nodes(self, name: str) -> list[str]:
        """Parts that have nodes of a set."""
        return parts_with(self.content, self.parts, name, self.rows(name))

    def whole_parts(self, name: str) -> list[str] | None:
        """Parts all of whose nodes are in a node set; None where it has some of the nodes of one."""
        rows = self.rows(name)
        groups = {part: self.content.nodes_of(group) for group, part in self.parts.items()}
        touched = {part: np.isin(nodes, rows) for part, nodes in groups.items() if np.isin(nodes, rows).any()}
        if not touched or not all(inside.all() for inside in touched.values()):
            return None
        return list(touched)

    def parts_of_elements(self, elset: str) -> list[str] | None:
        """Parts all of whose cells are in an element set; None where it has some cells of a part, or is not there."""
        owner, _, short = elset.strip('"').rpartition(".")
        names = {name.upper(): name for name in self.content.volumes}
        chosen = self.content.volumes.get(names.get(elset.strip('"').upper(), names.get(short.upper(), "")))
        if chosen is None:
            return None
        found = []
        for group, part in self.parts.items():
            if owner and group.upper() != owner.upper():
                continue
            cells = self.content.volumes[group]
            inside = [np.isin(rows, chosen.get(kind, rows[:0])) for kind, rows in cells.items()]
            if all(i.all() for i in inside):
                found.append(part)
            elif any(i.any() for i in inside):
                return None
        return found or None

    def alike(self, name: str) -> str:
        """Name of the first set or surface that had the same nodes or facets: loads of several steps on it are one."""
        spelled = {key.upper(): key for key in self.content.facets}
        tables = self.content.facets.get(spelled.get(name.upper(), ""), [])
        if tables:
            key = b"faces" + b"".join(np.sort(table, axis=1).tobytes() for table in tables)
        else:
            key = b"nodes" + self.rows(name).tobytes()
        return self._names.setdefault(key, name)

    # -- tables --------------------------------------------------------------------------------------------------
    def add(self, kind: str, name: str, table: Mapping[str, Any]) -> str:
        """Add a table ``[kind.NAME]``; its name, with a number where it is taken."""
        tables = self.tables.setdefault(kind, {})
        stem = part_name(name)
        free, count = stem, 1
        while free in tables:
            count += 1
            free = f"{stem}_{count}"
        tables[free] = dict(table)
        return free

    def output(self, **keys: Any) -> None:
        """Add keys of [output]."""
        self.tables.setdefault("output", {}).update(keys)

    # -- loads and motions ---------------------------------------------------------------------------------------
    def set(self, quantity: DeckQuantity, value: float, card: Card) -> None:
        """Set a quantity from the present step on; forces that one step sets several times add up."""
        history = self.histories.setdefault(quantity, DeckHistory())
        amplitude = self._amplitude(card)
        last = history.settings[-1] if history.settings else None
        if last is not None and last.step == self.number:
            if quantity.kind in ADDING:
                if last.amplitude != amplitude:
                    self.refuse(card, f"{quantity.target} is loaded twice in one step, by different amplitudes")
                value += last.value
            history.settings.pop()
        history.settings.append(Setting(self.number, value, amplitude, card))

    def _amplitude(self, card: Card) -> Amplitude | None:
        """The amplitude that a card names, later by its TIME DELAY."""
        found = self.amplitudes.get(card.name("AMPLITUDE").upper())
        if found is None or not card.name("TIME DELAY"):
            return found
        delay = real(card.name("TIME DELAY"))
        return Amplitude(tuple(time + delay for time in found.times), found.values, found.total)

    def renew(self, card: Card, kinds: Iterable[str]) -> None:
        """Take away what the steps before set, where a card says OP=NEW."""
        if card.name("OP").upper() != "NEW":
            return
        for quantity, history in self.histories.items():
            if quantity.kind in kinds and history.settings and history.settings[-1].step < self.number:
                history.ended.append(self.number)


MOTIONS: Final = ("displacement", "velocity", "acceleration")
"""Kinds of quantities that are motions."""
ADDING: Final = ("nodal_force", "pressure", "traction", "gravity", "rotation")
"""Kinds of quantities that add up."""
