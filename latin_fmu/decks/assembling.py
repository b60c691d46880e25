"""The tables of a scene from the cards of a deck: bodies, bolts, time, loads and motions."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np

from ..errors import Problem
from ..mesh_files.abaqus_elements import element_type, fills_volume
from ..mesh_files.content import CORNERS
from ..mesh_files.deck_card import Card
from ..mesh_files.deck_model import HeldSet
from ..mesh_files.deck_scene import axes_at, held_tables, set_named, with_model
from ..scene.substructures import part_name
from .histories import DeckHistory, DeckQuantity, DeckStep, Law, Points, common_step, law_of, shifted, tidy
from .reference_tables import add_references
from .translation import LEFT_OUT, MOTIONS, USED, CardUse, Translation

_TIGHTENING: Final = ("bolt_force", "bolt_shift")
_PLAIN: Final = (
    "C3D4",
    "C3D10",
    "C3D8",
    "C3D8I",
    "C3D8R",
    "C3D20",
    "C3D20R",
    "C3D27",
    "C3D6",
    "C3D15",
    "C3D5",
    "C3D13",
)
"""Types of elements that a body has as they are in the deck."""
_WAVE_SPEED: Final = 5000.0  # m/s, of metals: for a density that nothing depends on


# -- bodies -----------------------------------------------------------------------------------------------------------
def add_bodies(deck: Translation, units_size: float) -> None:
    """Substructures with their materials, ties and clearances, as the mesh reader has them; ``units_size`` : of Pa over
    that of a density times a squared speed, to choose a density that nothing depends on."""
    materials: dict[str, Any] = {}
    spelled = {card.name("NAME").upper(): card.name("NAME") for card in deck.model.cards if card.keyword == "MATERIAL"}
    for name, constants in deck.model.materials.items():
        table = _with_axes(deck, name, dict(deck.material_keys.get(name, {})))
        modulus = constants.get("young_modulus")
        if "orthotropic" in table:
            modulus = table["orthotropic"]["young_moduli"][0]
        if "density" not in constants and modulus is not None and not _heavy(deck):
            table["density"] = float(f"{modulus * units_size / _WAVE_SPEED**2:.4g}")
            place = next(card.place for card in deck.model.cards if card.name("NAME").upper() == name)
            text = f"without *DENSITY: {table['density']:g} is put in its place, nothing depends on it without inertia"
            deck.uses.append(CardUse(LEFT_OUT, "MATERIAL", place, text))
        materials[part_name(spelled[name])] = table
    before = deck.tables.get("substructure", {})
    raw: dict[str, Any] = {
        "material": materials,
        "substructure": {part: dict(before.get(part, {})) for part in deck.parts.values()},
        "interface": deck.tables.get("interface", {}),
    }
    problems: list[Problem] = []
    whole = with_model(raw, deck.content, deck.parts, 1.0, problems)
    deck.problems += [Problem("*MATERIAL", p.what, p.value, None, "give them in the deck") for p in problems]
    used = {str(body.get("material")) for body in whole["substructure"].values()}
    deck.tables["material"] = {name: _ordered(table) for name, table in whole["material"].items() if name in used}
    deck.tables["substructure"] = whole["substructure"]
    if whole["interface"]:
        deck.tables["interface"] = whole["interface"]
    for part, body in whole["substructure"].items():
        if "material" not in body:
            what = "no *SOLID SECTION gives this part one material"
            deck.problems.append(Problem(f"part {part}", what, None, None, "give each part a section of its own"))
    lost = [tie.name for tie in deck.model.ties if part_name(tie.name) not in whole["interface"]]
    if lost:
        card = next(card for card in deck.model.cards if card.keyword == "TIE")
        remedy = "a pair of parts has one interface: make two parts of one"
        deck.refuse(card, "ties between parts that are in contact or tied elsewhere", ", ".join(lost), remedy)
    _add_types(deck)
    _join_shared(deck)


def _with_axes(deck: Translation, name: str, keys: dict[str, Any]) -> dict[str, Any]:
    """Keys of a material: constants of an orthotropic one along the axes that its sections name, in one table."""
    three = keys.pop("thermal_expansions", None)
    own = keys.get("orthotropic")
    if own is None:
        if three is not None:
            place = next(card for card in deck.model.cards if card.name("NAME").upper() == name)
            deck.refuse(place, "three coefficients of expansion of an isotropic material", name)
        return keys
    if "thermal_expansion" in keys:
        own["thermal_expansions"] = three or [keys.pop("thermal_expansion")] * 3
        keys.pop("thermal_expansion", None)
    axes = deck.section_axes.get(name, set())
    found = [deck.orientations[one] for one in sorted(axes) if one in deck.orientations]
    sections = [material for _, material in deck.model.sections if material == name]
    if len(found) == 1 and len(axes) == 1:
        own["axes"] = found[0]
    if len(axes) > 1 or len(found) < len(axes):
        place = next(card for card in deck.model.cards if card.name("NAME").upper() == name)
        what = "an orthotropic material has the axes of one *ORIENTATION that is there"
        deck.refuse(place, what, ", ".join(sorted(axes)), "make a material for each of them")
    elif axes and len(sections) > deck.sections_turned(name):
        place = next(card for card in deck.model.cards if card.name("NAME").upper() == name)
        deck.refuse(place, "an orthotropic material in sections with and without ORIENTATION", name)
    return keys


def _heavy(deck: Translation) -> bool:
    """Whether a density counts."""
    return deck.inertia or any(quantity.kind in ("gravity", "rotation") for quantity in deck.histories)


def _ordered(table: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of a material in the order of a scene."""
    first = ("young_modulus", "poisson_ratio", "density", "thermal_expansion")
    return {key: table[key] for key in (*first, *(k for k in table if k not in first)) if key in table}


