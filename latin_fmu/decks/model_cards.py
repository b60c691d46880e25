"""Cards of the model: materials, surfaces in contact, ties, bolts, what there is at the start."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ..mesh_files.deck_card import Card, real
from ..mesh_files.deck_model import numbers
from .histories import tidy
from .surfaces import closest, mean_facet
from .translation import SectionBolt, Translation

_TOUCHING: Final = 1e-9  # of the size of the mesh
_ALIKE: Final = 1e-3  # of the area of a facet
APART: Final = "write a deck for each state of the contact, with the steps in which it is so"
"""Remedy for contact that changes from step to step."""
_EXACT: Final = "contact exact at its points, no penalty"


def material(deck: Translation, card: Card) -> None:
    """*MATERIAL: the cards below it are its own."""
    deck.material = card.name("NAME").upper()
    deck.used(card, f"[material.{card.name('NAME')}]")


def elastic(deck: Translation, card: Card) -> None:
    """*ELASTIC, isotropic or orthotropic, at one temperature."""
    kind = card.name("TYPE").upper()
    if kind in _ORTHOTROPIC:
        constants = _nine_constants(deck, card, kind)
        if constants is not None:
            deck.material_keys.setdefault(deck.material, {})["orthotropic"] = constants
            deck.used(card, "orthotropic, along the axes of the ORIENTATION of its sections")
    elif kind not in ("", "ISO", "ISOTROPIC"):
        what = "isotropic and orthotropic constants alone are translated"
        deck.refuse(
            card, what, f"TYPE={card.name('TYPE')}", "write [material.NAME.orthotropic] in a scene for the mesh"
        )
    elif "young_modulus" not in deck.model.materials.get(deck.material, {}) or len(card.rows) != 1:
        deck.refuse(card, "two constants at one temperature alone are translated", f"{len(card.rows)} lines")
    else:
        deck.used(card, "young_modulus and poisson_ratio")


_ORTHOTROPIC: Final = ("ENGINEERING CONSTANTS", "ORTHO", "ORTHOTROPIC")


def _nine_constants(deck: Translation, card: Card, kind: str) -> dict[str, Any] | None:
    """Nine constants of an orthotropic material: given, or those of nine stiffnesses; None with a problem.

    Stiffnesses are D1111, D1122, D2222, D1133, D2233, D3333, D1212, D1313, D2323; the compliance of the first six is
    1/E_i on its diagonal and -nu_ij/E_i beside it.
    """
    values = numbers([field for _, fields in card.tokens() for field in fields])
    if values is None or len(card.rows) != 2 or len(values) not in (9, 10):
        deck.refuse(card, "nine constants at one temperature alone are translated", f"{len(card.rows)} lines")
        return None
    values = values[:9]
    if kind == "ENGINEERING CONSTANTS":
        return {"young_moduli": values[:3], "poisson_ratios": values[3:6], "shear_moduli": values[6:]}
    a, b, c, d, e, f = values[:6]
    stiffness = np.array([[a, b, d], [b, c, e], [d, e, f]])
    if not np.linalg.eigvalsh(stiffness).min() > 0.0:
        deck.refuse(card, "stiffnesses with which a strain has no energy", ", ".join(f"{x:g}" for x in values[:6]))
        return None
    compliance = np.linalg.inv(stiffness)
    moduli = 1.0 / np.diag(compliance)
    ratios = [-compliance[i, j] * moduli[i] for i, j in ((0, 1), (0, 2), (1, 2))]
    return {
        "young_moduli": [tidy(x) for x in moduli],
        "poisson_ratios": [tidy(x) for x in ratios],
        "shear_moduli": values[6:],
    }


def orientation(deck: Translation, card: Card) -> None:
    """*ORIENTATION, rectangular: axes of orthotropic materials by the sections that name it."""
    values = numbers(next((fields for _, fields in card.tokens()), [])[:6])
    system = card.name("SYSTEM").upper()[:1]
    if not any(one.keyword == "ELASTIC" and one.name("TYPE").upper() in _ORTHOTROPIC for one in deck.model.cards):
        deck.left_out(card, "materials are isotropic, stresses along the global axes")
    elif system not in ("", "R") or len(card.rows) != 1 or values is None or len(values) != 6:
        what = "rectangular axes by two points, without a further rotation, alone are translated"
        deck.refuse(card, what, f"SYSTEM={card.name('SYSTEM')}, {len(card.rows)} lines")
    else:
        deck.orientations[card.name("NAME").upper()] = {"x": values[:3], "y": values[3:]}
        deck.used(card, "axes of the orthotropic materials of its sections; stresses along the global axes")


def density(deck: Translation, card: Card) -> None:
    """*DENSITY at one temperature."""
    if "density" not in deck.model.materials.get(deck.material, {}) or len(card.rows) != 1:
        deck.refuse(card, "a density at one temperature alone is translated", f"{len(card.rows)} lines")
    else:
        deck.used(card, "density")


def expansion(deck: Translation, card: Card) -> None:
    """*EXPANSION, isotropic and at one temperature: its reference temperature does not count then."""
    count = {"": 1, "ISO": 1, "ORTHO": 3}.get(card.name("TYPE").upper(), 0)
    values = numbers(next((fields for _, fields in card.tokens()), [])[:count])
    if len(card.rows) != 1 or not values or len(values) != count:
        deck.refuse(card, "one coefficient, or three of an orthotropic material, at one temperature are translated")
        return
    keys = deck.material_keys.setdefault(deck.material, {})
    keys["thermal_expansion"] = values[0]
    if count == 3:
        keys["thermal_expansions"] = values
    deck.used(card, "thermal_expansion")


def damping(deck: Translation, card: Card) -> None:
    """*DAMPING of a material: Rayleigh's."""
    if deck.refuse_parameters(card, ("ALPHA", "BETA")):
        return
    values = numbers([card.name("ALPHA") or "0", card.name("BETA") or "0"])
    if values is None or not deck.material or min(values) < 0.0:
        deck.refuse(card, "Rayleigh damping of a material with ALPHA and BETA >= 0 alone is translated")
        return
    if not deck.inertia:
        deck.left_out(card, "without inertia nothing depends on rates")
        return
    keys: dict[str, Any] = {"rayleigh_mass": values[0], "rayleigh_stiffness": values[1]}
    if values[0]:
        keys["frame"] = "absolute"
    deck.material_keys.setdefault(deck.material, {}).update({k: v for k, v in keys.items() if v})
    deck.used(card, "rayleigh_mass (against a medium at rest) and rayleigh_stiffness")


