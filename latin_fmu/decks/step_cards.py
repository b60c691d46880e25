"""Cards of the steps: procedures, amplitudes, loads, motions and supports, outputs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from ..mesh_files.deck_card import Card
from ..mesh_files.deck_loads import LoadedSet, degrees, loaded_groups
from ..mesh_files.deck_model import numbers
from ..mesh_files.deck_scene import set_named
from .histories import Amplitude, DeckQuantity, DeckStep
from .surfaces import inner_facets, unlisted_middles
from .translation import Translation

OTHER_PROCEDURES: Final = {
    "FREQUENCY": "latin-fmu modes computes frequencies of the scene, about the state that bolts and loads clamp",
    "STEADY STATE DYNAMICS": "latin-fmu frf computes the response of the scene to harmonic loads",
    "MODAL DYNAMIC": 'write it as *DYNAMIC; solver.propagator = "modal" marches by modes',
    "COMPLEX FREQUENCY": "complex modes are not computed",
    "BUCKLE": "latin-fmu modes names the load factor of the state at t = 0 of a scene with a static start",
}
"""Procedures that are left out after a step that is translated, with what there is in their place."""
_DEFAULT: Final = {"STATIC": "RAMP", "DYNAMIC": "STEP"}
"""How loads without an amplitude come."""
_STEP: Final = ("NAME", "NLGEOM", "INC", "INCF", "AMPLITUDE", "PERTURBATION", "UNSYMM", "TPINC", "TEMP1", "TEMP2")
_STATIC: Final = ("SOLVER", "DIRECT", "EXPLICIT", "TIME RESET", "TOTAL TIME AT START", "STABILIZE", "FULLY PLASTIC")
_DYNAMIC: Final = ("SOLVER", "DIRECT", "ALPHA", "EXPLICIT", "RELATIVE TO ABSOLUTE", "HAFTOL", "APPLICATION", "INITIAL")


# -- steps ------------------------------------------------------------------------------------------------------------
def steps_of(cards: Sequence[Card]) -> list[DeckStep]:
    """The steps of a deck, in order, each with its procedure and times; what is wrong with them is reported later."""
    steps: list[DeckStep] = []
    start = 0.0
    for card in cards:
        if card.keyword == "STEP":
            steps.append(DeckStep(card, start=start, period=0.0))
        elif card.keyword in ("STATIC", "DYNAMIC") and steps:
            times = numbers(next((fields for _, fields in card.tokens()), [])[:2]) or []
            times = [time for time in times if time > 0.0]
            # without a line: one increment of 1
            period = times[-1] if times else 1.0
            step = steps[-1]
            step.procedure, step.period, step.increment = card, period, min([*times, period])
            start = step.start + period
            step.at_once = (step.card.name("AMPLITUDE").upper() or _DEFAULT[card.keyword]) == "STEP"
    return steps


def step(deck: Translation, card: Card) -> None:
    """*STEP: the next one."""
    deck.number += 1
    if deck.refuse_parameters(card, _STEP):
        return
    now = deck.steps[deck.number - 1]
    if "PERTURBATION" in card.parameters and now.procedure is not None:
        deck.refuse(card, "a step of small changes about the step before it", "PERTURBATION")
    if card.name("NLGEOM").upper() not in ("", "NO") or ("NLGEOM" in card.parameters and not card.name("NLGEOM")):
        deck.left_out(
            card, "NLGEOM: displacements and rotations are small here; motions have the stiffness of their first stress"
        )
    deck.used(card, "loads and time of the scene")


def end_step(deck: Translation, card: Card) -> None:
    """*END STEP closes a step."""
    deck.used(card, "loads and time of the scene")


def static(deck: Translation, card: Card) -> None:
    """*STATIC: an increment for each of its first length, or the equilibrium that a dynamic step starts from."""
    now = deck.step
    if now is None or deck.refuse_parameters(card, _STATIC):
        return
    if any(step.dynamic for step in deck.steps[: deck.number]):
        deck.refuse(card, "a static step after a dynamic one: the motion would have to be stopped")
    elif deck.inertia:
        deck.used(card, 'time.start = "static": equilibrium under the loads at its end, which come together')
    else:
        deck.used(card, f"quasi_static, increments of at most {now.increment:g}, the first one of the deck")


def dynamic(deck: Translation, card: Card) -> None:
    """*DYNAMIC: time, step and scheme."""
    now = deck.step
    if now is None or deck.refuse_parameters(card, _DYNAMIC):
        return
    fields = next((fields for _, fields in card.tokens()), [])
    if "EXPLICIT" in card.parameters:
        if len([f for f in fields[:2] if f]) < 2:
            what = "an explicit step without its increment: the step must be below the limit of stability"
            deck.refuse(card, what, None, "give increment and period in the data line")
            return
        deck.tables.setdefault("solver", {})["propagator"] = "explicit"
    elif card.name("ALPHA") or not deck.tables.get("interface"):
        alpha = numbers([card.name("ALPHA") or "-0.05"])
        deck.tables.setdefault("time", {})["scheme"] = {"type": "hht", "alpha": (alpha or [-0.05])[0]}
    else:
        text = "its scheme (ALPHA = -0.05 of the deck) is left to the scene, which lands bodies without spurious forces"
        deck.left_out(card, text)
    deck.used(card, f"time.end and step of {now.increment:g}: all increments are alike")


def other_procedure(deck: Translation, card: Card) -> None:
    """A procedure that a scene has not: left out where there is something to run."""
    if any(step.procedure is not None for step in deck.steps[: deck.number]):
        deck.left_out(card, f"the step from line {deck.steps[deck.number - 1].card.line} on: " + _instead(card))
    else:
        deck.refuse(card, "a deck without *STATIC or *DYNAMIC before it has nothing to run", None, _instead(card))


def _instead(card: Card) -> str:
    return OTHER_PROCEDURES[card.keyword]


_AMPLITUDE: Final = ("NAME", "TIME", "VALUE", "DEFINITION", "INPUT", "SHIFTX", "SHIFTY")


def amplitude(deck: Translation, card: Card) -> None:
    """*AMPLITUDE of points."""
    if deck.refuse_parameters(card, _AMPLITUDE):
        return
    if card.name("DEFINITION").upper() not in ("", "TABULAR") or "USER" in card.parameters:
        deck.refuse(card, "points alone are translated", card.name("DEFINITION"))
        return
    values = numbers([field for _, fields in card.tokens() for field in fields])
    shifts = numbers([card.name("SHIFTX") or "0", card.name("SHIFTY") or "0"])
    if not values or len(values) % 2 or shifts is None or not all(np.diff(values[::2]) > 0.0):
        deck.refuse(card, "pairs of times, which increase, and values alone are translated")
        return
    total = card.name("TIME").upper().startswith("TOTAL")
    times = tuple(time + shifts[0] for time in values[::2])
    deck.amplitudes[card.name("NAME").upper()] = Amplitude(times, tuple(v + shifts[1] for v in values[1::2]), total)
    deck.used(card, "law of the loads and motions that name it")


# -- loads ------------------------------------------------------------------------------------------------------------
_ACTING: Final = ("OP", "AMPLITUDE", "TIME DELAY")
_LOAD: Final = (*_ACTING, "INPUT", "FIXED", "TYPE")


def _in_step(deck: Translation, card: Card, kinds: Sequence[str], allowed: Sequence[str] = _LOAD) -> bool:
    """Whether a card of loads or motions can be read; what OP=NEW takes away is taken."""
    if deck.refuse_parameters(card, allowed):
        return False
    if card.name("AMPLITUDE") and card.name("AMPLITUDE").upper() not in deck.amplitudes:
        deck.refuse(card, "no *AMPLITUDE of this name before it", card.name("AMPLITUDE"))
        return False
    if numbers([card.name("TIME DELAY") or "0"]) is None:
        deck.refuse(card, "TIME DELAY is a number", card.name("TIME DELAY"))
        return False
    deck.renew(card, kinds)
    return True


def _left_with_its_step(deck: Translation, card: Card) -> bool:
    """Whether a card belongs to a step that is left out, and says so."""
    now = deck.step
    if now is None or now.procedure is not None:
        return False
    deck.left_out(card, f"it belongs to the step from line {now.card.line} on, which is left out")
    return True


def cload(deck: Translation, card: Card) -> None:
    """*CLOAD: forces on nodes; on the node of a pre-tension section, the force of its bolt."""
    if _left_with_its_step(deck, card) or not _in_step(deck, card, ("nodal_force", "bolt_force"), _ACTING):
        return
    _check_rows(deck, card, 3)
    of_bolts: list[list[str]] = []
    for group in _groups(deck, card):
        bolt = deck.bolts.get(_number(group))
        of_bolts.append([bolt.name] if bolt else [])
        if bolt:
            for degree, value in group.values:
                if degree != "1":
                    deck.refuse(card, "the node of a pre-tension section has the degree of freedom 1 alone", degree)
                deck.set(DeckQuantity("bolt_force", bolt.name), value, card)
            continue
        if _on_references(deck, card, "nodal_force", group) or not _on_parts(deck, card, group):
            continue
        for degree, value in group.values:
            if degree not in "123":
                deck.refuse(card, "moments on nodes of solids", f"{group.name}, degree of freedom {degree}")
            else:
                deck.set(DeckQuantity("nodal_force", deck.alike(group.name), int(degree) - 1), value, card)
    made = {f"force of [bolt.{bolts[0]}]" if bolts else "nodal_force of [load.NAME]": None for bolts in of_bolts}
    deck.used(card, ", ".join(made) or "no lines")


def boundary(deck: Translation, card: Card) -> None:
    """*BOUNDARY: held and moved nodes; on the node of a pre-tension section, the shortening of its bolt."""
    kinds = {"": "displacement", "DISPLACEMENT": "displacement", "VELOCITY": "velocity", "ACCELERATION": "acceleration"}
    kind = kinds.get(card.name("TYPE").upper())
    if _left_with_its_step(deck, card):
        return
    if kind is None:
        deck.refuse(card, "a motion of another kind", f"TYPE={card.name('TYPE')}")
        return
    if not _in_step(deck, card, (*dict.fromkeys(kinds.values()), "bolt_shift")):
        return
    _check_rows(deck, card, 2)
    for group in _groups(deck, card):
        if bolt := deck.bolts.get(_number(group)):
            _shift_bolt(deck, card, bolt.name, group)
            continue
        if _on_references(deck, card, kind, group) or not _on_parts(deck, card, group):
            continue
        if "FIXED" in card.parameters:
            deck.refuse(card, "nodes that are held where they are by then: a bolt alone keeps its length")
            continue
        for degree, value in group.values:
            if degree in "123":
                deck.set(DeckQuantity(kind, deck.alike(group.name), int(degree) - 1), value, card)
            elif value:
                deck.refuse(card, "a rotation of nodes of solids", f"{group.name}, degree of freedom {degree}")
    deck.used(card, "[boundary.NAME]; rotations of nodes of solids hold nothing")


def _shift_bolt(deck: Translation, card: Card, name: str, group: LoadedSet) -> None:
    """The shortening of a bolt; ``FIXED``, and a value of 0 that follows a force, keep the one that it has."""
    history = deck.histories.get(DeckQuantity("bolt_force", name))
    if "FIXED" in card.parameters and history is not None:
        deck.used(card, f"[bolt.{name}] keeps its shortening, as every bolt does")
        return
    for degree, value in group.values:
        if degree == "1":
            deck.set(DeckQuantity("bolt_shift", name), value, card)


def _groups(deck: Translation, card: Card) -> Iterator[LoadedSet]:
    """What the lines of a card act on; nodes of pre-tension sections, and reference nodes, one by one, several loaded
    alike as well."""
    rows = {str(deck.content.labels[row]) for row in deck.references}
    for group in loaded_groups(card):
        sections = [member for member in group.members if member[0] in deck.bolts or _digits(member[0]) in rows]
        yield from (
            LoadedSet(f"NODE_{number}", group.kind, ((number, part),), group.values) for number, part in sections
        )
        others = tuple(member for member in group.members if member not in sections)
        if others or not sections:
            yield LoadedSet(group.name, group.kind, others, group.values)


def _number(group: LoadedSet) -> str:
    """The number of the only node of a group, empty for sets and several nodes."""
    if len(group.members) == 1:
        return group.members[0][0]
    return ""


def _digits(text: str) -> str:
    """The number of a node of an instance, too."""
    return text.rpartition(".")[2]


def _on_references(deck: Translation, card: Card, kind: str, group: LoadedSet) -> bool:
    """Whether a group is reference nodes, and set what acts on them."""
    number = _digits(_number(group))
    if number:
        rows = np.flatnonzero(deck.content.labels == int(number)).tolist()
    else:
        rows = deck.rows(group.name).tolist()
    found = [row for row in rows if row in deck.references]
    if not found:
        return False
    if len(found) < len(rows) or "FIXED" in card.parameters:
        deck.refuse(card, "a set of reference nodes and other nodes, or FIXED of a reference node", group.name)
    elif any(np.isin(found, deck.rows(name)).any() for name in deck.model.transforms):
        deck.refuse(card, "a reference node with *TRANSFORM", group.name)
    for row in found:
        reference, first = deck.references[row]
        for degree, value in group.values:
            axis = first + int(degree) - 1
            if 0 <= axis < 6:
                deck.set(DeckQuantity(kind, reference.key, axis), value, card)
            else:
                deck.refuse(card, "a reference node has three translations and three rotations", f"{degree}")
    return True


def _on_parts(deck: Translation, card: Card, group: LoadedSet) -> bool:
    """Whether a group has nodes of parts; a reference node, or a set that is not there, is refused."""
    if len(deck.rows(group.name)) == 0:
        deck.refuse(card, "no such node or node set", group.name)
        return False
    if not deck.parts_of_nodes(group.name):
        deck.refuse(card, "nodes that are of no solid: a reference node, or a set of them", group.name)
        return False
    if unlisted_middles(deck.content, deck.rows(group.name)):
        # a face has its middle nodes, too
        deck.single.add(set_named(deck.content, group.name))
    return True


def _check_rows(deck: Translation, card: Card, least: int) -> None:
    """Refuse data lines that cannot be read."""
    for i, fields in card.tokens():
        try:
            # a line of *CLOAD has no last degree of freedom
            rest = fields[1:]
            if least == 3:
                rest = [*fields[1:2], "", *fields[2:3]]
            list(degrees(rest))
            wrong = len(fields) < least
        except ValueError:
            wrong = True
        if wrong:
            deck.refuse(card, "a line that cannot be read", ", ".join(fields), row=i)


def dload(deck: Translation, card: Card) -> None:
    """*DLOAD: pressures on faces of elements, gravity, rotation."""
    kinds = ("pressure", "gravity", "rotation")
    if _left_with_its_step(deck, card) or not _in_step(deck, card, kinds, _ACTING):
        return
    for group in loaded_groups(card):
        if not deck.faces(group.name):
            deck.refuse(card, "these faces are on the surface of no part", group.name)
        elif inside := inner_facets(deck.content, group.name):
            remedy = "name the elements whose faces are on the surface"
            deck.refuse(card, "a pressure on faces between two elements", f"{group.name}: {inside} faces", remedy)
        else:
            deck.set(DeckQuantity("pressure", deck.alike(group.name)), group.values[0][1], card)
    for i, fields in card.tokens():
        word = fields[1].upper() if len(fields) > 1 else ""
        if word == "GRAV":
            _gravity(deck, card, i, fields)
        elif word == "CENTRIF":
            _rotation(deck, card, i, fields)
        elif not (word[:1] == "P" and word[1:] in "123456" and word[1:]):
            what = "pressures P1 to P6, GRAV and CENTRIF alone are translated"
            deck.refuse(card, what, ", ".join(fields), "a load that depends on the place is none of a scene", i)
        elif numbers(fields[2:]) is None:
            deck.refuse(card, "a line that cannot be read", ", ".join(fields), row=i)
    words = {fields[1].upper() for _, fields in card.tokens() if len(fields) > 1}
    made = ["pressure of [load.NAME]"] * bool(words - {"GRAV", "CENTRIF"})
    made += ["[gravity]"] * ("GRAV" in words) + ["[rotation.NAME]"] * ("CENTRIF" in words)
    deck.used(card, ", ".join(made) or "no lines")


def _gravity(deck: Translation, card: Card, i: int, fields: list[str]) -> None:
    values = numbers(fields[2:6])
    parts = deck.parts_of_elements(fields[0]) if fields[0] else list(deck.parts.values())
    if values is None or len(values) != 4 or not any(values[1:]):
        deck.refuse(card, "GRAV takes its size and a direction of three numbers", ", ".join(fields), row=i)
    elif parts is None:
        deck.refuse(card, "GRAV of element sets that are whole parts alone is translated", fields[0], row=i)
    else:
        x, y, z = (np.array(values[1:]) / np.linalg.norm(values[1:])).tolist()
        for part in parts:
            deck.set(DeckQuantity("gravity", part, direction=(x, y, z)), values[0], card)


def _rotation(deck: Translation, card: Card, i: int, fields: list[str]) -> None:
    """CENTRIF: the square of the angular velocity, a point on the axis, its direction."""
    values = numbers(fields[2:9])
    parts = deck.parts_of_elements(fields[0]) if fields[0] else list(deck.parts.values())
    if values is None or len(values) != 7 or not any(values[4:]) or values[0] < 0.0:
        what = "CENTRIF takes the square of the angular velocity, a point and a direction of three numbers each"
        deck.refuse(card, what, ", ".join(fields), row=i)
    elif parts is None:
        deck.refuse(card, "CENTRIF of element sets that are whole parts alone is translated", fields[0], row=i)
    else:
        x, y, z = (np.array(values[4:]) / np.linalg.norm(values[4:])).tolist()
        for part in parts:
            quantity = DeckQuantity("rotation", part, direction=(x, y, z), point=(values[1], values[2], values[3]))
            deck.set(quantity, values[0], card)


def dsload(deck: Translation, card: Card) -> None:
    """*DSLOAD: pressures and tractions on surfaces."""
    kinds = ("pressure", "traction")
    if _left_with_its_step(deck, card) or not _in_step(deck, card, kinds, (*_ACTING, "FOLLOWER")):
        return
    if card.name("FOLLOWER").upper() not in ("", "NO", "YES"):
        deck.refuse(card, "FOLLOWER is YES or NO", card.name("FOLLOWER"))
    for i, fields in card.tokens():
        word = fields[1].upper() if len(fields) > 1 else ""
        values = numbers(fields[2:6])
        if not fields or not deck.faces(fields[0]):
            deck.refuse(card, "the surface is on no part", ", ".join(fields), row=i)
        elif word == "P" and values and len(values) == 1:
            deck.set(DeckQuantity("pressure", deck.faces(fields[0])[0].partition(".")[2]), values[0], card)
        elif word == "TRVEC" and values is not None and len(values) == 4 and any(values[1:]):
            x, y, z = (np.array(values[1:]) / np.linalg.norm(values[1:])).tolist()
            target = deck.faces(fields[0])[0].partition(".")[2]
            deck.set(DeckQuantity("traction", target, direction=(x, y, z)), values[0], card)
        else:
            deck.refuse(card, "P and TRVEC alone are translated", ", ".join(fields), row=i)
    deck.used(card, "pressure or traction of [load.NAME]")


def temperature(deck: Translation, card: Card) -> None:
    """*TEMPERATURE of whole parts, as a change from the initial one."""
    if _left_with_its_step(deck, card) or not _in_step(deck, card, ("temperature",), (*_ACTING, "INPUT")):
        return
    for i, fields in card.tokens():
        values = numbers(fields[1:2])
        parts = deck.whole_parts(fields[0].strip('"')) if fields else None
        if parts is None or not values:
            what = "one temperature of all nodes of parts alone is translated"
            deck.refuse(card, what, ", ".join(fields), row=i)
            continue
        for part in parts:
            deck.set(DeckQuantity("temperature", part), values[0], card)
    deck.used(card, "[temperature.NAME], as a change from the initial temperature")
