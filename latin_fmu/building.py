"""Builds the solver-ready problem of a scene: meshes, interfaces, checks, operators, static start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from .assembly.attachments import coupling_units, sensor_places, spring_units, with_masses, with_rigid_faces
from .assembly.body import Body, build_bodies
from .assembly.bolt_cuts import cuts_of
from .assembly.bolts import BoltCut, section_remarks
from .assembly.conditions import Conditions, conditions_on
from .assembly.driven_starts import check_driven_starts
from .assembly.inactive_substructures import arrival_times, cut_by_arrival, marched_share
from .assembly.initial_state import InitialState, check_fields, field_remarks, initial_problems
from .assembly.interfaces import build_interface, unconnected_remarks, with_behaviours, with_found
from .assembly.merged_assembly import loop_remarks
from .assembly.models import KeptOperators, scheme_remarks, store_of
from .assembly.press_fits import carried
from .assembly.problem import DiscretisedProblem, SolverReadyProblem, characteristic_traction
from .assembly.propagator_choice import box_memory
from .assembly.rigid_landings import rigid_landings
from .assembly.supports import port_places
from .assembly.threads import with_threads
from .assembly.untouched import never_touched
from .checks.drag import drag_problems
from .checks.joint_rotations import rotation_problems
from .checks.mesh_checks import (
    check_faces,
    locking_remarks,
    lumping_remarks,
    modal_damping_remarks,
    redundancy_remarks,
    sampling_remarks,
)
from .checks.plausibility import plausibility_remarks
from .errors import Problems, SceneError, SolverError
from .interface import Behaviour
from .joined.tied_assembly import TieError
from .latin.assembly import InterfaceUnit
from .laws.maxwell_joint import MaxwellJoint
from .remarks import Remark, remarks_of
from .scene.boundaries import Boundary
from .scene.ports import Port
from .scene.raw_scene import CENTRAL
from .scene.schema import Scene
from .scene.settings import GivenStart, HHTTable, ModalPropagatorTable, ReducedPropagatorTable

if TYPE_CHECKING:
    from .joined.bond_groups import GroupedAssembly
    from .joined.damping_band import DampingBand
    from .statics.statics import Stage


def build(
    scene: Scene, amplitudes: Mapping[str, float] | None = None, behaviours: Mapping[str, Behaviour] | None = None
) -> SolverReadyProblem:
    """Meshes, matrices, interfaces and factors of a scene, and its static start where it has one.

    Parameters
    ----------
    amplitudes : for a static start, of loads that are set from outside (their start value where left out).
    behaviours : user-defined laws, by interface, instead of those of the scene.

    Raises
    ------
    SceneError : meshes that cannot be read, unknown faces, faces that do not fit, all at once; no equilibrium.
    """
    return solver_ready(*started(discretise(scene, behaviours), amplitudes or {}))


def started(
    discretised: DiscretisedProblem, amplitudes: Mapping[str, float], stages: list[Stage] | None = None
) -> tuple[DiscretisedProblem, InitialState | None]:
    """The equilibrium that a scene starts from, None where it starts from its initial values, and the problem of the
    motion about it, with the stiffness of its stress where that counts.

    Parameters
    ----------
    amplitudes : at t = 0, as for ``build``. stages : for derivatives, the static ones are added to these.
    """
    if discretised.scene.time.start.type != "static":
        return _stressed_by_loads(discretised, amplitudes, stages is not None), None
    from .statics.displaced_starts import displaced_start
    from .statics.prestressed import with_prestress
    from .statics.starts import undisplaced_equilibrium

    state = undisplaced_equilibrium(discretised, amplitudes, stages)
    discretised, state = with_prestress(discretised, state, amplitudes)
    return discretised, displaced_start(discretised, state)


def _stressed_by_loads(
    discretised: DiscretisedProblem, amplitudes: Mapping[str, float], restricted: bool = False
) -> DiscretisedProblem:
    """The problem of a scene that starts from initial values with the stiffness of the stress of what acts at t = 0;
    ``restricted`` : whether derivatives are taken."""
    from .statics.loads_at_start import loaded_at_rest

    at_rest = loaded_at_rest(discretised, amplitudes)
    if at_rest is None:
        if discretised.scene.effects.prestress != "on" or discretised.scene.time.quasi_static:
            return discretised
        words = (
            "effects.prestress: nothing that acts at t = 0 stresses bodies that are held, and no stress has a stiffness"
        )
        return replace(discretised, remarks=(*discretised.remarks, *remarks_of("prestress", [words])))
    from .statics.prestressed import stressed_by_loads

    return stressed_by_loads(discretised, at_rest, amplitudes, restricted)


def solver_ready(
    discretised: DiscretisedProblem,
    start: InitialState | None,
    processes: int = 1,
    modal: bool = False,
    at_once: bool = False,
    grouped: GroupedAssembly | None = None,
) -> SolverReadyProblem:
    """Operators, with the initial values given or an equilibrium (``started``); ``processes`` : among which the
    substructures are divided. modal : whether the assembly is marched by its modes. at_once : whether one without
    inertia is solved over all bodies together, where it can be. grouped : the substructures where bonded bodies are
    one, None where they are not."""
    if at_once:
        from .statics.static_fields import static_problem_at_once

        try:
            return static_problem_at_once(discretised, start)
        except (TieError, SolverError):  # bonds between driven faces, bodies that float: one by one
            pass
    if modal:
        from .joined.modal_problem import modal_problem

        return modal_problem(discretised, start)
    if grouped is not None:
        from .joined.bonded_run import bonded_problem

        try:
            return bonded_problem(discretised, start, grouped)
        except TieError as error:
            return replace(discretised.build(start), bonds=f"iterated: {error}")
    return discretised.build(start, processes=processes)


def _attached(scene: Scene, bodies: dict[str, Body], problems: Problems) -> dict[str, Body]:
    """Bodies with point masses and rigid faces, before any matrix: both are part of a body."""
    if scene.point_mass:
        bodies = with_masses(scene, bodies, problems)
    if scene.coupling:
        return with_rigid_faces(scene, bodies)
    return bodies


def discretise(
    scene: Scene,
    behaviours: Mapping[str, Behaviour] | None = None,
    kept: KeptOperators | None = None,
    leave_out: bool = False,
) -> DiscretisedProblem:
    """Meshes, matrices and interfaces of a scene, nothing factorised (parameters and errors: ``build``).

    kept : of the scene solved before, used where nothing they depend on has changed, then replaced by those of this
        one. leave_out : the bodies that are probably never touched (``untouched``).
    """
    problems = Problems(box_memory(scene))
    _stop_at(problems)
    remarks: list[Remark] = []
    files: list[str] = []
    if kept is None:
        known = KeptOperators()
    else:
        known = kept
    store_of(scene).recount()
    scene = _damped(scene, remarks)
    bodies = build_bodies(scene, problems, None if kept is None else kept.bodies, remarks, files)
    scene, bodies, notes = with_threads(scene, bodies, problems, remarks)
    check_faces(scene, bodies, problems)
    # faces that are not there would fail all that follows
    _stop_at(problems)
    bodies = _attached(scene, bodies, problems)
    if any(s.initial_fields for s in scene.substructure.values()):
        check_fields(bodies, problems, remarks)
    if scene.contact:
        scene = with_found(scene, bodies, problems, remarks, known)
        remarks += remarks_of("unjoined", unconnected_remarks(scene, bodies))
        scene = _damped(scene, remarks)  # the interfaces found
    sensors = sensor_places(scene, bodies, problems) if scene.sensor else {}
    if scene.port:
        sensors |= port_places(scene, bodies)
    explicit = scene.time.scheme.type == CENTRAL  # central differences need diagonal dashpots
    conditions = {
        name: _conditions(body, scene.boundaries_of(name), scene.ports_of(name), explicit, problems, known)
        for name, body in bodies.items()
    }
    units = _units(scene, bodies, conditions, problems, remarks, known)
    _stop_at(problems)
    if behaviours:
        units = with_behaviours(units, behaviours, problems)
    scene = carried(scene, units, problems)
    if behaviours or any(s.initial_keys for s in scene.substructure.values()):
        initial_problems(scene, bodies, units, problems, remarks)
    problems += [*rigid_landings(scene, bodies, units), *rotation_problems(scene, bodies, conditions, units)]
    _check_conditions(scene, bodies, conditions, problems, remarks)
    # free bodies are looked for only where nothing else is wrong: their motions need sound conditions
    if (scene.time.quasi_static or scene.time.start.type == "static") and not problems:
        from .statics.starts import checked_equilibrium

        conditions = checked_equilibrium(scene, bodies, conditions, units, problems, remarks)
    if not problems:
        problems += _damping_problems(scene, bodies, conditions, units)
    cuts = cuts_of(scene, bodies, conditions, units, problems, notes) if scene.bolt else {}
    if cuts and not problems:
        from .statics.statics import loose_bolts

        problems += loose_bolts(scene, bodies, conditions, units, cuts)
    _stop_at(problems)
    problem = _problem(scene, bodies, conditions, units, cuts, kept, leave_out)
    if not known.compared:
        remarks += _remarks(problem, bodies, units)
    return replace(problem, remarks=tuple(remarks), sensors=sensors, files=tuple(files))


def _stop_at(problems: Problems) -> None:
    """Raises SceneError where there are problems."""
    if problems:
        raise SceneError(problems, "the scene cannot be built")


def without_scheme(scene: Scene) -> DiscretisedProblem:
    """Matrices and interfaces of a scene with a scheme that moves no mass."""
    plain = {"scheme": HHTTable(), "quasi_static": False, "start": GivenStart()}
    return discretise(scene.model_copy(update={"time": scene.time.model_copy(update=plain)}))


def start_state(scene: Scene) -> InitialState | None:
    """The equilibrium with tight bolts under what acts at t = 0; None for a scene without bolts and static start."""
    if not (scene.bolt or scene.time.start.type == "static"):
        return None
    from .statics.starts import undisplaced_equilibrium
    from .statics.statics import tightened

    discretised = discretise(scene)
    if scene.time.quasi_static:
        return tightened(discretised, {})
    return undisplaced_equilibrium(discretised, {})


def clamped(
    scene: Scene, problem: DiscretisedProblem, joints: str = "sticking"
) -> tuple[DiscretisedProblem, InitialState | None]:
    """The ``problem`` of a scene by ``without_scheme`` with the stiffness of the stress of the state at t = 0 where it
    counts, and that state; None where the ``joints`` do not stick, nothing acts, or the scene starts from initial
    values, where its joints are closed by their gaps.

    Raises
    ------
    SceneError : no equilibrium, or one that has buckled.
    """
    if joints != "sticking":
        return problem, None
    state = start_state(scene)
    if state is None:
        return _stressed_by_loads(problem, {}), None
    from .statics.prestressed import stressed_problem

    return stressed_problem(problem, state), state


def _damped(scene: Scene, remarks: list[Remark]) -> Scene:
    """The scene with the ratio of [damping] where nothing else is said; a remark names a band that was found."""
    table = scene.damping
    if table is None:
        return scene
    if table.band is None:
        found = _band_of(_SceneText(scene.text(), str(scene.base_dir), scene))
        table = table.model_copy(update={"band": found.ends})
        remarks += remarks_of("damping", [f"[damping] holds {100 * table.ratio:g} % of critical {found.words}"])
    completed: Scene = table.completed(scene.model_copy(update={"damping": table}))
    return completed


@dataclass(frozen=True)
class _SceneText:
    """A scene that is compared by its text."""

    text: str
    base_dir: str
    scene: Scene = field(compare=False)


@lru_cache(maxsize=8)
def _band_of(of: _SceneText) -> DampingBand:
    """The band of the damping of a scene that names none, from the modes of its undamped tightened assembly.

    Raises
    ------
    SceneError : the assembly has no elastic mode.
    """
    from .joined.damping_band import band_of
    from .joined.joined_assembly import JoinedAssembly, pressed_of

    plain = of.scene.model_copy(update={"damping": None})
    problem, state = clamped(plain, without_scheme(plain))
    joined = JoinedAssembly.of(problem, "sticking", pressed_of(problem, state))
    return band_of(plain, joined.modes(1))


def _damping_problems(
    scene: Scene, bodies: dict[str, Body], conditions: dict[str, Conditions], units: list[InterfaceUnit]
) -> Problems:
    """Damping that brakes what moves as a whole, and springs that relax in windows of several instants."""
    problems = Problems(drag_problems(scene, bodies, conditions, units))
    if scene.solver.window != 1 and any(isinstance(unit.behaviour, MaxwellJoint) for unit in units):
        what = "springs that relax are solved in windows of one instant"
        problems.add("solver.window", what, str(scene.solver.window), "1", "leave the window out")
    return problems


def _check_conditions(
    scene: Scene,
    bodies: dict[str, Body],
    conditions: Mapping[str, Conditions],
    problems: Problems,
    remarks: list[Remark],
) -> None:
    """What initial values and the conditions on the same nodes say against each other."""
    check_driven_starts(scene, bodies, conditions, problems, remarks)
    if any(s.initial_fields for s in scene.substructure.values()):
        remarks += remarks_of("initial_state", field_remarks(scene, bodies, conditions))


def _problem(
    scene: Scene,
    bodies: dict[str, Body],
    conditions: dict[str, Conditions],
    units: list[InterfaceUnit],
    cuts: Mapping[str, BoltCut],
    kept: KeptOperators | None,
    leave_out: bool,
) -> DiscretisedProblem:
    """The problem of checked bodies and interfaces, with its classes; ``kept`` and ``leave_out`` as for
    ``discretise``."""
    names = frozenset[str]()
    # bodies that are reduced have modes that depend on all their faces
    plain = not isinstance(scene.solver.propagator, (ReducedPropagatorTable, ModalPropagatorTable))
    if leave_out and plain:
        time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
        names = never_touched(scene, bodies, units, characteristic_traction(scene, bodies, time))
    problem = DiscretisedProblem.of(scene, bodies, conditions, units, cuts, kept, names).with_classes()
    if kept is not None:
        kept.bodies = bodies
        if kept.compared:
            return problem
    if scene.solver.skip_at_rest == "tolerance" and problem.units:
        time, arrival = problem.time, arrival_times(scene, problem.bodies, problem.units, problem.time)
        marched = {name: marched_share(t, time) for name, t in arrival.items()}
        problem = replace(problem, classes=cut_by_arrival(problem.classes, marched))
    return problem


def _conditions(
    body: Body,
    boundaries: dict[str, Boundary],
    ports: dict[str, Port],
    explicit: bool,
    problems: Problems,
    known: KeptOperators,
) -> Conditions:
    """``conditions_on`` a body, or those of the scene solved last where they are the same."""
    return known.again(
        f"conditions {body.name}",
        (body, boundaries, ports, explicit),
        lambda: conditions_on(body, boundaries, problems, ports, explicit),
    )


def _units(
    scene: Scene,
    bodies: dict[str, Body],
    conditions: Mapping[str, Conditions],
    problems: Problems,
    remarks: list[Remark],
    known: KeptOperators,
) -> list[InterfaceUnit]:
    """Interfaces of a scene, and those that stand for its springs and couplings; ``known`` : of the scene solved
    last."""
    faces = {name: joint for n, i in scene.interface.items() for name, joint in ((n, i), *i.dampers(n).items())}
    made = [build_interface(n, i, bodies, conditions, problems, remarks, known) for n, i in faces.items()]
    if scene.spring:
        made += spring_units(scene, bodies, problems)
    if scene.coupling:
        made += coupling_units(scene, bodies, problems)
    return [unit for unit in made if unit is not None]


def _remarks(problem: DiscretisedProblem, bodies: dict[str, Body], units: list[InterfaceUnit]) -> list[Remark]:
    """Remarks on sizes, materials, loads, interfaces, meshes, laws and the time scheme; ``bodies`` and ``units`` : all
    of the scene."""
    scene, scheme = problem.scene, problem.scheme
    return [
        *plausibility_remarks(replace(problem, bodies=bodies, units=units)),
        *remarks_of("size", section_remarks(problem.cuts.values(), scene.unit_system)),
        *remarks_of("redundant", redundancy_remarks(scene)),
        *remarks_of("redundant", loop_remarks(bodies, [unit for unit in units if unit.name in scene.interface])),
        *remarks_of("damping", modal_damping_remarks(bodies, units)),
        *remarks_of("locking", locking_remarks(scene, bodies)),
        *remarks_of("lumping", lumping_remarks(bodies) if scheme.explicit else []),
        *remarks_of("sampling", [] if scene.time.quasi_static else sampling_remarks(scene, problem.time)),
        *remarks_of("scheme", scheme_remarks(scene, problem.bodies, problem.units, scheme, problem.dt, problem.layers)),
    ]