def _add_types(deck: Translation) -> None:
    """What the types of elements are here: a line for each that differs, bending modes for C3D8I, uniform strain for
    C3D8R, reduced rules for C3D20R and C3D6."""
    mixed = _add_reduced(deck)
    for name, place in deck.model.element_types.items():
        kind = element_type(name)
        if (name in _PLAIN and name not in mixed) or name == "DCOUP3D":  # that of *DISTRIBUTING COUPLING
            continue
        if kind is not None and kind[0] in CORNERS:
            text = f"{name}: integrated fully here, stiffer in bending and shear than its own rule"
            if re.fullmatch(r"C3D\d+[A-Z]*H", name):
                text = f"{name}: a displacement element here, too stiff where the material is incompressible"
            deck.uses.append(CardUse(LEFT_OUT, "ELEMENT", place, text))
        elif kind is not None:
            text = f"{name}: names faces of solids, without stiffness of its own"
            deck.uses.append(CardUse(LEFT_OUT, "ELEMENT", place, text))
        else:
            what = "*ELEMENT: elements of this type are not computed"
            if not fills_volume(name):
                what = "*ELEMENT: beams, springs, masses and their like are not translated"
            deck.problems.append(Problem(f"{place.where}, line {place.line}", what, name))
    _add_hexahedra(deck)


def _add_hexahedra(deck: Translation) -> None:
    """Bending modes of parts with C3D8I, uniform strain of those with C3D8R."""
    for group, part in deck.parts.items():
        hexahedra = deck.content.volumes[group].get("hexahedron")
        if hexahedra is None:
            continue
        marks = {}
        for name in ("C3D8I", "C3D8R"):
            marks[name] = np.isin(hexahedra, deck.content.types.get(name, {}).get("hexahedron", hexahedra[:0]))
        if marks["C3D8I"].any():
            deck.tables["substructure"][part]["bending_modes"] = True
        if not marks["C3D8R"].any():
            continue
        place = deck.model.element_types["C3D8R"]
        if not marks["C3D8R"].all():
            what = f"*ELEMENT: part {part} has other elements of 8 nodes, too, and one rule is that of a whole part"
            remedy = (
                "a *SOLID SECTION for the elements of each type: each is a part then, bonded where they share nodes"
            )
            deck.problems.append(Problem(f"{place.where}, line {place.line}", what, "C3D8R", remedy=remedy))
            continue
        deck.tables["substructure"][part]["uniform_strain"] = True
        text = f"[substructure.{part}] uniform_strain: one point, and CalculiX' stiffness against hourglass modes"
        if deck.inertia:
            text += "; the mass is the consistent one, CalculiX takes that of one point: other frequencies where few "
            text += "elements are across"
        deck.uses.append(CardUse(USED, "ELEMENT", place, f"C3D8R: {text}"))


