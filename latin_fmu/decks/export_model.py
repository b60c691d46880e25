"""The model of a scene as cards: materials, sections, interfaces, bolts, supports, what there is at the start."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Final

import numpy as np

from ..assembly.shank_facets import ShankFacets
from ..fem.faces import Surface
from ..fem.mesh import FacetBlock, FacetSet, Index
from ..fem.mortar import common_cells
from ..latin.assembly import InterfaceUnit
from ..scene.fields import ALL_OF_IT, BOX_FACES, split_face
from ..scene.interfaces import Interface
from ..scene.materials import MaterialTable
from ..scene.substructures import part_name
from .card_text import Field, card, node_card
from .deck_mesh import ELEMENTS
from .export_draft import EVERY_NODE, SETS, DeckDraft

_ROOM_TEMPERATURE: Final = 294.0  # K, where constants that depend on none stand
_LAYERS: Final = {"soft_contact": "LINEAR", "elastic_layer": "TIED"}


# -- bodies -----------------------------------------------------------------------------------------------------------
def mesh_cards(deck: DeckDraft) -> Iterator[str]:
    """Nodes, elements, and a set of the nodes of each body."""
    lost = {
        f"substructure.{name}": block.cell_type
        for name, body in deck.ready.bodies.items()
        for block in body.mesh.blocks
        if block.cell_type not in ELEMENTS
    }
    for where, cell_type in lost.items():
        deck.refuse(where, "CalculiX has no element of these cells", cell_type, "mesh it with other cells")
    if lost:
        return
    yield from deck.mesh.lines(EVERY_NODE)
    for name, body in deck.ready.bodies.items():
        if deck.scene.temperature or any(deck.scene.substructure[name].initial_velocity):
            deck.part_sets[name], lines = deck.node_set(f"nodes_of_{name}", name, np.arange(body.mesh.n_node))
            yield from lines
        if any(block.cell_type == "wedge" and not block.reduced for block in body.mesh.blocks):
            text = "reduced_integration = false: C3D6 of CalculiX has two points, and is softer"
            deck.left_out(f"substructure.{name}", text)
        if body.shape.moduli is not None:
            deck.left_out(f"substructure.{name}", "the shank of its screw carries as it is drawn, not by its core")
        deck.used(f"substructure.{name}", "*ELEMENT, *SOLID SECTION")


def material_cards(deck: DeckDraft) -> Iterator[str]:
    """Materials that a body has, and the sections."""
    bodies = deck.ready.bodies
    of_bodies = dict.fromkeys(deck.scene.substructure[name].material for name in bodies)
    for name in of_bodies:
        material = deck.scene.material[name]
        yield from _orientation(name, material)
        yield from card("MATERIAL", {"NAME": name})
        yield from _elastic(material)
        yield from card("DENSITY", rows=[(material.density,)])
        yield from _expansion(material)
        if deck.inertia:
            yield from _damping(deck, name, material)
        deck.used(f"material.{name}", "*MATERIAL, *ELASTIC, *DENSITY")
    for name in bodies:
        material_name = deck.scene.substructure[name].material
        section: dict[str, Field] = {"ELSET": name, "MATERIAL": material_name}
        if deck.scene.material[material_name].orthotropic is not None:
            section["ORIENTATION"] = material_name
        yield from card("SOLID SECTION", section)
    for name, body in bodies.items():
        if body.rigid:
            # a node of its own, which CalculiX requires
            number = deck.new_node()
            yield from node_card(body.rigid_motions.centre[None], np.array([number]))
            yield from card("RIGID BODY", {"ELSET": name, "REF NODE": number})


def _orientation(name: str, material: MaterialTable) -> Iterator[str]:
    """Axes of an orthotropic material, under its name."""
    if material.orthotropic is not None:
        axes = material.orthotropic.axes
        rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)) if axes is None else axes.rows[:2]
        yield from card("ORIENTATION", {"NAME": name, "SYSTEM": "RECTANGULAR"}, [tuple(chain(*rows))])


def _elastic(material: MaterialTable) -> Iterator[str]:
    own = material.orthotropic
    if own is None:
        assert material.poisson_ratio is not None, "material_problems"
        yield from card("ELASTIC", rows=[(material.young_moduli[0], material.poisson_ratio)])
        return
    constants = (*own.young_moduli, *own.poisson_ratios, *own.shear_moduli)
    # eight numbers a line
    yield from card("ELASTIC", {"TYPE": "ENGINEERING CONSTANTS"}, [constants[:8], (constants[8], _ROOM_TEMPERATURE)])


def _expansion(material: MaterialTable) -> Iterator[str]:
    own = material.orthotropic
    if own is not None and own.thermal_expansions is not None:
        yield from card("EXPANSION", {"TYPE": "ORTHO", "ZERO": 0.0}, [own.thermal_expansions])
    elif material.thermal_expansion is not None:
        yield from card("EXPANSION", {"ZERO": 0.0}, [(material.thermal_expansion,)])


def _damping(deck: DeckDraft, name: str, material: MaterialTable) -> Iterator[str]:
    """Rayleigh's coefficients; damping over a band has none."""
    damping = material.damping
    if damping.strengths:
        deck.left_out(f"material.{name}.damping_ratios", "damping over a band: motions go on longer in the deck")
    elif material.drag or damping.viscosity:
        yield from card("DAMPING", {"ALPHA": material.drag, "BETA": damping.viscosity})


