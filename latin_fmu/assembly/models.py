"""Models of the substructures of a scene, grouped into classes of identical ones; operators of the scene solved last,
for a scene that differs in parameters which enter none or few of them.

Friction, preload, amplitudes, laws and initial velocities change no operator; a time step changes the factors, a
material the matrices too. What may be used again is decided by comparison: meshes and element matrices where the
description of a body is equal, factors where all matrices of a class, the time scheme and the step are equal to the
last bit, modes of the assembly likewise. A key that is not listed here can therefore cost time, but never give other
results. Whether an assembly is marched by its modes is decided for the first scene.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np
import scipy.sparse as sp
from pydantic import BaseModel

from ..errors import SceneError
from ..fem.contact_layer import blended_mass, landing_viscosity, layer_of, longest_edge, without_contact_mass
from ..latin.assembly import Array, Index, InterfaceUnit
from ..operator_store import NO_STORE, OperatorStore, store_at
from ..propagator import LoadTerm, Propagator, SubstructureModel
from ..propagator.model import FaceStiffness, share_operators
from ..scene.fields import split_face
from ..scene.laws import TimeLaw
from ..scene.schema import Scene, straining_loads
from ..scene.settings import AutomaticScheme, ModalPropagatorTable, ReducedPropagatorTable
from ..time_scheme import HHT, SCHEMES, GeneralizedAlpha, MaxwellBranches, QuasiStatic, TimeScheme
from .body import AddedMass, Body, body_sides
from .loaded_faces import BodyFace

_OWN: Final = frozenset(("name", "store", "loads", "displacement", "velocity", "imposed_start", "imposed_speed"))
"""Fields of a model that no operator depends on."""
_COMPARED: Final = (str, bytes, int, float, tuple, dict, BaseModel, MaxwellBranches)
"""Types of objects whose == tells whether they are equal."""


Made = TypeVar("Made")
Kept = dict[bytes, list[tuple[float, Any]]]
"""Operators of static problems by ``ModelClass.key``."""


@dataclass
class KeptOperators:
    """Bodies, models and propagators of the scene solved last (module docstring).

    Attributes
    ----------
    bodies : by substructure. models : first member of every class, before its propagator changes it. propagators : of
        the classes. made_with : scheme, step (s) and choices that the propagators were made with. compared : whether
        the scene is compared with that one, and never built: no classes are looked for, nothing is reduced.
    error_of_modes : ``TruncationError`` of the first run that the program has marched by the modes of its assembly,
        which is that of the runs that follow, too. modes_refused : why these are marched by their bodies.
    stress_modes : motions (n_full, 2) of the bodies whose stiffness the stress of t = 0 changed most and least in the
        first run, of unit elastic stiffness; None where that was not looked at.
    resultants_alone : whether a study reads the resultants of bonds alone, no tractions of their points.
    """

    bodies: dict[str, Body] = field(default_factory=dict)
    models: list[SubstructureModel] = field(default_factory=list)
    propagators: list[Propagator] = field(default_factory=list)
    made_with: tuple[Any, ...] = ()
    compared: bool = False
    error_of_modes: Any = None
    modes_refused: str = ""
    stress_modes: Array | None = None
    resultants_alone: bool = False
    _parts: dict[str, tuple[tuple[Any, ...], Any]] = field(default_factory=dict)

    def again(self, name: str, given: tuple[Any, ...], make: Callable[[], Made]) -> Made:
        """The part of this name of the scene solved last, where the same was ``given`` for it: objects of the scene or
        arrays that are equal, others that are the same. Else what ``make`` returns, kept for the next scene."""
        known = self._parts.get(name)
        if known is None or len(known[0]) != len(given) or not all(map(same, known[0], given)):
            self._parts[name] = known = given, make()
        part: Made = known[1]
        return part

    def beside(self, bodies: Mapping[str, Body]) -> KeptOperators:
        """Operators for a scene that is compared with that of these ``bodies``; those here stay as they are."""
        return KeptOperators(bodies={**bodies}, compared=True, _parts={**self._parts})

    def copy(self) -> KeptOperators:
        """Operators for a scene that is solved beside the one solved last; those here stay as they are."""
        return replace(self, bodies={**self.bodies}, _parts={**self._parts})

    def adopt(self, model: SubstructureModel) -> None:
        """Give a model the reduced matrices of one with equal matrices, where there is one."""
        known = self._like(model)
        if known is not None:
            share_operators(self.models[known], model)

    def twin(self, model: SubstructureModel, made_with: tuple[Any, ...]) -> Propagator | None:
        """Propagator with the operators of a model, made with the same scheme, step and choices; None where there is
        none."""
        known = self._like(model) if self.propagators and made_with == self.made_with else None
        if known is None:
            return None
        return self.propagators[known]

    def replace(
        self, models: Sequence[SubstructureModel], propagators: Sequence[Propagator], made_with: tuple[Any, ...]
    ) -> None:
        """Take the operators of the scene that is solved next in the place of the former ones."""
        self.models, self.propagators, self.made_with = list(models), list(propagators), made_with

    def _like(self, model: SubstructureModel) -> int | None:
        """Number of the class with the operators of a model; None where there is none."""
        return next((i for i, known in enumerate(self.models) if same_operators(known, model)), None)


def same_operators(first: SubstructureModel, second: SubstructureModel) -> bool:
    """Whether all matrices of two models are equal to the last bit."""
    return all(map(same, operator_parts(first), operator_parts(second)))


def operator_parts(model: SubstructureModel) -> list[Any]:
    """All of a model that its operators depend on."""
    return [getattr(model, f.name) for f in fields(SubstructureModel) if f.name not in _OWN]


def same(a: Any, b: Any) -> bool:
    """Whether two parts of a model are equal to the last bit; objects of other kinds where they are the same object."""
    if a is b:
        return True
    if isinstance(a, sp.csr_array) and isinstance(b, sp.csr_array):
        parts = ((a.indptr, b.indptr), (a.indices, b.indices), (a.data, b.data))
        return a.shape == b.shape and all(np.array_equal(x, y) for x, y in parts)
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, FaceStiffness) and isinstance(b, FaceStiffness):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(FaceStiffness))
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and isinstance(a, _COMPARED) and bool(a == b)


_RESOLVED = 0.7  # Courant number from which the force of a landing is resolved with mass on the contact nodes
_WITH_MASS = ("hht", "newmark")  # implicit schemes with mass on the contact nodes
_CLOSED = 1e-9  # gaps up to this share of the size of a body, approaches of its velocity: round-off of closed ones
_MASSLESS = 1.0  # largest one at which massless_contact keeps the energy (1.002 of it; 1.04 at 2, 1.5 at 4)
# a front: change of a load while a wave crosses this part of a body
_STEEP = 0.2
_PART = 0.05
_SAMPLES = 4097
# viscosity of elements at faces closed from the start over that of those that land: a front that crosses the joint
# loses 0.4 % of its energy in them (bars of 40 elements; 1.6 % with 1) with a peak 3 % above that of bonded bars (6 %
# with 0), and a clamped joint at rest stays quiet (with 0 its round-off grows by a half in 1e4 instants)
_AT_REST = 0.2
_THICK = 0.25  # of the elements of a body: more than that viscous, and waves that cross it lose energy
_TOUCH = f"touch a face that may open (generalized_alpha suits up to {100 * _THICK:.0f} %)"


@dataclass(frozen=True)
class ContactLayer:
    """What a time scheme changes at the faces of a body that may open.

    Attributes
    ----------
    mass : (n_full, n_full), kg. viscosity : of the landing, N s m-1, or None. loaded : mass of the mesh alone, on which
        body forces act, where it is not that of the shape. left : number of contact nodes that keep their mass for lack
        of an inner neighbour. lumped : (n_full,) masses of an explicit scheme where they are not row sums, kg, or None.
    """

    mass: sp.csr_array
    viscosity: sp.csr_array | None = None
    loaded: sp.csr_array | None = None
    left: int = 0
    lumped: Array | None = None


@dataclass(frozen=True)
class ModelClass:
    """Substructures that share their operators.

    Attributes
    ----------
    members : models with equal matrices and traces. channels : flat indices of theirs (n_channel, n_member).
    twin : number of an earlier class with the same operators, where there is one. key : equal for equal operators.
    """

    members: list[SubstructureModel]
    channels: Index
    twin: int | None = None
    key: bytes = b""


def store_of(scene: Scene) -> OperatorStore:
    """Where the operators of a scene are looked for, and kept."""
    table = scene.solver.operators
    if table is None:
        return NO_STORE
    return store_at((scene.base_dir / table.folder).absolute(), 1e9 * table.limit)


def contact_layers(
    bodies: Mapping[str, Body],
    units: list[InterfaceUnit],
    scheme: TimeScheme,
    dt: float,
    left_out: frozenset[str] = frozenset(),
) -> dict[str, ContactLayer]:
    """Masses of the elastic bodies, and the viscosities of their contact layers, as the scheme takes them with steps dt
    (s); none in statics, and none of the bodies ``left_out``.

    Raises
    ------
    SceneError : a contact node of ``massless_contact`` has no inner neighbour.
    """
    if isinstance(scheme, QuasiStatic):
        return {}
    landing = [u for u in _opening(units) if _lands(bodies, u)]
    elastic = {name: body for name, body in bodies.items() if not body.rigid and name not in left_out}
    return {name: _contact_layer(name, body, units, landing, scheme, dt) for name, body in elastic.items()}


def _contact_layer(
    name: str, body: Body, units: list[InterfaceUnit], landing: list[InterfaceUnit], scheme: TimeScheme, dt: float
) -> ContactLayer:
    """That of one elastic body; elements at interfaces that do not land are viscous by the share _AT_REST."""
    shape, material = body.shape, body.shape.fast_elasticity
    if not scheme.massless_contact:
        # every node keeps its mass
        return ContactLayer(body.mass, lumped=body.lumped_mass if scheme.explicit else None)
    share = scheme.consistent_share(material.bar_speed * dt / longest_edge(shape.mesh))
    mass = blended_mass(shape.mass, shape.lumped_mass, share)
    # nodes of a rigid face keep their mass: they move with it
    nodes = np.setdiff1d(_contact_nodes(name, units), body.rigid_nodes)
    q, blends = scheme.landing_damping, scheme.consistent_share(0.0) < 1.0
    own, left = without_contact_mass(mass, shape.mesh, nodes, several_layers=blends and q == 0.0)
    moved = own
    if body.added is not None:
        _check_arms(name, body.added, nodes)
        moved, _ = without_contact_mass(body.with_added(mass), shape.mesh, nodes, several_layers=blends and q == 0.0)
    if len(left) and not blends:
        raise SceneError.of(
            "the scene cannot be built",
            "time.scheme",
            f"massless_contact, substructure {name}: contact nodes without an inner neighbour",
            remedy="give it two elements between its contacts, or choose another scheme",
        )
    viscous = np.zeros(shape.mesh.n_node)
    # faces that stay closed are viscous a little, those that land fully
    viscous[nodes] = _AT_REST
    viscous[np.setdiff1d(_contact_nodes(name, landing), body.rigid_nodes)] = 1.0
    viscosity = landing_viscosity(shape.mesh, q * viscous, material, shape.bending_modes)
    return ContactLayer(moved, viscosity, own, len(left))


def _check_arms(name: str, added: AddedMass, nodes: Index) -> None:
    """Refuse a mass that follows a face by a rigid arm where nodes of the face have no mass."""
    if np.isin(added.arms, nodes).any():
        raise SceneError.of(
            "the scene cannot be built",
            "point_mass",
            f"substructure {name}: a mass with an arm or inertia on a face that may open, whose nodes have no mass "
            "with this time scheme",
            remedy='choose time.scheme = "hht", or spread the mass evenly: leave out its point and inertia',
        )


def _contact_nodes(name: str, units: list[InterfaceUnit]) -> Index:
    """Nodes of a substructure that take part in interfaces which may open."""
    opening = _opening(units)
    traces = [opening[i].geometry.traces[side] for i, side, owner in body_sides(opening) if owner == name]
    nodes = [np.asarray(trace.indices, dtype=np.int64) // 3 for trace in traces if trace is not None]
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *nodes]))


def _opening(units: list[InterfaceUnit]) -> list[InterfaceUnit]:
    """Interfaces that may open, without a layer of their own."""
    return [u for u in units if u.behaviour.opens and not u.behaviour.compliant]


def chosen_scheme(scene: Scene, bodies: dict[str, Body], units: list[InterfaceUnit]) -> tuple[TimeScheme, str]:
    """Time scheme of a scene, and why where it is chosen automatically.

    ``generalized_alpha`` where a body lands: an interface that may open has a gap, or sides that approach each other at
    t = 0. Not where a body is rigid (its contact points keep their mass, and would rebound), reduced (every node has
    mass), or so thin that its contact layer is more than a quarter of it: waves that cross a stack of such bodies lose
    energy in every one (stack of four bodies of four elements that lands: 79 % kept, HHT 94 %).

    Faces that are closed from the start are better off with HHT where the loads grow slowly (crushing of two specimens,
    L2 error of the force at 6 elements per edge: 0.7 %, against 1.7 %). A front makes them chatter with it (equal bars,
    80 elements: 21 % of the pressure after the exact separation), and not with ``generalized_alpha``
    (``examples/front_through_joint.py``).
    """
    given = scene.time.scheme
    if scene.time.quasi_static:
        return QuasiStatic(), ""
    if not isinstance(given, AutomaticScheme):
        return SCHEMES[given.type](**given.model_dump(exclude={"type"})), ""
    return _suited_scheme(scene, bodies, units)


def _suited_scheme(scene: Scene, bodies: Mapping[str, Body], units: list[InterfaceUnit]) -> tuple[TimeScheme, str]:
    """The automatic choice, and why."""
    opening = _opening(units)
    landing = [u for u in opening if _lands(bodies, u)]
    if landing or not opening:
        front = ""
    else:
        front = _front(scene, bodies, opening)
    if not landing and not front:
        return HHT(), "no body lands: no gap at a face that may open, no sides that approach each other, no front"
    if obstacle := _obstacle(scene, bodies, units)[0]:
        return HHT(), obstacle
    return GeneralizedAlpha(), f"bodies land: {', '.join(u.name for u in landing[:3])}" if landing else front


def _obstacle(scene: Scene, bodies: Mapping[str, Body], units: list[InterfaceUnit]) -> tuple[str, str]:
    """Why ``generalized_alpha`` does not suit the bodies of a scene, and what removes that; empty where it suits."""
    if isinstance(scene.solver.propagator, ModalPropagatorTable):
        return "the modes of the assembly have its whole mass", 'choose solver.propagator = "direct"'
    if isinstance(scene.solver.propagator, ReducedPropagatorTable):
        return "reduced bodies have mass at every node", 'choose solver.propagator = "direct"'
    for name in dict.fromkeys(name for _, _, name in body_sides(_opening(units))):
        body = bodies[name]
        if body.rigid:
            return f"substructure {name} is rigid", f"make substructure {name} elastic"
        share = layer_of(body.shape.mesh, _contact_nodes(name, units), body.shape.fast_elasticity)[1]
        if share > _THICK:
            now = f"{100 * share:.0f} %"
            why = f"substructure {name} is thin: {now} of its elements touch a face that may open"
            return why, f"refine the mesh of substructure {name}, {now} of whose elements {_TOUCH}"
    return "", ""


def _remedy(scene: Scene, bodies: Mapping[str, Body], units: list[InterfaceUnit], lands: bool) -> str:
    """The advice on a time scheme that does not suit: for landings generalized_alpha, after what is in its way,
    else the automatic choice."""
    if not lands:
        return f'choose time.scheme = "{_suited_scheme(scene, bodies, units)[0].name}"'
    first = _obstacle(scene, bodies, units)[1]
    chosen = 'choose time.scheme = "generalized_alpha" (--set time.scheme=generalized_alpha)'
    if first:
        return f"{first}, and then {chosen}"
    return chosen


def _front(scene: Scene, bodies: Mapping[str, Body], opening: list[InterfaceUnit]) -> str:
    """The load whose front crosses faces that may open, in words; empty where every load grows slowly: measured by the
    bodies and not by their meshes, so that a refined scene keeps its scheme."""
    crossing = np.inf  # time that a wave takes through a part of a body, the shortest
    for name in {name for _, _, name in body_sides(opening) if not bodies[name].rigid}:
        crossing = min(crossing, _PART * bodies[name].mesh.size / bodies[name].shape.fast_elasticity.bar_speed)
    static = scene.time.start.type == "static"
    # what moves a body as a whole acts in all points at once
    at_once = {load.name for load in scene.body_loads} - straining_loads(scene)
    for name, law in scene.force_laws.items():
        if name in at_once:
            continue
        if np.isfinite(crossing) and _steepest(law, scene.time.end, crossing, static) > _STEEP:
            return f"a front: load {name} changes by over {100 * _STEEP:.0f} % while a wave crosses {_PART:g} of a body"
    return ""


def _steepest(law: TimeLaw, end: float, within: float, static: bool) -> float:
    """Largest change of a law in a time ``within``, s, relative to its largest value; looked for closely where it
    changes most. ``static``: the motion starts from the equilibrium under its first value."""
    first = 0.0
    last = end
    largest = 0.0
    jump = 0.0
    while True:
        times = np.linspace(first, last, _SAMPLES)
        values = law.sample(times)
        if largest == 0.0:
            largest, jump = float(np.abs(values).max()), 0.0 if static else abs(float(values[0]))
        if largest == 0.0:
            return 0.0
        # shorter than a sample: once more, between the two samples with the largest change
        width = int(within / (times[1] - times[0]))
        if width > 0:
            width = min(width, _SAMPLES - 1)
            return max(jump, float(np.abs(values[width:] - values[:-width]).max())) / largest
        # the next round takes the span between two samples
        at = int(np.abs(np.diff(values)).argmax())
        first, last = times[at], times[at + 1]


def scheme_remarks(
    scene: Scene,
    bodies: dict[str, Body],
    units: list[InterfaceUnit],
    scheme: TimeScheme,
    dt: float,
    layers: Mapping[str, ContactLayer],
) -> list[str]:
    """Sentences on a time scheme that does not suit the contacts of a scene, with steps dt (s); ``layers`` :
    ``contact_layers`` of the bodies.

    Bodies land where an interface that may open has a gap, or sides that move relative to each other along N at t = 0.
    The Courant number is that of the elements at their contact faces.
    """
    opening = _opening(units)
    if not opening or isinstance(scheme, QuasiStatic):
        return []
    landing = {name for u in opening if _lands(bodies, u) for _, _, name in body_sides([u])}
    fit = partial(_unfit, scene, bodies, units, scheme)
    # no body lands, and nothing is viscous: the elements at contacts do not matter
    if not landing and not scheme.massless_contact and scheme.landing_damping == 0.0:
        return fit({}, landing)
    courant, remarks = {}, []
    for name, body in bodies.items():
        if body.rigid:
            nodes = np.zeros(0, dtype=np.int64)
        else:
            nodes = _contact_nodes(name, units)
        if not len(nodes):
            continue
        crossing, share = layer_of(body.shape.mesh, nodes, body.shape.fast_elasticity)
        if crossing > 0.0:
            courant[name] = dt / crossing
        if scheme.landing_damping > 0.0 and name in landing and share > _THICK:
            remarks.append(
                f"substructure {name}: {100 * share:.0f} % of its elements {_TOUCH}; their viscosity damps waves "
                f"(landing_damping = {scheme.landing_damping:g}): refine its mesh, or set landing_damping = 0"
            )
        if scheme.massless_contact:
            layer = layers[name]
            if layer.left:
                remarks.append(
                    f"substructure {name}: {layer.left} contact nodes have no inner neighbour (one element between two "
                    "contacts) and keep their mass: their contact force is less smooth; give it two elements there"
                )
    return [*fit(courant, landing), *remarks]


def landing_choice(scene: Scene, bodies: Mapping[str, Body], units: list[InterfaceUnit]) -> tuple[list[str], str]:
    """Interfaces for whose landings the automatic scheme was chosen, none where it was not, and the name of the scheme
    that is chosen where these are closed."""
    if not isinstance(scene.time.scheme, AutomaticScheme) or scene.time.quasi_static:
        return [], ""
    opening = _opening(units)
    landing = [unit.name for unit in opening if _lands(bodies, unit)]
    if not landing or _obstacle(scene, bodies, units)[0]:
        return [], ""
    return landing, (GeneralizedAlpha if _front(scene, bodies, opening) else HHT)().name


def unforeseen_landings(
    scene: Scene, bodies: Mapping[str, Body], units: list[InterfaceUnit], scheme: TimeScheme, dt: float
) -> dict[str, str]:
    """By interface that no body lands on at the start, and whose faces the step dt (s) is too short for with this
    scheme: what to say where it closes by an impact during the run."""
    waiting = [u for u in _opening(units) if not _lands(bodies, u)] if scheme.name in _WITH_MASS else []
    made = dict[str, str]()
    crossing = dict[str, float]()
    remedy = ""
    for unit in waiting:
        for name in {name for _, _, name in body_sides([unit]) if not bodies[name].rigid} - crossing.keys():
            body = bodies[name]
            crossing[name] = layer_of(body.shape.mesh, _contact_nodes(name, units), body.shape.fast_elasticity)[0]
        own = [dt / crossing[name] for _, _, name in body_sides([unit]) if crossing.get(name, 0.0) > 0.0]
        if min(own, default=np.inf) < _RESOLVED:
            remedy = remedy or _remedy(scene, bodies, units, lands=True)
            made[unit.name] = f"time.scheme {scheme.name} {_of_landings(min(own))} {remedy}"
    return made


def _lands(bodies: Mapping[str, Body], unit: InterfaceUnit) -> bool:
    """Whether the sides of an interface meet during the motion."""
    if unit.geometry.gap.max(initial=0.0) > _CLOSED * max(bodies[name].mesh.size for _, _, name in body_sides([unit])):
        return True
    return approaches(bodies, unit)


def approaches(bodies: Mapping[str, Body], unit: InterfaceUnit) -> bool:
    """Whether the sides of an interface approach each other along N at t = 0."""
    speeds, largest = np.zeros((unit.geometry.n_point, 3)), 0.0
    for _, side, name in body_sides([unit]):
        trace = unit.geometry.traces[side]
        if trace is not None:
            own = (trace @ bodies[name].initial_velocity()).reshape(-1, 3)
            # E less E': closing where it is along N
            speeds, largest = speeds + (1 - 2 * side) * own, max(largest, float(np.abs(own).max(initial=0.0)))
    closing = np.einsum("pi,pi->p", speeds, unit.geometry.frames[:, 0])
    return bool((closing > _CLOSED * largest).any())


def _unfit(
    scene: Scene,
    bodies: Mapping[str, Body],
    units: list[InterfaceUnit],
    scheme: TimeScheme,
    courant: Mapping[str, float],
    landing: set[str],
) -> list[str]:
    """A sentence where the scheme gains energy, or makes the force of a landing depend on the step."""
    largest = max(courant.values(), default=0.0)
    # gamma = 1/2 undamped: velocity_gain(1) is gamma
    if scheme.name == "newmark" and scheme.force_weight == 1.0 and scheme.velocity_gain(1.0) == 0.5:
        remedy = _remedy(scene, bodies, units, bool(landing))
        return [f"time.scheme newmark with gamma = 0.5 gains energy at contacts that open and close: {remedy}"]
    if scheme.name == "massless_contact" and largest > _MASSLESS:
        return [
            f"time.scheme massless_contact at Courant number {largest:.2g} of the contact faces (stable up to "
            f"{_MASSLESS:g}): it gains energy at impacts: "
            f"{_remedy(scene, bodies, units, bool(landing))}, or use smaller steps"
        ]
    # the smallest: the peak of a landing grows as the step shrinks
    lowest = min((c for n, c in courant.items() if n in landing), default=np.inf)
    if scheme.name in _WITH_MASS and lowest < _RESOLVED:
        return [f"time.scheme {scheme.name} {_of_landings(lowest)} {_remedy(scene, bodies, units, lands=True)}"]
    return []


def _of_landings(courant: float) -> str:
    """What a scheme with mass on the contact nodes does to a landing, up to the remedy."""
    return (
        f"at Courant number {courant:.2g} of a face that lands (suited from {_RESOLVED:g} on): the first contact force "
        "is the momentum of a layer of nodes over one step, and grows without limit as the step shrinks, and "
        "accelerations with it; impulses are correct. For force and accelerations"
    )


def load_terms(
    scene: Scene, name: str, body: Body, layer: ContactLayer | None, straining: bool = True
) -> list[LoadTerm]:
    """Loads of a scene on the nodes of a body; ``layer`` : the mass that body forces act with. ``straining`` : with
    loads that move no free body."""
    # of this scene: that of a static start has other forces on the same bodies
    described, loaded_body = scene.substructure[name], BodyVolume(body, layer)
    terms = [
        LoadTerm(load.name, load.nodal_forces(loaded_body))
        for load in scene.body_loads
        if load.acts_on(name, described) and (straining or not load.kind.strains)
    ]
    for load_name, load in scene.loads.items():
        if split_face(load.face)[0] != name:
            continue
        loaded = BodyFace.of({name: body}, load.face)
        pattern = np.zeros((body.mesh.n_node, 3))
        pattern[loaded.face.nodes] = load.nodal_forces(loaded)
        terms.append(LoadTerm(load_name, pattern.ravel()))
    return terms


@dataclass(frozen=True)
class BodyVolume:
    """A body with what loads of its whole volume need, `scene.body_loads.LoadedBody`.

    Attributes
    ----------
    layer : the mass that they act with; that of the mesh, and added ones, where None.
    """

    body: Body
    layer: ContactLayer | None = None

    @property
    def size(self) -> float:
        """Length of the body, m."""
        return self.body.mesh.size

    @property
    def places(self) -> Array:
        """Nodes (n_node, 3), m."""
        return self.body.mesh.nodes

    @property
    def density(self) -> float:
        """Mass per volume, kg m-3."""
        return self.body.shape.material.density

    @property
    def stress_per_kelvin(self) -> tuple[float, float]:
        """Largest expansion, K-1, and Young's modulus, Pa."""
        material = self.body.shape.elasticity
        return max(map(abs, material.expansions)), material.young_moduli[1]

    def volume_forces(self, per_volume: Sequence[float]) -> Array:
        """Nodal forces (3 n_node,) of a force per volume, N m-3, where the mass of the mesh is: a free body is not
        strained."""
        force, layer, shape = np.asarray(per_volume), self.layer, self.body.shape
        acceleration = np.tile(force / shape.material.density, self.body.mesh.n_node)
        if layer is not None and layer.loaded is not None:
            return np.asarray(layer.loaded @ acceleration)
        if layer is not None and layer.lumped is not None and shape.lumped_mass is not None:
            return np.asarray(shape.lumped_mass * acceleration)
        return shape.body_load(force)

    def weight(self, acceleration: Sequence[float] | Array) -> Array:
        """Nodal forces (3 n_node,) of an acceleration (3,) or (n_node, 3), m s-2, on all the mass of the body, N."""
        layer, body = self.layer, self.body
        everywhere = np.broadcast_to(acceleration, (body.mesh.n_node, 3)).ravel()
        if layer is not None:
            return np.asarray(layer.mass @ everywhere if layer.lumped is None else layer.lumped * everywhere)
        own = body.shape.body_load(body.shape.material.density * np.asarray(acceleration))
        if body.added is None:
            return own
        return np.asarray(own + body.added.matrix @ everywhere)

    def expansion(self, change: float) -> Array:
        """Nodal forces (3 n_node,) that strain the free body by a change of temperature, K; N."""
        return np.asarray(change * self.body.shape.thermal_load)
