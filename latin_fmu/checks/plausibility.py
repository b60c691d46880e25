"""Remarks on numbers that a scene may have but hardly means: units of materials, loads, gaps and steps; torn parts.

Ranges are those of solids, from rubber and foam to diamond: E from 1 MPa to 1.3 TPa, density from 10 to 25,000 kg m-3,
speed of waves sqrt(E / rho) from 50 to 20,000 m/s, dry friction up to 2. They are compared in SI, with the sizes of the
units that the scene names (``scene.units``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..assembly.body import Body
from ..assembly.interfaces import between
from ..assembly.loaded_faces import BodyFace
from ..assembly.problem import DiscretisedProblem
from ..assembly.wave_pace import waves_count
from ..errors import listed
from ..fem.mesh import nearest
from ..latin.assembly import InterfaceUnit
from ..remarks import Remark, remarks_of
from ..scene.boundaries import Driven
from ..scene.fields import GROUND, split_face
from ..scene.histories import history_remarks
from ..scene.laws import InputLaw
from ..scene.load_kinds import LoadEstimate
from ..scene.materials import MaterialTable
from ..scene.schema import Scene
from ..scene.screw_names import is_screw, words_of_name
from ..scene.units import SI, UNIT_SYSTEMS, UnitSystem
from .mesh_checks import size_remarks

MODULUS = (1e6, 1.3e12)
DENSITY = (10.0, 25e3)
SPEED = (50.0, 2e4)
"""Ranges of Young's modulus, Pa, of the density, kg m-3, and of sqrt(E / rho), m s-1."""
FRICTION: Final = 2.0
"""Largest coefficient of dry friction."""
STRESS: Final = (1e-8, 1e-2)
"""Range of pressures over Young's modulus; above, strains are not small."""
_MODULI = (("GPa", 1e9), ("MPa", 1e6), ("Pa", 1.0))  # units that a number may be meant in
_DENSITIES = (("g/cm3", 1e3), ("kg/m3", 1.0), ("t/mm3", 1e12))
_GAP = 0.2  # of the size of the smaller body
_COURANT = (1e-3, 100.0)  # steps over the passage of a wave through a mean element
_MOST_BODIES = 20  # of which the nearest pair is named
_COINCIDENT = 1e-6  # of the size of the body


def plausibility_remarks(problem: DiscretisedProblem) -> list[Remark]:
    """All remarks of this module on a scene."""
    scene = problem.scene
    bodies = problem.bodies
    units = problem.units
    of_units = []
    if not meant_system(scene):
        of_units = size_remarks(bodies)
    return [
        *([*of_units, *_material_remarks(scene)] if scene.unit_system.measurable else []),
        *_friction_remarks(units),
        *_load_remarks(scene, bodies),
        *_driving_remarks(problem),
        *remarks_of("history", history_remarks(scene)),
        *_gap_remarks(bodies, units),
        *([] if scene.port else _unjoined_remarks(bodies, units)),
        *_step_remarks(problem),
        *_screw_remarks(scene),
        *(remark for name, body in bodies.items() for remark in _pieces(name, body)),
    ]


def _screw_remarks(scene: Scene) -> Iterator[Remark]:
    """Bodies with names of screws that no bolt tightens."""
    tightened = {bolt.substructure for bolt in scene.bolt.values()}
    left = [n for n in scene.substructure if n not in tightened and is_screw(words_of_name(n))]
    if left:
        text = f"no [bolt] tightens {listed(left)}, by name {'a screw' if len(left) == 1 else 'screws'}"
        yield Remark("screw", f"{text}: add a table [bolt.NAME], or the name to parts of one, if it has a preload")


def meant_system(scene: Scene) -> UnitSystem | None:
    """Another system of units in which all materials are those of solids, where none is in that of the scene."""
    used = _elastic_materials(scene).values()
    if not used or any(_is_solid(m, scene.unit_system) for m in used):
        return None
    return next((s for s in UNIT_SYSTEMS.values() if s.measurable and all(_is_solid(m, s) for m in used)), None)


def _elastic_materials(scene: Scene) -> dict[str, MaterialTable]:
    """Materials of bodies that deform."""
    names = dict.fromkeys(s.material for s in scene.substructure.values() if not s.rigid)
    return {name: scene.material[name] for name in names}


