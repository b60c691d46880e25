"""The discretised problem of a scene, and the solver-ready problem with its operators."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Final

import numpy as np

from ..fem.mesh import padded_cells
from ..latin.assembly import Array, Assembly, GroundState, InterfaceUnit, Layout
from ..latin.probes import SensorPlace
from ..latin.recorder import OutputRequest, SubstructureInfo
from ..latin.search_direction import inertial_impedance, unresolved_sides
from ..latin.settings import SearchDirection, Settings
from ..propagator import Histories, SubstructureModel
from ..propagator.interface_probing import SHARE
from ..remarks import Remark, remarks_of
from ..results.dataset import Recovered
from ..scene.boundaries import Driven
from ..scene.fields import split_face
from ..scene.laws import InputLaw, TimeLaw, sampled
from ..scene.schema import Scene
from ..scene.settings import WHOLE, Anderson, Uniform
from ..scene.units import SI, UnitSystem
from ..time_scheme import QuasiStatic, TimeScheme
from .body import Body, flexibility, side_impedance, side_stiffness
from .bolts import BoltCut, Clamp, OpenedMesh, OpenedStress, load_name
from .checks import resolution_remarks
from .conditions import Conditions
from .initial_state import InitialState, TightBolts, field_tractions
from .models import (
    NO_BOLTS,
    ContactLayer,
    Kept,
    KeptOperators,
    ModelClass,
    chosen_scheme,
    contact_layers,
    model_classes,
)
from .propagator_choice import divided, made_propagators
from .supports import Motion, port_motions, port_supports, supports

REST = 1e-2
"""Tractions below this share of tolerance x characteristic traction leave a substructure at rest inactive."""
ROUND_OFF = 1e-13
"""The same as a share of the characteristic traction, where rounding errors alone are to be ignored."""
NO_RAMPS: Final[Mapping[str, tuple[float, float]]] = MappingProxyType({})


class Timeline:
    """Samples the laws of a scene; histories given from outside replace those laws.

    They are given by the name of a force (``Scene.force_laws``), ``boundary.NAME`` (see ``Motion.velocity``), or
    ``ground.INTERFACE`` (amplitude of its velocity). ``bolts`` : first and last amplitude of the load term of each
    bolt, linear in between over the interval of the scene.
    """

    def __init__(
        self, scene: Scene, conditions: dict[str, Conditions], bolts: Mapping[str, tuple[float, float]] = NO_RAMPS
    ) -> None:
        self._scene, self._conditions, self._laws = scene, conditions, scene.force_laws
        self._bolts = {load_name(name): ramp for name, ramp in bolts.items()}

    def begin(
        self,
        assembly: Assembly,
        time: Array,
        given: Mapping[str, Array],
        ground_start: Mapping[int, GroundState],
        dt: float | None = None,
    ) -> None:
        """Set the instants of an assembly and of its propagators.

        Parameters
        ----------
        time : (n_time,), s. given : histories (n_time,) from outside by name. ground_start : see ``Assembly.begin``.
        dt : step of the operators, s; that of ``time`` where None (they may differ by round-off).
        """
        dt = float(time[1] - time[0]) if dt is None else dt
        for propagator in assembly.propagators:
            propagator.begin([self.histories(member, time, given) for member in propagator.members], dt)
        assembly.begin(time, dt, self._ground(assembly, time, given), ground_start)

    def histories(self, model: SubstructureModel, time: Array, given: Mapping[str, Array] | None = None) -> Histories:
        """Histories that drive one substructure at the instants; ``given`` as for ``begin``."""
        amplitudes = [self._amplitude(load.name, time, given or {}) for load in model.loads]
        motion = self._conditions[model.name].velocity(time, self._scene.time.quasi_static, given or {})
        return Histories(time, amplitudes, motion, self._conditions[model.name].accelerated)

    def _amplitude(self, name: str, time: Array, given: Mapping[str, Array]) -> Array:
        if not name:
            return np.ones(len(time))
        if name in self._bolts:
            first, last = self._bolts[name]
            return first + (last - first) * time / self._scene.time.end
        return given[name] if name in given else sampled(self._laws[name], time)

    def _ground(self, assembly: Assembly, time: Array, given: Mapping[str, Array]) -> dict[int, Array]:
        ground = {}
        for i, unit in enumerate(assembly.interfaces):
            if not unit.against_ground:
                continue
            moving = self._scene.joints[unit.name].ground_velocity
            ground[i] = np.zeros((len(time), 3))
            if moving is not None:
                amplitude = given.get(f"ground.{unit.name}", moving.law.sample(time))
                ground[i] = amplitude[:, None] * np.asarray(moving.vector)
            if self._scene.time.quasi_static:  # over the step that ends at each instant
                ground[i][1:] = 0.5 * (ground[i][1:] + ground[i][:-1])
        return ground


@dataclass(frozen=True)
class SolverReadyProblem:
    """A scene turned into operators, ready to run.

    The assembly stands at t = 0 with the instants of the scene; ``timeline`` can give it others. ``start`` is the
    equilibrium that the motion starts from, None where there is none; ``recovered`` finds more fields of the
    substructures from what is kept.
    """

    assembly: Assembly
    settings: Settings
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

    @property
    def choices(self) -> dict[str, str]:
        """Automatic choices, in words."""
        start = {} if self.start is None else {"start": self.start.message}
        stores = {id(p.members[0].store): p.members[0].store for p in self.assembly.propagators}
        kept = "; ".join(filter(None, (store.remark() for store in stores.values())))
        return {"time scheme": self.scheme, **start, **({"operators": kept} if kept else {})}


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
    sensors: Mapping[str, SensorPlace] = field(default_factory=dict)
    scheme_reason: str = ""
    cuts: Mapping[str, BoltCut] = field(default_factory=dict)
    ramps: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """First and last amplitude of the load terms of the bolts while they are tightened."""
    layers: Mapping[str, ContactLayer] = field(default_factory=dict)
    """Contact layers of the elastic bodies (``models.contact_layers``)."""
    kept: KeptOperators | None = None
    """Operators of a scene solved before, replaced by those of this one."""

    @staticmethod
    def of(
        scene: Scene,
        bodies: dict[str, Body],
        conditions: dict[str, Conditions],
        units: list[InterfaceUnit],
        moved: Mapping[str, ContactLayer] | None = None,
        cuts: Mapping[str, BoltCut] = NO_BOLTS,
        free: Collection[str] = (),
        kept: KeptOperators | None = None,
    ) -> DiscretisedProblem:
        """The problem with the time scheme, instants and classes of identical substructures of the scene; ``moved``,
        ``cuts``, ``free`` and ``kept`` as for ``model_classes``."""
        layout = Layout(units)
        scheme, reason = chosen_scheme(scene, bodies, units)
        time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
        dt = float(time[1] - time[0])
        layers = contact_layers(bodies, units, scheme, dt)
        classes = model_classes(scene, bodies, conditions, units, layout, scheme, layers, moved, cuts, free, kept)
        made = DiscretisedProblem(scene, bodies, conditions, units, layout, classes, scheme, time, scheme_reason=reason)
        return replace(made, cuts=cuts, layers=layers, kept=kept)

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
        for n, b in self.bodies.items():
            opened = self.opened(n, shortening) if stress else None
            recover = None if opened is None else OpenedStress(opened, b.shape.material)
            plain = b.shape.stress if stress and not b.rigid else None
            cells, types = padded_cells(b.mesh.blocks), " ".join(b.mesh.cell_types)
            made[n] = SubstructureInfo(b.mesh.nodes, cells, types, recover or plain)
        return made

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
                made[n] = Recovered(recovery, *fields)
        return made

    def _timeline(self, bolts: TightBolts) -> Timeline:
        """Histories with the bolts as tightened, or while they are."""
        return Timeline(self.scene, self.conditions, self.ramps or (bolts.locked(self.cuts) if self.cuts else NO_RAMPS))

    def opened(self, name: str, shortening: Mapping[str, float]) -> OpenedMesh | None:
        """Mesh of a substructure with the cuts of its bolts open; None where it has none."""
        own = [cut for cut in self.cuts.values() if cut.table.substructure == name]
        return OpenedMesh(self.bodies[name].mesh, own, shortening) if own else None

    @property
    def timeline(self) -> Timeline:
        """Histories of the loads and motions of the substructures, bolts that are not being tightened left out."""
        return self._timeline(TightBolts())

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
        return max(size(self.scene, self.bodies, self.time), *stresses, 0.0)

    def build(
        self, start: InitialState | None = None, kept: Kept | None = None, processes: int = 1
    ) -> SolverReadyProblem:
        """Factorise and condense the substructures.

        start : initial state in the place of that of the scene. kept : operators of static problems by
        ``ModelClass.key``, which are used again and added to. processes : among which the substructures are divided.
        """
        scene, scheme, units = self.scene, self.scheme, self.units
        layout = self.layout if start is None else Layout(units)  # ``start`` changes its gaps
        classes = self.classes if start is None else start.displaced(self.classes)
        classes, *distribution = divided(scene, classes, processes)
        static = isinstance(scheme, QuasiStatic)
        impedance = self.impedance.copy()
        propagators, without_factor = made_propagators(
            scene, classes, scheme, self.dt, impedance, self.kept if kept is None else None, kept
        )
        assembly = Assembly(
            propagators, [c.channels for c in classes], units, layout, impedance, self.characteristic_traction, scheme
        )
        assembly.owner, assembly.part_of = distribution
        levels = {"off": -1.0, "exact": 0.0, "round_off": ROUND_OFF, "tolerance": REST * scene.solver.tolerance}
        level = levels[scene.solver.skip_at_rest]
        assembly.rest_traction = level * (assembly.characteristic_traction if level > 0 else 1.0)
        if start is not None:
            start.hand_over(assembly)
        timeline = self._timeline(bolts := TightBolts() if start is None else start.bolts)
        timeline.begin(assembly, self.time, {}, assembly.ground_start)
        if not static and any(body.rigid for body in self.bodies.values()):
            inertial_impedance(assembly)
        unresolved = [] if static else unresolved_sides(assembly)
        warnings = (*self.remarks, *remarks_of("memory", without_factor), *resolution_remarks(unresolved))
        warnings += () if start is None else tuple(remarks_of("start", start.remarks))
        return SolverReadyProblem(
            assembly,
            settings_of(scene),
            self._output(classes, bolts),
            self.info_of(bolts.shortening),
            warnings,
            timeline,
            start,
            self.recovered_of(bolts.shortening),
            self.scheme_in_words,
            scene.unit_system,
            [
                cut.clamp(self.bodies[cut.table.substructure].mesh.nodes, bolts.shortening.get(n, 0.0))
                for n, cut in self.cuts.items()
            ],
            flexibility(self.bodies, units, layout),
        )

    def _output(self, classes: list[ModelClass], bolts: TightBolts) -> OutputRequest:
        """What the recorder keeps."""
        keys = self.scene.output
        models = {m.name: m for c in classes for m in c.members}
        supported = supports(self.scene.boundary, self.bodies, models) if keys.reactions else {}
        if self.scene.port:
            supported |= port_supports(self.scene, self.bodies, models)
        return OutputRequest(
            keys.keeps_fields,
            keys.stress,
            keys.energy,
            keys.every,
            self.sensors,
            keys.peak_duration,
            keys.interfaces_every,
            supported,
            bolts.places(self.cuts) if self.cuts and not self.ramps else {},
        )


def settings_of(scene: Scene) -> Settings:
    """Settings of the iteration."""
    solver = scene.solver
    direction = solver.search_direction
    uniform = (direction.normal, direction.tangential) if isinstance(direction, Uniform) else (0.0, 0.0)
    return Settings(
        tolerance=solver.tolerance,
        force_tolerance=10.0 * solver.tolerance if solver.force_tolerance is None else solver.force_tolerance,
        max_iterations=solver.max_iterations,
        search_direction=SearchDirection(direction.type, direction.factor, *uniform),
        anderson_depth=solver.acceleration.depth if isinstance(solver.acceleration, Anderson) else 0,
        relaxation=solver.relaxation,
        window=0 if solver.window == WHOLE else min(int(solver.window), scene.time.n_step),
        quasi_static=scene.time.quasi_static,
        direct_bonds=solver.bonds == "direct",
        threads=solver.threads,
        skip_unchanged=solver.skip_unchanged,
        newton=solver.newton,
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
    for interface in scene.interface.values():
        substructure, face = split_face(interface.sides[0])
        sizes.append(interface.initial_pressure(float(bodies[substructure].face(face).areas.sum())))
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
        impedances[name] = min(stop, max(elastic, default=stop)) if body.rigid else body.shape.impedances[0]
    return impedances


def _load_tractions(scene: Scene, bodies: Mapping[str, Body], time: Array) -> Iterator[float]:
    """Largest traction of each load, Pa; the amplitude of an input, known only later, counts as 1 at least."""
    for load in scene.loads.values():
        substructure, face = split_face(load.face)
        yield load.size(float(bodies[substructure].face(face).areas.sum())) * _largest(load.law, time)


def _body_tractions(scene: Scene, body: Body, time: Array) -> Iterator[float]:
    """Largest tractions that the body force and gravity bring over the length of a body, Pa."""
    force, law = body.description.body_force, body.description.body_force_law
    yield float(np.linalg.norm(force)) * _largest(law, time) * body.mesh.size
    if scene.gravity is not None:
        weight = body.shape.material.density * float(np.linalg.norm(scene.gravity.acceleration))
        yield weight * _largest(scene.gravity.law, time) * body.mesh.size


def _largest(law: TimeLaw, time: Array) -> float:
    """Largest amplitude of a law; that of an input, known only later, counts as 1 at least."""
    largest = float(np.abs(law.sample(time)).max())
    return max(largest, 1.0) if isinstance(law, InputLaw) else largest


def _motions(scene: Scene, body: Body) -> Iterator[Motion]:
    """Prescribed motions of a substructure, component by component."""
    for boundary in scene.boundaries_of(body.name).values():
        if isinstance(boundary, Driven):
            for value in boundary.value:
                yield Motion(boundary.law, value, boundary.type)
    for name, port in scene.ports_of(body.name).items():
        if port.causality == "motion_in":
            yield from port_motions(body, name, port)


def static_traction(scene: Scene, bodies: dict[str, Body], time: Array) -> float:
    """Largest traction that loads and prescribed motions can bring, Pa: a motion counts as if it strained the softest
    body along its whole length."""
    sizes = [*(i.preload for i in scene.interface.values()), *_load_tractions(scene, bodies, time)]
    softest = min(body.shape.material.young_modulus / body.mesh.size for body in bodies.values())
    travels = [0.0]
    for body in bodies.values():
        sizes += _body_tractions(scene, body, time)
        for motion in _motions(scene, body):
            steps = motion.step_velocity(time)[1:] * np.diff(time)
            travels.append(float(np.abs(np.cumsum(steps)).max()))
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