def solid_section(deck: Translation, card: Card) -> None:
    """*SOLID SECTION: the material of a part."""
    names = {name.upper() for name in deck.model.materials}
    if card.name("MATERIAL").upper() not in names:
        deck.refuse(card, "no *MATERIAL of this name", card.name("MATERIAL"))
    elif card.name("ORIENTATION"):
        deck.section_axes.setdefault(card.name("MATERIAL").upper(), set()).add(card.name("ORIENTATION").upper())
        deck.used(card, "part and its material, orthotropic ones along the axes of the ORIENTATION")
    else:
        deck.used(card, "part and its material")


def interaction(deck: Translation, card: Card) -> None:
    """*SURFACE INTERACTION: the law of contact pairs."""
    deck.interaction = card.name("NAME").upper()
    deck.interactions[deck.interaction] = {}
    deck.used(card, "law of the interfaces of its contact pairs")


def friction(deck: Translation, card: Card) -> None:
    """*FRICTION: Coulomb's coefficient; the stick slope of a penalty is no part of an exact law."""
    if deck.number:
        deck.refuse(card, "friction that changes from step to step", remedy=APART)
        return
    if deck.refuse_parameters(card, ("SLIP TOLERANCE", "ELASTIC SLIP")):
        return
    values = numbers(next((fields for _, fields in card.tokens()), [])[:2])
    if not values or len(card.rows) != 1 or values[0] < 0.0:
        deck.refuse(card, "one coefficient alone is translated", f"{len(card.rows)} lines")
        return
    law = deck.interactions.setdefault(deck.interaction, {})
    law["friction_coefficient"] = values[0]
    if len(values) > 1:
        law["stick_slope"] = values[1]
    deck.used(card, "friction_coefficient; points stick without the elastic slip of a stick slope")