# -- interfaces -------------------------------------------------------------------------------------------------------
def interface_cards(deck: DeckDraft) -> Iterator[str]:
    """Surfaces, contact pairs and ties of the interfaces. Slave is the side that gives the points of contact."""
    if deck.bonded:
        return
    units = {unit.name: unit for unit in deck.ready.units}
    for name, interface in deck.scene.interface.items():
        where = f"interface.{name}"
        if interface.against_ground:
            deck.refuse(where, "contact with the ground, which has no mesh", None, "make the ground a rigid body")
        elif interface.behaviour not in ("contact", "perfect", *_LAYERS):
            deck.refuse(where, "a behaviour that no card has", interface.behaviour)
        elif name in units:
            yield from _pair(deck, name, interface, units[name])


def _pair(deck: DeckDraft, name: str, interface: Interface, unit: InterfaceUnit) -> Iterator[str]:
    """Cards of one interface between two bodies."""
    owner = unit.geometry.owner
    named: list[str] = []
    for side, facets in zip(unit.sides, _facets(deck, interface, unit), strict=True):
        body, face = split_face(side)
        if any(block.kind == "quad9" for block in facets.blocks):
            deck.refuse(f"interface.{name}", "facets of nine nodes")
        if face != ALL_OF_IT and side in deck.surfaces:
            named.append(deck.surfaces[side])
            continue
        surface, lines = deck.surface(_stem(deck, name, side), deck.mesh.faces(body, facets))
        yield from lines
        named.append(surface)
        if face != ALL_OF_IT and interface.search is None:
            deck.surfaces[side] = surface
    slave, master = named[owner], named[1 - owner]
    deck.pairs[name] = slave, master
    if interface.behaviour == "perfect":
        yield from _tie(deck, name, interface, (slave, master))
        return
    yield from card("SURFACE INTERACTION", {"NAME": name})
    yield from _behaviour(deck, interface)
    yield from card("CONTACT PAIR", {"INTERACTION": name, "TYPE": "SURFACE TO SURFACE"}, [(slave, master)])
    if interface.number_gap is not None or interface.gap == "closed":
        gap = interface.number_gap or 0.0
        yield from card("CLEARANCE", {"MASTER": master, "SLAVE": slave, "VALUE": gap})
    if interface.overlap == "ignore" and interface.gap is None and unit.geometry.gap.max() <= 0.0:
        # what would overlap has no distance
        yield from card("CLEARANCE", {"MASTER": master, "SLAVE": slave, "VALUE": 0.0})
    deck.used(f"interface.{name}", f"*CONTACT PAIR {slave}, {master}")


def _stem(deck: DeckDraft, interface: str, side: str) -> str:
    """Name of a surface: that of the face where one body has it, else with that of the body, as of the faces of boxes;
    of a whole boundary it is that of the interface and the body."""
    body, face = split_face(side)
    if face == ALL_OF_IT:
        return f"{interface}_{body}"
    sides = {side for table in deck.scene.interface.values() for side in table.sides}
    if face in BOX_FACES or len([other for other in sides if other.partition(".")[2] == face]) > 1:
        return part_name(f"{body}_{face}")
    return part_name(face)


def _facets(deck: DeckDraft, interface: Interface, unit: InterfaceUnit) -> tuple[FacetSet, FacetSet]:
    """Facets of both sides: whole faces, of those with a reach the ones that are within it."""
    sides = [split_face(side) for side in unit.sides]
    whole = [deck.ready.bodies[body].facets(face) for body, face in sides]
    if any(facets.within is not None for facets in whole):
        text = "bonded over whole facets of the thread, a little more than its length"
        deck.left_out(f"interface.{unit.name}", text)
    if interface.search is None:
        return whole[0], whole[1]
    owner = unit.geometry.owner
    places = [deck.ready.bodies[body].mesh.nodes for body, _ in sides]
    surfaces = [Surface(nodes, facets) for nodes, facets in zip(places, whole, strict=True)]
    common = common_cells(surfaces[owner], surfaces[1 - owner], interface.search)
    mine = [[cells.owner for cells in row] for row in common]
    theirs = [[row[i].other for row in common] for i in range(len(surfaces[1 - owner].pieces))]
    found = [_touched(surfaces[owner], mine), _touched(surfaces[1 - owner], theirs)]
    return found[owner], found[1 - owner]