def _is_solid(m: MaterialTable, units: UnitSystem) -> bool:
    values = [("Pa", e, MODULUS) for e in m.young_moduli]
    values += [("kg m-3", m.density, DENSITY), ("m s-1", _bar_speed(m), SPEED)]
    return all(low <= units.size(unit) * value <= high for unit, value, (low, high) in values)


def _bar_speed(m: MaterialTable) -> float:
    return float(np.sqrt(max(m.young_moduli) / m.density))


def _material_remarks(scene: Scene) -> Iterator[Remark]:
    if (meant := meant_system(scene)) is not None:
        text = f"the values of the materials are plausible in {meant.name}, the scene is in {scene.units}: if all its"
        yield Remark("size", f'{text} numbers are in {meant.name}, write units = "{meant.name}"')
        return
    units = scene.unit_system
    for name, m in _elastic_materials(scene).items():
        rho, speed = m.density, _bar_speed(m)
        where = f"material {name}:"
        if question := next(filter(None, (_doubt(e, MODULUS, "Pa", units) for e in m.young_moduli)), ""):
            yield Remark("material", f"{where} no solid has a Young's modulus of {question}")
        if doubt := _doubt(rho, DENSITY, "kg m-3", units):
            yield Remark("material", f"{where} no solid has a density of {doubt}")
        # E and rho may each be possible, and wrong together
        elif not question and not SPEED[0] <= units.size("m s-1") * speed <= SPEED[1]:
            text = f"no solid has a wave speed sqrt(E / rho) of {speed:.3g} {units['m s-1']}: check the units of both"
            yield Remark("material", f"{where} {text}")


def _doubt(value: float, allowed: tuple[float, float], unit: str, units: UnitSystem) -> str:
    """A value out of a range in SI, with a question about the unit that it would be plausible in, or with the usual
    range; nothing for one within."""
    size, label = units.size(unit), units[unit]
    if allowed[0] <= value * size <= allowed[1]:
        return ""
    for name, factor in _MODULI if unit == "Pa" else _DENSITIES:
        if allowed[0] <= value * factor <= allowed[1]:
            return f"{value:g} {label}: if it is in {name}, write {value * factor / size:g} ({label})"
    return f"{value:g} {label} (solids: {allowed[0] / size:g} to {allowed[1] / size:g} {label}): check its unit"


def _friction_remarks(units: list[InterfaceUnit]) -> Iterator[Remark]:
    for unit in units:
        mu = float(getattr(unit.behaviour, "friction_coefficient", 0.0) or 0.0)
        if mu > FRICTION:
            text = f"a friction coefficient of {mu:g} is above that of all dry pairs (up to {FRICTION:g})"
            remedy = f"if it is in per cent, write {mu / 100:g}; for sides that never slide use behaviour no_slip"
            yield Remark("friction", f"interface {unit.name}: {text}: {remedy}")


def _load_remarks(scene: Scene, bodies: Mapping[str, Body]) -> Iterator[Remark]:
    units = scene.unit_system
    for name, load in scene.load.items():
        substructure = split_face(load.face)[0]
        body = bodies[substructure]
        inside = [n for n, i in scene.interface.items() if load.face in i.sides]
        if inside:
            text = f"its face {load.face} is a side of interface {inside[0]}: it acts between the two bodies and is not"
            yield Remark("load", f"load {name}: {text} external; choose a free face if this is not intended")
        if isinstance(load.law, InputLaw) or body.rigid:
            continue
        modulus = body.shape.elasticity.young_moduli[0]
        times = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
        largest = float(np.abs(load.law.sample(times)).max())
        share = load.largest_traction(BodyFace.of(bodies, load.face)) * largest / modulus
        stress = f"{share * modulus:.3g} {units['Pa']}"
        if share > STRESS[1]:
            text = f"it acts with {stress}, {100 * share:.2g} % of Young's modulus: strains"
            remedy = "check the units of the load, of its law and of the material"
            yield Remark("load", f"load {name}: {text} are not small; {remedy}")
        mean = float(np.mean(load.law.sample(times)))
        estimate = LoadEstimate(substructure, stress, share, share < STRESS[0], mean, units is SI)
        for text in load.doubts(estimate):
            yield Remark("load", f"load {name}: {text}")