def _add_reduced(deck: Translation) -> set[str]:
    """Reduced rules of parts all of whose cells of a kind have one; types that are integrated fully for the others."""
    mixed: set[str] = set()
    for group, part in deck.parts.items():
        cells = deck.content.volumes[group]
        reduced, full = set(), set()
        for name, kind in (("C3D20R", "hexahedron20"), ("C3D6", "wedge")):
            rows = cells.get(kind)
            if rows is not None and len(rows):
                of_type = deck.content.types.get(name, {}).get(kind, rows[:0])
                inside = np.isin(rows, of_type)
                reduced |= {name} if inside.any() else set()
                full |= set() if inside.all() else {name}
        if reduced and not full:
            deck.tables["substructure"][part]["reduced_integration"] = True
        elif reduced:
            mixed |= reduced
    return mixed


def _join_shared(deck: Translation) -> None:
    """Parts that share nodes are bonded there."""
    groups = [(part, deck.content.nodes_of(group)) for group, part in deck.parts.items()]
    joined = [{str(side).partition(".")[0] for side in t["sides"]} for t in deck.tables.get("interface", {}).values()]
    size = float(np.ptp(deck.content.points, axis=0).max())
    for i, (part, nodes) in enumerate(groups):
        for other, others in groups[i + 1 :]:
            if not np.isin(nodes, others).any():
                continue
            if {part, other} in joined:
                what = "these parts share nodes and are in contact or tied as well"
                deck.problems.append(Problem(f"parts {part}, {other}", what))
                continue
            search = {"search": float(f"{1e-6 * size:.3g}"), "parts": [part, other], "behaviour": "perfect"}
            name = deck.add("contact", f"{part}_{other}", search)
            place = next(card.place for card in deck.model.cards if card.keyword == "SOLID SECTION")
            text = f"{part} and {other} share nodes: bonded by [contact.{name}]"
            deck.uses.append(CardUse(USED, "SOLID SECTION", place, text))


# -- bolts ------------------------------------------------------------------------------------------------------------
def add_bolts(deck: Translation) -> None:
    """Force or shortening, and order, of each bolt; steps that only tighten are taken off the axis of time."""
    steps: dict[str, int] = {}
    for bolt in deck.bolts.values():
        found = [
            (quantity, deck.histories[quantity])
            for quantity in (DeckQuantity(kind, bolt.name) for kind in _TIGHTENING)
            if quantity in deck.histories
        ]
        if len(found) != 1:
            what = "its node has neither a force nor a displacement, or both"
            deck.refuse(bolt.card, what, bolt.node, "*CLOAD or *BOUNDARY on degree of freedom 1 of the node")
            continue
        quantity, history = found[0]
        steps[bolt.name] = _tighten(deck, quantity, history, bolt.sign)
    orders = sorted(set(steps.values()))
    for name, step in steps.items():
        if len(orders) > 1:
            deck.tables["bolt"][name]["order"] = orders.index(step) + 1
    for number in range(1, max(orders, default=0) + 1):
        if not _loads_set(deck, number):
            deck.steps[number - 1].kept = False


