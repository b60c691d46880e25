"""Cards of output: what they become in a scene, and what is printed of a run as CalculiX prints it.

A *NODE PRINT goes on over the steps after its own, until a step has a card of the same name: its first one takes those
of the steps before away. There is one FREQUENCY: the last one that a card of output has given counts for all of them,
also in the steps that follow (ccx 2.20, measured).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from ..mesh_files.content import MeshContent
from ..mesh_files.deck_card import Card
from ..results.writing import FILED as FRD
from ..results.writing import PRINTED as DAT
from .frd_file import ELEMENTS
from .histories import DeckStep
from .translation import PrintRequest, Translation

_FEW: Final = 10  # nodes of a set that become sensors
_FIELDS: Final[dict[str, dict[str, bool]]] = {
    "U": {"fields": True},
    "V": {"fields": True},
    "RF": {"reactions": True},
    "S": {"nodal_stress": True},
    "E": {"strain": True},
    "LE": {"strain": True},
    "ENER": {"energy": True},
    "ELSE": {"energy": True},
    "ALLKE": {"energy": True},
    "ALLIE": {"energy": True},
    "CSTR": {"surfaces": True},
    "CSTRESS": {"surfaces": True},
    "CDIS": {"surfaces": True},
    "CDISP": {"surfaces": True},
    "CF": {},
}
"""Keys of [output] by the word of a deck; CF, the force of a contact, is always there."""
PRINTED: Final[Mapping[str, tuple[str, ...]]] = {
    "NODE PRINT": ("U", "V", "RF"),
    "EL PRINT": ("S", "E", "ME", "ENER", "EVOL", "ELSE"),
    "CONTACT PRINT": ("CF",),
    "NODE FILE": ("U", "V", "RF"),
    "EL FILE": ("S", "E", "ME"),
}
"""Words of each card that are written as CalculiX does."""
_SAME: Final[Mapping[str, str]] = {"NODE OUTPUT": "NODE FILE", "ELEMENT OUTPUT": "EL FILE"}
"""Cards that write the same file in another form."""
FILED: Final = ("NODE FILE", "EL FILE")
"""Cards of the .frd."""
_ELEMENTS: Final = ("C3D4", "C3D10", "C3D6", "C3D15", "C3D8", "C3D8I", "C3D8R", "C3D20", "C3D20R")
"""Types of elements whose integration points are known."""


@dataclass(frozen=True)
class PrintInstant:
    """An instant at which is printed.

    Attributes
    ----------
    step : number, from 1. deck, scene : times. increment : number in its step, from 1. last : whether it ends the step.
    """

    step: int
    deck: float
    scene: float
    increment: int
    last: bool


@dataclass(frozen=True)
class DeckPrints:
    """What is printed of a run.

    Attributes
    ----------
    content : mesh of the deck. parts : names of substructures by volume group. requests : by step, in order. every :
    increments from one block to the next, by step, 0 for none. instants : of the scene. sensors : their names by rows
    of nodes. pairs : interfaces by ``SLAVE/MASTER``. moving : numbers of the steps with inertia.
    """

    content: MeshContent
    parts: Mapping[str, str]
    requests: Mapping[int, Sequence[PrintRequest]] = field(default_factory=dict)
    every: Mapping[int, int] = field(default_factory=dict)
    instants: Sequence[PrintInstant] = ()
    sensors: Mapping[int, str] = field(default_factory=dict)
    pairs: Mapping[str, Sequence[str]] = field(default_factory=dict)
    moving: Sequence[int] = ()

    def printed(self) -> Iterator[tuple[PrintInstant, PrintRequest]]:
        """What is printed, in the order of the file."""
        for instant in self.instants:
            yield from ((instant, request) for request in self._wanted(instant) if request.keyword not in FILED)

    def filed(self, instant: PrintInstant) -> list[PrintRequest]:
        """What is filed at an instant."""
        return [request for request in self._wanted(instant) if request.keyword in FILED]

    def _wanted(self, instant: PrintInstant) -> Sequence[PrintRequest]:
        every = self.every[instant.step]
        if every and (instant.last or instant.increment % every == 0):
            return self.requests.get(instant.step, ())
        return ()


# -- cards ------------------------------------------------------------------------------------------------------------
def output(deck: Translation, card: Card) -> None:
    """*NODE PRINT and its like: sensors of few nodes, keys of [output], and what is printed as CalculiX prints it."""
    now = deck.step
    if now is not None and now.procedure is None:
        deck.left_out(card, f"it belongs to the step from line {now.card.line} on, which is left out")
        return
    words = [word.upper() for _, fields in card.tokens() for word in fields if word]
    if card.name("FREQUENCY").isdigit():
        deck.frequencies[deck.number] = int(card.name("FREQUENCY"))
    moved = {"U", "V", "A"} & set(words)
    # first: what is printed of reference nodes is that of their sensors
    points = _sensors(deck, card) if card.keyword == "NODE PRINT" and moved else 0
    printed = _request(deck, card, words)
    lost = [word for word in words if word not in _FIELDS and word not in printed]
    keys: dict[str, Any] = {}
    for word in words:
        if not (points and word in ("U", "V", "A")):
            keys |= _FIELDS.get(word, {})
    if card.keyword == "EL PRINT" and "S" in words:
        keys = {**{key: value for key, value in keys.items() if key != "nodal_stress"}, "stress": True}
    recovered = {"RF", "E", "ME"} if card.keyword != "EL PRINT" else {*PRINTED["EL PRINT"]}
    if recovered & set(printed):
        # what is printed is recovered from displacements, as strains are
        keys["strain"] = True
    if keys:
        deck.output(**keys)
    into = ""
    if printed:
        nobody = "all nodes" if _SAME.get(card.keyword, card.keyword) in FILED else "the contact"
        of = card.name("NSET") or card.name("ELSET") or nobody
        into = f"; {', '.join(printed)} of {of} in the {_file_of(card)}"
    if points:
        deck.used(card, f"{points} [sensor.NAME]{into}")
    elif keys or "CF" in words:
        names = ", ".join(f"output.{key}" for key in keys) or "forces of the interfaces, always there"
        text = f"{names}; of the whole mesh" if card.name("NSET") or card.name("ELSET") else names
        deck.used(card, text + into)
    if lost and not (lost == ["A"] and points):
        deck.left_out(card, f"{', '.join(lost)}: not in the results")
    unprinted = [word for word in words if word not in printed and word not in lost]
    if unprinted:
        deck.left_out(card, f"{', '.join(unprinted)}: in the results, not in the {_file_of(card)}")
    if not words:
        deck.left_out(card, "no quantities named, the results have theirs")


def _file_of(card: Card) -> str:
    """Suffix of the file that a card writes."""
    return DAT if card.keyword.endswith("PRINT") else FRD


def _sensors(deck: Translation, card: Card) -> int:
    """Add sensors at the nodes of a small set; their number."""
    rows = deck.rows(card.name("NSET"))
    if not 0 < len(rows) <= _FEW:
        return 0
    count = 0
    for i, row in enumerate(rows.tolist(), 1):
        place = _place(deck, row)
        if place is None:
            continue
        name = card.name("NSET") if len(rows) == 1 else f"{card.name('NSET')}_{i}"
        if row not in deck.sensors:
            deck.sensors[row] = deck.add("sensor", name, {**place, "point": deck.content.points[row].tolist()})
        count += 1
    return count


def _place(deck: Translation, row: int) -> dict[str, str] | None:
    """The substructure of a node, or the face that a reference node moves with; None of other nodes."""
    for group, part in deck.parts.items():
        if row in deck.content.nodes_of(group):
            return {"substructure": part}
    reference, first = deck.references.get(row, (None, 0))
    if reference is None or first or reference.point is None or reference.face in deck.single:
        return None
    return {"face": reference.place}


def _request(deck: Translation, card: Card, words: Sequence[str]) -> tuple[str, ...]:
    """Note what a card prints; its words that are."""
    keyword = _SAME.get(card.keyword, card.keyword)
    known = PRINTED.get(keyword, ())
    printed = tuple(word for word in words if word in known)
    labels = deck.content.labels
    why = None
    if not printed or deck.step is None:
        return ()
    if len(np.unique(labels)) < len(labels):
        why = "nodes of several instances have one number"
    elif keyword in FILED:
        why = _unfiled(deck, card, printed)
        if why is not None and printed != ("RF",) and "RF" in printed and why is _CONTACT:
            deck.left_out(card, f"RF: not in the .frd, {why}")
            why, printed = None, tuple(word for word in printed if word != "RF")
    elif card.keyword == "NODE PRINT" and not (
        deck.parts_of_nodes(card.name("NSET")) or any(row in deck.sensors for row in deck.rows(card.name("NSET")))
    ):
        why = "no node of the set is on a solid"
    elif card.keyword == "EL PRINT":
        why = _unknown_elements(deck, card.name("ELSET"))
    elif card.keyword == "CONTACT PRINT" and not (card.name("SLAVE") and card.name("MASTER")):
        why = "SLAVE and MASTER have to be named"
    target = card.name("NSET") or card.name("ELSET")
    if card.keyword == "CONTACT PRINT":
        target = f"{card.name('SLAVE')}/{card.name('MASTER')}"
    if why is not None:
        deck.left_out(card, f"{', '.join(printed)} of {target or 'all nodes'}: not in the {_file_of(card)}, {why}")
        return ()
    if card.name("TIME POINTS"):
        deck.left_out(card, "TIME POINTS: all instants are printed")
    totals = card.name("TOTALS").upper() or "NO"
    local = card.name("GLOBAL").upper() == "NO" or (card.keyword == "NODE PRINT" and card.name("GLOBAL") == "")
    request = PrintRequest(keyword, printed, target.upper(), totals, local)
    deck.prints.setdefault(deck.number, []).append(request)
    return printed


_CONTACT: Final = "at nodes of contacts other forces act"


def _unfiled(deck: Translation, card: Card, printed: Sequence[str]) -> str | None:
    """Why what a card files is not in the .frd; None where it is."""
    lost = sorted({kind for group in deck.parts for kind in deck.content.volumes[group] if kind not in ELEMENTS})
    if lost:
        return f"the format has no elements like {', '.join(lost)}"
    if card.name("NSET") and not deck.parts_of_nodes(card.name("NSET")):
        return "no node of the set is on a solid"
    if "RF" in printed and deck.pairs:
        return _CONTACT
    return None


def _unknown_elements(deck: Translation, elset: str) -> str | None:
    """Why elements of a set are not printed; None where they are."""
    name = {key.upper(): key for key in deck.content.volumes}.get(elset.upper())
    if name is None:
        return "no solid is in the set"
    for kind, rows in deck.content.volumes[name].items():
        for word, of_type in deck.content.types.items():
            if word not in _ELEMENTS and np.isin(rows, of_type.get(kind, rows[:0])).any():
                return f"the integration points of {word} are not known"
    return None


# -- over the steps ---------------------------------------------------------------------------------------------------
def prints_of(deck: Translation, start: float) -> DeckPrints:
    """What is printed, by step and instant.

    start : time of the deck at which the axis of the scene begins.
    """
    requests: dict[int, list[PrintRequest]] = {}
    every: dict[int, int] = {}
    now: list[PrintRequest] = []
    for number in range(1, len(deck.steps) + 1):
        new = deck.prints.get(number, [])
        renewed = {request.keyword for request in new}
        now = [*(request for request in now if request.keyword not in renewed), *new]
        requests[number] = now
        every[number] = deck.frequencies.get(number, every.get(number - 1, 1))
    pairs: dict[str, list[str]] = {}
    for name, pair in deck.pairs.items():
        pairs.setdefault(pair.upper(), []).append(name)
    instants = list(_instants(deck, start))
    moving = [number for number, step in enumerate(deck.steps, 1) if step.dynamic]
    return DeckPrints(deck.content, deck.parts, requests, every, instants, dict(deck.sensors), pairs, moving)


def _instants(deck: Translation, start: float) -> Iterator[PrintInstant]:
    """Instants of the scene as increments of the steps of the deck."""
    table = deck.tables["time"]
    length = table["end"] / table["instants"]
    there = [(number, step) for number, step in enumerate(deck.steps, 1) if step.procedure is not None]
    on_axis = [(number, step) for number, step in there if step.kept and (step.dynamic or not deck.inertia)]
    before = [(number, step) for number, step in there if (number, step) not in on_axis]
    for number, step in before[:-1]:
        if deck.prints.get(number):
            deck.left_out(step.card, "the state at its end is not printed: the scene begins with that of a later step")
    if before:
        number, step = before[-1]
        # the state from which the motion or the loads begin
        yield PrintInstant(number, step.start + step.period, 0.0, 1, True)
    increment, position = 0, 0
    for k in range(1, table["instants"] + 1) if on_axis else ():
        time = start + k * length
        while time > _end(on_axis[position][1]) + 1e-6 * length and position + 1 < len(on_axis):
            position, increment = position + 1, 0
        number, step = on_axis[position]
        increment += 1
        last = abs(time - _end(step)) < 1e-6 * length
        if last or not _is_linear(deck, step):
            yield PrintInstant(number, time, k * length, increment, last)


def _end(step: DeckStep) -> float:
    return step.start + step.period


def _is_linear(deck: Translation, step: DeckStep) -> bool:
    """Whether a step is one increment in CalculiX: static, of small displacements, without contact."""
    large = "NLGEOM" in step.card.parameters and step.card.name("NLGEOM").upper() != "NO"
    return not (step.dynamic or large or any(card.keyword == "CONTACT PAIR" for card in deck.model.cards))
