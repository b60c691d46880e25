"""What becomes of reference nodes and equations in a scene: couplings, boundaries, loads of their faces."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..scene.ports import COMPONENTS
from .histories import DeckHistory, DeckQuantity, Law, LawMaker, tidy
from .surfaces import surface_nodes
from .translation import ALIKE, BODY, MEAN, MOTIONS, RIGID, SHARED, ReferenceNode, Translation

_AXES: Final = "xyz"


@dataclass(frozen=True)
class _Moved:
    """What a motion of a reference node is: its kind, amount and law."""

    kind: str
    amount: float
    law: Law


def add_references(deck: Translation, law_of: LawMaker) -> None:
    """Tables of all reference nodes; ``law_of`` : amount and law of a history over the scene."""
    if deck.coupling is not None:
        deck.refuse(deck.coupling, "no *KINEMATIC or *DISTRIBUTING below it")
    taken: dict[tuple[str, int], list[tuple[ReferenceNode, np.ndarray]]] = {}
    for reference in deck.reference_nodes:
        moved = {
            quantity.axis: _Moved(quantity.kind if amount else "fixed", amount, law)
            for quantity, history in _of(deck, reference, *MOTIONS)
            for amount, law, _ in [law_of(quantity, history)]
        }
        _add_forces(deck, reference, law_of)
        _add_motion(deck, reference, moved)
        if reference.kind in (RIGID, ALIKE):
            _check_shared(deck, reference, taken)
    if deck.reference_nodes and deck.tables.get("output", {}).pop("reactions", None):
        deck.left_out(deck.reference_nodes[0].card, "output.reactions: supports share nodes with what moves as one")


def _of(deck: Translation, reference: ReferenceNode, *kinds: str) -> list[tuple[DeckQuantity, DeckHistory]]:
    return [
        (quantity, history)
        for quantity, history in deck.histories.items()
        if quantity.target == reference.key and quantity.kind in kinds and history.settings
    ]


# -- forces -----------------------------------------------------------------------------------------------------------
def _add_forces(deck: Translation, reference: ReferenceNode, law_of: LawMaker) -> None:
    """Loads of the face of a reference node, one for each law."""
    loads: dict[str, tuple[list[float], Law]] = {}
    for quantity, history in _of(deck, reference, "nodal_force"):
        amount, law, _ = law_of(quantity, history)
        coupled = quantity.axis in reference.axes or quantity.axis - 3 in reference.rotations
        if amount and not coupled:
            what = "a force or moment on a reference node along what it does not couple"
            deck.refuse(history.settings[-1].card, what, f"{reference.name}, degree of freedom {quantity.axis + 1}")
        elif amount:
            loads.setdefault(json.dumps(law), ([0.0] * 6, law))[0][quantity.axis] += tidy(amount)
    rows = deck.rows(reference.face)
    for vector, law in loads.values():
        table: dict[str, Any] = {"face": reference.place}
        group = next(group for group, part in deck.parts.items() if part == reference.part)
        if reference.kind in (ALIKE, SHARED):
            # of nodes with one displacement the sum of the forces counts
            count = int(np.isin(rows, deck.content.nodes_of(group)).sum())
            table["nodal_force"] = [tidy(x / count) for x in vector[:3]]
        elif reference.face in deck.single or not (
            reference.face == "*" or deck.content.touching(group, reference.face)
        ):
            deck.refuse(reference.card, "a load on a reference node whose nodes make up no face", reference.name)
            continue
        else:
            table["force"] = vector[:3]
            if any(vector[3:]):
                table["moment"] = vector[3:]
            if reference.point is not None:
                table["point"] = list(reference.point)
        if law is not None:
            table["law"] = dict(law)
        deck.add("load", reference.name, table)


# -- motions ----------------------------------------------------------------------------------------------------------
def _add_motion(deck: Translation, reference: ReferenceNode, moved: Mapping[int, _Moved]) -> None:
    """Coupling or boundary of a reference node that is free, held or moved."""
    shifts = {axis: motion for axis, motion in moved.items() if axis in reference.axes}
    turns = {axis - 3: motion for axis, motion in moved.items() if axis - 3 in reference.rotations}
    if any(motion.amount for motion in turns.values()):
        what = "a rotation of a reference node that is not 0"
        deck.refuse(reference.card, what, reference.name, "[port.NAME] moves a face by velocities and rotations")
        return
    free = [axis for axis in reference.axes if axis not in shifts]
    spins = [axis for axis in reference.rotations if axis not in turns]
    still = all(motion.amount == 0.0 for motion in shifts.values())
    if not shifts and not turns:
        if reference.kind in (RIGID, ALIKE):
            _add_rigid(deck, reference, [*free, *(axis + 3 for axis in spins)])
    elif still and len(shifts) == 3 and (len(spins) == 3 or (reference.kind == MEAN and len(spins) in (0, 3))):
        _add_ground(deck, reference, bool(turns) and not spins)
    elif reference.kind in (MEAN, SHARED):
        what = "a reference node of *DISTRIBUTING that is held or moved, but neither free nor held along 1 to 3 at zero"
        deck.refuse(reference.card, what, reference.name, "*KINEMATIC holds the nodes themselves")
    elif reference.kind in (RIGID, ALIKE) and not shifts:
        _add_rigid(deck, reference, [*free, *(axis + 3 for axis in spins)])
    elif not spins and (reference.kind != BODY or len(shifts) > 1):
        _add_boundaries(deck, reference, shifts)
        if free and reference.kind != BODY:
            _add_rigid(deck, reference, free)
    else:
        what = "a reference node that is held or moved along some of its motions and free to turn"
        remedy = "hold 4 to 6 as well, or 1 to 3 at zero without 4 to 6"
        deck.refuse(reference.card, what, reference.name, remedy)


def _add_rigid(deck: Translation, reference: ReferenceNode, components: list[int]) -> None:
    table: dict[str, Any] = {"ends": [reference.place], "rigid": True}
    if len(components) < len(COMPONENTS):
        table["components"] = [COMPONENTS[i] for i in sorted(components)]
    deck.add("coupling", reference.name, table)


def _add_ground(deck: Translation, reference: ReferenceNode, turns: bool) -> None:
    """Translations of the node held at zero, and its rotations where ``turns``; a rigid face that is held altogether
    is a fixed one."""
    assert reference.point is not None
    end = {"face": reference.place, "point": list(reference.point)}
    table: dict[str, Any] = {"ends": [end, "ground"]}
    if reference.kind == RIGID:
        table["rigid"] = True
    if not turns:
        table["rotations"] = False
    deck.add("coupling", reference.name, table)


def _add_boundaries(deck: Translation, reference: ReferenceNode, shifts: Mapping[int, _Moved]) -> None:
    """All nodes move as the node, which does not turn: a boundary for each law."""
    grouped: dict[str, dict[int, _Moved]] = {}
    for axis in sorted(shifts):
        grouped.setdefault(json.dumps([shifts[axis].kind, shifts[axis].law]), {})[axis] = shifts[axis]
    group = next(group for group, part in deck.parts.items() if part == reference.part)
    for alike in grouped.values():
        first = next(iter(alike.values()))
        table: dict[str, Any] = {"type": first.kind, "face": reference.place}
        if len(alike) < 3 or first.kind != "fixed":
            table["components"] = [_AXES[axis] for axis in alike]
        if first.kind != "fixed":
            no_face = reference.face in deck.single or not deck.content.touching(group, reference.face)
            if reference.face != "*" and no_face:
                deck.refuse(reference.card, "moved nodes that make up no facet of an element", reference.name)
                return
            table["value"] = [tidy(motion.amount) for motion in alike.values()]
            if first.law is not None:
                table["law"] = dict(first.law)
        deck.add("boundary", reference.name, table)


def _check_shared(
    deck: Translation, reference: ReferenceNode, taken: dict[tuple[str, int], list[tuple[ReferenceNode, np.ndarray]]]
) -> None:
    """Refuse nodes that two of these join, or that move otherwise as well, along one axis."""
    rows = deck.rows(reference.face)
    if not len(rows):
        rows = surface_nodes(deck.content, reference.face)
    for axis in reference.axes:
        for other, others in taken.setdefault((reference.part, axis), []):
            if np.isin(rows, others).any():
                what = f"nodes that two cards join along {_AXES[axis]}"
                deck.refuse(reference.card, what, f"{other.name}, {reference.name}")
        taken[reference.part, axis].append((reference, rows))
    for quantity, history in deck.histories.items():
        moves = quantity.kind in MOTIONS and quantity.axis in reference.axes and quantity.target != reference.key
        if not moves or not any(setting.value for setting in history.settings):
            continue
        if np.isin(rows, deck.rows(quantity.target)).any():
            what = "nodes that move as one, some of which are moved by *BOUNDARY"
            deck.refuse(reference.card, what, quantity.target, "move all of them, or the reference node")