def behavior(deck: Translation, card: Card) -> None:
    """*SURFACE BEHAVIOR: hard, linear (a layer of its stiffness), or tied (a bonded layer)."""
    if deck.refuse_parameters(card, ("PRESSURE-OVERCLOSURE",)):
        return
    kind = card.name("PRESSURE-OVERCLOSURE").upper() or "HARD"
    law = deck.interactions.setdefault(deck.interaction, {})
    values = numbers(next((fields for _, fields in card.tokens()), [])[:1])
    if kind == "HARD":
        law["behaviour"] = "contact"
        deck.used(card, _EXACT)
    elif kind in ("LINEAR", "TIED") and values and values[0] > 0.0:
        law["behaviour"] = {"LINEAR": "soft_contact", "TIED": "elastic_layer"}[kind]
        law["normal_stiffness"] = values[0]
        if kind == "LINEAR":
            text = f"soft_contact with the stiffness {values[0]:g} of the deck, without tension; exact: behaviour = "
            deck.used(card, f'{text}"contact"')
        else:
            deck.used(card, f"elastic_layer with the stiffness {values[0]:g} of the deck")
    else:
        remedy = "PRESSURE-OVERCLOSURE=HARD has no penalty here, LINEAR with its slope one"
        deck.refuse(card, "HARD, LINEAR and TIED with their stiffness alone are translated", kind, remedy)


_PAIR: Final = ("INTERACTION", "TYPE", "SMALL SLIDING", "ADJUST", "CPSET")
_KINDS: Final = ("", "NODE TO SURFACE", "SURFACE TO SURFACE", "MORTAR", "LINMORTAR", "PGLINMORTAR", "MASSLESS")


def contact_pair(deck: Translation, card: Card) -> None:
    """*CONTACT PAIR: an interface for each pair of parts that the two surfaces lie on."""
    if deck.refuse_parameters(card, _PAIR):
        return
    kind = " ".join(card.name("TYPE").upper().split())
    law = deck.interactions.get(card.name("INTERACTION").upper())
    if kind not in _KINDS or law is None:
        deck.refuse(card, "no such type of contact, or no *SURFACE INTERACTION of this name", kind or None)
        return
    for i, fields in card.tokens():
        if len(fields) < 2:
            deck.refuse(card, "a pair has two surfaces, slave and master", ", ".join(fields), row=i)
            continue
        pairs = _pairs(deck, fields[0], fields[1])
        if not pairs:
            what = "the two surfaces are not on two different parts"
            deck.refuse(card, what, ", ".join(fields[:2]), "a body in contact with itself is not computed", i)
        for sides in pairs:
            name = card.name("INTERACTION") if len(card.rows) == len(pairs) == 1 else f"{fields[0]}_{fields[1]}"
            table = {"sides": sides, **_points(deck, kind, fields[0], fields[1]), **_law(deck, card, law)}
            table |= _adjusted(deck, card, fields[0], fields[1])
            deck.pairs[deck.add("interface", name.replace(".", "_"), table)] = f"{fields[0]}/{fields[1]}"
    text = "interfaces with the slave first; on the places that the nodes have at the start"
    if "SMALL SLIDING" not in card.parameters:
        text += ", also where the deck lets them slide far"
    deck.used(card, text)


def _pairs(deck: Translation, slave: str, master: str) -> list[list[str]]:
    """Faces of two different parts that face each other; of several pairs those whose boxes meet."""
    pairs = [[a, b] for a in deck.faces(slave) for b in deck.faces(master) if a.split(".")[0] != b.split(".")[0]]
    if len(pairs) < 2:
        return pairs
    return [pair for pair in pairs if _near(*(_box(deck, side) for side in pair))]


