"""Static states before the motion: equilibrium at t = 0, and the tightening of bolts.

A static start (``time.start = "static"``) is the equilibrium under what acts at t = 0, as the initial state of the
motion. The static problem is the scene without inertia: the same meshes and interfaces, loads raised in increments to
their value at t = 0, faces driven by a velocity and moving ground at rest, no dashpots. Substructures that have a
velocity of their own are not in it. It is solved far more closely than the motion will be, so that the unbalanced rest
is negligible there.

Bolts are tightened by force control, friction included. The bolts of each order are tightened together, in increments,
from the tensions that they have by then to their forces (or to their shortenings); the shortenings of all others are
kept, so that their tensions follow. Every order is a static problem of its own, which starts from the equilibrium of
the order before. The shortening of a bolt that is being tightened is eliminated (``bolts``), so that the tension is met
exactly, whatever the contacts do.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import scipy.linalg as la

from ..assembly.body import Body, body_sides, side_stiffness
from ..assembly.bolts import BoltCut, check_yield
from ..assembly.conditions import Conditions, conditions_on
from ..assembly.initial_state import InitialState, TightBolts
from ..assembly.models import Kept
from ..assembly.press_fits import interference, loose_remarks, sliding_ones, strain_remark
from ..assembly.prestress import Prestress
from ..assembly.problem import DiscretisedProblem, SolverReadyProblem, settings_of, static_traction
from ..errors import Problem, Problems, SceneError
from ..fem.mesh import Array
from ..interface.laws import bonds
from ..latin.assembly import InterfaceUnit
from ..latin.interface_rows import InterfaceRows
from ..reader import scene_from_dict
from ..scene.body_loads import body_loads_of
from ..scene.boundaries import Absorbing, PrescribedAcceleration, PrescribedDisplacement, PrescribedVelocity
from ..scene.fields import GROUND, split_face
from ..scene.laws import InputLaw, TimeLaw
from ..scene.materials import DAMPING_KEYS
from ..scene.schema import Scene, toml_text
from ..scene.settings import StaticStart
from ..scene.units import UnitSystem
from .bolt_ends import unheld_ends
from .displaced_starts import at_rest
from .equilibrium import Equilibrium, equilibrium
from .falling_bodies import (
    closed_by_strains,
    falling_groups,
    falling_parts,
    held_by_friction_alone,
    held_in_place,
    relieved,
)
from .free_bodies import (
    FreeGroup,
    acting,
    allowed_motions,
    balanced_parts,
    free_groups,
    free_list,
    free_motions,
    loss_of_equilibrium,
    unheld,
    with_place,
)
from .places_at_rest import PRESSED, TOUCHES, gaps_of, least_displaced

_MOVES = 1e-6  # motion of a node that counts, for unit motions of bodies
_MOST = 500  # iterations of an increment
_NO_VISCOSITY: Final[Mapping[str, float]] = MappingProxyType({"viscosity": 0.0, "lateral_viscosity": 0.0})
_Tables = dict[str, Any]


@dataclass(frozen=True)
class Stage:
    """A solved stage of a run, for its derivatives (``sensitivities.tangents``).

    Attributes
    ----------
    problem, ready : of the stage. rows : its fields at the interfaces. start : initial state, None where it is that of
        the scene. operators : those of the static problems. static : whether it is one of those, with loads where
        ``loaded``. tightened : bolts that it tightens. end : of a static one, its equilibrium, bolts as tightened.
    """

    problem: DiscretisedProblem
    ready: SolverReadyProblem
    rows: InterfaceRows
    start: InitialState | None
    operators: Kept | None = None
    static: bool = False
    loaded: bool = True
    tightened: tuple[str, ...] = ()
    end: InitialState | None = None

    def likewise(self, whole: DiscretisedProblem) -> DiscretisedProblem:
        """The problem of this stage of another scene, whose bolts have the loads of this one."""
        if self.start is None:
            bolts = TightBolts()
        else:
            bolts = self.start.bolts
        ramps = self.problem.ramps or (bolts.locked(self.problem.cuts) if self.problem.cuts else {})
        if self.static:
            free = [name for name in self.tightened if whole.cuts[name].tension is not None]
            present = {unit.name for unit in self.problem.units}
            left_out = [unit.name for unit in whole.units if unit.name not in present]
            whole = static_problem(whole, static_scene(whole.scene, {}, self.loaded), free, left_out)
        return replace(whole, ramps=ramps)


def start_problems(
    scene: Scene, bodies: dict[str, Body], conditions: dict[str, Conditions], units: list[InterfaceUnit]
) -> Iterator[Problem]:
    """Reasons for which a scene with ``time.start = "static"`` has no unique static equilibrium."""
    still = resting(scene)
    if not still:
        yield Problem(
            "time.start",
            "every substructure has an initial velocity; none is at rest",
            "static",
            "given",
            'set time.start = "given"',
        )
        return
    for load in scene.body_loads:
        heated = [n for n in bodies if n not in still and load.acts_on(n, scene.substructure[n])]
        if load.kind.strains and heated and _at_start(load.name, load.law, {}) != 0.0:
            yield Problem(
                load.key,
                "heats a substructure that has an initial velocity from the start on: the static start leaves it "
                "out, so that it would begin without its expansion, and ring",
                heated[0],
                "substructures at rest, or a law that begins with 0",
                "list only the others in substructures",
            )
    for unit in units:
        moving = [name for _, _, name in body_sides([unit]) if name not in still]
        # pushed or held by a body that is not in equilibrium itself
        fit = bool(interference(unit).any())
        tied = bonds(unit.behaviour) or unit.behaviour.elastic or unit.preload > 0 or fit
        if moving and tied:
            yield Problem(
                f"interface.{unit.name}",
                "holds or presses a substructure that has an initial velocity, so that it is "
                "not in equilibrium at the start",
                moving[0],
                None,
                f"remove the velocity of {moving[0]}, give that of all bodies as [motion] velocity, or set "
                'time.start = "given"',
            )
    forces = acting(scene, {n: bodies[n] for n in still}, np.zeros(1))
    yield from unheld(start_groups(scene, bodies, conditions, units), forces, conditions, "time.start")


def start_groups(
    scene: Scene, bodies: Mapping[str, Body], conditions: Mapping[str, Conditions], units: list[InterfaceUnit]
) -> list[FreeGroup]:
    """Substructures at rest that nothing holds in a static start."""
    still, joints = resting(scene), static_interfaces(scene)
    there, restraints = {n: bodies[n] for n in still}, {n: conditions[n] for n in still}
    return free_groups(there, restraints, [u for u in units if u.name in joints])


def start_remarks(
    scene: Scene, bodies: Mapping[str, Body], conditions: Mapping[str, Conditions], units: list[InterfaceUnit]
) -> list[str]:
    """One sentence that lists the bodies that nothing holds in a static start: those whose place it chooses, and those
    that fall from theirs."""
    still, static = resting(scene), static_interfaces(scene)
    there, supports = {n: bodies[n] for n in still}, {n: conditions[n] for n in still}
    falling = falling_groups(scene, there, supports, [unit for unit in units if unit.name in static])
    taken = {name for group in falling for name in group.names}
    groups = [group for group in start_groups(scene, bodies, conditions, units) if taken.isdisjoint(group.motions)]
    place = "the static start takes the place with the least displacement, as a mean over the mass"
    parts = [*balanced_parts(groups, place), *falling_parts(falling)]
    if parts:
        return [f"substructures that nothing holds at t = 0: {free_list(parts)}"]
    return []


def static_state(
    whole: DiscretisedProblem,
    amplitudes: Mapping[str, float],
    tight: InitialState | None,
    operators: Kept,
    stages: list[Stage] | None = None,
) -> InitialState | None:
    """The equilibrium that the motion starts from; None where nothing acts at t = 0.

    Parameters
    ----------
    amplitudes : at t = 0, of loads that are set from outside; those left out have their start value.
    tight : state with tight bolts, None where there are none. kept : as for ``DiscretisedProblem.build``.
    stages : what was solved is added to these.

    Raises
    ------
    SceneError : contact and friction cannot hold the loads.
    """
    scene = static_scene(whole.scene, amplitudes)
    if whole.scene.time.quasi_static or not something_acts(scene):  # without inertia the loads come in its increments
        if tight is None:
            return tight
        return replace(tight, amplitudes=dict(amplitudes))
    discretised = static_problem(whole, scene)
    found, state = _solved_start(whole, discretised, amplitudes, tight, operators, stages is not None)
    size = static_size(whole, amplitudes)
    before: Mapping[str, Array] = {}
    if tight is not None:
        before = tight.traction
    closed = closed_by_strains(whole, before, state.traction, PRESSED * size)
    if loose := closed or held_by_friction_alone(whole, before, state.traction, PRESSED * size):
        other = static_problem(whole, scene, without=loose)
        solved = _solved_start(whole, other, amplitudes, tight, operators, stages is not None)
        overlaps = _overlaps(whole, solved[1], loose, size)
        if closed and overlaps:
            raise SceneError(overlaps, "the scene cannot be built")
        if not overlaps:
            discretised, (found, state) = other, solved
            state = replace(state, left_out=tuple(loose))
    if stages is not None:
        if tight is None:
            end = state
        else:
            end = replace(state, bolts=tight.bolts)
        stages.append(
            Stage(discretised, found.of_bodies, found.run.recorder.rows, tight, operators, static=True, end=end)
        )
    if tight is None:
        return state
    remarks = tuple(dict.fromkeys((*tight.remarks, *state.remarks)))
    return replace(state, message=f"{tight.message}; {state.message}", remarks=remarks, bolts=tight.bolts)


def static_size(whole: DiscretisedProblem, amplitudes: Mapping[str, float]) -> float:
    """Largest traction that what acts at t = 0 can bring, Pa."""
    scene = static_scene(whole.scene, amplitudes)
    bodies = {name: whole.bodies[name] for name in scene.substructure}
    tight = [cut.stress(whole.bodies[cut.table.substructure]) for cut in whole.cuts.values()]
    return max(static_traction(scene, bodies, np.array([0.0, 1.0])), *tight, 0.0)


def _solved_start(
    whole: DiscretisedProblem,
    discretised: DiscretisedProblem,
    amplitudes: Mapping[str, float],
    tight: InitialState | None,
    operators: Kept,
    bodies: bool,
) -> tuple[Equilibrium, InitialState]:
    """The static problem ``discretised`` of a start, solved, and its equilibrium, in which interfaces that it lacks
    carry nothing; ``bodies`` as for ``equilibrium``."""
    if (lost := loss_of_equilibrium(discretised)) is not None:
        raise _no_start(f"{lost.what}, and contact and friction cannot hold it")
    found = equilibrium(discretised, tight, settings_of(whole.scene), operators, bodies)
    converged, sentence = found.run.status()
    if not converged:
        raise _no_start(sentence)
    state = found.state(amplitudes)
    present, static = {unit.name for unit in discretised.units}, static_interfaces(whole.scene)
    absent = [unit for unit in whole.units if unit.name in static and unit.name not in present]
    nothing = {u.name: np.zeros((u.geometry.n_point, u.behaviour.n_component)) for u in absent}
    return found, replace(state, traction={**state.traction, **nothing})


def _overlaps(whole: DiscretisedProblem, state: InitialState, loose: Collection[str], size: float) -> Problems:
    """A problem for every interface of ``loose``, which carry nothing in an equilibrium, whose sides overlap where
    bodies have moved out of the way as far as they can (``places_at_rest``); ``size`` : of its tractions, Pa."""
    place = least_displaced(whole, state, size).displacement
    largest = max(float(np.abs(u).max(initial=0.0)) for u in place.values())
    problems = Problems()
    for name, gap in gaps_of(whole, [unit for unit in whole.units if unit.name in loose], place).items():
        # as exact as the place
        if gap.min(initial=0.0) < -TOUCHES * largest:
            problems.add(
                f"interface.{name}",
                "is open in the scene, nothing else holds its bodies, strains of t = 0 close it, and no motion of the "
                "bodies opens it again: whether it holds them depends on the way to this state",
                f"overlap {-float(gap.min()):.3g} {whole.scene.unit_system['m']}",
                "an interface that touches in the scene, or a gap that stays open",
                'give it gap = 0, a larger gap, or set time.start = "given"',
            )
    return problems


def _no_start(why: str) -> SceneError:
    return SceneError.of(
        "the scene cannot be built",
        "time.start",
        f"no static equilibrium under the loads of t = 0 was found: {why}",
        "static",
        "given",
        'support the bodies that slide or topple, or set time.start = "given"',
    )


def static_problem(
    whole: DiscretisedProblem,
    scene: Scene,
    free: Collection[str] = (),
    without: Collection[str] = (),
    prestress: Prestress | None = None,
) -> DiscretisedProblem:
    """The static problem on the meshes and interfaces that are there; ``free`` : bolts whose tension is given,
    ``without`` : interfaces left out, of bodies that fall. ``prestress`` : geometric stiffness of its bodies."""
    bodies = {name: whole.bodies[name] for name in scene.substructure}
    problems = Problems()
    conditions = {n: conditions_on(b, scene.boundaries_of(n), problems, scene.ports_of(n)) for n, b in bodies.items()}
    assert not problems, problems  # the same conditions stood before
    units = [unit for unit in whole.units if unit.name in scene.joints]
    falling = falling_groups(whole.scene, bodies, conditions, units)
    taken = {name for group in falling for name in group.names}
    units = [unit for unit in units if unit.name not in without]
    still = [group for group in free_groups(bodies, conditions, units) if taken.isdisjoint(group.motions)]
    groups = [*still, *(group.free for group in falling)]
    conditions = with_place(groups, bodies, held_in_place(falling, conditions), units)
    moved = {name: layer for name, layer in whole.layers.items() if name in bodies}  # loads of the motion that follows
    cuts = {name: replace(cut, loose=name in free) for name, cut in whole.cuts.items()}
    operators = None
    if whole.kept is not None and whole.kept.compared:
        operators = whole.kept
    problem = DiscretisedProblem.of(scene, bodies, conditions, units, cuts, operators)
    problem = replace(problem, prestress=prestress).with_classes(moved)
    return at_rest(relieved(problem, falling, moved))


def loose_bolts(
    scene: Scene,
    bodies: Mapping[str, Body],
    conditions: Mapping[str, Conditions],
    units: list[InterfaceUnit],
    cuts: Mapping[str, BoltCut],
) -> Problems:
    """A problem for every end of a bolt that nothing holds (``bolt_ends``), else for every bolt whose tension nothing
    resists while the bolts of its order are tightened: it could pull bodies without relative motion at any interface,
    open or closed."""
    still, joints = resting(scene), static_interfaces(scene)
    units = [unit for unit in units if unit.name in joints]
    # the ends of the bolts first: what they lean on counts where they are held
    problems = Problems(unheld_ends(cuts.values(), bodies, conditions, units))
    if problems:
        return problems
    pulled = [cut for cut in cuts.values() if cut.tension is not None and cut.moving.any()]
    for order in sorted({cut.table.order for cut in pulled}):
        group = [cut for cut in pulled if cut.table.order == order]
        # rigid motions, of bolts with the shortening beside them
        motions, rigid = {}, {name: allowed_motions(bodies[name], conditions[name]) for name in still}
        for name in still:
            jumps = [cut.motion for cut in group if cut.table.substructure == name]
            more = None
            if jumps:
                more = np.stack(jumps, axis=1)
            motions[name] = allowed_motions(bodies[name], conditions[name], more)
        apart = _pulled_apart(motions, rigid, units)
        moved = [n for n, u in apart.items() if np.abs(u).max(initial=0.0) > _MOVES]
        problems += [_loose(cut, moved, scene.unit_system) for cut in group if cut.table.substructure in moved]
    return problems


def _pulled_apart(
    motions: Mapping[str, Array], rigid: Mapping[str, Array], units: list[InterfaceUnit]
) -> dict[str, Array]:
    """Motions without relative motion at any interface (3 n_node, n) by substructure, but for those of all bodies as
    rigid ones: what nothing holds moves with its bolts."""
    free, whole = free_motions(motions, units), free_motions(rigid, units)
    moving = np.concatenate([motions[n] @ free[n] for n in motions])
    along = np.concatenate([rigid[n] @ whole[n] for n in motions])
    if along.size and moving.size:
        apart = moving - along @ la.lstsq(along, moving)[0]
    else:
        apart = moving
    ends = np.cumsum([len(motion) for motion in motions.values()])[:-1]
    return dict(zip(motions, np.split(apart, ends), strict=True))


def _loose(cut: BoltCut, moved: list[str], units: UnitSystem) -> Problem:
    """The problem of a bolt whose tension pulls the bodies ``moved`` without resistance."""
    body = cut.table.substructure
    others = ", ".join(name for name in moved if name != body)
    return Problem(
        f"bolt.{cut.name}.force",
        f"nothing resists the tension: one side of the cut of {body} can be pulled along the axis"
        + (f", with {others}" if others else ""),
        f"{cut.tension:g} {units['N']}",
        "interfaces or boundaries that hold both sides of the cut against each other",
        "add what lies between head and nut, or give a shortening",
    )


def resting(scene: Scene) -> list[str]:
    """Substructures without a velocity of their own."""
    return [n for n, s in scene.substructure.items() if not s.motion_keys]


def static_interfaces(scene: Scene) -> list[str]:
    """Interfaces that carry something at rest: not dashpots, nor those of bodies that move."""
    still = {GROUND, *resting(scene)}
    return [
        name
        for name, interface in scene.joints.items()
        if interface.behaviour not in ("viscous_joint", "maxwell_joint")
        and all(split_face(side)[0] in still for side in interface.sides)
    ]


def static_scene(scene: Scene, amplitudes: Mapping[str, float], loaded: bool = True) -> Scene:
    """The quasi-static scene whose last instant is the equilibrium under what acts at t = 0.

    Parameters
    ----------
    amplitudes : at t = 0, of loads that are set from outside; those left out have their start value.
    loaded : with loads, body forces and displaced faces, not with preloads alone.
    """
    assert isinstance(scene.time.start, StaticStart)
    data, still = scene.tables(), resting(scene)
    data["substructure"] = {n: data["substructure"][n] for n in still}
    # damping acts on rates
    for table in data["substructure"].values():
        table.pop("modal_damping", None)
    data["point_mass"] = {n: data["point_mass"][n] for n, m in scene.point_mass.items() if m.body in still}
    joints = static_interfaces(scene)
    data["interface"] = {n: table for n, table in data["interface"].items() if n in joints}
    # a dashpot beside the spring
    data["spring"] = {n: {**table, **_NO_VISCOSITY} for n, table in data["spring"].items() if n in joints}
    data["coupling"] = {
        n: data["coupling"][n] for n, c in scene.coupling.items() if all(e.body in {GROUND, *still} for e in c.ends)
    }
    for interface in data["interface"].values():
        interface.pop("ground_velocity", None)
    data["boundary"] = dict(_boundaries(scene, data["boundary"], still))
    data["load"] = dict(_loads(scene, data["load"], still, amplitudes))
    data["port"] = dict(_ports(scene, data["port"], still, amplitudes, loaded))
    for load in body_loads_of(scene):
        if loaded and load.kind.acts(load.table):
            amplitude = _at_start(load.name, load.law, amplitudes)
        else:
            amplitude = 0.0
        raised = None
        if amplitude:
            raised = _raised(amplitude)
        load.kind.at_rest(data, load.of, still, raised)
    if not loaded:
        data["load"] = {}
        for boundary in data["boundary"].values():
            # faces stay driven, at zero
            if "value" in boundary:
                boundary |= {"value": [0.0] * len(boundary["value"])}
    for material in data["material"].values():
        for key in (*DAMPING_KEYS, "at_frequency", "frame"):
            material.pop(key, None)
    # springs that relax carry nothing at rest
    for joint in (*data["interface"].values(), *data["spring"].values()):
        joint.pop("damping_ratios", None)
    # no time: a parameter of the loads
    data["time"] = {"end": 1.0, "instants": scene.time.start.increments, "quasi_static": True}
    # tolerance and all else: the defaults without inertia
    same = {"share_identical": scene.solver.share_identical, "threads": scene.solver.threads}
    data["solver"] = {"max_iterations": _MOST, **same}
    if scene.solver.operators is not None:
        data["solver"]["operators"] = scene.solver.operators.model_dump()
    for key in ("sensor", "limit", "accuracy", "output", "bolt", "spread", "damping", "motion"):
        data.pop(key, None)
    return scene_from_dict(data, scene.base_dir)


def start_data(whole: DiscretisedProblem, amplitudes: Mapping[str, float]) -> Iterator[Any]:
    """All that the state at t = 0 with tight bolts depends on: its scene, in which a load that begins with 0 does not
    stand, bolts, tolerances, and the numbers of meshes, which scenes name by files."""
    scene, settings = static_scene(whole.scene, amplitudes), settings_of(whole.scene)
    tables = {key: table for key, table in scene.tables().items() if key not in ("name", "description", "solver")}
    yield toml_text(tables | {"bolt": whole.scene.tables()["bolt"]})
    yield from (settings.tolerance, settings.force_tolerance, sorted(amplitudes.items()))
    yield from (part for item in whole.elongation.items() for part in item)
    for c in static_problem(whole, scene).classes:
        for member in c.members:
            yield from (member.name, member.stiffness, member.expansion, member.trace, member.channel_area)
            yield from (member.imposed_pattern, member.imposed_start, member.displacement, member.positions)
            yield from (part for load in member.loads for part in (load.name, load.pattern))
    for unit in whole.units:
        yield from (unit.name, unit.geometry.gap, unit.geometry.frames)


def static_operator_data(whole: DiscretisedProblem) -> Iterator[Any]:
    """All that the operators of the static problems of a scene depend on."""
    yield from (whole.scene.solver, side_stiffness(whole.bodies, whole.units, whole.layout))
    for c in whole.classes:
        member = c.members[0]
        yield from (c.key, member.stiffness, member.expansion, member.trace, member.channel_area)
        yield from (member.imposed_pattern, member.positions)
    yield from (cut.pattern for cut in whole.cuts.values())


def something_acts(scene: Scene) -> bool:
    """Whether anything moves or strains a body of a static scene."""
    return (
        bool(scene.load or scene.port)
        or any(i.preload or i.preload_force for i in scene.interface.values())
        or bool(scene.body_loads)
        or any(isinstance(b, PrescribedDisplacement) for b in scene.boundary.values())
    )


def _boundaries(scene: Scene, tables: _Tables, still: list[str]) -> Iterator[tuple[str, _Tables]]:
    for name, boundary in scene.boundary.items():
        table = tables[name]
        if "faces" in table:
            face = table["faces"][0]
        else:
            face = table["face"]
        if split_face(face)[0] not in still or isinstance(boundary, Absorbing):
            continue
        if isinstance(boundary, PrescribedVelocity | PrescribedAcceleration):
            # a face driven by a velocity stands still: its displacement at t = 0 is 0
            table = {**table, "type": "velocity", "value": [0.0] * len(boundary.value), "law": "constant"}
        elif isinstance(boundary, PrescribedDisplacement):
            table = {**table, "law": _raised(float(boundary.law.sample(np.zeros(1))[0]))}
        yield name, table


def _loads(
    scene: Scene, tables: _Tables, still: list[str], amplitudes: Mapping[str, float]
) -> Iterator[tuple[str, _Tables]]:
    for name, load in scene.load.items():
        amplitude = _at_start(name, load.law, amplitudes)
        if amplitude != 0.0 and split_face(load.face)[0] in still:
            yield name, {**tables[name], "law": _raised(amplitude)}


def _ports(
    scene: Scene, tables: _Tables, still: list[str], amplitudes: Mapping[str, float], loaded: bool
) -> Iterator[tuple[str, _Tables]]:
    """Ports at rest: moved faces stand still, and a wave is a force alone. ``loaded`` : with their forces."""
    for name, port in scene.port.items():
        if port.body not in still:
            continue
        laws = {}
        for source, component in port.inputs(name).items():
            acts = loaded and port.causality != "motion_in"
            laws[component] = _raised(_at_start(source, port.law(component), amplitudes) if acts else 0.0)
        if port.causality == "motion_in":
            causality = "motion_in"
        else:
            causality = "force_in"
        table = {key: value for key, value in tables[name].items() if key != "impedance"}
        yield name, {**table, "causality": causality, "laws": laws}


def _at_start(name: str, law: TimeLaw, amplitudes: Mapping[str, float]) -> float:
    """Amplitude of a law at t = 0; that of one set from outside is in ``amplitudes``."""
    amplitude = float(law.sample(np.zeros(1))[0])
    if isinstance(law, InputLaw):
        return amplitudes.get(name, amplitude)
    return amplitude


def _raised(amplitude: float) -> _Tables:
    return {"type": "table", "times": [0.0, 1.0], "values": [0.0, amplitude]}


_Ramps = dict[str, tuple[float, float]]


def fitted(whole: DiscretisedProblem, operators: Kept, stages: list[Stage] | None = None) -> InitialState:
    """The equilibrium of press fits and preloads alone (``press_fits``), bolts loose; ``operators`` and ``stages`` as
    for ``tightened``.

    Raises
    ------
    SceneError : no equilibrium was found, or the strains are too large.
    """
    scene = static_scene(whole.scene, {}, loaded=False)
    # all of it at once: a gap does not grow with the increments
    scene = scene.model_copy(update={"time": scene.time.model_copy(update={"instants": 1})})
    units = sliding_ones(whole.units)
    problem = replace(static_problem(replace(whole, units=units), scene), ramps=TightBolts().locked(whole.cuts))
    found = equilibrium(problem, None, settings_of(whole.scene), operators, stages is not None)
    converged, sentence = found.run.status()
    if not converged:
        raise _no_start(f"the press fits are not carried: {sentence}")
    state = found.state({})
    if stages is not None:
        stages.append(Stage(problem, found.of_bodies, found.run.recorder.rows, None, operators, True, False, (), state))
    said = [strain_remark(whole.bodies, problem.units, state.displacement, scene.unit_system["m"])]
    said += loose_remarks(problem.units, state.traction, problem.characteristic_traction)
    words = f"press fits closed, {sum(window.iterations for window in found.run.windows)} iterations"
    return replace(state, message=words, remarks=(*state.remarks, *said))


def tightened(
    whole: DiscretisedProblem, operators: Kept, stages: list[Stage] | None = None, start: InitialState | None = None
) -> InitialState:
    """The equilibrium with all bolts tight and no other load acting.

    Parameters
    ----------
    operators : ``kept`` of ``DiscretisedProblem.build``. stages : what was solved is added to these. start : state
    with press fits, before any bolt is tight.

    Raises
    ------
    SceneError : no equilibrium with such a force was found, or the mean stress of a bolt is above the yield stress.
    """
    scene, cuts = static_scene(whole.scene, {}, loaded=False), whole.cuts
    state = start
    bolts = TightBolts(dict.fromkeys(cuts, 0.0))
    increments = 0
    iterations = 0
    remarks = dict.fromkeys(() if start is None else start.remarks)
    for order in sorted({cut.table.order for cut in cuts.values()}):
        group = [cut for cut in cuts.values() if cut.table.order == order]
        ramps = _ramps(group, bolts, _tensions(cuts, bolts.shortening, state))
        free = [cut.name for cut in group if cut.tension is not None]
        problem = replace(static_problem(whole, scene, free), ramps=ramps)
        found = equilibrium(problem, state, settings_of(whole.scene), operators, stages is not None)
        converged, sentence = found.run.status()
        windows = found.run.windows
        if not converged:
            # increments that converged are the share of the way that was made
            share = sum(window.converged for window in windows) / scene.time.n_step
            raise _not_tight(group, ramps, share, sentence, scene.unit_system)
        increments += len(windows)
        iterations += sum(window.iterations for window in windows)
        before, names = state, tuple(cut.name for cut in group)
        state = found.state({})
        remarks |= dict.fromkeys(state.remarks)
        bolts = _locked(bolts, order, group, cuts, state)
        if stages is not None:
            end = replace(state, bolts=bolts)
            rows = found.run.recorder.rows
            stages.append(Stage(problem, found.of_bodies, rows, before, operators, True, False, names, end))
        # its factors are freed before those of the next order are made
        del found, windows
    assert state is not None, "a scene without bolts"
    _check_yield(whole, bolts)
    words = f"{len(cuts)} bolt(s) tightened in {len(bolts.orders)} step(s)"
    words += f", {increments} increment(s), {iterations} iterations"
    if start is not None:
        words = f"{start.message}; {words}"
    return replace(state, bolts=bolts, message=words, remarks=tuple(remarks))


def _ramps(group: Sequence[BoltCut], bolts: TightBolts, tensions: Mapping[str, float]) -> _Ramps:
    """First and last amplitude of the load of each bolt: shortening, or tension of those that have a force to reach."""
    ramps = {name: (amount, amount) for name, amount in bolts.shortening.items()}
    for cut in group:
        force, shortening = cut.tension, cut.table.shortening
        if force is not None:
            ramps[cut.name] = tensions[cut.name], force
        elif shortening is not None:
            ramps[cut.name] = 0.0, shortening
    return ramps


def _tensions(
    cuts: Mapping[str, BoltCut], shortening: Mapping[str, float], state: InitialState | None
) -> dict[str, float]:
    """Tension of each bolt in a state, N."""
    if state is None:
        return dict.fromkeys(cuts, 0.0)
    return {n: cut.force(shortening[n], state.displacement[cut.table.substructure]) for n, cut in cuts.items()}


def _locked(
    bolts: TightBolts, order: int, group: Sequence[BoltCut], cuts: Mapping[str, BoltCut], state: InitialState
) -> TightBolts:
    """The bolts with the shortenings that those of an order have in a state, and the tensions of all."""
    shortening = dict(bolts.shortening)
    for cut in group:
        force, prescribed = cut.tension, cut.table.shortening
        if force is not None:
            shortening[cut.name] = cut.shortening(force, state.displacement[cut.table.substructure])
        elif prescribed is not None:
            shortening[cut.name] = prescribed
    now = _tensions(cuts, shortening, state)
    return TightBolts(
        shortening, (*bolts.orders, order), {name: (*bolts.forces.get(name, ()), force) for name, force in now.items()}
    )


def _not_tight(group: Sequence[BoltCut], ramps: _Ramps, share: float, why: str, units: UnitSystem) -> SceneError:
    """The error of bolts that reached only a share of their force, or shortening."""
    reached = []
    for cut in group:
        first, last = ramps[cut.name]
        unit = units["m" if cut.tension is None else "N"]
        reached.append(f"{cut.name} {first + share * (last - first):.6g} of {last:.6g} {unit}")
    return SceneError.of(
        "the scene cannot be built",
        f"bolt.{group[0].name}",
        f"bolts of order {group[0].table.order} cannot be tightened, no equilibrium was found; reached: "
        f"{', '.join(reached)}. {why[:1].upper()}{why[1:]}",
        None,
        "closed faces under head and nut and between the parts, which can hold the force",
        "check the gaps on the way of the force and what keeps the parts from sliding, or raise time.start.increments",
    )


def _check_yield(whole: DiscretisedProblem, bolts: TightBolts) -> None:
    """Refuse bolts whose mean stress was above the yield stress while they were tightened. Raises SceneError."""
    problems = Problems()
    for name, cut in whole.cuts.items():
        check_yield(name, max(bolts.forces[name]), cut, whole.bodies[cut.table.substructure], problems)
    if problems:
        raise SceneError(problems, "the scene cannot be built")
