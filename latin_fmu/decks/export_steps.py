"""Loads, steps and prints of a scene as cards.

Bolts are tightened first, in a static step for each of their orders; then they keep their shortening. A static start is
a static step under what acts before t = 0. The last step is that of the scene, static or dynamic, with amplitudes at
its instants.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..assembly.loaded_faces import BodyFace
from ..fem.mesh import Array
from ..scene.fields import split_face
from ..scene.laws import InputLaw, TimeLaw, sampled
from ..scene.loads import Load
from ..scene.substructures import RotationTable
from ..time_scheme import CentralDifference
from .card_text import Field, amplitude_card, card
from .export_draft import EVERY_NODE, DeckDraft
from .export_supports import DrivenSet

_RAISED: Final = (0.2, 1.0)  # first increment and length of a step that tightens bolts
_SHORTEST: Final = 1e-6  # of an increment, the shortest that CalculiX may cut it to
_LAST: Final = 1_000_000  # increments from one print to the next, of those at the end of a step
_DIGITS: Final = 10  # of forces on nodes: equal ones are loaded alike
_FEW: Final = 12  # different forces of one load up to which the nodes of each are a set
Lines = Iterator[str]
Writer = Callable[[str, float], Lines]
"""Cards of a load by the name of its amplitude, empty where it has none, and a factor."""


@dataclass(frozen=True)
class ActingLoad:
    """What acts over time.

    Attributes
    ----------
    name : of its amplitude. write : its cards. times, values : (n,) of its amplitude. before : value before t = 0.
    """

    name: str
    write: Writer
    times: Array
    values: Array
    before: float

    @property
    def steady(self) -> bool:
        """Whether it is the same at all times."""
        return bool((self.values == self.values[0]).all())


# -- loads ------------------------------------------------------------------------------------------------------------
def load_sets(deck: DeckDraft) -> tuple[list[ActingLoad], list[str]]:
    """Everything that acts, and the cards of its sets and surfaces, which stand before the steps."""
    acting: list[ActingLoad] = []
    lines: list[str] = []
    for name, load in deck.scene.loads.items():
        if split_face(load.face)[0] in deck.ready.bodies:
            writer = (
                _pressure(deck, name, load, lines) if load.pressure is not None else _forces(deck, name, load, lines)
            )
            acting += _acting(deck, f"load.{name}", name, load.law, writer)
    for body_load in deck.scene.body_loads:
        name = body_load.of or "gravity"
        bodies = [n for n in deck.ready.bodies if body_load.acts_on(n, deck.scene.substructure[n])]
        if not bodies:
            continue
        value = body_load.kind.value(body_load.table)
        if isinstance(body_load.table, RotationTable):
            writer = _rotation(bodies, body_load.table)
        elif body_load.kind.strains:
            writer = _temperature([deck.part_sets[n] for n in bodies], float(value))
        else:
            density = dict.fromkeys(bodies, 1.0)
            if body_load.kind.owner(body_load.of) is not None:
                density = {n: deck.ready.bodies[n].shape.material.density for n in bodies}
            writer = _accelerations({n: np.asarray(value) / density[n] for n in bodies})
        acting += _acting(deck, body_load.key, name, body_load.law, writer)
    _refuse_twice(deck)
    return acting, lines


def _acting(deck: DeckDraft, where: str, name: str, law: TimeLaw, writer: Writer) -> Iterator[ActingLoad]:
    if isinstance(law, InputLaw):
        deck.refuse(f"{where}.law", "a load that is set from outside")
        return
    time = deck.ready.time
    before = float(law.sample(time[:1])[0])
    yield ActingLoad(deck.free_name("amplitudes", name), writer, time, sampled(law, time), before)


def _pressure(deck: DeckDraft, name: str, load: Load, lines: list[str]) -> Writer:
    body, face = split_face(load.face)
    surface, cards = deck.surface(name, deck.mesh.faces(body, deck.ready.bodies[body].facets(face)))
    lines.extend(cards)
    deck.used(f"load.{name}", f"*DSLOAD on {surface}")

    def write(amplitude: str, factor: float) -> Lines:
        assert load.pressure is not None
        yield from card("DSLOAD", _with_amplitude(amplitude), [(surface, "P", factor * load.pressure)])

    return write


def _forces(deck: DeckDraft, name: str, load: Load, lines: list[str]) -> Writer:
    """Forces on nodes, to ten digits: the integrals of a traction are those of the scene. Nodes with the same force are
    a set where these are few."""
    body = split_face(load.face)[0]
    face = BodyFace.of(deck.ready.bodies, load.face)
    forces = load.nodal_forces(face)
    size = float(np.abs(forces).max(initial=0.0)) or 1.0
    unique, group = np.unique(np.round(forces / size, _DIGITS) + 0.0, axis=0, return_inverse=True)
    rows: list[tuple[int | str, int, float]] = []
    for i, force in enumerate((size * unique).tolist()):
        nodes = face.face.nodes[group.ravel() == i]
        targets: list[int | str] = deck.mesh.nodes[body][nodes].tolist()
        if len(unique) <= _FEW:
            nodes_name, cards = deck.node_set(name if len(unique) == 1 else f"{name}_{i + 1}", body, nodes)
            lines.extend(cards)
            targets = [nodes_name]
        rows += [(target, axis, value) for target in targets for axis, value in enumerate(force, 1) if value]
    deck.used(f"load.{name}", f"*CLOAD on {len(face.face.nodes)} nodes")

    def write(amplitude: str, factor: float) -> Lines:
        scaled = [(node, axis, float(f"{factor * value:.{_DIGITS}g}")) for node, axis, value in rows]
        yield from card("CLOAD", _with_amplitude(amplitude), scaled)

    return write


def _temperature(sets: list[str], change: float) -> Writer:
    def write(amplitude: str, factor: float) -> Lines:
        yield from card("TEMPERATURE", _with_amplitude(amplitude), [(nodes, factor * change) for nodes in sets])

    return write


def _accelerations(vectors: dict[str, Array]) -> Writer:
    """Gravity of bodies, m s-2."""

    def write(amplitude: str, factor: float) -> Lines:
        rows = []
        for body, vector in vectors.items():
            size = float(np.linalg.norm(vector))
            if size > 0.0:
                rows.append((body, "GRAV", factor * size, *(vector / size).tolist()))
        if rows:
            yield from card("DLOAD", _with_amplitude(amplitude), rows)

    return write


def _rotation(bodies: list[str], table: RotationTable) -> Writer:
    """Centrifugal force of bodies: the square of the speed, a point on the axis, its direction."""
    axis = (np.array(table.axis) / np.linalg.norm(table.axis)).tolist()

    def write(amplitude: str, factor: float) -> Lines:
        square = factor * table.angular_velocity**2
        rows = [(body, "CENTRIF", square, *table.point, *axis) for body in bodies]
        yield from card("DLOAD", _with_amplitude(amplitude), rows)

    return write


def _with_amplitude(name: str) -> dict[str, Field]:
    if name:
        return {"AMPLITUDE": name}
    return {}


def _refuse_twice(deck: DeckDraft) -> None:
    """Refuse what acts twice on the same nodes, faces or bodies: in a deck the last one may count alone."""
    for name in deck.ready.bodies:
        of_body = [x.key for x in deck.scene.body_loads if x.acts_on(name, deck.scene.substructure[name])]
        twice = [key for key in of_body if not key.startswith("temperature")]
        if len(twice) > 1 or len(of_body) - len(twice) > 1:
            what = "two loads of all of a body: of a deck the last one alone counts"
            deck.refuse(f"substructure.{name}", what, ", ".join(of_body), "make one load of them")
    seen: dict[str, tuple[Load, set[Any]]] = {}
    for name, load in deck.scene.loads.items():
        body, face = split_face(load.face)
        if body not in deck.ready.bodies:
            continue
        places: set[Any] = {(body, int(node)) for node in deck.ready.bodies[body].nodes_of(face)}
        if load.pressure is not None:
            places = set(deck.mesh.faces(body, deck.ready.bodies[body].facets(face)))
        for other, (table, others) in seen.items():
            alike = (table.pressure is None) == (load.pressure is None) and table.law != load.law
            if alike and places & others:
                what = "two laws of loads on the same nodes or facets: of a deck the last one alone counts"
                deck.refuse(f"load.{name}", what, other, "let them act on different faces")
        seen[name] = load, places


# -- steps ------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class DeckPlan:
    """What the steps are made of.

    Attributes
    ----------
    acting : loads. driven : motions.
    """

    acting: list[ActingLoad]
    driven: list[DrivenSet]

    @property
    def at_start(self) -> bool:
        """Whether anything acts before t = 0."""
        return any(one.before for one in self.acting) or any(motion.before for motion in self.driven)


def has_steps_before(deck: DeckDraft) -> bool:
    """Whether a step comes before that of the scene."""
    return bool(deck.scene.bolt) or deck.static_start


def amplitude_cards(deck: DeckDraft, plan: DeckPlan) -> Lines:
    """Amplitudes of what changes over time."""
    for one in plan.acting:
        if _has_amplitude(deck, one):
            yield from amplitude_card(one.name, one.times, one.values)
    for motion in plan.driven:
        yield from amplitude_card(motion.name, motion.times, motion.values)


def _has_amplitude(deck: DeckDraft, load: ActingLoad) -> bool:
    """Whether a load has an amplitude; a static step would raise a steady one."""
    return not (load.steady and deck.inertia)


def step_cards(deck: DeckDraft, plan: DeckPlan) -> Lines:
    """Steps that tighten bolts, the static start, the step of the scene."""
    orders = sorted({cut.table.order for cut in deck.ready.cuts.values()})
    first = True
    for order in orders:
        yield from card("STEP", {"INC": _LAST})
        yield from card("STATIC", rows=[(*_RAISED, _SHORTEST, _RAISED[0])])
        yield from _tightening(deck, order, orders[0])
        yield from _prints(deck) if first else ()
        yield from card("END STEP")
        first = False
    fixed = bool(orders)
    if deck.static_start and plan.at_start:
        increments = getattr(deck.scene.time.start, "increments", 1)
        yield from card("STEP", {"INC": _LAST})
        yield from card("STATIC", rows=[(1.0 / increments, 1.0, _SHORTEST, 1.0 / increments)])
        yield from _kept(deck) if fixed else ()
        fixed = False
        for one in plan.acting:
            yield from one.write("", one.before) if one.before else ()
        for motion in plan.driven:
            if motion.before:
                yield from card("BOUNDARY", rows=_moved(motion, motion.before))
        yield from _prints(deck) if first else ()
        yield from card("END STEP")
        first = False
    yield from card("STEP", {"INC": _LAST})
    yield from _procedure(deck)
    yield from _kept(deck) if fixed else ()
    for one in plan.acting:
        there = deck.static_start and one.steady and one.before == one.values[0]
        if not there and one.values.any():
            amplitude = one.name if _has_amplitude(deck, one) else ""
            yield from one.write(amplitude, 1.0 if amplitude else float(one.values[0]))
    for motion in plan.driven:
        yield from card("BOUNDARY", {"AMPLITUDE": motion.name}, _moved(motion, 1.0))
    yield from _prints(deck) if first else ()
    yield from card("END STEP")


def _moved(motion: DrivenSet, factor: float) -> list[tuple[Field, ...]]:
    return [(motion.nodes, degree, degree, factor * value) for degree, value in motion.degrees]


def _tightening(deck: DeckDraft, order: int, first: int) -> Lines:
    """Forces and shortenings of the bolts of an order; those of orders before keep theirs."""
    cuts = deck.ready.cuts
    if order != first:
        yield from _kept(deck, order)
    tight = [(name, cut) for name, cut in cuts.items() if cut.table.order == order]
    forces = [(deck.bolts[name], 1, cut.tension) for name, cut in tight if cut.tension is not None]
    shifts = [(deck.bolts[name], 1, 1, cut.table.shortening or 0.0) for name, cut in tight if cut.tension is None]
    if forces:
        yield from card("CLOAD", rows=forces)
    if shifts:
        yield from card("BOUNDARY", rows=shifts)


def _kept(deck: DeckDraft, order: int | None = None) -> Lines:
    """Bolts that were tightened by a force, in an order before this one where it is given, keep their shortening."""
    tight = [
        deck.bolts[name]
        for name, cut in deck.ready.cuts.items()
        if cut.tension is not None and (order is None or cut.table.order < order)
    ]
    if tight:
        yield from card("BOUNDARY", {"FIXED": ""}, [(node, 1, 1) for node in tight])


def _procedure(deck: DeckDraft) -> Lines:
    """*STATIC or *DYNAMIC with the increments of the scene."""
    choices, dt, end = deck.choices, deck.ready.dt, float(deck.ready.time[-1])
    times: tuple[float, ...] = (dt, end)
    parameters: dict[str, Field] = {}
    # an explicit step with DIRECT does not come to an end in CalculiX 2.20
    explicit = isinstance(deck.ready.scheme, CentralDifference)
    if choices.direct and not explicit:
        parameters["DIRECT"] = ""
    else:
        times = (dt, end, _SHORTEST * dt, dt)
    if not deck.inertia:
        yield from card("STATIC", parameters, [times])
        return
    alpha = _alpha(deck)
    if explicit:
        parameters["EXPLICIT"] = ""
    elif alpha is not None:
        parameters = {"ALPHA": alpha, **parameters}
    yield from card("DYNAMIC", parameters, [times])


def _alpha(deck: DeckDraft) -> float | None:
    """ALPHA of the scheme; None of one that CalculiX has not."""
    scheme = deck.ready.scheme
    if deck.choices.alpha is not None:
        return deck.choices.alpha
    if scheme.name == "hht":
        return scheme.memory_weight
    if not isinstance(scheme, CentralDifference):
        deck.left_out("time.scheme", f"{scheme.name}: the deck has HHT with ALPHA = -0.05")
    return None


# -- prints -----------------------------------------------------------------------------------------------------------
def _prints(deck: DeckDraft) -> Lines:
    """What is printed from a step on; there is one FREQUENCY for all of it."""
    frequency: dict[str, Field] = {"FREQUENCY": _LAST if deck.choices.last else 1}
    output = deck.scene.output
    for name in deck.sensor_sets.values():
        yield from card("NODE PRINT", {"NSET": name, **frequency}, [("U",)])
    if deck.choices.every:
        yield from card("NODE PRINT", {"NSET": EVERY_NODE, **frequency}, [("U",)])
    if output.reactions:
        for name in deck.boundary_sets.values():
            yield from card("NODE PRINT", {"NSET": name, "TOTALS": "ONLY", **frequency}, [("RF",)])
    if output.fields:
        yield from card("NODE FILE", frequency, [("U",)])
    words = [word for key, word in (("strain", "E"), ("nodal_stress", "S")) if getattr(output, key)]
    if deck.choices.stresses and "S" not in words:
        words.append("S")
    # without an energy CalculiX 2.20 stops in a dynamic step after a static one
    if output.energy or (deck.inertia and has_steps_before(deck)):
        words.append("ENER")
    if words:
        yield from card("EL FILE", frequency, [words])
    if output.stress:
        for name in deck.ready.bodies:
            yield from card("EL PRINT", {"ELSET": name, **frequency}, [("S",)])
    ties = {name for name, interface in deck.scene.interface.items() if interface.behaviour == "perfect"}
    pairs = [pair for name, pair in deck.pairs.items() if name not in ties]
    for slave, master in pairs:
        yield from card("CONTACT PRINT", {"SLAVE": slave, "MASTER": master, **frequency}, [("CF",)])
    if output.surfaces and pairs:
        yield from card("CONTACT FILE", frequency, [("CDIS", "CSTR")])


def sensor_cards(deck: DeckDraft) -> Lines:
    """Sets of the nodes of sensors, which print their displacements."""
    for name, sensor in deck.scene.sensor.items():
        if sensor.face is not None or sensor.substructure not in deck.ready.bodies or sensor.point is None:
            continue
        mesh = deck.ready.bodies[sensor.substructure].mesh
        away = np.linalg.norm(mesh.nodes - np.asarray(sensor.point), axis=1)
        node = int(away.argmin())
        if away[node] > 1e-6 * mesh.size:
            at = ", ".join(f"{x:.6g}" for x in mesh.nodes[node])
            deck.left_out(f"sensor.{name}", f"no node is there; the nearest is at [{at}]")
            continue
        deck.sensor_sets[name], lines = deck.node_set(name, sensor.substructure, np.array([node]))
        yield from lines
        deck.used(f"sensor.{name}", f"*NODE PRINT {deck.sensor_sets[name]}")