def _tighten(deck: Translation, quantity: DeckQuantity, history: DeckHistory, sign: float) -> int:
    """Add force or shortening to a bolt; the step that tightens it. ``sign`` : of a number that does."""
    first = history.settings[0]
    points = history.points(deck.steps[: first.step])
    value = sign * points[-1][1] if points else 0.0
    if not value > 0.0 or deck.steps[first.step - 1].dynamic:
        deck.refuse(first.card, "a bolt is tightened, by a pull on its section, in a static step", f"{value:g}")
    if len({setting.value for setting in history.settings}) > 1 or history.ended:
        deck.refuse(history.settings[-1].card, "a bolt whose force or displacement changes after it was tightened")
    if quantity.kind == "bolt_force":
        deck.tables["bolt"][quantity.target]["force"] = value
        loaded = [number for number in range(1, first.step + 1) if _loads_set(deck, number)]
        if loaded:
            remedy = "tighten the bolts in a step of their own, before the loads"
            what = "loads act while the bolt is tightened: here bolts are tightened before"
            deck.refuse(first.card, what, f"step {loaded[0]}", remedy)
        if first.step < len(deck.steps) and not _is_fixed(deck, quantity.target):
            text = (
                "the deck keeps the force of the bolt in later steps, here its shortening stays and its force changes"
            )
            deck.left_out(first.card, text)
    else:
        deck.tables["bolt"][quantity.target]["shortening"] = value
    return first.step


def _is_fixed(deck: Translation, bolt: str) -> bool:
    """Whether the deck fixes the length of a bolt after it was tightened."""
    return any(use.keyword == "BOUNDARY" and f"[bolt.{bolt}]" in use.text for use in deck.uses)


def _loads_set(deck: Translation, number: int) -> bool:
    """Whether a step sets anything but bolts and supports."""
    return any(
        setting.step == number and setting.value != 0.0
        for quantity, history in deck.histories.items()
        if quantity.kind not in _TIGHTENING
        for setting in history.settings
    )


# -- time -------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Axis:
    """The axis of time of the scene.

    Attributes
    ----------
    steps : of the deck. origin : time of the deck at which it begins. step : of the scene. inertia : whether there is
    any. static : whether static steps come before the motion.
    """

    steps: Sequence[DeckStep]
    origin: float
    step: float
    inertia: bool
    static: bool

    def law(self, history: DeckHistory, before: float = 0.0) -> tuple[float, Law, Points]:
        """Amount, law and points of a quantity over the scene."""
        points = shifted(history.points(self.steps, before), self.origin)
        if not points:
            return 0.0, None, points
        start = None
        if self.inertia and self.static:
            start = points[0][1]
        amount, law = law_of(points, start, self.step)
        return amount, law, points


def add_time(deck: Translation) -> Axis:
    """Table [time], and the axis on which loads and motions are counted."""
    there = [step for step in deck.steps if step.procedure is not None]
    kept = [step for step in there if step.kept]
    chosen = [step for step in kept if step.dynamic] if deck.inertia else kept
    table: dict[str, Any] = {}
    if not chosen:
        chosen = there[-1:]
        table = {"end": 1.0, "instants": 1}
        last = chosen[0]
        axis = Axis(deck.steps, last.start + last.period, 1.0, False, True)
    else:
        step = common_step([s.period for s in chosen], [s.increment for s in chosen])
        end = sum(s.period for s in chosen)
        if step is None:
            remedy = "choose periods that are whole numbers of a common increment"
            deck.refuse(chosen[0].card, "the periods of its steps have no common increment", None, remedy)
            step = end
        table = {"end": float(f"{end:.12g}"), "instants": round(end / step)}
        before = deck.inertia and any(not s.dynamic for s in kept)
        axis = Axis(deck.steps, chosen[0].start, step, deck.inertia, before)
    if not deck.inertia:
        table["quasi_static"] = True
    elif axis.static:
        table["start"] = "static"
    deck.tables["time"] = {**table, **deck.tables.get("time", {})}
    return axis


