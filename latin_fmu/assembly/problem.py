"""The discretised problem of a scene, and the solver-ready problem with its operators."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import Final

import numpy as np
import scipy.sparse as sp

from ..fem.mesh import padded_cells
from ..latin.assembly import Array, Assembly, Index, InterfaceUnit, Layout
from ..latin.probes import OutputRequest, SensorPlace
from ..latin.recorder import Recorder, SubstructureInfo
from ..latin.search_direction import inertial_impedance, unresolved_sides
from ..latin.settings import SearchDirection, SolverSettings
from ..laws.maxwell_joint import MaxwellJoint
from ..propagator import LoadTerm, SubstructureModel
from ..propagator.interface_probing import SHARE
from ..propagator.model import diagonal_matrix, share_patterns
from ..remarks import Remark, remarks_of
from ..results.dataset import Recovered
from ..scene.boundaries import Driven
from ..scene.fields import split_face
from ..scene.laws import InputLaw, TimeLaw
from ..scene.schema import Scene
from ..scene.settings import WHOLE, AndersonTable, Uniform
from ..scene.substructures import Temperature
from ..scene.units import SI, UnitSystem
from ..time_scheme import QuasiStatic, TimeScheme, joint_weights
from .body import Body, body_sides, branches_of, flexibility, side_impedance, side_stiffness
from .bolts import BoltCut, Clamp, OpenedMesh, OpenedStress
from .conditions import Conditions, RigidConditions, rigid_model, total
from .initial_state import InitialState, TightBolts, field_tractions
from .loaded_faces import BodyFace
from .models import (
    BodyVolume,
    ContactLayer,
    Kept,
    KeptOperators,
    ModelClass,
    chosen_scheme,
    contact_layers,
    landing_choice,
    load_terms,
    store_of,
    unforeseen_landings,
)
from .node_marks import node_marks
from .press_fits import fit_pressures, fits
from .prestress import Prestress
from .propagator_choice import divided, made_propagators
from .rigid_landings import rigid_impacts
from .start_contacts import lifted, open_points, scheme_remarks_at_start, start_contacts
from .supports import PrescribedMotion, port_motions, port_supports, supports
from .timeline import NO_RAMPS, Timeline
from .untouched import Untouched
from .wave_pace import resolution_remarks, waves_count
from .whole_march import GroupedMarch, WholeMarch

REST = 1e-2
"""Tractions below this share of tolerance x characteristic traction leave a substructure at rest inactive."""
ROUND_OFF = 1e-13
"""The same as a share of the characteristic traction, where rounding errors alone are to be ignored."""
NO_BOLTS: Final[Mapping[str, BoltCut]] = MappingProxyType({})


@dataclass(frozen=True)
class SolverReadyProblem:
    """A scene turned into operators, ready to run.

    The assembly stands at t = 0 with the instants of the scene; ``timeline`` can give it others. ``start`` is the
    equilibrium that the motion starts from, None where there is none; ``recovered`` finds more fields of the
    substructures from what is kept.
    """

    assembly: Assembly
    settings: SolverSettings
    output: OutputRequest
    info: dict[str, SubstructureInfo]
    warnings: tuple[Remark, ...]
    timeline: Timeline
    start: InitialState | None = None
    recovered: Mapping[str, Recovered] = field(default_factory=dict)
    scheme: str = ""
    """Time scheme, and why it was chosen."""
    unit_system: UnitSystem = SI
    clamps: Sequence[Clamp] = ()
    """Where the bolts clamp."""
    flexibility: Mapping[str, float] = field(default_factory=dict)
    """Elastic approach of both bodies under a mean pressure, by interface, m Pa-1."""
    untouched: Untouched | None = None
    """What is left out of the run, None where nothing is."""
    unforeseen: Mapping[str, str] = field(default_factory=dict)
    """By interface: what an impact means that the time scheme was not chosen for (``models.unforeseen_landings``)."""
    reduced: WholeMarch | None = None
    """The whole assembly, which is marched in the place of its bodies; None where these are."""
    grouped: GroupedMarch | None = None
    """The assembly that is marched where bonded bodies are one substructure; None where none are."""
    prestress: Prestress | None = None
    """Stiffness of the stress of t = 0; None where there is none."""
    bonds: str = ""
    """Why bonds are iterated although nothing is said about them; empty where they are not, or where there are none."""

    @property
    def marched(self) -> Assembly:
        """What is marched: the bodies, groups of bonded ones, or the whole assembly as one substructure."""
        if self.reduced is not None:
            return self.reduced.assembly
        if self.grouped is not None:
            return self.grouped.assembly
        return self.assembly

    def recorder(self) -> Recorder:
        """One that keeps what the scene asks for, in memory."""
        return Recorder(self.assembly, self.output, self.info)

    @property
    def choices(self) -> dict[str, str]:
        """Automatic choices, in words."""
        start = {} if self.start is None else {"start": self.start.message}
        stores = {id(p.members[0].store): p.members[0].store for p in self.assembly.propagators}
        kept = "; ".join(filter(None, (store.remark() for store in stores.values())))
        out = {} if self.reduced is None else {"propagator": self.reduced.in_words}
        words = self.bonds if self.grouped is None else self.grouped.in_words
        out |= {"bonds": words} if words else {}
        out |= {"prestress": self.prestress.words} if self.prestress is not None else {}
        out |= {} if self.untouched is None else {"left out, never touched": ", ".join(self.untouched.info)}
        return {"time scheme": self.scheme, **start, **out, **({"operators": kept} if kept else {})}


About = tuple[tuple[Remark, ...], Timeline, InitialState | None, str, Mapping[str, str]]
"""What is said of a problem that is ready: remarks, histories, start, time scheme, landings that it was not chosen
for."""


@dataclass(frozen=True)
class DiscretisedProblem:
    """Meshes, matrices and interfaces of a scene; nothing is factorised yet."""

    scene: Scene
    bodies: dict[str, Body]
    conditions: dict[str, Conditions]
    units: list[InterfaceUnit]
    layout: Layout
    classes: list[ModelClass]
    scheme: TimeScheme
    time: Array
    remarks: tuple[Remark, ...] = ()
    files: tuple[str, ...] = ()
    """A line on each mesh file that was read."""
    sensors: Mapping[str, SensorPlace] = field(default_factory=dict)
    scheme_reason: str = ""
    cuts: Mapping[str, BoltCut] = field(default_factory=dict)
    ramps: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """First and last amplitude of the load terms of the bolts while they are tightened."""
    layers: Mapping[str, ContactLayer] = field(default_factory=dict)
    """Contact layers of the elastic bodies (``models.contact_layers``)."""
    kept: KeptOperators | None = None
    """Operators of a scene solved before, replaced by those of this one."""
    untouched: Untouched | None = None
    """Bodies of the scene that are left out of this problem, None where none are."""
    elongation: Mapping[str, Array] = field(default_factory=dict)
    """Plastic elongation (n_time,) of the bolts that may yield, m (``yielding_bolts.Yielding``)."""
    histories: Mapping[str, Array] = field(default_factory=dict)
    """(n_time,) of load terms of the classes that no law of the scene has."""
    prestress: Prestress | None = None
    """Geometric stiffness of the bodies, which their classes have; None where there is none."""

    @staticmethod
    def of(
        scene: Scene,
        bodies: dict[str, Body],
        conditions: dict[str, Conditions],
        units: list[InterfaceUnit],
        cuts: Mapping[str, BoltCut] = NO_BOLTS,
        kept: KeptOperators | None = None,
        names: frozenset[str] = frozenset(),
    ) -> DiscretisedProblem:
        """The problem with the time scheme and instants of the scene, without classes (``with_classes``).

        cuts : of the bolts. kept : operators of a scene solved before. names : of the bodies to be left out: the scheme
        and the contact layers of the others are those with all bodies.
        """
        scheme, reason = chosen_scheme(scene, bodies, units)
        time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
        dt = float(time[1] - time[0])
        units = [_in_step(unit, scheme, dt) for unit in units]
        left, untouched = {name: body for name, body in bodies.items() if name not in names}, None
        layers = contact_layers(bodies, units, scheme, dt, names)
        if names:
            untouched = Untouched.of(bodies, units, names)
            units = [unit for unit in units if not any(owner in names for _, _, owner in body_sides([unit]))]
        layout = Layout(units)
        made = DiscretisedProblem(scene, left, conditions, units, layout, [], scheme, time, scheme_reason=reason)
        return replace(made, cuts=cuts, layers=layers, kept=kept, untouched=untouched)

    def with_classes(self, moved: Mapping[str, ContactLayer] | None = None) -> DiscretisedProblem:
        """The problem with its classes of identical substructures; ``moved`` : contact layers of the body forces where
        they are others (static start)."""
        return replace(self, classes=_model_classes(self, moved))

    @property
    def scheme_in_words(self) -> str:
        """Name of the time scheme, and why where it is chosen automatically."""
        return self.scheme.name + (f" ({self.scheme_reason})" if self.scheme_reason else "")

    @property
    def dt(self) -> float:
        """Length of a time step, s."""
        return float(self.time[1] - self.time[0])

    @property
    def info(self) -> dict[str, SubstructureInfo]:
        """Meshes for the recorder."""
        return self.info_of({})

    def info_of(self, shortening: Mapping[str, float]) -> dict[str, SubstructureInfo]:
        """Meshes for the recorder; ``shortening`` of the bolts, m."""
        stress, made = self.scene.output.stress, {}
        marks = node_marks(self.scene, self.bodies, self.units) if self.scene.output.keeps_fields else {}
        for n, b in self.bodies.items():
            limit = None if b.rigid else b.shape.material.yield_stress
            wanted = stress or limit is not None
            opened = self.opened(n, shortening) if wanted else None
            recover = None if opened is None else OpenedStress(opened, b.shape)
            plain = b.shape.stress if wanted and not b.rigid else None
            cells, types = padded_cells(b.mesh.blocks), " ".join(b.mesh.cell_types)
            unstrained = self.unstrained(b, wanted)
            made[n] = SubstructureInfo(b.mesh.nodes, cells, types, recover or plain, unstrained, limit, marks.get(n))
        return made

    def unstrained(self, body: Body, yielding: bool = False) -> Callable[[Array], Array] | None:
        """Part (n_time, n_cell or 1, 6) of the stress at instants (n_time,) that the displacements do not make, Pa, by
        temperatures and, where ``yielding``, in the elements, by plastic elongations of bolts; None without these."""
        acting, elongated = tuple(self.scene.temperatures_of(body.name).values()), list[tuple[Array, Array]]()
        for name, q in self.elongation.items() if yielding else ():
            if self.cuts[name].table.substructure == body.name:
                opened = self.opened(body.name, {name: 1.0})
                assert opened is not None
                one = OpenedStress(opened, body.shape)(np.zeros((body.mesh.n_node, 3)))
                elongated.append((q, one))
        if not (acting or elongated):
            return None
        thermal, moduli = body.shape.elasticity.thermal_stress, body.shape.moduli
        thermal = thermal if moduli is None else moduli[:, None] * thermal
        return partial(_unstrained, thermal, acting, self.time, elongated)

    def recovered_of(self, shortening: Mapping[str, float]) -> dict[str, Recovered]:
        """Recovery of further fields of the elastic substructures, where the scene requests them; ``shortening`` of the
        bolts, m."""
        output = self.scene.output
        if not output.recovers:
            return {}
        fields, made = (output.strain, output.nodal_stress, output.principal_stress), {}
        for n, b in self.bodies.items():
            if not b.rigid:
                opened = self.opened(n, shortening)
                recovery = b.shape.recovery if opened is None else opened.recovery(b.shape)
                made[n] = Recovered(recovery, *fields, self.unstrained(b))
        return made

    def timeline_with(self, bolts: TightBolts) -> Timeline:
        """Histories with the bolts as tightened, or while they are."""
        ramps = self.ramps or (bolts.locked(self.cuts) if self.cuts else NO_RAMPS)
        return Timeline(self.scene, self.conditions, ramps, self.elongation, self.histories)

    def opened(self, name: str, shortening: Mapping[str, float]) -> OpenedMesh | None:
        """Mesh of a substructure with the cuts of its bolts open; None where it has none."""
        own = [cut for cut in self.cuts.values() if cut.table.substructure == name]
        return OpenedMesh(self.bodies[name].mesh, own, shortening) if own else None

    @property
    def timeline(self) -> Timeline:
        """Histories of the loads and motions of the substructures, bolts that are not being tightened left out."""
        return self.timeline_with(TightBolts())

    @cached_property
    def impedance(self) -> Array:
        """Impedance, in statics stiffness, of the side of every channel (see ``Assembly``)."""
        side = side_stiffness if isinstance(self.scheme, QuasiStatic) else side_impedance
        return side(self.bodies, self.units, self.layout)

    @cached_property
    def characteristic_traction(self) -> float:
        """Largest traction that loads, motions and bolts can cause, Pa."""
        size = static_traction if isinstance(self.scheme, QuasiStatic) else characteristic_traction
        stresses = [cut.stress(self.bodies[cut.table.substructure]) for cut in self.cuts.values()]
        approach = flexibility(self.bodies, self.units, self.layout) if fits(self.units) else {}
        pressed = fit_pressures(self.units, approach)
        return max(size(self.scene, self.bodies, self.time), *stresses, *pressed, 0.0)

    def build(
        self, start: InitialState | None = None, kept: Kept | None = None, processes: int = 1
    ) -> SolverReadyProblem:
        """Factorise and condense the substructures.

        start : initial state in the place of that of the scene. kept : operators of static problems by
        ``ModelClass.key``, which are used again and added to. processes : among which the substructures are divided.
        """
        layout = self.layout if start is None else Layout(self.units)  # ``start`` changes its gaps
        classes = self.classes if start is None else start.displaced(self.classes)
        classes, *distribution = divided(self.scene, classes, processes)
        assembly, without_factor = self.assembled(classes, self.units, layout, self.impedance.copy(), kept)
        assembly.owner, assembly.part_of = distribution
        if start is not None:
            start.hand_over(assembly)
        timeline = self.timeline_with(TightBolts() if start is None else start.bolts)
        timeline.begin(assembly, self.time, {}, assembly.ground.start)
        return ready(self, assembly, self.about(assembly, start, timeline, without_factor))

    def assembled(
        self,
        classes: list[ModelClass],
        units: list[InterfaceUnit],
        layout: Layout,
        impedance: Array,
        kept: Kept | None = None,
    ) -> tuple[Assembly, list[str]]:
        """Substructures with their operators, and interfaces, joined; remarks on the choice of propagators."""
        scene, scheme = self.scene, self.scheme
        operators = self.kept if kept is None else None
        propagators, without_factor = made_propagators(scene, classes, scheme, self.dt, impedance, operators, kept)
        channels, traction = [c.channels for c in classes], self.characteristic_traction
        assembly = Assembly(propagators, channels, units, layout, impedance, traction, scheme)
        # in shares of the largest traction that loads can bring; below 0: no class rests
        levels = {"off": -1.0, "exact": 0.0, "round_off": ROUND_OFF, "tolerance": REST * scene.solver.tolerance}
        level = levels[scene.solver.skip_at_rest]
        # 0 and -1 are no tractions
        assembly.rest_traction = level * (assembly.characteristic_traction if level > 0 else 1.0)
        return assembly, without_factor

    def about(
        self, assembly: Assembly, start: InitialState | None, timeline: Timeline, without_factor: Sequence[str]
    ) -> About:
        """What ``ready`` says of an assembly that has begun; its rigid bodies get their impedances."""
        static = assembly.quasi_static
        # they have no material impedance: that of their inertia in a step
        if not static and any(body.rigid for body in self.bodies.values()):
            inertial_impedance(assembly)
        # one line on waves: where the step is far off for all bodies, that says what to change
        known = any(remark.code == "step" for remark in self.remarks)
        counts = not known and waves_count(self.scene, self.bodies, self.units, self.time)
        unresolved = resolution_remarks(unresolved_sides(assembly) if counts else [])
        warnings = (*self.remarks, *remarks_of("memory", without_factor), *unresolved)
        warnings += () if start is None else tuple(remarks_of("start", start.remarks))
        words, against, unforeseen = _checked_scheme(self, None if static else start)
        unforeseen |= rigid_impacts(self.scene, self.bodies, self.units)
        return (*warnings, *remarks_of("scheme", against)), timeline, start, words, unforeseen

    def output(self, bolts: TightBolts) -> OutputRequest:
        """What the recorder keeps; ``bolts`` as tightened."""
        keys = self.scene.output
        models = {m.name: m for c in self.classes for m in c.members}
        supported = supports(self.scene.boundary, self.bodies, models) if keys.reactions else {}
        if self.scene.port:
            supported |= port_supports(self.scene, self.bodies, models)
        heats = {name: self.scene.temperatures_of(cut.table.substructure) for name, cut in self.cuts.items()}
        changes = {name: {load: t.change for load, t in acting.items()} for name, acting in heats.items()}
        return OutputRequest(
            keys.keeps_fields,
            keys.stress,
            keys.energy,
            keys.every,
            self.sensors,
            keys.peak_duration,
            keys.interfaces_every,
            supported,
            bolts.places(self.cuts, changes, self.elongation) if self.cuts and not self.ramps else {},
            {} if self.untouched is None else self.untouched.faces,
            contacts_alone=self.kept is not None and self.kept.resultants_alone,
            bond_resultants=True,
        )


def ready(
    problem: DiscretisedProblem,
    assembly: Assembly,
    about: About,
    reduced: WholeMarch | None = None,
    grouped: GroupedMarch | None = None,
) -> SolverReadyProblem:
    """The problem with its operators."""
    warnings, timeline, start, words, unforeseen = about
    bolts = TightBolts() if start is None else start.bolts
    nodes = {name: body.mesh.nodes for name, body in problem.bodies.items()}
    return SolverReadyProblem(
        assembly,
        settings_of(problem.scene),
        problem.output(bolts),
        problem.info_of(bolts.shortening),
        warnings,
        timeline,
        start,
        problem.recovered_of(bolts.shortening),
        words,
        problem.scene.unit_system,
        [cut.clamp(nodes[cut.table.substructure], bolts.shortening.get(n, 0.0)) for n, cut in problem.cuts.items()],
        flexibility(problem.bodies, problem.units, assembly.layout),
        problem.untouched,
        unforeseen,
        reduced,
        grouped,
        problem.prestress,
    )


def _in_step(unit: InterfaceUnit, scheme: TimeScheme, dt: float) -> InterfaceUnit:
    """The interface in the march of a scheme, on which the stiffness of Maxwell joints over a step depends."""
    if not isinstance(unit.behaviour, MaxwellJoint):
        return unit
    share = joint_weights(scheme, dt, np.array([unit.behaviour.relaxation_time]))[0, 1]
    return replace(unit, behaviour=unit.behaviour.in_step(float(share)))


def _checked_scheme(problem: DiscretisedProblem, start: InitialState | None) -> tuple[str, list[str], dict[str, str]]:
    """The time scheme of a motion in words, remarks where the equilibrium that it starts from speaks against it, and
    what landings mean that it was not chosen for, by interface (``models.unforeseen_landings``)."""
    scene, words = problem.scene, problem.scheme_in_words
    unforeseen = unforeseen_landings(scene, problem.bodies, problem.units, problem.scheme, problem.dt)
    if start is None:
        return words, [], unforeseen
    models = {member.name: member for c in problem.classes for member in c.members}
    contacts = start_contacts(problem.units, models, start)
    if problem.scheme_reason and (opened := open_points(contacts, scene.unit_system)):
        words = f"{words.removesuffix(')')}; {opened})"
    landing, suited = landing_choice(scene, problem.bodies, problem.units)
    chosen = problem.scheme.name, suited
    against = list(scheme_remarks_at_start(contacts, unforeseen, landing, chosen, scene.unit_system))
    # said of those that are open already
    return words, against, {name: text for name, text in unforeseen.items() if name not in lifted(contacts)}


def _unstrained(
    per_kelvin: Array,
    acting: Sequence[Temperature],
    grid: Array,
    elongations: Sequence[tuple[Array, Array]],
    times: Array,
) -> Array:
    """Stress (n_time, n_cell or 1, 6), Pa, of hindered expansion and of shanks that are shortened less. elongations :
    plastic (n_grid,), m, with the stress of the elements (n_cell, 6) under a shortening of 1."""
    rise = sum((t.change * t.law.sample(times) for t in acting), np.zeros(len(times)))
    stress = -rise[:, None, None] * per_kelvin
    for q, one in elongations:
        stress = stress - np.interp(times, grid, q)[:, None, None] * one
    return np.asarray(stress)


def _model_classes(problem: DiscretisedProblem, moved: Mapping[str, ContactLayer] | None) -> list[ModelClass]:
    """Matrices of every substructure, grouped into classes of identical ones (of one each where the scene requests it).

    moved : contact layers of the body forces where they are not those of the problem (static start).
    """
    scene = problem.scene
    classes: dict[bytes, list[tuple[SubstructureModel, Index]]] = {}
    store, compared = store_of(scene), problem.kept is not None and problem.kept.compared
    for name, body in problem.bodies.items():
        loading = (problem.layers if moved is None else moved).get(name)
        loads = load_terms(scene, name, body, loading)
        own = [cut for cut in problem.cuts.values() if cut.table.substructure == name]
        loads += [cut.loads() for cut in own]
        # before the key: the store is no part of it
        model, channels = _model(problem, name, loads)
        model = replace(model, store=store)
        key = _signature(model, body) if scene.solver.share_identical and not compared else name.encode()
        key += _dashpots_key(scene, name)
        if problem.prestress is not None and name in problem.prestress.stiffness:
            key += hashlib.sha256(problem.prestress.stiffness[name].data.tobytes()).digest()
        if loose := [cut for cut in own if cut.loose]:
            model, key = _loosened(model, loose), key + b"".join(cut.pattern.tobytes() for cut in loose)
        # shape of the cut: bodies that are else alike have stiffnesses of their own
        classes.setdefault(key, []).append((model, channels))
    if compared:
        return [ModelClass([m], channels[:, None]) for ((m, channels),) in classes.values()]
    groups = []
    for key, members in classes.items():
        models = [m for m, _ in members]
        if problem.kept is not None:
            problem.kept.adopt(models[0])
        # with the matrices: no part of the factorisation
        _ = models[0].reduced_stiffness if models[0].mass is None else models[0].reduced
        groups.append(ModelClass(models, np.stack([c for _, c in members], axis=1), key=key))
    share_patterns([c.members[0] for c in groups if c.members[0].mass is not None])
    return groups


def _model(problem: DiscretisedProblem, name: str, loads: list[LoadTerm]) -> tuple[SubstructureModel, Index]:
    """Model of a substructure and the flat indices of its channels (n_channel,)."""
    body = problem.bodies[name]
    held = problem.conditions[name]
    scheme = problem.scheme
    units = problem.units
    layout = problem.layout
    layer = problem.layers.get(name)
    areas = []
    preloads = []
    channels = []
    own = [(i, side) for i, side, owner in body_sides(units) if owner == name]
    for i, side in own:
        unit, n_component = units[i], units[i].behaviour.n_component
        areas.append(np.repeat(unit.geometry.areas, n_component))
        pressed = np.zeros((unit.geometry.n_point, n_component))
        # F.N = -P on side E
        pressed[:, 0] = unit.preload * (-1.0 if side == 0 else 1.0)
        preloads.append(pressed.ravel())
        channels.append(layout.channels(i, side).ravel())
    known, sides = KeptOperators() if problem.kept is None else problem.kept, [(units[i], side) for i, side in own]
    # what the traces in the local frames follow from
    given = [x for u, s in sides for x in (u.geometry.traces[s], u.geometry.frames, u.behaviour.n_component)]
    trace = known.again(f"trace {name}", (body, *given), lambda: _trace(body, sides))
    area = np.concatenate(areas) if areas else np.zeros(0)
    if any(p.any() for p in preloads):  # the initial stress is in equilibrium: it holds the preload
        # the load that holds the preload: opposite to it
        balance = np.asarray(-(trace.T @ (area * np.concatenate(preloads))))
        loads.append(LoadTerm("", balance))
    flat = np.concatenate(channels) if channels else np.zeros(0, dtype=np.int64)
    if isinstance(held, RigidConditions):
        rigid = _stressed(problem, rigid_model(body, held, trace, area, loads))
        return (replace(rigid, mass=None) if isinstance(scheme, QuasiStatic) else rigid), flat
    modal = body.description.modal_damping
    model = SubstructureModel(
        name=name,
        mass=None if layer is None else layer.mass,
        damping=_damping(body, held, layer),
        stiffness=body.shape.stiffness,
        expansion=held.expansion,
        trace=trace,
        channel_area=area,
        loads=loads,
        displacement=body.initial_displacement(),
        velocity=body.initial_velocity(),
        imposed_pattern=held.pattern,
        imposed_start=held.start(),
        imposed_speed=held.speeds(),
        ordering=body.shape.rank[0],
        parts=body.shape.rank[1],
        positions=body.mesh.nodes,
        lumped_mass=body.lumped_mass if scheme.explicit else None,
        lumped_damping=_lumped_damping(body, held) if scheme.explicit else None,
        landing=None if layer is None else layer.viscosity,
        branches=branches_of(body.shape.material),
        modal=None if modal is None else (modal.ratio, modal.below or np.inf),
    )
    return _stressed(problem, model), flat


def _stressed(problem: DiscretisedProblem, model: SubstructureModel) -> SubstructureModel:
    """The model with the geometric stiffness of its body, which no damping by strain acts on."""
    if problem.prestress is None or model.name not in problem.prestress.stiffness:
        return model
    added = problem.prestress.stiffness[model.name]
    stiffness = problem.prestress.added(model.name, model.stiffness)
    return replace(model, stiffness=stiffness, unrelaxed=added, geometric=added)


def _trace(body: Body, sides: Sequence[tuple[InterfaceUnit, int]]) -> sp.csr_array:
    """Trace (n_channel, 3 n_node) from the nodes of a body to the channels of its sides of interfaces."""
    traces = []
    for unit, side in sides:
        trace = unit.geometry.local_trace(side, unit.behaviour.n_component)
        assert trace is not None, "a side of a body has a trace"
        traces.append(trace)
    return sp.csr_array(sp.vstack(traces)) if traces else sp.csr_array((0, body.full_size()))


def _loosened(model: SubstructureModel, cuts: Sequence[BoltCut]) -> SubstructureModel:
    """The model while the shortenings of some of its bolts are free (``bolts``)."""
    softened = sum((-cut.softening() for cut in cuts), model.stiffness)
    return replace(model, stiffness=sp.csr_array(softened))


def _damping(body: Body, held: Conditions, layer: ContactLayer | None) -> sp.csr_array | None:
    material, viscosity = body.shape.material, None if layer is None else layer.viscosity
    a, b = material.drag, material.damping.viscosity
    if not (a or b):
        return total(held.dashpots, viscosity)
    mass = body.mass if layer is None else layer.mass
    rayleigh = a * mass + b * body.shape.stiffness
    return total(sp.csr_array(rayleigh), held.dashpots, viscosity)


def _lumped_damping(body: Body, held: Conditions) -> sp.csr_array | None:
    """Damping lumped with the masses of the shape, where it has its own; stiffness-proportional damping has no part."""
    mass = body.lumped_mass
    if mass is None:
        return None
    return total(diagonal_matrix(body.shape.material.drag * mass), held.lumped_dashpots)


def _dashpots_key(scene: Scene, name: str) -> bytes:
    """The wave ports of a substructure, which its damping matrix depends on; empty where it has none."""
    waves = [port for port in scene.port.values() if port.body == name and port.causality == "wave"]
    return repr([(split_face(p.face)[1], p.components, p.impedance) for p in waves]).encode() if waves else b""


def _signature(model: SubstructureModel, body: Body) -> bytes:
    """Equal for substructures whose operators are equal (loads, initial values and place do not count)."""
    digest = hashlib.sha256()
    size = body.mesh.size
    digest.update(
        # rounded: equal bodies at different places differ in the last bits of their coordinates
        repr((model.modal, body.shape.material, body.shape.bending_modes, body.mesh.cell_types, f"{size:.9e}")).encode()
    )
    digest.update(np.round((body.mesh.nodes - body.mesh.nodes[0]) / size, 9).astype("f8").tobytes())
    for block in body.shape.mesh.blocks:
        digest.update(block.cells.tobytes() + bytes([block.reduced]))
    if body.shape.moduli is not None:
        digest.update(body.shape.moduli.tobytes())
    for matrix in (model.expansion, model.trace):
        matrix.sort_indices()
        index = (matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64))
        # + 0.0: no negative zeros, whose bits differ
        for part in (*index, np.round(matrix.data, 9) + 0.0):
            digest.update(np.ascontiguousarray(part).tobytes())
    digest.update((np.round(model.channel_area / size**2, 12) + 0.0).tobytes())
    if model.damping is not None:
        sizes = float(model.damping.trace()), float(abs(model.damping).sum())
        digest.update(f"{model.damping.nnz} {sizes[0]:.9e} {sizes[1]:.9e}".encode())
        digest.update(model.damping.indices.astype(np.int64).tobytes())
    # which nodes have no mass depends on the contacts of a body, not on its shape
    if model.mass is not None and model.nodal is None:
        digest.update(np.flatnonzero(model.mass.diagonal() <= 0.0).tobytes())
    if body.added is not None:
        digest.update(body.added.matrix.indices.astype(np.int64).tobytes())
        digest.update(np.ascontiguousarray(body.added.matrix.data).tobytes())
    digest.update(model.imposed_pattern.tobytes())
    if model.nodal is not None:
        digest.update((np.round(model.nodal, 9) + 0.0).tobytes())
    return digest.digest()


def settings_of(scene: Scene) -> SolverSettings:
    """Settings of the iteration."""
    solver = scene.solver
    direction = solver.search_direction
    uniform = (direction.normal, direction.tangential) if isinstance(direction, Uniform) else (0.0, 0.0)
    return SolverSettings(
        tolerance=solver.tolerance,
        force_tolerance=10.0 * solver.tolerance if solver.force_tolerance is None else solver.force_tolerance,
        max_iterations=solver.max_iterations,
        search_direction=SearchDirection(direction.type, direction.factor, *uniform),
        anderson_depth=solver.acceleration.depth if isinstance(solver.acceleration, AndersonTable) else 0,
        relaxation=solver.relaxation,
        # 0: one window over the interval
        window=0 if solver.window == WHOLE else min(int(solver.window), scene.time.n_step),
        quasi_static=scene.time.quasi_static,
        direct_bonds=solver.bonds == "direct",
        threads=solver.threads,
        skip_unchanged=solver.skip_unchanged,
        newton=solver.newton,
        # share of the dense matrices up to which tables are taken
        tables={"automatic": SHARE, "sparse": 1.0}.get(solver.interface_operator, 0.0),
        sequential_start=solver.start == "sequential",
    )


def characteristic_traction(scene: Scene, bodies: dict[str, Body], time: Array) -> float:
    """Largest traction that loads, initial values and prescribed motions can bring, Pa."""
    sizes = [0.0, *_load_tractions(scene, bodies, time)]
    impedances = _impact_impedances(bodies, float(time[1] - time[0]))
    for name, body in bodies.items():
        z_p, description = impedances[name], body.description
        spin = float(np.linalg.norm(description.initial_spin)) * body.mesh.size
        sizes.append(z_p * (float(np.linalg.norm(description.initial_velocity)) + spin))
        if description.initial_fields:
            sizes += field_tractions(body, z_p)
        sizes += _body_tractions(scene, body, time)
        sizes += [z_p * motion.largest_speed(time) for motion in _motions(scene, body)]
    stiffest = max(impedances.values())
    sizes += _preloads(scene, bodies)
    for interface in scene.interface.values():
        if split_face(interface.sides[0])[0] not in bodies:  # one that is left out
            continue
        if interface.ground_velocity is not None:
            ground = interface.ground_velocity
            speed = float(np.linalg.norm(ground.vector)) * _largest(ground.law, time)
            sizes.append(stiffest * speed)
    return max(sizes)


def _impact_impedances(bodies: dict[str, Body], dt: float) -> dict[str, float]:
    """Traction per velocity that a body can bring, Pa s m-1: rho c_p; of a rigid body, its momentum lost in one step,
    or what the stiffest elastic body can take where there is one."""
    elastic = [body.shape.impedances[0] for body in bodies.values() if not body.rigid]
    impedances = {}
    for name, body in bodies.items():
        stop = body.shape.material.density * body.mesh.size / dt
        # a rigid body is stopped by what it hits, if that is softer than itself stopped in one step
        impedances[name] = min(stop, max(elastic, default=stop)) if body.rigid else body.shape.impedances[0]
    return impedances


def _load_tractions(scene: Scene, bodies: Mapping[str, Body], time: Array) -> Iterator[float]:
    """Largest traction of each load, Pa; the amplitude of an input, known only later, counts as 1 at least."""
    for load in scene.loads.values():
        yield load.largest_traction(BodyFace.of(bodies, load.face)) * _largest(load.law, time)


def _preloads(scene: Scene, bodies: Mapping[str, Body]) -> Iterator[float]:
    """Pressure of each interface at t = 0, Pa; without those of bodies that are left out, which have no preload."""
    for interface in scene.interface.values():
        substructure, face = split_face(interface.sides[0])
        if substructure in bodies:
            yield interface.initial_pressure(float(bodies[substructure].face(face).areas.sum()))


def _body_tractions(scene: Scene, body: Body, time: Array) -> Iterator[float]:
    """Largest traction of each load of the whole body, Pa."""
    # of this scene: that of a static start has other forces on the same bodies
    described, volume = scene.substructure[body.name], BodyVolume(body)
    for load in scene.body_loads:
        if load.acts_on(body.name, described):
            yield load.largest_traction(volume, _largest(load.law, time))


def _largest(law: TimeLaw, time: Array) -> float:
    """Largest amplitude of a law; that of an input, known only later, counts as 1 at least."""
    largest = float(np.abs(law.sample(time)).max())
    return max(largest, 1.0) if isinstance(law, InputLaw) else largest


def _motions(scene: Scene, body: Body) -> Iterator[PrescribedMotion]:
    """Prescribed motions of a substructure, component by component."""
    for boundary in scene.boundaries_of(body.name).values():
        if isinstance(boundary, Driven):
            for value in boundary.value:
                yield PrescribedMotion(boundary.law, value, boundary.type)
    for name, port in scene.ports_of(body.name).items():
        if port.causality == "motion_in":
            yield from port_motions(body, name, port)


def static_traction(scene: Scene, bodies: dict[str, Body], time: Array) -> float:
    """Largest traction that preloads, loads and prescribed motions can bring, Pa: a motion counts as if it strained the
    softest body along its whole length."""
    sizes = [*_preloads(scene, bodies), *_load_tractions(scene, bodies, time)]
    softest = min(body.shape.elasticity.young_moduli[0] / body.mesh.size for body in bodies.values())
    travels = [0.0]
    for body in bodies.values():
        sizes += _body_tractions(scene, body, time)
        for motion in _motions(scene, body):
            driving = motion.driving(time, over_steps=True)
            # a displacement has the rates of the steps that begin, others means of those that end
            steps = driving[:-1] if motion.kind == "displacement" else driving[1:]
            travels.append(float(np.abs(np.cumsum(steps * np.diff(time))).max()))
            # an input counts as if it lasted: its history is not known
            if isinstance(motion.law, InputLaw):
                travels.append(motion.largest_speed(time) * float(time[-1]))
    for interface in scene.interface.values():
        if interface.ground_velocity is not None:
            ground = interface.ground_velocity
            speed = ground.law.sample(time)
            travels.append(float(np.linalg.norm(ground.vector)) * float(np.abs(np.cumsum(speed)).max() * time[1]))
            if isinstance(ground.law, InputLaw):
                travels.append(float(np.linalg.norm(ground.vector)) * _largest(ground.law, time) * float(time[-1]))
    return max(*sizes, softest * max(travels), 0.0)