def _driving_remarks(problem: DiscretisedProblem) -> Iterator[Remark]:
    """Nothing that could move a body."""
    scene = problem.scene
    driven = scene.force_laws or scene.standing or scene.port or scene.time.start.type == "static"
    driven = driven or any(isinstance(b, Driven) for b in scene.boundary.values())
    driven = driven or any(i.ground_velocity is not None for i in scene.joints.values())
    if not driven:
        text = "nothing loads or moves a body: every result is zero; add a [load], an initial velocity or a driven"
        yield Remark("load", f"{text} [boundary]")


def _gap_remarks(bodies: Mapping[str, Body], units: list[InterfaceUnit]) -> Iterator[Remark]:
    """Gaps as wide as bodies: a number in mm, or meshes that were not put together."""
    for unit in units if next(iter(bodies.values())).units.measurable else ():
        if unit.attached or not unit.behaviour.opens:
            continue
        length = next(iter(bodies.values())).units["m"]
        size = min(bodies[split_face(side)[0]].mesh.size for side in unit.sides if side != GROUND)
        gap = float(unit.geometry.gap.min())
        if gap > _GAP * size:
            text = f"a gap of {gap:.4g} {length} between bodies of {size:.4g} {length}: "
            if length == "m":
                text += "is it in mm, or "
            text += "is a mesh misplaced?"
            yield Remark("gap", f"interface {unit.name}: {text}")


def _unjoined_remarks(bodies: Mapping[str, Body], units: list[InterfaceUnit]) -> Iterator[Remark]:
    if len(bodies) < 2 or units:
        return
    distance, first, second = min(
        (between(bodies[a], bodies[b]), a, b) for a, b in combinations(list(bodies)[:_MOST_BODIES], 2)
    )
    text = f"no interface joins the bodies: they penetrate each other without contact; {first} and {second} are "
    text += f"{distance:.4g} {bodies[first].units['m']} apart (between nodes): add an [interface.NAME], "
    text += "or a [contact.NAME] with a larger search"
    yield Remark("unjoined", text)


def _step_remarks(problem: DiscretisedProblem) -> Iterator[Remark]:
    """Steps far from the time in which a wave crosses an element."""
    scene = problem.scene
    if scene.time.quasi_static:
        return
    courant = {}
    for name, body in problem.bodies.items():
        if not body.rigid:
            edge = (float(body.shape.elements.volume.sum()) / max(body.mesh.n_cell, 1)) ** (1 / 3)
            courant[name] = problem.dt * body.shape.fast_elasticity.bar_speed / edge
    if not courant:
        return
    low, high = min(courant, key=courant.__getitem__), max(courant, key=courant.__getitem__)
    # even the body with the longest way in a step
    if courant[high] < _COURANT[0]:
        text = f"a wave takes {1 / courant[high]:.2g} steps to cross an element of {high}: longer steps cost less at"
        yield Remark("step", f"time step {problem.dt:.3g} s: {text} the same accuracy, which the mesh limits")
    elif courant[low] > _COURANT[1] and waves_count(scene, problem.bodies, problem.units, problem.time):
        text = f"a wave crosses {courant[low]:.2g} elements of {low} in a step: waves are not resolved"
        yield Remark("step", f"time step {problem.dt:.3g} s: {text}; use smaller steps if waves matter")


def _pieces(name: str, body: Body) -> Iterator[Remark]:
    """Parts of a body that share no node: a mesh torn along duplicate nodes, or several blocks."""
    n = body.mesh.n_node
    if body.description.box is not None:
        return
    # each cell as a star about its first node
    first = np.concatenate([np.repeat(b.cells[:, 0], b.cells.shape[1]) for b in body.mesh.blocks])
    others = np.concatenate([b.cells.ravel() for b in body.mesh.blocks])
    graph = sp.coo_array((np.ones(len(first), dtype=np.int8), (first, others)), shape=(n, n))
    count, piece = connected_components(graph, directed=False)
    if count == 1:
        return
    largest = piece == np.bincount(piece).argmax()
    distance, _ = nearest(body.mesh.nodes[~largest], body.mesh.nodes[largest])
    twice = int((distance <= _COINCIDENT * body.mesh.size).sum())
    text = f"substructure {name}: its mesh consists of {count} pieces without common nodes"
    if twice:
        text += (
            f"; {twice} nodes coincide with nodes of another piece: the mesh is torn there; merge its duplicate nodes,"
        )
        yield Remark("torn", f"{text} or make the pieces separate parts with a perfect interface")
    else:
        yield Remark("torn", f"{text} that do not touch: make them separate parts, with interfaces between them")
