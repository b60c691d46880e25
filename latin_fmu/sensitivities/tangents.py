"""Derivatives of a run by parameters of its scene: static start, tightening and march (``kernels.tangent_march``).

What a parameter changes in the data of the problem (loads, motions, initial values, gaps, parameters of laws) is the
central difference of two discretised scenes, exact where the data is linear in it. The derivative of the solution then
follows stage by stage from the solution itself: the bolts of each order, the static equilibrium, the motion; each stage
hands displacements, tractions, closures and shortenings to the next one, as the run does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, cast

import numpy as np
import scipy.sparse as sp

from ..assembly.body import body_sides
from ..assembly.initial_state import InitialState
from ..assembly.models import Kept, KeptOperators
from ..assembly.problem import DiscretisedProblem
from ..assembly.yielding_bolts import Yielding
from ..building import discretise
from ..errors import Problem, SceneError, SolverError, listed
from ..interface.laws import coulomb_coefficient
from ..latin.assembly import Array, Layout
from ..latin.probes import BoltPlace, OutputRequest
from ..latin.recorder import Recorder
from ..march import MarchedRun
from ..propagator import Histories, LoadTerm, SubstructureModel
from ..propagator.image import Image
from ..propagator.model import share_operators
from ..results.sensitivities import HistoryChanges
from ..scene.overrides import no_number, number_at
from ..scene.schema import Scene
from ..statics.displaced_starts import displaced_bodies
from ..statics.places_at_rest import least_displaced
from ..statics.statics import Stage, static_size
from ..time_scheme import QuasiStatic
from .copies import MARK, Marched, assembled, copied, differences, models_of, named, of_copy, places_in, twins, unit_of
from .data_changes import (
    MATRICES,
    Ends,
    StateChange,
    VariedParameter,
    balance_start,
    bolt_changes,
    changed_bolt,
    changed_model,
    changed_unit,
    friction_changes,
    ground_changes,
    hand_over,
    law_changes,
    ramp_changes,
    slope_of,
)
from .reduced_tangents import marched_by_modes
from .tangent_run import SolvedFields, TangentRun

_STEP: Final = 1e-4
"""Change of a parameter over its value in the differences of data; of one that is 0 the change itself."""
_UNCHANGED: Final = 1e-9
"""Of the largest displacement of a start, its change by a parameter over its value that is round-off."""
_ON_LIMIT: Final = 1e-6  # share of the friction limit
_Matrices = tuple[sp.csr_array | None, ...]


def check_run(problem: DiscretisedProblem, elsewhere: bool) -> None:
    """Refuse runs whose derivatives are not known. Raises SceneError."""
    scene, solver = problem.scene, problem.scene.solver
    refused = {
        "on several processes, or with user-defined laws": elsewhere,
        "with output.interfaces_every above 1": scene.output.interfaces_every > 1,
        "with windows of several instants": solver.window != 1 and problem.scene.time.n_step > 1,
        "with an explicit scheme": problem.scheme.explicit,
        "with reduced bodies or conjugate gradients": solver.propagator.type not in ("automatic", "direct", "modal"),
        "with bolts that may yield": bool(Yielding(scene).tables),
        "with initial displacements on top of a static start": bool(displaced_bodies(scene)),
        "with rigid bodies, or soft contacts that are pressed, in contact at t = 0": _pressed_at_start(problem),
    }
    if reasons := [reason for reason, found in refused.items() if found]:
        remedy = "leave output.sensitivities out, or change that"
        problems = [Problem("output.sensitivities", f"not known {reason}", None, None, remedy) for reason in reasons]
        raise SceneError(problems, "the scene cannot be built")


def _pressed_at_start(problem: DiscretisedProblem) -> bool:
    """Whether contact forces at t = 0 are found from accelerations, or from a law that is not linear there."""
    if isinstance(problem.scheme, QuasiStatic):
        return False
    rigid, from_state = (
        {name for name, body in problem.bodies.items() if body.rigid},
        problem.scene.time.start.type == "given",
    )
    opening = [unit for unit in problem.units if unit.behaviour.opens]
    closed = [u for u in opening if u.geometry.gap.min(initial=np.inf) <= 0.0]
    return any(
        any(name in rigid for _, _, name in body_sides([u]))
        or (from_state and u.behaviour.compliant and u.geometry.gap.min() < 0)
        for u in closed
    )


def value_of(scene: Scene, name: str) -> float:
    """Value of a parameter of a scene, by its dotted name.

    Raises
    ------
    SceneError : there is no number under this name.
    """
    value = number_at(scene.tables(), name)
    if value is None:
        raise SceneError([no_number("output.sensitivities", scene.tables(), name)], "the scene cannot be built")
    return value


def parameters_of(whole: Scene, problem: DiscretisedProblem) -> list[VariedParameter]:
    """The parameters by which results of a scene are differentiated; ``problem`` : of this scene.

    Raises
    ------
    SceneError : one that is no number, or that changes what the derivatives take as given.
    """
    varied = []
    for name in whole.differentiated:
        value = value_of(whole, name)
        step = _STEP * abs(value) or _STEP
        ends = []
        for sign in (1.0, -1.0):
            other = _changed(whole.replace(name, value + sign * step), problem)
            if reason := differences(problem, other):
                raise _refused(name, reason)
            ends.append(other)
        varied.append(VariedParameter(name, value, 2.0 * step / (value or 1.0), *ends))
    return varied


def _changed(scene: Scene, problem: DiscretisedProblem) -> DiscretisedProblem:
    """The problem of a scene with another value of a parameter."""
    return discretise(scene, None, (problem.kept or KeptOperators()).beside(problem.bodies))


def _refused(name: str, reason: str) -> SceneError:
    remedy = "derivatives are known by friction, gaps, bolts, loads, motions, initial values, materials; omit it"
    return SceneError([Problem("output.sensitivities", reason, name, None, remedy)], "the scene cannot be built")


@dataclass(frozen=True)
class Tangents:
    """Derivatives of a run.

    Attributes
    ----------
    problem : of the run. parameters : of its scene. stages : static ones that it starts from, as they are solved.
    """

    problem: DiscretisedProblem
    parameters: Sequence[VariedParameter]
    stages: list[Stage]

    @staticmethod
    def of(scene: Scene, problem: DiscretisedProblem, elsewhere: bool) -> Tangents:
        """Those of the parameters that the scene names; ``elsewhere``: in a run on several processes, or with laws of
        the caller.

        Raises
        ------
        SceneError : parameters, or a run, that they are not known for.
        """
        check_run(problem, elsewhere)
        return Tangents(problem, parameters_of(scene, problem), [])

    @property
    def of_bodies(self) -> list[str]:
        """Parameters that change mass or stiffness, so that the run has to march the bodies."""
        return [p.name for p in self.parameters if p.changes_bodies]

    def check_modes(self) -> None:
        """Refuse a march by the modes of the assembly that these parameters do not allow. Raises SceneError."""
        remedy = 'omit it, or set solver.propagator = "automatic", which marches the bodies then'
        what = "changes mass or stiffness: such derivatives take the march of the bodies, not that of the modes"
        allowed = "frictions, gaps, bolts, loads, motions, initial values, damping"
        problems = [Problem("output.sensitivities", what, name, allowed, remedy) for name in self.of_bodies]
        if problems:
            raise SceneError(problems, "the scene cannot be built")

    @property
    def statics(self) -> Kept | None:
        """Operators of the static start; None where there is none."""
        if self.stages:
            return self.stages[-1].operators
        return None

    def motion(self, run: MarchedRun) -> Stage:
        """The motion of the run as a stage, with the fields of what was marched."""
        recorder = run.recorder if run.marched is None else run.marched
        return Stage(self.problem, run.problem, recorder.rows, run.problem.start)

    def march(self, run: MarchedRun, progress: Callable[[int, int], None] | None = None) -> list[HistoryChanges]:
        """Derivatives by each parameter, from the histories of the run; ``progress`` is called at the start of a static
        stage, and with the instants of the motion that are done, and all. What it raises ends the march.

        Raises
        ------
        SolverError : an instant has no unique derivative.
        """
        parameters, states = self.parameters, self._placed(self._at_start(progress))
        motion = self.motion(run)
        if motion.ready.reduced is None:
            found = [*_histories(_march(motion, parameters, states, progress), len(parameters))]
        else:
            found = marched_by_modes(motion, cast(Recorder, run.marched), parameters, states, progress)
        return [
            HistoryChanges(p.name, p.value, of.interfaces, of.sensors, of.bolts, friction_changes(p))
            for p, of in zip(parameters, found, strict=True)
        ]

    def _at_start(self, progress: Callable[[int, int], None] | None = None) -> list[StateChange]:
        """The derivatives of the end of the static stages (parameters, errors: ``march``)."""
        parameters, states = self.parameters, [StateChange() for _ in self.parameters]
        for stage in self.stages:
            if progress is not None:
                progress(0, len(stage.problem.time))  # what it raises is no failure of the stage
            try:
                ended = _march(stage, parameters, states)
            except SolverError as error:
                if stage.tightened:
                    how = f"tightening of {listed(stage.tightened)}"
                else:
                    how = "static start"
                where = f"where t goes from 0 to 1 s in the increments of the {how}, before the run"
                remedy = "bonded faces whose meshes do not match may leave them undetermined: take the points of such "
                remedy += "an interface from the side that has fewer (points_from)"
                raise SolverError(f"{error}, {where}; {remedy}") from None
            states = [_state_after(stage, ended, i, p, states[i]) for i, p in enumerate(parameters)]
        return states

    def stressed(self, problem: DiscretisedProblem, start: InitialState) -> Tangents:
        """The derivatives of a run with the stiffness of the stress of its start; ``problem`` : with it.

        That stiffness is that of the static start, whose derivative must be 0, as its own is not known.

        Raises
        ------
        SceneError : a parameter that changes the start. SolverError : as for ``march``.
        """
        largest = max((float(np.abs(u).max(initial=0.0)) for u in start.displacement.values()), default=0.0)
        slides = _sliding(problem, start)
        for parameter, state in zip(self.parameters, self._at_start(), strict=True):
            moved = max((float(np.abs(u).max(initial=0.0)) for u in state.displacement.values()), default=0.0)
            by_friction = any(friction for name, friction in friction_changes(parameter).items() if name in slides)
            if moved <= _UNCHANGED * largest and not by_friction:
                continue
            raise SceneError.of(
                "derivatives cannot be taken",
                "output.sensitivities",
                "changes the state at t = 0, whose stress has a stiffness in this run: its derivative is not known",
                parameter.name,
                "parameters that change the motion alone (loads after t = 0, damping, densities, frictions of joints "
                "that stick at t = 0)",
                'omit it, or take the derivatives of the scene without this stiffness by effects.prestress = "off"',
            )
        return replace(self, problem=problem)

    def _placed(self, states: Sequence[StateChange]) -> list[StateChange]:
        """The derivatives of the start with those of the places of bodies that its equilibrium leaves free, which are
        taken as differences of both ends of a parameter."""
        end = self.stages[-1].end if self.stages else None
        if end is None or self.problem.scene.time.quasi_static:
            return list(states)
        size = static_size(self.problem, end.amplitudes)
        if least_displaced(self.problem, end, size) is end:
            return list(states)
        changes = []
        for p, change in zip(self.parameters, states, strict=True):
            more, less = (
                least_displaced(whole, _moved(end, change, 0.5 * sign * p.span), size).displacement
                for whole, sign in ((p.more, 1.0), (p.less, -1.0))
            )
            placed = {name: (more[name] - less[name]) / p.span for name in change.displacement}
            changes.append(replace(change, displacement=placed))
        return changes


def _sliding(problem: DiscretisedProblem, start: InitialState) -> set[str]:
    """Interfaces with points on their friction limit in an equilibrium."""
    found = set[str]()
    for unit in problem.units:
        traction, coefficient = start.traction.get(unit.name), coulomb_coefficient(unit.behaviour)
        if traction is None or not coefficient:
            continue
        limit = coefficient * np.maximum(-traction[:, 0], 0.0)
        shear = np.linalg.norm(traction[:, 1:], axis=1)
        if (shear > (1.0 - _ON_LIMIT) * limit)[limit > _ON_LIMIT * limit.max(initial=0.0)].any():
            found.add(unit.name)
    return found


def _histories(run: TangentRun, copies: int) -> Iterator[Marched]:
    """Histories of all copies of a run of derivatives."""
    interfaces, sensors = run.recorder.interfaces(), run.recorder.sensors(run.assembly)
    bolts = run.recorder.bolt_histories()
    for i in range(copies):
        yield Marched(of_copy(interfaces, i), of_copy(sensors, i), of_copy(bolts, i))


def _moved(state: InitialState, change: StateChange, by: float) -> InitialState:
    """An equilibrium at another value of a parameter, larger ``by`` so much."""
    moved = {name: u + by * change.displacement[name] for name, u in state.displacement.items()}
    return replace(state, displacement=moved)


def _march(
    stage: Stage,
    parameters: Sequence[VariedParameter],
    states: Sequence[StateChange],
    progress: Callable[[int, int], None] | None = None,
) -> TangentRun:
    """Derivatives of one stage from those of its initial state; ``progress`` as for ``Tangents.march``."""
    problem, base = stage.problem, stage.ready.assembly
    ends = [(stage.likewise(p.more), stage.likewise(p.less)) for p in parameters]
    units = [
        unit_of(copy, changed_unit(unit, p, (more.units[i], less.units[i])))
        for copy, (p, (more, less)) in enumerate(zip(parameters, ends, strict=True))
        for i, unit in enumerate(problem.units)
    ]
    layout, dt = Layout(units), problem.dt
    places = places_in(base.layout, layout, len(problem.units), len(parameters))
    operators = OperatorChanges.of(stage, parameters, ends)
    copies, histories = _copies(stage, parameters, states, ends, operators)
    classes = [
        replace(c, members=members, channels=np.concatenate([to[c.channels] for to in places], axis=1))
        for c, members in zip(problem.classes, copies, strict=True)
    ]
    impedance = np.zeros(layout.n_flat)
    for to in places:
        impedance[to] = problem.impedance
    assembly = assembled(stage, classes, units, layout, impedance)
    balance_start(stage, assembly)
    hand_over(states, assembly)
    for propagator in assembly.propagators:
        propagator.energy = False  # quadratic in the motion: derivatives have none
        propagator.begin([histories[name] for name in propagator.names], dt)
    ground, n = dict[int, Array](), len(base.interfaces)
    for copy, (parameter, pair) in enumerate(zip(parameters, ends, strict=True)):
        ground |= {copy * n + i: velocity for i, velocity in ground_changes(base, parameter, pair).items()}
    assembly.begin(problem.time, dt, ground, assembly.ground.start)
    sensors, bolts = dict[str, Any](), dict[str, Any]()
    for copy in range(len(parameters)):
        sensors |= copied(stage.ready.output.sensors, copy)
        bolts |= copied(stage.ready.output.bolts, copy, changed_bolt)
    recorder = Recorder(assembly, OutputRequest(sensors=sensors, bolts=bolts), {})
    changes = [law_changes(p, more.layout, less.layout) for p, (more, less) in zip(parameters, ends, strict=True)]
    solved, forced = SolvedFields(base, stage.rows, changes), operators is not None
    run = TangentRun(assembly, stage.ready.settings, recorder, solved, forced)
    if operators is None:
        run.march(None, progress)
        return run
    run.march(lambda n, row: operators.act(run.image, n, row), progress)
    for name, series in operators.tensions().items():
        recorder.series("tension")[name][...] += series
    return run


def _copies(
    stage: Stage,
    parameters: Sequence[VariedParameter],
    states: Sequence[StateChange],
    ends: Sequence[Ends],
    operators: OperatorChanges | None,
) -> tuple[list[list[SubstructureModel]], dict[str, Histories]]:
    """Members of each class, those of the first parameter first, and what drives them by name."""
    classes = list[list[SubstructureModel]]()
    histories = dict[str, Histories]()
    time = stage.problem.time
    ramps = [ramp_changes(stage, p, state) for p, state in zip(parameters, states, strict=True)]
    for c in stage.problem.classes:
        members = []
        for copy, (parameter, pair) in enumerate(zip(parameters, ends, strict=True)):
            for model in c.members:
                member, driven = changed_model(model, time, parameter, pair, states[copy], ramps[copy])
                if operators is not None and (force := operators.start(copy, model.name)) is not None:
                    member = replace(member, loads=[*member.loads, LoadTerm(MARK, force)])
                    driven = replace(driven, amplitudes=[*driven.amplitudes, np.eye(1, len(time))[0]])
                members.append(replace(member, name=named(copy, model.name)))
                histories[members[-1].name] = driven
        share_operators(c.members[0], members[0])
        classes.append(members)
    return classes, histories


class OperatorChanges:
    """Changes of stiffness, damping and mass by parameters: the forces with which they act on the derivatives.

    With P = C' v + K' u of the run, and with Maxwell branches what these add to it (``_Strains``), w =
    ``force_weight``, o = ``force_old`` - ``memory_weight`` and the weights of M a in the scheme, the force g of an
    instant, which the scheme takes with the weights of loads, obeys

        w g + o g_old = -(w P + o P_old + mass_weight M' a + mass_old M' a_old),    g = -(P + M' a) at t = 0.

    The motion of the run is that of a march under the tractions known, ahead of the derivatives.

    Parameters
    ----------
    stage : of the run. changes : (M', C', K') on the full dofs, each None where it is zero, by copy and body; strains :
    Maxwell branches likewise.
    bolts : by copy and name, with the derivatives of stiffness and pattern.
    """

    def __init__(
        self,
        stage: Stage,
        changes: Mapping[tuple[int, str], _Matrices],
        strains: Mapping[tuple[int, str], _Strains],
        bolts: Mapping[str, BoltPlace],
        copies: int,
    ) -> None:
        base = stage.ready.assembly
        problem = stage.problem
        self._copies = copies
        ready = replace(problem, kept=twins(stage)).build(stage.start, stage.operators)
        ready.assembly.rest_traction = -1.0
        recorder = Recorder(ready.assembly, OutputRequest(bolts=bolts), {})
        solved = SolvedFields(base, stage.rows, [None])
        self._run = TangentRun(ready.assembly, stage.ready.settings, recorder, solved)
        self._recorder, self._changes = recorder, changes
        places = [(c, j) for c, p in enumerate(ready.assembly.propagators) for j in range(len(p.members))]
        self._places = {ready.assembly.propagators[c].names[j]: (c, j) for c, j in places}
        self._strains = {key: strains for key, strains in strains.items() if strains.branches}
        # u, v, a (3, n) of the bodies at the last instant marched; g, P and M' a there, by change
        self._motion = {name: self._start(*place) for name, place in self._places.items()}
        self._last: dict[tuple[int, str], tuple[Array, Array, Array]] = {}
        self._known: dict[tuple[int, str], list[Array]] = {key: [] for key in changes}  # g (n, 1) of instants to come
        for key in changes:
            static, inertia = (part[:, 0] for part in self._parts(key, 0, self._motion[key[1]][..., None], None))
            self._last[key] = -(static + inertia), static, inertia

    def _start(self, c: int, j: int) -> Array:
        state = self._run.assembly.propagators[c].state
        return np.stack([state.u[:, j], state.v[:, j], state.a[:, j]])

    @staticmethod
    def of(stage: Stage, parameters: Sequence[VariedParameter], ends: Sequence[Ends]) -> OperatorChanges | None:
        """Those of a stage; None where no parameter changes a matrix."""
        changes, bolts = dict[tuple[int, str], _Matrices](), dict[str, BoltPlace]()
        strains, present = dict[tuple[int, str], _Strains](), models_of(stage.problem)
        dt, scheme = stage.problem.dt, stage.problem.scheme
        for copy, (parameter, pair) in enumerate(zip(parameters, ends, strict=True)):
            more, less = (models_of(end) for end in pair)
            for name, model in more.items():
                # without inertia velocities are those of increments, and no damping acts
                matrices = tuple(
                    None
                    if key == "damping" and isinstance(scheme, QuasiStatic)
                    else slope_of(getattr(model, key), getattr(less[name], key), parameter.span)
                    for key in MATRICES
                )
                present_branches, ends_of = (
                    present[name].branches.marched(scheme),
                    (model.branches, less[name].branches),
                )
                if any(matrix is not None for matrix in matrices) or (
                    len(present_branches) and ends_of[0] != ends_of[1]
                ):
                    changes[copy, name] = matrices
                    weights = [branches.weights(scheme, dt) for branches in (present_branches, *ends_of)]
                    strains[copy, name] = _Strains(
                        len(present_branches) > 0, weights, model.stiffness, matrices[2], parameter.span
                    )
            for name, place in stage.ready.output.bolts.items():
                cuts = [end.cuts[name] for end in (parameter.more, parameter.less)]
                up, down = (cut.terms({}) for cut in cuts)
                terms = {load: (up[load] - down[load]) / parameter.span for load in up}
                pattern = sp.csr_array((cuts[0].rows - cuts[1].rows) / parameter.span)
                bolts[named(copy, name)] = replace(place, pattern=pattern, terms=terms)
        if changes:
            return OperatorChanges(stage, changes, strains, bolts, len(parameters))
        return None

    def start(self, copy: int, name: str) -> Array | None:
        """Force (n_full,) on a body at t = 0, N."""
        if (copy, name) in self._last:
            return self._last[copy, name][0]
        return None

    def act(self, image: Image, n: int, row: int) -> None:
        """Write the forces of the next n instants into the image of the derivatives, from a row on."""
        for c, propagator in enumerate(image.propagators):
            constant = propagator.forcing.loads_over_time()[0]
            rows = image.class_field(c, "forces", image.rows, *constant.shape)[row : row + n]
            rows[:] = constant
            base = self._run.assembly.propagators[c]
            m = len(base.members)
            for copy, name in self._changes:
                if name in base.names:
                    j = base.names.index(name)
                    rows[:, :, copy * m + j] += (base.members[j].expansion.T @ self._next((copy, name), n)).T

    def _next(self, key: tuple[int, str], n: int) -> Array:
        """g (n_full, n) of a change at the next n instants."""
        parts = self._known[key]
        while sum(part.shape[1] for part in parts) < n:
            self._advance()
        every = np.concatenate(parts, axis=1)
        parts[:] = [every[:, n:]]
        return every[:, :n]

    def _advance(self) -> None:
        """March the run over the next instants, and find the forces there."""
        first, n, row = self._run.block()
        image, weights = self._run.image, self._run.image.run[0]
        new, old = float(weights["force_weight"]), float(weights["force_old"] - weights["memory_weight"])
        if self._run.assembly.quasi_static:
            new, old = 1.0, 0.0
        motions = {}
        for name, (c, j) in self._places.items():
            size = self._run.assembly.propagators[c].state.u.shape
            course = image.class_field(c, "course", image.rows, 3, *size)[row : row + n, :, :, j]
            motions[name] = np.concatenate([self._motion[name][..., None], course.transpose(1, 2, 0)], axis=2)
            self._motion[name] = motions[name][..., -1].copy()
        for key in self._changes:
            motion = motions[key[1]]
            before, now = motion[..., :-1], motion[..., 1:]
            static, inertia = self._parts(key, first, now, before)
            # what the next instant takes of this one has the velocity of the state
            if weights["force_old"] != 0.0:
                old_static = self._parts(key, first, now, None)[0]
            else:
                old_static = static
            if key in self._strains:
                strained = self._strained(key, first, motion)
                static, old_static = static + strained, old_static + strained
            force, earlier, inertia_before = self._last[key]
            forces = np.empty_like(static)
            for i in range(n):
                total = new * static[:, i] + old * earlier
                total += weights["mass_weight"] * inertia[:, i] + weights["mass_old"] * inertia_before
                force = forces[:, i] = -(total + old * force) / new
                earlier, inertia_before = old_static[:, i], inertia[:, i]
            self._last[key] = force.copy(), earlier.copy(), inertia_before.copy()
            self._known[key].append(forces)

    def _strained(self, key: tuple[int, str], first: int, motion: Array) -> Array:
        """What Maxwell branches add to P (n_full, n) of a body at instants from ``first`` on; ``motion`` (3, n_dof,
        n + 1) from the instant before."""
        c, j = self._places[key[1]]
        propagator = self._run.assembly.propagators[c]
        whole = propagator.members[j].expansion @ motion[0]
        if propagator.forcing.moves:
            imposed = propagator.forcing.imposed_u
            whole += np.stack([imposed(first - 1 + i)[:, j] for i in range(whole.shape[1])], axis=1)
        return self._strains[key].forces(whole)

    def tensions(self) -> dict[str, Array]:
        """What the changes of the cuts of bolts add to the derivatives of their tensions, by copy and name."""
        return self._recorder.series("tension")

    def _parts(self, key: tuple[int, str], first: int, now: Array, before: Array | None) -> tuple[Array, Array]:
        """P and M' a (n_full, n) of a body at instants from ``first`` on, from its motion ``now`` (3, n_dof, n).
        ``before``: that of one instant earlier each, for P with the velocity of the equation of motion, which is not
        that of the state where dofs have no mass."""
        c, j = self._places[key[1]]
        propagator, run = self._run.assembly.propagators[c], self._run.image.run[0]
        forcing, expand = propagator.forcing, propagator.members[j].expansion
        u, velocity, a = now
        gain = float(run["displacement_gain"])
        if before is not None and gain != 0.0 and not self._run.assembly.quasi_static:
            u_old, v_old, a_old = before
            u_free = u_old + float(run["u_v"]) * v_old + float(run["u_a"]) * a_old
            v_free = v_old + float(run["v_a"]) * a_old
            velocity = v_free + float(run["velocity_gain"]) / gain * (u - u_free - float(run["u_late"]) * v_free)
        imposed = (forcing.imposed_a, forcing.imposed_v, forcing.imposed_u)
        static, inertia = np.zeros((2, expand.shape[0], u.shape[1]))
        for number, (matrix, motion, imposed_at) in enumerate(
            zip(self._changes[key], (a, velocity, u), imposed, strict=True)
        ):
            if matrix is None:
                continue
            whole = expand @ motion
            if forcing.moves:
                whole += np.stack([imposed_at(first + i)[:, j] for i in range(u.shape[1])], axis=1)
            (static if number else inertia)[...] += matrix @ whole
        return static, inertia


@dataclass
class _Strains:
    """Maxwell branches of a body whose matrices or branches change by a parameter: K' s + K s', s = sum_j g_j e_j of
    the run and s' its derivative by the branches, both along the displacements of the run (``kernels.maxwell``).

    Attributes
    ----------
    branches : whether there are any. weights : of the branches of the run, and with the parameter a little larger and a
        little smaller (4, n_branch). stiffness : K. change : K', None where it does not change. span : difference of
        the parameter.
    """

    branches: bool
    weights: Sequence[Array]
    stiffness: sp.csr_array
    change: sp.csr_array | None
    span: float

    def __post_init__(self) -> None:
        n = self.stiffness.shape[0]
        self._elongations = [np.zeros((weights.shape[1], n)) for weights in self.weights]

    def forces(self, displacement: Array) -> Array:
        """Forces (n_full, n) at n instants, from the displacements (n_full, n + 1) at these and at the one before."""
        strains = np.zeros((3, *displacement[:, 1:].shape))
        for number, ((strength, decay, moved, _), elongation) in enumerate(
            zip(self.weights, self._elongations, strict=True)
        ):
            for i, step in enumerate(np.diff(displacement, axis=1).T):
                elongation[:] = decay[:, None] * elongation + moved[:, None] * step
                strains[number, :, i] = strength @ elongation
        present, more, less = strains
        forces: Array = self.stiffness @ ((more - less) / self.span)
        return forces if self.change is None else forces + self.change @ present


def _state_after(
    stage: Stage, run: TangentRun, copy: int, parameter: VariedParameter, state: StateChange
) -> StateChange:
    """Derivative of the state at the end of a static stage, as ``statics.state_at_end`` and ``statics._locked``."""
    assembly, head = run.assembly, named(copy, "")
    displacement = dict[str, Array]()
    traction = dict[str, Array]()
    closure = dict[str, Array]()
    for p in assembly.propagators:
        imposed = p.forcing.imposed_u(p.instant)
        for j, member in enumerate(p.members):
            if member.name.startswith(head):
                name = member.name.removeprefix(head)
                displacement[name] = member.expansion @ p.state.u[:, j] + imposed[:, j]
    gaps = dict(zip(map(id, assembly.layout.groups), run.gaps(), strict=True))
    pressed = {unit.name: i for i, unit in enumerate(stage.ready.assembly.interfaces)}
    for i, unit in enumerate(assembly.interfaces):
        if not unit.name.startswith(head):
            continue
        name, group = unit.name.removeprefix(head), assembly.layout.group(i)
        points = group.members[i]
        traction[name] = group.block(run.f_hat)[0, points]
        if unit.behaviour.opens and not unit.behaviour.elastic:
            number = pressed[name]
            whole = stage.ready.assembly.layout.group(number)
            end = whole.block(stage.rows.f_hat[-1])[0, whole.members[number]]
            closure[name] = np.where(end[:, 0] < 0.0, gaps[id(group)][points], 0.0)
    shortening = dict(state.shortening)
    tension = dict[str, float]()
    solved = stage.end
    assert solved is not None, "the end of a static stage"
    for name, cut in stage.problem.cuts.items():
        u = displacement.get(cut.table.substructure)
        if u is None:
            continue
        more, less = parameter.more.cuts[name], parameter.less.cuts[name]
        k = (more.stiffness - less.stiffness) / parameter.span
        body_motion = solved.displacement[cut.table.substructure]
        changed = k * solved.bolts.shortening.get(name, 0.0)
        changed -= float(parameter.of(more.pattern, less.pattern) @ body_motion)
        if name in stage.tightened:
            force, amount = bolt_changes(parameter, name)
            shortening[name] = cut.shortening(force - changed, u) if cut.loose else amount
        tension[name] = cut.force(shortening.get(name, 0.0), u) + changed
    return StateChange(displacement, traction, closure, shortening, tension)
