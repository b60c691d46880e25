"""Reference nodes and equations of a deck: rigid bodies and faces, mean motions, nodes that move as one.

A reference node has three translations and, by itself or by a second node (ROT NODE), three rotations. What acts on it
acts on its face: a force and a moment at its place. The scene has no such node; its table is a coupling, a boundary of
the face where all rotations are held, or a rigid substructure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ..mesh_files.content import Index
from ..mesh_files.deck_card import Card
from ..mesh_files.deck_equations import TiedSet, tied_sets
from ..mesh_files.deck_scene import set_named
from .surfaces import unlisted_middles
from .translation import ALIKE, BODY, MEAN, RIGID, SHARED, ReferenceNode, Translation

_ALL: Final = (0, 1, 2)
_ACROSS: Final = 1e-6  # of a normal, and of a plane over its size: digits that a deck writes


def _row(deck: Translation, text: str) -> int:
    """Row of a node, by its number or by a set that holds it alone; -1 where there is none."""
    rows = deck.rows(text)
    if len(rows) == 1:
        return int(rows[0])
    number = text.rpartition(".")[2]
    found = np.flatnonzero(deck.content.labels == int(number)) if number.isdigit() else np.zeros(0, dtype=np.int64)
    return int(found[0]) if len(found) == 1 else -1


def _named(card: Card, words: str) -> str:
    """A parameter that CalculiX also reads without its blank."""
    return card.name(words) or card.name(words.replace(" ", ""))


def _add(deck: Translation, reference: ReferenceNode, nodes: Sequence[tuple[int, int]]) -> bool:
    """Note a reference node; ``nodes`` : rows, and the degree of freedom that their first one is, from 0."""
    for row, first in nodes:
        if row in deck.references or any(row in deck.content.nodes_of(group) for group in deck.parts):
            what = "a reference node that is a node of a solid, or that of another card"
            deck.refuse(reference.card, what, str(deck.content.labels[row]))
            return False
        deck.references[row] = reference, first
    deck.reference_nodes.append(reference)
    return True


def _point(deck: Translation, row: int) -> tuple[float, float, float] | None:
    if row < 0:
        return None
    x, y, z = deck.content.points[row].tolist()
    return x, y, z


# -- rigid bodies -----------------------------------------------------------------------------------------------------
def rigid_body(deck: Translation, card: Card) -> None:
    """*RIGID BODY: a rigid part, or a rigid face by its nodes, with the node that it follows."""
    if deck.refuse_parameters(card, ("NSET", "ELSET", "REF NODE", "REFNODE", "ROT NODE", "ROTNODE")):
        return
    nodes = []
    for words, first in (("REF NODE", 0), ("ROT NODE", 3)):
        if text := _named(card, words):
            row = _row(deck, text)
            if row < 0:
                deck.refuse(card, f"no such node as {words}", text)
                return
            nodes.append((row, first))
    found = _whole(deck, card)
    if found is not None:
        text = "rigid = true of the substructure"
        for part in found:
            deck.tables.setdefault("substructure", {}).setdefault(part, {})["rigid"] = True
        if len(found) > 1 and nodes:
            deck.refuse(card, "a rigid body of several parts with a reference node", ", ".join(found))
            return
        part, kind, face = found[0], BODY, "*"
    else:
        face = set_named(deck.content, card.name("NSET"))
        owners = deck.parts_of_nodes(face) if face else []
        if len(owners) != 1 or card.name("ELSET"):
            what = "a rigid body of all elements of parts, or of nodes of one part, alone is translated"
            deck.refuse(card, what, card.name("ELSET") or card.name("NSET"))
            return
        part, kind, text = owners[0], RIGID, f"[coupling.NAME] with rigid = true: {owners[0]}.{face} moves as one body"
        _without_middles(deck, face)
    place = _point(deck, next((row for row, first in nodes if first == 0), -1))
    reference = ReferenceNode(face if face != "*" else part, card, kind, part, face, _ALL, _ALL, place)
    if _add(deck, reference, nodes):
        deck.used(card, text + "; loads and supports of its reference node are those of the body" * bool(nodes))


def _whole(deck: Translation, card: Card) -> list[str] | None:
    """Parts that a rigid body holds all of."""
    if card.name("ELSET"):
        return deck.parts_of_elements(card.name("ELSET"))
    rows = deck.rows(card.name("NSET"))
    if not len(rows) or not all(np.isin(rows, deck.content.nodes_of(g)).all() for g in _groups_with(deck, rows)):
        return None
    return deck.whole_parts(card.name("NSET"))


def _groups_with(deck: Translation, rows: Index) -> list[str]:
    return [group for group in deck.parts if np.isin(rows, deck.content.nodes_of(group)).any()]


def _without_middles(deck: Translation, face: str) -> None:
    """Corners of quadratic facets without the middle nodes are these nodes alone, no face."""
    if face in deck.content.node_sets and unlisted_middles(deck.content, deck.rows(face)):
        deck.single.add(face)


# -- couplings --------------------------------------------------------------------------------------------------------
def coupling(deck: Translation, card: Card) -> None:
    """*COUPLING: node and surface of the *KINEMATIC or *DISTRIBUTING below it."""
    allowed = ("CONSTRAINT NAME", "REF NODE", "REFNODE", "SURFACE")
    deck.coupling = None if deck.refuse_parameters(card, allowed) else card
    faces = deck.faces(card.name("SURFACE"))
    row = _row(deck, _named(card, "REF NODE"))
    if row < 0 or len(faces) != 1:
        deck.refuse(card, "a coupling of a node that is there to a surface on one part alone is translated")
        deck.coupling = None
    elif deck.coupling is not None:
        deck.used(card, f"[coupling.NAME] or load on {faces[0]}, by the card below it")


def kinematic(deck: Translation, card: Card) -> None:
    """*KINEMATIC: the nodes of a surface move as a rigid body, along the axes that are listed."""
    _couple(deck, card, RIGID, "its nodes move as those of a rigid body")


def distributing(deck: Translation, card: Card) -> None:
    """*DISTRIBUTING: what acts on the node spreads over the surface, by area."""
    _couple(deck, card, MEAN, "force and moment spread by area, it deforms")


def _couple(deck: Translation, card: Card, kind: str, text: str) -> None:
    above, deck.coupling = deck.coupling, None
    if above is None:
        if not deck.problems:
            deck.refuse(card, "no *COUPLING above it")
        return
    if deck.refuse_parameters(card, ()):
        return
    degrees: set[int] = set()
    for i, fields in card.tokens():
        try:
            first = int(fields[0])
            degrees |= set(range(first, int(fields[1] if len(fields) > 1 else first) + 1))
        except (ValueError, IndexError):
            deck.refuse(card, "not a range of degrees of freedom", ", ".join(fields), row=i)
            return
    degrees = degrees or set(range(1, 7))
    axes = tuple(d - 1 for d in sorted(degrees) if d <= 3)
    if not axes or not degrees <= set(range(1, 7)) or (kind == MEAN and axes != _ALL):
        what = "degrees of freedom 1 to 6, some of 1 to 3 among them, all of 1 to 3 of *DISTRIBUTING"
        deck.refuse(card, what, ", ".join(map(str, sorted(degrees))))
        return
    # the nodes of a solid have no rotations: a kinematic one turns them with the node, whether it lists these or not
    turns = _ALL if kind == RIGID or degrees >= {4, 5, 6} else ()
    part, _, face = deck.faces(above.name("SURFACE"))[0].partition(".")
    row = _row(deck, _named(above, "REF NODE"))
    name = above.name("CONSTRAINT NAME") or face
    reference = ReferenceNode(name, card, kind, part, face, axes, turns, _point(deck, row))
    _without_middles(deck, face)
    if _add(deck, reference, [(row, 0)]):
        deck.used(card, f"of {part}.{face} {text}")


def distributing_coupling(deck: Translation, card: Card) -> None:
    """*DISTRIBUTING COUPLING: the force on the node of an element DCOUP3D, shared by the nodes, wherever their node is
    (ccx 2.20, measured)."""
    number = deck.model.couplers.get(card.name("ELSET").upper(), "")
    row = _row(deck, number)
    lines = [fields for _, fields in card.tokens()]
    sets = [fields[0].strip('"') for fields in lines]
    face = set_named(deck.content, sets[0]) if len(sets) == 1 else ""
    parts = deck.parts_of_nodes(face) if face and not sets[0].isdigit() else []
    if row < 0 or len(parts) != 1:
        what = "an element DCOUP3D and one set of nodes of one part, of equal weight, alone are translated"
        deck.refuse(card, what, ", ".join(sets))
        return
    reference = ReferenceNode(face, card, SHARED, parts[0], face, _ALL, (), None)
    _without_middles(deck, face)
    if _add(deck, reference, [(row, 0)]):
        deck.used(
            card, f"forces of its node are shared evenly by those of {parts[0]}.{face}, without a moment of its arm"
        )


# -- equations --------------------------------------------------------------------------------------------------------
def equation(deck: Translation, card: Card) -> None:
    """*EQUATION, *MPC: nodes with equal displacements, on a plane that holds them, or that stay in a plane."""
    if deck.tied is None:
        deck.tied = tied_sets(deck.model.cards)
    tied, unread = deck.tied
    for lost in unread:
        if lost.card is card:
            deck.refuse(card, lost.what, lost.terms, _remedy(card), lost.row)
    for one in tied:
        if one.card is card:
            _tie(deck, one)
    if not any(one.card is card for one in tied) and not any(lost.card is card for lost in unread):
        deck.used(card, "its nodes are among those of an earlier card of this kind")


def _remedy(card: Card) -> str | None:
    if card.keyword == "MPC":
        return None
    return "faces that move alike are a *TIE, a sector is [boundary.NAME] of the type periodic of a scene"


def _tie(deck: Translation, tied: TiedSet) -> None:
    rows = deck.rows(tied.name)
    parts = deck.parts_of_nodes(tied.name)
    solid = np.isin(rows, np.concatenate([rows[:0], *(deck.content.nodes_of(group) for group in deck.parts)]))
    loose = rows[~solid]
    if any(np.isin(rows, deck.rows(name)).any() for name in deck.model.transforms):
        deck.refuse(tied.card, "an equation of nodes with *TRANSFORM", tied.name)
    elif tied.kind == "held" and not len(loose) and len(parts) == 1:
        _hold_along(deck, tied, parts[0])
    elif len(parts) != 1 or (len(loose) and tied.kind != ALIKE):
        what = "an equation between nodes of several parts, or of no solid"
        deck.refuse(tied.card, what, ", ".join(tied.members[:6]), "nodes of two parts that move as one are a *TIE")
    elif tied.kind == ALIKE:
        _without_middles(deck, tied.name)
        reference = ReferenceNode(tied.name, tied.card, ALIKE, parts[0], tied.name, tied.axes, (), None)
        along = ", ".join("xyz"[axis] for axis in tied.axes)
        if _add(deck, reference, [(int(row), 0) for row in loose]):
            text = f"[coupling.{tied.name}]: its nodes on {parts[0]} have the same displacement along {along}"
            deck.used(tied.card, text + "; its node of no solid stands for it" * bool(len(loose)))
    else:
        _keep_plane(deck, tied, parts[0])


def _hold_along(deck: Translation, tied: TiedSet, part: str) -> None:
    """A support along one direction."""
    direction = np.array(tied.direction)
    if not direction.any():
        deck.refuse(
            tied.card, "factors whose sum is 0: the equation holds for any displacements", ", ".join(tied.members[:6])
        )
        return
    _without_middles(deck, tied.name)
    table: dict[str, Any] = {"type": "fixed", "face": f"{part}.{tied.name}", "components": ["x"]}
    if np.count_nonzero(direction) == 1:
        table["components"] = ["xyz"[int(np.flatnonzero(direction)[0])]]
    else:
        other = np.eye(3)[int(np.argmin(np.abs(direction)))]
        across = np.cross(direction, other)
        table["axes"] = {"x": direction.tolist(), "y": [float(f"{x:.12g}") for x in across]}
    name = deck.add("boundary", tied.name, table)
    deck.used(tied.card, f"[boundary.{name}]: its nodes are held along {', '.join(f'{x:g}' for x in direction)}")


def _keep_plane(deck: Translation, tied: TiedSet, part: str) -> None:
    """Nodes that stay in a plane across one of the axes."""
    points = deck.points_of(tied.name)
    arms = points - points.mean(axis=0)
    sizes, directions = np.linalg.svd(arms, full_matrices=False)[1:]
    normal = directions[2] if len(points) > 3 else np.cross(arms[1] - arms[0], arms[-1] - arms[0])
    normal = normal / (np.linalg.norm(normal) or 1.0)
    axis = int(np.argmax(np.abs(normal)))
    if len(points) < 3 or sizes[2] > _ACROSS * sizes[0] or abs(abs(normal[axis]) - 1.0) > _ACROSS:
        what = "nodes of MPC PLANE that are not in a plane across x, y or z"
        deck.refuse(tied.card, what, ", ".join(tied.members[:6]))
        return
    _without_middles(deck, tied.name)
    turns = tuple(i for i in _ALL if i != axis)
    _add(deck, ReferenceNode(tied.name, tied.card, RIGID, part, tied.name, (axis,), turns, None), [])
    deck.used(tied.card, f"[coupling.{tied.name}]: {part}.{tied.name} stays plane across {'xyz'[axis]}")