def _box(deck: Translation, side: str) -> np.ndarray:
    """Ends (2, 3) of the box around a face."""
    part, _, face = side.partition(".")
    group = next(group for group, name in deck.parts.items() if name == part)
    nodes = deck.content.nodes_of(group)
    tables = deck.content.facets.get(face, [deck.content.node_sets.get(face, nodes[:0])])
    rows = np.unique(np.concatenate([table.ravel() for table in tables]))
    points = deck.content.points[rows[np.isin(rows, nodes)]]
    return np.array([points.min(axis=0), points.max(axis=0)])


def _near(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two boxes meet, grown by a tenth of the smaller one."""
    size = 0.1 * min(float(np.ptp(one, axis=0).max()), float(np.ptp(other, axis=0).max()))
    return bool((one[0] <= other[1] + size).all() and (other[0] <= one[1] + size).all())


def _law(deck: Translation, card: Card, law: dict[str, Any]) -> dict[str, Any]:
    """Keys of an interface by the law of its pair."""
    keys = {key: value for key, value in law.items() if key != "stick_slope"}
    if keys.get("behaviour") == "contact":
        # the default
        del keys["behaviour"]
    if law.get("behaviour") == "elastic_layer":
        keys.pop("friction_coefficient", None)
        if "stick_slope" not in law:
            deck.refuse(
                card, "a TIED pair takes its tangential stiffness from the stick slope of *FRICTION: none there"
            )
        keys["tangential_stiffness"] = law.get("stick_slope", 0.0)
    return keys


def _points(deck: Translation, kind: str, slave: str, master: str) -> dict[str, str]:
    """The slave gives the points: in NODE TO SURFACE they are its nodes. Other types have many points on each of its
    facets, and nodes of facets that are larger than those of the master would be too few."""
    if kind in ("", "NODE TO SURFACE"):
        return {"points_from": "E"}
    size, other = (mean_facet(deck.content, surface) for surface in (slave, master))
    return {"points_from": "E"} if size <= other * (1.0 + _ALIKE) else {}


def _adjusted(deck: Translation, card: Card, slave: str, master: str) -> dict[str, Any]:
    """Keys for ADJUST, which moves slave nodes onto the master: closed where it moves all of them."""
    if "ADJUST" not in card.parameters or deck.interactions[card.name("INTERACTION").upper()].get("behaviour") == (
        "elastic_layer"
    ):
        return {}
    # the mesh is the moved one
    gaps = closest(deck.content, slave, master)
    size = float(np.ptp(deck.content.points, axis=0).max())
    moved = int((gaps <= _TOUCHING * size).sum())
    if moved and moved == len(gaps):
        deck.used(card, 'ADJUST: all nodes of the slave are on the master, gap = "closed"')
        return {"gap": "closed"}
    if len(gaps) and moved:
        deck.used(card, f"ADJUST: {moved} of {len(gaps)} corners of the slave are on the master, by mesh.adjust")
        return {"overlap": "ignore"}
    text = "ADJUST moves no node: none is within its reach, or the master is curved"
    deck.left_out(card, text)
    return {}


def clearance(deck: Translation, card: Card) -> None:
    """*CLEARANCE: the gap of an interface."""
    value = numbers([card.name("VALUE")])
    if not value or value[0] < 0.0 or not card.name("MASTER") or not card.name("SLAVE"):
        deck.refuse(card, "a clearance with MASTER, SLAVE and VALUE >= 0 alone is translated")
    else:
        deck.used(
            card, f"gap = {value[0]:g} of the interface between its surfaces, whatever the distance of the meshes"
        )


def tie(deck: Translation, card: Card) -> None:
    """*TIE: perfect interfaces (``mesh_files.deck_scene``)."""
    if deck.refuse_parameters(card, ("NAME", "POSITION TOLERANCE", "ADJUST", "TYPE")):
        return
    for i, fields in card.tokens():
        sides = [deck.faces(surface) for surface in fields[:2]]
        if len(sides) < 2 or any(len(side) != 1 for side in sides):
            deck.refuse(card, "each surface of a tie lies on one part", ", ".join(fields), row=i)
        elif sides[0][0].split(".")[0] == sides[1][0].split(".")[0]:
            deck.refuse(card, "both surfaces of the tie are on one part", ", ".join(fields), row=i)
    deck.used(card, "perfect interface")


def pretension(deck: Translation, card: Card) -> None:
    """*PRE-TENSION SECTION of a surface across a shank: a bolt, cut at its place along its normal."""
    surface = card.name("SURFACE").rpartition(".")[2]
    spelled = {name.upper(): name for name in deck.content.facets}.get(surface.upper())
    if card.name("ELEMENT") or spelled is None or not card.name("NODE"):
        deck.refuse(card, "a section with SURFACE (of element faces) and NODE alone is translated")
        return
    facets = np.concatenate([deck.content.points[table].mean(axis=1) for table in deck.content.facets[spelled]])
    rows = np.unique(np.concatenate([table.ravel() for table in deck.content.facets[spelled]]))
    owners = [part for group, part in deck.parts.items() if np.isin(rows, deck.content.nodes_of(group)).all()]
    if len(owners) != 1:
        deck.refuse(card, "the section is not on one part", ", ".join(owners) or "none")
        return
    outward = _outward(deck, spelled)
    axis = numbers(next((fields for _, fields in card.tokens()), [])[:3]) or outward
    # along the outward normal of the elements below the section a positive force pulls (ccx 2.20, measured)
    sign = 1.0
    if float(np.dot(axis, outward)) < 0.0:
        sign = -1.0
    point = [float(f"{x:.9g}") for x in facets.mean(axis=0)]
    table = {"substructure": owners[0], "axis": axis, "point": point}
    name = deck.add("bolt", _name_of_node(deck, card.name("NODE")) or owners[0], table)
    deck.bolts[card.name("NODE")] = SectionBolt(name, card.name("NODE"), card, sign)
    deck.used(card, f"[bolt.{name}]: cut at the place of the section, tightened before t = 0")


def _name_of_node(deck: Translation, number: str) -> str:
    """The node set that holds this node alone; empty where there is none."""
    labels = deck.content.labels
    for name, rows in deck.content.node_sets.items():
        if len(rows) == 1 and rows[0] < len(labels) and str(labels[rows[0]]) == number and name != f"NODE_{number}":
            return name
    return ""


def _outward(deck: Translation, surface: str) -> list[float]:
    """Mean normal of a surface, out of the elements that it is made of."""
    total = np.zeros(3)
    for table in deck.content.facets[surface]:
        corners = deck.content.points[table]
        # the reader lists the corners of a face of an element as seen from inside
        total -= np.cross(corners[:, 1] - corners[:, 0], corners[:, -1] - corners[:, 0]).sum(axis=0)
    return [tidy(x) for x in total / np.linalg.norm(total)]


def initial_conditions(deck: Translation, card: Card) -> None:
    """*INITIAL CONDITIONS: velocities of whole parts, temperatures."""
    kind = card.name("TYPE").upper()
    if kind not in ("VELOCITY", "TEMPERATURE") or deck.refuse_parameters(card, ("TYPE", "INPUT")):
        deck.refuse(card, "TYPE=VELOCITY and TYPE=TEMPERATURE alone are translated", kind)
        return
    for i, fields in card.tokens():
        try:
            value = real(fields[2 if kind == "VELOCITY" else 1])
            if kind == "TEMPERATURE":
                deck.initial[fields[0].strip('"')] = value
                continue
            axis = int(fields[1]) - 1
        except (ValueError, IndexError):
            deck.refuse(card, "not a line of initial conditions", ", ".join(fields), row=i)
            continue
        parts = deck.whole_parts(fields[0].strip('"'))
        if parts is None or not 0 <= axis <= 2:
            what = "a velocity of all nodes of parts, along 1, 2 or 3, alone is translated"
            deck.refuse(card, what, ", ".join(fields), "[substructure.NAME] initial_velocity_field has fields", i)
            continue
        for part in parts:
            body = deck.tables.setdefault("substructure", {}).setdefault(part, {})
            velocity = body.setdefault("initial_velocity", [0.0, 0.0, 0.0])
            velocity[axis] = value
    deck.used(card, "initial_velocity" if kind == "VELOCITY" else "temperature that changes are counted from")
