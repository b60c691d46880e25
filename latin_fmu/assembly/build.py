"""From description to operators: the one place that knows both the scene and the solver."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..errors import Problem, SceneError
from ..fem.mesh import padded_cells
from ..interface import Behaviour
from ..latin.assembly import Array, Assembly, InterfaceUnit, Layout
from ..latin.recorder import SubstructureInfo, Wanted
from ..latin.search_direction import inertial_impedance, unresolved_sides
from ..latin.settings import SearchDirection, Settings
from ..propagator import Propagator, StaticPropagator, make_propagator
from ..results.dataset import Recovered
from ..scene.schema import Scene
from ..scene.solver_settings import WHOLE, Anderson, Uniform
from ..time_scheme import QuasiStatic, TimeScheme, make_scheme
from .body import Body, build_bodies
from .checks import (
    boundaries_of,
    check_faces,
    initial_problems,
    locking_remarks,
    lumping_remarks,
    redundancy_remarks,
    sampling_remarks,
)
from .conditions import Conditions, conditions_on
from .inactive_substructures import arrival_times, cut_by_arrival, marched_share
from .initial_state import InitialState
from .interfaces import Messages, build_interface, lonely_remarks, with_behaviours, with_found
from .models import ModelClass, model_classes
from .prediction import Prediction, predict
from .propagator_choice import chosen_propagators, unstable_steps
from .run_sizes import run_sizes
from .scales import characteristic_traction, side_impedance, side_stiffness, static_traction
from .statics import start_problems, starts_static, static_state, unheld
from .timeline import Timeline

REST = 1e-2
"""Tractions below this share of tolerance x characteristic traction do not wake a substructure at rest."""
ROUND_OFF = 1e-13
"""The same as a share of the characteristic traction, where rounding errors alone are to be left out."""


@dataclass(frozen=True)
class Built:
    """A scene turned into operators, ready to run.

    The assembly stands at t = 0 with the instants of the scene; ``timeline`` can give it others. ``predict`` tells
    what the run should cost; ``start`` is the equilibrium that the motion starts from, None where there is none;
    ``recovered`` finds more fields of the substructures from what is kept.
    """

    assembly: Assembly
    settings: Settings
    wanted: Wanted
    info: dict[str, SubstructureInfo]
    warnings: tuple[str, ...]
    timeline: Timeline
    predict: Callable[[], Prediction | None] = lambda: None
    start: InitialState | None = None
    recovered: Mapping[str, Recovered] = field(default_factory=dict)


@dataclass(frozen=True)
class Prepared:
    """Meshes, matrices and interfaces of a scene; nothing is factorised yet."""

    scene: Scene
    bodies: dict[str, Body]
    conditions: dict[str, Conditions]
    units: list[InterfaceUnit]
    layout: Layout
    classes: list[ModelClass]
    scheme: TimeScheme
    time: Array
    remarks: tuple[str, ...]

    @property
    def dt(self) -> float:
        """Step, s."""
        return float(self.time[1] - self.time[0])

    @property
    def info(self) -> dict[str, SubstructureInfo]:
        """Meshes for the recorder."""
        stress = self.scene.output.stress
        return {
            n: SubstructureInfo(
                b.mesh.nodes,
                padded_cells(b.mesh.blocks),
                " ".join(b.mesh.cell_types),
                b.shape.stress if stress and not b.rigid else None,
            )
            for n, b in self.bodies.items()
        }

    @property
    def recovered(self) -> dict[str, Recovered]:
        """What finds more fields of the elastic substructures, where the scene asks for them."""
        output = self.scene.output
        if not output.recovers:
            return {}
        wanted = output.strain, output.nodal_stress, output.principal_stress
        return {n: Recovered(b.shape.recovery, *wanted) for n, b in self.bodies.items() if not b.rigid}

    @property
    def timeline(self) -> Timeline:
        """What drives the substructures."""
        return Timeline(self.scene, self.conditions)

    @cached_property
    def impedance(self) -> Array:
        """Impedance of the side of every channel (see ``Assembly``)."""
        side = side_stiffness if isinstance(self.scheme, QuasiStatic) else side_impedance
        return side(self.bodies, self.units, self.layout)

    @cached_property
    def characteristic_traction(self) -> float:
        """Size of the tractions the loads can bring, Pa."""
        size = static_traction if isinstance(self.scheme, QuasiStatic) else characteristic_traction
        return size(self.scene, self.bodies, self.time)

    def build(self, start: InitialState | None = None) -> Built:
        """Factorise and condense the substructures and tie them together; ``start``: not from the values given."""
        scene, scheme, units = self.scene, self.scheme, self.units
        layout = self.layout if start is None else Layout(units)  # its gaps are handed over
        settings, without_factor = chosen_propagators(scene, self.classes)
        classes = self.classes if start is None else start.displaced(self.classes)
        static = isinstance(scheme, QuasiStatic)
        impedance = self.impedance.copy()
        propagators: list[Propagator] = []
        for c in classes:
            twin = None if c.twin is None else propagators[c.twin]
            propagators.append(
                StaticPropagator(c.members, self.dt, scene.output.energy, impedance[c.channels[:, 0]])
                if static
                else make_propagator(c.members, scheme, self.dt, scene.output.energy, settings, twin)
            )
        if problems := unstable_steps(propagators, scene, self.dt):
            raise SceneError(problems, "the scene cannot be built")
        assembly = Assembly(
            propagators, [c.channels for c in classes], units, layout, impedance, self.characteristic_traction, scheme
        )
        level = {"off": -1.0, "exact": 0.0, "round_off": ROUND_OFF, "tolerance": REST * scene.solver.tolerance}[
            scene.solver.skip_at_rest
        ]
        assembly.rest_traction = level * (assembly.characteristic_traction if level > 0 else 1.0)
        if start is not None:
            start.hand_over(assembly)
        timeline = self.timeline
        timeline.begin(assembly, self.time, {}, assembly.ground_start)
        if not static and any(body.rigid for body in self.bodies.values()):
            inertial_impedance(assembly)
        output = scene.output
        wanted = Wanted(output.keeps_fields, output.stress, output.energy, output.every)
        warnings = (*self.remarks, *without_factor, *([] if static else unresolved_sides(assembly)))
        warnings += () if start is None else start.remarks
        return Built(
            assembly, settings_of(scene), wanted, self.info, warnings, timeline, self.prediction, start, self.recovered
        )

    def started(self, amplitudes: Mapping[str, float]) -> Built:
        """Built from the values given, or from the equilibrium where the scene starts from one (see ``build``)."""
        return self.build(static_state(self, amplitudes) if starts_static(self.scene) else None)

    def prediction(self) -> Prediction:
        """Predicted cost of the run."""
        return predict(run_sizes(self))


def build(
    scene: Scene, amplitudes: Mapping[str, float] | None = None, behaviours: Mapping[str, Behaviour] | None = None
) -> Built:
    """Meshes, matrices, interfaces and factors of a scene, and the equilibrium it starts from where it asks for one.

    Parameters
    ----------
    amplitudes : for a static start, of loads that are set from outside (their start value where left out).
    behaviours : laws of the caller's own, by interface, in the place of those that the scene names.

    Raises
    ------
    SceneError : meshes that cannot be read, unknown faces, faces that do not fit, all at once; no equilibrium.
    """
    return prepare(scene, behaviours).started(amplitudes or {})


def prepare(scene: Scene, behaviours: Mapping[str, Behaviour] | None = None) -> Prepared:
    """All of ``build`` but the factors (same errors)."""
    problems: list[Problem] = []
    bodies = build_bodies(scene, problems)
    check_faces(scene, bodies, problems)
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    remarks: list[str] = []
    if scene.contact:
        scene = with_found(scene, bodies, problems)
        remarks += lonely_remarks(scene, bodies)
    conditions = {name: conditions_on(body, boundaries_of(scene, name), problems) for name, body in bodies.items()}
    messages = Messages(problems, remarks)
    found = [build_interface(n, i, bodies, conditions, messages) for n, i in scene.interface.items()]
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    units = with_behaviours([unit for unit in found if unit is not None], behaviours or {}, problems)
    initial_problems(scene, units, problems, remarks)
    if scene.time.quasi_static and not problems:
        problems += unheld(bodies, conditions, units, "quasi_static")
    if starts_static(scene) and not problems:
        problems += start_problems(scene, bodies, conditions, units)
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    layout = Layout(units)
    scheme = scheme_of(scene)
    time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    classes = model_classes(scene, bodies, conditions, units, layout, scheme)
    if scene.solver.skip_at_rest == "tolerance" and units:
        arrival = arrival_times(scene, bodies, units, time)
        classes = cut_by_arrival(classes, {name: marched_share(t, time) for name, t in arrival.items()})
    remarks += [
        *redundancy_remarks(scene),
        *locking_remarks(scene, bodies),
        *(lumping_remarks(bodies) if scheme.explicit else []),
        *([] if scene.time.quasi_static else sampling_remarks(scene, time)),
    ]
    return Prepared(scene, bodies, conditions, units, layout, classes, scheme, time, tuple(remarks))


def scheme_of(scene: Scene) -> TimeScheme:
    """Time scheme of a scene."""
    if scene.time.quasi_static:
        return QuasiStatic()
    return make_scheme(scene.time.scheme.type, scene.time.scheme.model_dump(exclude={"type"}))


def settings_of(scene: Scene) -> Settings:
    """Settings of the iteration."""
    solver = scene.solver
    direction = solver.search_direction
    uniform = (direction.normal, direction.tangential) if isinstance(direction, Uniform) else (0.0, 0.0)
    return Settings(
        tolerance=solver.tolerance,
        force_tolerance=solver.force_mismatch_tolerance,
        max_iterations=solver.max_iterations,
        search_direction=SearchDirection(direction.type, direction.factor, *uniform),
        anderson_depth=solver.acceleration.depth if isinstance(solver.acceleration, Anderson) else 0,
        relaxation=solver.relaxation,
        window=0 if solver.window == WHOLE else min(int(solver.window), scene.time.n_step),
        quasi_static=scene.time.quasi_static,
        direct_bonds=solver.bonds == "direct",
        threads=solver.threads,
        skip_unchanged=solver.skip_unchanged,
        sequential_start=solver.window == WHOLE and solver.start == "sequential",
    )