# -- loads and motions ------------------------------------------------------------------------------------------------
def add_loads(deck: Translation, axis: Axis) -> None:
    """Tables of loads, motions and supports."""
    _refuse_overlaps(deck)
    _add_surface_loads(deck, axis)
    _add_nodal_forces(deck, axis)
    _add_gravity(deck, axis)
    _add_rotations(deck, axis)
    _add_temperatures(deck, axis)
    _add_motions(deck, axis)

    def law_of_reference(quantity: DeckQuantity, history: DeckHistory) -> tuple[float, Law, Points]:
        found = axis.law(history)
        if quantity.kind in MOTIONS:
            _check_motion(deck, axis, quantity, history, found[2])
        return found

    add_references(deck, law_of_reference)


def _key(law: Law) -> str:
    return json.dumps(law)


def _with_law(table: dict[str, Any], law: Law) -> dict[str, Any]:
    if law is None:
        return table
    return {**table, "law": dict(law)}


def _of_kind(deck: Translation, *kinds: str) -> Iterator[tuple[DeckQuantity, DeckHistory]]:
    """Quantities of some kinds on sets and bodies; those of reference nodes are ``reference_tables``'s."""
    elsewhere = {reference.key for reference in deck.reference_nodes}
    for quantity, history in deck.histories.items():
        if quantity.kind in kinds and history.settings and quantity.target not in elsewhere:
            yield quantity, history


def _refuse_overlaps(deck: Translation) -> None:
    """Refuse nodes that two sets move or load differently: the last one of a deck counts, in a scene there is none."""
    owners: dict[tuple[str, int], np.ndarray] = {}
    names: list[tuple[DeckQuantity, DeckHistory]] = []
    for quantity, history in _of_kind(deck, "nodal_force", *MOTIONS):
        family = "force" if quantity.kind == "nodal_force" else "motion"
        owner = owners.setdefault((family, quantity.axis), np.full(len(deck.content.points), -1))
        rows = deck.rows(quantity.target)
        for i in np.unique(owner[rows]).tolist():
            if i >= 0 and not _agree(quantity, history, *names[i]):
                both = f"{names[i][0].target}, {quantity.target}"
                what = f"nodes of two sets with different values along {'xyz'[quantity.axis]}"
                deck.refuse(history.settings[-1].card, what, both, "take the common nodes out of one of them")
        owner[rows] = len(names)
        names.append((quantity, history))


def _agree(one: DeckQuantity, first: DeckHistory, other: DeckQuantity, second: DeckHistory) -> bool:
    """Whether common nodes of two sets have one meaning: forces of one step add up, motions are the same."""
    if one.kind == "nodal_force":
        return [s.step for s in first.settings] == [s.step for s in second.settings]
    values = [[(s.step, s.value, s.amplitude) for s in h.settings] for h in (first, second)]
    still = not any(value for pairs in values for _, value, _ in pairs)
    return still or (values[0] == values[1] and one.kind == other.kind)


def _add_surface_loads(deck: Translation, axis: Axis) -> None:
    for quantity, history in _of_kind(deck, "pressure", "traction"):
        amount, law, _ = axis.law(history)
        if amount == 0.0:
            continue
        value: Any = amount
        if quantity.kind == "traction":
            value = [tidy(amount * x) for x in quantity.direction]
        faces = deck.faces(quantity.target)
        for face in faces:
            name = face.partition(".")[2] if len(faces) == 1 else face.replace(".", "_")
            deck.add("load", name, _with_law({"face": face, quantity.kind: value}, law))