def _touched(surface: Surface, pieces: list[list[Index]]) -> FacetSet:
    """Facets of a surface, by block, that these pieces are of."""
    blocks = []
    for block, cut, numbers in zip(surface.facets.blocks, surface.pieces, pieces, strict=True):
        rows = np.unique(cut.facet[np.concatenate(numbers)])
        if len(rows):
            blocks.append(FacetBlock(block.kind, block.facets[rows]))
    return FacetSet(tuple(blocks))


def _tie(deck: DeckDraft, name: str, interface: Interface, pair: tuple[str, str]) -> Iterator[str]:
    parameters: dict[str, Field] = {"NAME": name}
    if interface.search is not None:
        parameters["POSITION TOLERANCE"] = interface.search
    yield from card("TIE", parameters, [pair])
    deck.used(f"interface.{name}", f"*TIE {', '.join(pair)}")


def _behaviour(deck: DeckDraft, interface: Interface) -> Iterator[str]:
    """The law of a contact pair. CalculiX takes the slope of a HARD one from its data line, which Abaqus and
    ``latin-fmu import`` leave alone."""
    slope = interface.normal_stiffness
    kind = _LAYERS.get(interface.behaviour, "HARD")
    if slope is None:
        slope = _penalty(deck, interface)
    yield from card("SURFACE BEHAVIOR", {"PRESSURE-OVERCLOSURE": kind}, [(slope,)])
    stick = deck.choices.stick * slope
    if interface.behaviour == "elastic_layer":
        # a bonded layer does not slip: the coefficient does not count
        yield from card("FRICTION", rows=[(1.0, interface.tangential_stiffness or 0.0)])
    elif interface.friction_coefficient > 0.0:
        yield from card("FRICTION", rows=[(interface.friction_coefficient, stick)])


def _penalty(deck: DeckDraft, interface: Interface) -> float:
    """Slope of the pressure, Pa m-1, in units of E/h of the softer side, h the smaller size of facets."""
    moduli, sizes = [], []
    for side in interface.sides:
        body = deck.ready.bodies[split_face(side)[0]]
        surface = body.surface(split_face(side)[1])
        moduli.append(body.shape.elasticity.young_moduli[0])
        sizes.append(float(np.sqrt(surface.area / surface.facets.n_facet)))
    return deck.choices.penalty * min(moduli) / min(sizes)


# -- bolts ------------------------------------------------------------------------------------------------------------
def bolt_cards(deck: DeckDraft) -> Iterator[str]:
    """Sections across the shanks, each with a node that tightens it; a set of the bolt's name has the node."""
    for name, cut in deck.ready.cuts.items():
        body = deck.ready.bodies[cut.table.substructure]
        shank = ShankFacets(body, cut.axis)
        rows = np.flatnonzero(
            ~cut.beyond[shank.below] & cut.beyond[shank.above] & _all_in(shank.facets, cut.nodes, body.mesh.n_node)
        )
        corners = [shank.facets[i, : _corners(shank.facets[i])][None] for i in rows]
        below = np.zeros(body.mesh.n_cell, dtype=bool)
        below[shank.below[rows]] = True
        surface, lines = deck.surface(f"cut_{name}", deck.mesh.faces_among(body.name, corners, below))
        yield from lines
        number = deck.new_node()
        # a node of its own, wherever it is
        yield from node_card(cut.point[None], np.array([number]), deck.free_name(SETS, name))
        yield from card("PRE-TENSION SECTION", {"SURFACE": surface, "NODE": number}, [tuple(cut.axis.tolist())])
        deck.bolts[name] = number
        deck.used(f"bolt.{name}", f"*PRE-TENSION SECTION {surface}, node {number}")
        if cut.table.thread is not None:
            deck.left_out(f"bolt.{name}.thread", "what is bonded for it is written as a tie, its stresses are not")


def _all_in(facets: Index, nodes: Index, n_node: int) -> np.ndarray:
    """Whether all nodes of facets, filled with -1, are among some."""
    inside = np.zeros(n_node + 1, dtype=bool)
    inside[nodes] = inside[-1] = True
    return np.asarray(inside[facets].all(axis=1))


def _corners(facet: Index) -> int:
    """Corners of a facet whose nodes are filled with -1."""
    return 3 if int((facet >= 0).sum()) in (3, 6) else 4


# -- the start --------------------------------------------------------------------------------------------------------
def initial_cards(deck: DeckDraft) -> Iterator[str]:
    """Temperatures, from which changes are counted, and velocities."""
    if deck.scene.temperature:
        yield from card("INITIAL CONDITIONS", {"TYPE": "TEMPERATURE"}, [(EVERY_NODE, 0.0)])
    rows: list[tuple[str, int, float]] = []
    for name, described in deck.scene.substructure.items():
        if name in deck.part_sets and any(described.initial_velocity):
            velocity = enumerate(described.initial_velocity, 1)
            rows += [(deck.part_sets[name], axis, value) for axis, value in velocity if value]
            deck.used(f"substructure.{name}.initial_velocity", "*INITIAL CONDITIONS")
    if rows:
        yield from card("INITIAL CONDITIONS", {"TYPE": "VELOCITY"}, rows)