def _add_nodal_forces(deck: Translation, axis: Axis) -> None:
    by_target: dict[str, dict[str, tuple[list[float], Law]]] = {}
    cards: dict[str, Card] = {}
    for quantity, history in _of_kind(deck, "nodal_force"):
        amount, law, _ = axis.law(history)
        cards[quantity.target] = history.settings[-1].card
        if amount:
            vector, _ = by_target.setdefault(quantity.target, {}).setdefault(_key(law), ([0.0] * 3, law))
            vector[quantity.axis] += tidy(amount)
    for target, loads in by_target.items():
        rows = deck.rows(target)
        axes = axes_at(deck.content, rows, "x")
        parts = deck.parts_of_nodes(target)
        groups = [deck.content.nodes_of(group) for group, part in deck.parts.items() if part in parts]
        if sum(int(np.isin(rows, nodes).sum()) for nodes in groups) != len(rows) or axes is None:
            what = "forces on nodes that two parts share, that are of no part, or whose axes differ"
            deck.refuse(cards[target], what, target)
            continue
        face = set_named(deck.content, target)
        for part in parts:
            for vector, law in loads.values():
                name = face if len(parts) == 1 else f"{face}_{part}"
                table = {"face": f"{part}.{face}", "nodal_force": vector, **axes}
                deck.add("load", name, _with_law(table, law))


def _add_gravity(deck: Translation, axis: Axis) -> None:
    by_part: dict[str, dict[str, tuple[np.ndarray, Law]]] = {}
    for quantity, history in _of_kind(deck, "gravity"):
        amount, law, _ = axis.law(history)
        of_part = by_part.setdefault(quantity.target, {})
        before = of_part.get(_key(law), (np.zeros(3), law))[0]
        of_part[_key(law)] = before + amount * np.array(quantity.direction), law
        if len(of_part) > 1:
            deck.refuse(history.settings[-1].card, f"two histories of gravity on {quantity.target}")
    if not by_part:
        return
    found = {part: next(iter(of_part.values())) for part, of_part in by_part.items()}
    same = {(tuple(np.round(vector, 12)), _key(law)) for vector, law in found.values()}
    vector, law = next(iter(found.values()))
    if len(same) == 1 and len(found) == len(deck.parts):
        deck.tables["gravity"] = _with_law({"acceleration": [tidy(x) for x in vector]}, law)
        return
    for part, (vector, law) in found.items():
        body = deck.tables["substructure"][part]
        density = deck.tables["material"][body["material"]]["density"]
        body["body_force"] = [tidy(density * x) for x in vector]
        if law is not None:
            body["body_force_law"] = dict(law)


def _add_rotations(deck: Translation, axis: Axis) -> None:
    """A table for bodies that turn alike; the deck has the square of their speed."""
    alike: dict[str, tuple[dict[str, Any], list[str]]] = {}
    for quantity, history in _of_kind(deck, "rotation"):
        amount, law, _ = axis.law(history)
        if amount == 0.0:
            continue
        table = _with_law(
            {
                "angular_velocity": tidy(math.sqrt(amount)),
                "axis": [tidy(x) for x in quantity.direction],
                "point": list(quantity.point),
            },
            law,
        )
        alike.setdefault(json.dumps(table), (table, []))[1].append(quantity.target)
    for table, parts in alike.values():
        if len(parts) == len(deck.parts):
            deck.add("rotation", "all", table)
        else:
            deck.add("rotation", "_".join(parts), {"substructures": parts, **table})


def _add_temperatures(deck: Translation, axis: Axis) -> None:
    alike: dict[str, tuple[float, Law, list[str]]] = {}
    for quantity, history in _of_kind(deck, "temperature"):
        start = next(
            (value for name, value in deck.initial.items() if quantity.target in (deck.whole_parts(name) or ())), 0.0
        )
        cold = DeckHistory([_colder(setting, start) for setting in history.settings], history.ended)
        if any(setting.amplitude is not None and start for setting in history.settings):
            deck.refuse(history.settings[-1].card, "an amplitude of a temperature, with an initial one that is not 0")
        amount, law, _ = axis.law(cold)
        body = deck.tables["substructure"][quantity.target]
        material = deck.tables["material"].get(body.get("material"), {})
        if "thermal_expansion" not in material and "thermal_expansions" not in material.get("orthotropic", {}):
            deck.refuse(history.settings[-1].card, "the material has no *EXPANSION", quantity.target)
        if amount:
            alike.setdefault(json.dumps([amount, law]), (amount, law, []))[2].append(quantity.target)
    for amount, law, parts in alike.values():
        table: dict[str, Any] = {"change": amount}
        if len(parts) < len(deck.parts):
            table = {"substructures": parts, **table}
        deck.add("temperature", "all" if len(parts) == len(deck.parts) else "_".join(parts), _with_law(table, law))


def _colder(setting: Any, start: float) -> Any:
    """A setting of a temperature as one of its change."""
    return type(setting)(setting.step, setting.value - start, setting.amplitude, setting.card)


def _add_motions(deck: Translation, axis: Axis) -> None:
    grouped: dict[tuple[str, str, str], dict[int, float]] = {}
    laws: dict[str, Law] = {}
    cards: dict[str, Card] = {}
    for quantity, history in _of_kind(deck, *MOTIONS):
        amount, law, points = axis.law(history)
        kind = quantity.kind
        cards[quantity.target] = history.settings[-1].card
        _check_motion(deck, axis, quantity, history, points)
        if amount == 0.0:
            kind = "fixed"
        laws[_key(law)] = law
        grouped.setdefault((quantity.target, kind, _key(law)), {})[quantity.axis] = amount
    for (target, kind, law_key), values in grouped.items():
        _add_boundary(deck, cards[target], target, kind, values, laws[law_key])


def _check_motion(deck: Translation, axis: Axis, quantity: DeckQuantity, history: DeckHistory, points: Points) -> None:
    """Refuse supports that come or go, motions that jump where there is inertia, and rates without it."""
    card = history.settings[-1].card
    active = [history.at_step(number) is not None for number in range(len(deck.steps) + 1)]
    if any(not later for earlier, later in pairwise(active[1:]) if earlier):
        deck.refuse(card, "a support or motion that OP=NEW takes away in a later step", quantity.target)
    if not active[1]:
        deck.refuse(card, "a support or motion that comes with a later step: no motion is free before", quantity.target)
    if quantity.kind != "displacement" and not axis.inertia:
        deck.refuse(card, "a velocity or acceleration in a static step", quantity.target)
    if quantity.kind == "displacement" and axis.inertia:
        values = [0.0 if not axis.static else (points[0][1] if points else 0.0), *(v for _, v in points)]
        times = [0.0, *(t for t, _ in points)]
        largest = max(map(abs, values))
        jumps = any(
            t1 - t0 <= 1e-9 * axis.step and abs(v1 - v0) > 1e-9 * largest
            for (t0, v0), (t1, v1) in pairwise(zip(times, values, strict=True))
        )
        if jumps:
            remedy = "give it an amplitude that starts from where the nodes are"
            deck.refuse(card, "a displacement that jumps in a dynamic step", quantity.target, remedy)


def _add_boundary(deck: Translation, card: Card, target: str, kind: str, values: Mapping[int, float], law: Law) -> None:
    """The boundary of one set, on each part that it has nodes of."""
    axes = sorted(values)
    components = "".join("xyz"[axis] for axis in axes)
    tables = list(held_tables(deck.content, deck.parts, HeldSet(target, components, card.line)))
    if not tables:
        deck.refuse(card, "components along axes of *TRANSFORM that differ from node to node", target)
    for name, held in tables:
        if kind == "fixed":
            table = dict(held)
            if components == "xyz":
                del table["components"]
        else:
            part, _, face = str(held["face"]).partition(".")
            group = next(group for group, owner in deck.parts.items() if owner == part)
            if face in deck.single:
                what = "moved corners of quadratic facets without their middle nodes"
                deck.refuse(card, what, target, "add the middle nodes to the set")
            elif not deck.content.touching(group, face):
                deck.refuse(card, "moved nodes that make up no facet of an element: an edge or a point", target)
            table = {**held, "type": kind, "value": [tidy(values[axis]) for axis in axes]}
            table = _with_law(table, law)
        short = name.removesuffix(f"_{part_name(str(held['face']).partition('.')[0])}") if len(tables) == 1 else name
        deck.add("boundary", short, table)
