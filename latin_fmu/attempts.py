"""Attempts at a run: a scene made ready, marched, and made ready anew where the end refutes a choice made before.

Four choices are made before a run that only its end can justify: which bodies are never touched and left out
(``assembly.untouched``), whether the modes of the assembly are marched in the place of its bodies
(``effects.modal_choice``), whether the stress of t = 0 has a stiffness where it changes no vibration
(``statics.prestressed``), and by how much bolts yield (``assembly.yielding_bolts``). Each has a function here that
reads the end of a run and says whether it stands (``Verdict``).
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, NamedTuple

from .assembly.models import KeptOperators
from .assembly.problem import DiscretisedProblem, SolverReadyProblem
from .assembly.propagator_choice import by_modes, chosen_propagators
from .assembly.untouched import touched
from .assembly.yielding_bolts import Yielding
from .building import discretise, solver_ready, started
from .checks.lost_stress import lost_stress, rocking
from .checks.run_checks import with_faults
from .effects.cost import Prediction, check_memory, least_output
from .errors import InputError, Problems, ResultsError, SceneError, listed
from .interface.laws import bonds
from .joined.tied_assembly import TieError
from .latin.outcome import Outcome, Timings
from .machine import one_thread, peak_memory
from .march import MarchedRun, RunClock, RunOptions, march, rewound
from .remarks import remarks_of
from .results.checkpoint import scene_digest
from .results.estimates import TruncationError
from .results.writing import check_folder
from .scene.schema import Scene

if TYPE_CHECKING:
    from .assembly.initial_state import InitialState
    from .sensitivities.tangents import Tangents


@dataclass(frozen=True)
class Attempt:
    """The choices made before a run.

    Attributes
    ----------
    leave_out : whether bodies that are probably never touched are left out. yielding : plastic elongations of bolts.
        modes_open : whether a march by modes may be tried. modes_refused : why it was given up. stress : "on" or "off"
        in the place of an automatic choice of ``effects.prestress``, empty before its end has been seen.
    """

    leave_out: bool
    yielding: Yielding
    modes_open: bool
    modes_refused: str = ""
    stress: str = ""

    @staticmethod
    def first(scene: Scene, options: RunOptions) -> Attempt:
        """The choices for the first run of a scene."""
        yielding = Yielding(scene)
        # a bolt that yields needs runs of one form
        modes_open = not options.iterates_all_interfaces and not yielding.tables
        refused = ""
        if modes_open and options.kept is not None:
            refused = options.kept.modes_refused
        # the stress that a scene requires is that of all its bodies
        leave_out = options.may_leave_bodies_out and scene.effects.prestress != "on"
        return Attempt(leave_out, yielding, modes_open and not refused, refused)

    def applied(self, discretised: DiscretisedProblem) -> DiscretisedProblem:
        """The problem with the elongations of bolts, and with the stiffness of stress or without."""
        discretised = replace(discretised, elongation=self.yielding.elongation)
        if not self.stress:
            return discretised
        scene = discretised.scene
        effects = scene.effects.model_copy(update={"prestress": self.stress})
        return replace(discretised, scene=scene.model_copy(update={"effects": effects}))


class Prepared(NamedTuple):
    """A problem that is ready to run, what it will take, its derivatives where the scene names parameters, and whether
    the program has chosen to try the modes of the assembly."""

    problem: SolverReadyProblem
    prediction: Prediction
    tangent: Tangents | None
    tries_modes: bool = False


@dataclass(frozen=True)
class Verdict:
    """What the end of a run says of a choice that was made before it.

    Attributes
    ----------
    another : the attempt that follows, where the run is void. settings, faults : of the outcome, where it stands.
        truncation : error of a march by modes.
    """

    another: Attempt | None = None
    settings: Mapping[str, str] = field(default_factory=dict)
    faults: Sequence[str] = ()
    truncation: TruncationError | None = None

    def applied(self, outcome: Outcome) -> Outcome:
        """The outcome with what is known of it now."""
        return replace(
            outcome,
            settings=outcome.settings | dict(self.settings),
            faults=(*outcome.faults, *self.faults),
            status=with_faults(outcome.status, self.faults),
        )


class EndedRun(NamedTuple):
    """A run at its end: of which scene and attempt, what was made ready and marched for it, its clock, and operators of
    the runs of its study."""

    scene: Scene
    attempt: Attempt
    ready: Prepared
    run: MarchedRun
    started: RunClock
    kept: KeptOperators | None = None


class StandingRun(NamedTuple):
    """A run that no choice speaks against: what was run, its end, the error of a march by modes chosen for it, and its
    choices."""

    ready: Prepared
    run: MarchedRun
    truncation: TruncationError | None
    attempt: Attempt


def standing_run(scene: Scene, options: RunOptions, started: RunClock) -> StandingRun:
    """Run a scene until a run stands (parameters and errors: ``api.solve``)."""
    attempt = Attempt.first(scene, options)
    if options.kept is None and (attempt.yielding.tables or scene.differentiated):
        # of the runs that may follow, and of the scenes in which parameters are varied
        options = replace(options, kept=KeptOperators())
    while True:
        try:
            ready = prepared(scene, options, attempt)
        except SceneError:
            # what stands without the stiffness of its stress may have no equilibrium with it
            if attempt.stress != "on":
                raise
            attempt = replace(attempt, stress="off")
            continue
        try:
            run = _marched(scene, options, ready, started, attempt.stress)
        except ResultsError:
            other = _other_form(scene, attempt, ready)
            if other is None:
                raise
            attempt = other
            continue
        another, standing = _judged(EndedRun(scene, attempt, ready, run, started, options.kept))
        if standing is not None:
            return standing
        # the run is void; its time counts as set-up: the limit begins where it did
        attempt = another
        if options.checkpoint is not None:
            options.checkpoint.remove()
        if run.outcome.stream is not None:
            run.outcome.stream.close()


def standing_again(
    before: StandingRun | None, scene: Scene, kept: KeptOperators | None = None, max_cpu: float | None = None
) -> StandingRun:
    """Run a scene that differs from one whose run stands in the laws of loads and driven faces alone: what was marched
    is marched again, and nothing is made anew (``march.rewound``). Runs as by ``standing_run`` are the first one, with
    None ``before``, those of bonded bodies that are one substructure, with bodies left out or bolts that yield, and one
    whose end speaks against the choices of the run before; ``kept``, ``max_cpu`` : as for ``api.solve``."""
    options, started = RunOptions(kept=kept, max_cpu=max_cpu), RunClock(max_cpu)
    if before is None:
        return standing_run(scene, options, started)
    problem = before.ready.problem
    whole = problem.grouped is None and problem.untouched is None and before.ready.tangent is None
    if not whole or before.attempt.yielding.tables:
        return standing_run(scene, options, started)
    ready = before.ready._replace(problem=rewound(problem, scene))
    run = _marched(scene, options, ready, started, before.attempt.stress)
    _, standing = _judged(EndedRun(scene, before.attempt, ready, run, started, options.kept))
    if standing is None:
        return standing_run(scene, options, started)
    return standing


def _other_form(scene: Scene, attempt: Attempt, ready: Prepared) -> Attempt | None:
    """The next form of a run that a checkpoint may be of: of the bodies, with all of them, with the stiffness of their
    stress; None where it is of none."""
    if ready.tries_modes:
        return replace(attempt, modes_open=False)
    if ready.problem.untouched is not None:
        return replace(attempt, leave_out=False)
    if not attempt.stress and _stress_open(scene) and ready.problem.start is not None:
        return replace(attempt, stress="on")
    return None


def _stress_open(scene: Scene) -> bool:
    """Whether the stiffness of stress may follow from the end of a run; derivatives do not know of it."""
    return scene.effects.prestress == "automatic" and not scene.differentiated and not scene.time.quasi_static


def _judged(ended: EndedRun) -> tuple[Attempt, StandingRun | None]:
    """The attempt that follows a run, and the run with what its choices say of it; None where it is void."""
    outcome, truncation = ended.run.outcome, None
    for check in CHOICES:
        verdict = check(ended)
        if verdict.another is not None:
            return verdict.another, None
        outcome = verdict.applied(outcome)
        truncation = verdict.truncation or truncation
    if outcome.converged:
        outcome.timings.predicted = ended.ready.prediction.march
    return ended.attempt, StandingRun(ended.ready, ended.run._replace(outcome=outcome), truncation, ended.attempt)


def _marched(scene: Scene, options: RunOptions, ready: Prepared, started: RunClock, stress: str) -> MarchedRun:
    """One march of a prepared scene; ``stress`` of its attempt."""
    timings = Timings()
    if options.stream is not None:
        check_folder(options.stream, least_output(ready.prediction))
    timings.setup = started.used
    digest = ""
    if options.checkpoint is not None:
        left_out = ready.problem.untouched
        names = [] if left_out is None else [*left_out.info]
        if ready.tries_modes:
            names += ["by modes"]
        if stress:
            names += [f"prestress {stress}"]
        digest = scene_digest(scene, [*(options.behaviours or ()), *names])
    run = march(ready.problem, options, timings, started, digest)
    # of what was marched in the place of the bodies derivatives alone need the fields
    return run if ready.tangent is not None else run._replace(marched=None)


def bodies_left_out(ended: EndedRun) -> Verdict:
    """Whether nothing has touched the bodies that were left out."""
    left_out = ended.ready.problem.untouched
    if left_out is None:
        return Verdict()
    sides = [ended.run.outcome.interfaces[name] for name in left_out.sides]
    reached = touched(sides, ended.ready.problem.assembly.dt)
    return Verdict(replace(ended.attempt, leave_out=False) if reached else None)


def modes_tried(ended: EndedRun) -> Verdict:
    """Whether the error of a march by modes that the program has chosen is small enough."""
    ready, outcome, started = ended.ready, ended.run.outcome, ended.started
    if not ready.tries_modes or outcome.interrupted:
        return Verdict()
    from .effects.modal_choice import truncation_of, unfit

    def coarser(problem: SolverReadyProblem) -> Outcome:
        return march(problem, RunOptions(max_cpu=started.left)).outcome

    begin = clock.process_time()
    kept, discretised = ended.kept, ready.prediction.discretised
    truncation = None if kept is None else kept.error_of_modes
    refused = unfit(discretised, outcome)
    # of a study once
    if not refused and truncation is None:
        truncation, refused = truncation_of(ended.scene, discretised, ready.problem, outcome, coarser)
        if kept is not None:
            kept.error_of_modes, kept.modes_refused = truncation, refused
    outcome.timings.other += clock.process_time() - begin
    outcome.timings.peak_memory = peak_memory()
    if refused:
        words = f"{refused}; the try took {started.used:.3g} s of CPU"
        return Verdict(replace(ended.attempt, modes_open=False, modes_refused=words))
    settings = {} if truncation is None else {"error of the modes": truncation.in_words()}
    return Verdict(settings=settings, truncation=truncation)


def stress_left_out(ended: EndedRun) -> Verdict:
    """Whether parts that stand on contacts have rocked so little that the stiffness of their stress does not count;
    where it was taken for them, whether their contacts have kept the stress."""
    attempt, outcome, problem = ended.attempt, ended.run.outcome, ended.ready.problem
    if not _stress_open(ended.scene) or outcome.interrupted:
        return Verdict()
    if attempt.stress == "off":
        words = "left out: with it the parts that rock have no equilibrium, or leave their contacts"
        return Verdict(settings={"stiffness of stress": words})
    if attempt.stress == "on":
        time = outcome.time[:: outcome.interfaces_every]
        if any(lost_stress(problem, outcome.interfaces, time)):
            return Verdict(replace(attempt, stress="off"))
        return Verdict(settings={"stiffness of stress": "taken, as parts rocked in a run without it"})
    rocked = any(rocking(problem, outcome.interfaces))
    return Verdict(replace(attempt, stress="on") if rocked else None)


def yielding_bolts(ended: EndedRun) -> Verdict:
    """Whether the plastic elongations of bolts are those that the run began with."""
    yielding, outcome = ended.attempt.yielding, ended.run.outcome
    if yielding.tables and outcome.complete and yielding.goes_on(outcome.bolts):
        return Verdict(ended.attempt)
    return Verdict(settings=yielding.words(), faults=yielding.faults())


CHOICES: Final[tuple[Callable[[EndedRun], Verdict], ...]] = (
    bodies_left_out,
    stress_left_out,
    modes_tried,
    yielding_bolts,
)
"""Made before a run, and checked at its end in this order: a march by modes is judged once all bodies and stresses are
in it."""


def prepared(scene: Scene, options: RunOptions, attempt: Attempt) -> Prepared:
    """The problem of a scene, ready to run; parameters and errors as for ``api.solve``."""
    wanted = bool(scene.differentiated)
    processes, behaviours, kept = options.processes, options.behaviours, options.kept
    with one_thread(), nullcontext() if processes is None else processes.agreed():
        discretised = attempt.applied(discretise(scene, behaviours, kept, attempt.leave_out and not wanted))
        prediction = Prediction(discretised)
        check_memory(prediction, options.stream is not None)
        if processes is not None:
            check_distributable(discretised, processes.size)
        tangent = None
        if wanted:
            from .sensitivities.tangents import Tangents

            tangent = Tangents.of(scene, discretised, processes is not None or behaviours is not None)
        # what needs the iterates of single bodies
        looks_at_bodies = wanted or options.n_process > 1 or options.iterates_all_interfaces
        restricted = behaviours is not None or options.n_process > 1 or options.iterates_all_interfaces
        modal, reasons = by_modes(scene, restricted)
        tries = attempt.modes_open and not restricted and prediction.tries_modes
        if tangent is not None and tangent.of_bodies and (modal or tries):
            tries, attempt = _by_bodies_for(tangent, modal, attempt)
        if tries:
            from .effects.modal_choice import by_choice

            prediction.discretised = discretised = by_choice(discretised)
        try:
            at_once = scene.time.quasi_static
            if at_once:
                from .statics.static_fields import solved_at_once

                at_once = solved_at_once(scene, discretised, looks_at_bodies)
            discretised, start, tangent = _started(discretised, tangent)
            prediction.discretised = discretised
            grouped, why = None, ""
            bonded = any(bonds(unit.behaviour) for unit in discretised.units)
            if bonded and not (modal or tries or reasons or scene.time.quasi_static or scene.solver.bonds == "iterate"):
                from .effects.march_choice import cheaper_march

                grouped, prediction, why = cheaper_march(discretised, prediction, restricted or wanted)
            problem = solver_ready(discretised, start, options.n_process, modal or tries, at_once, grouped)
            problem = replace(problem, bonds=f"iterated: {why}") if why else problem
        except TieError as error:
            if tries:
                return prepared(scene, options, replace(attempt, modes_open=False))
            modal, reasons = False, [str(error)]
        if reasons:
            # with the time scheme that suits the bodies
            plain = scene.replace("solver.propagator", "automatic")
            found = prepared(plain, options, replace(attempt, modes_open=False))
            return found._replace(problem=_marched_by_bodies(found.problem, reasons))
        if attempt.modes_refused:
            problem = _marched_by_bodies(problem, [attempt.modes_refused])
        if scene.time.quasi_static:
            from .statics.free_bodies import loss_of_equilibrium

            lost = loss_of_equilibrium(discretised)
            problem.assembly.lost = lost
            if problem.reduced is not None:
                problem.reduced.assembly.lost = lost
    return Prepared(problem, prediction, tangent, tries)


def _started(
    discretised: DiscretisedProblem, tangent: Tangents | None
) -> tuple[DiscretisedProblem, InitialState | None, Tangents | None]:
    """The problem about its start, this (``building.started``), and the derivatives of that problem.

    Raises
    ------
    SceneError, SolverError : as ``Tangents.stressed``.
    """
    discretised, start = started(discretised, {}, None if tangent is None else tangent.stages)
    if tangent is not None and discretised.prestress is not None and start is not None:
        tangent = tangent.stressed(discretised, start)
    return discretised, start, tangent


def _by_bodies_for(tangent: Tangents, modal: bool, attempt: Attempt) -> tuple[bool, Attempt]:
    """That modes are not tried, as derivatives need the bodies, and the attempt with the reason; ``modal``:
    whether the scene asks for modes.

    Raises
    ------
    SceneError : it does.
    """
    if modal:
        tangent.check_modes()
    words = f"the derivatives by {listed(tangent.of_bodies)}, which change mass or stiffness, take this march"
    return False, replace(attempt, modes_open=False, modes_refused=words)


def _marched_by_bodies(problem: SolverReadyProblem, reasons: list[str]) -> SolverReadyProblem:
    """The problem with remarks on why its assembly is not marched by its modes."""
    words = [f"marched body by body and not by the modes of the assembly: {reason}" for reason in reasons]
    return replace(problem, warnings=(*problem.warnings, *remarks_of("propagator", words)))


def check_distributable(discretised: DiscretisedProblem, size: int) -> None:
    """Make sure that the substructures of a problem can be distributed over ``size`` processes.

    Raises
    ------
    InputError : names the settings that need a single process.
    """
    solver, n = discretised.scene.solver, len(discretised.bodies)
    problems = Problems()
    if size > n:
        problems.add("mpiexec -n", "more processes than substructures", str(size), f"at most {n}")
    if solver.threads > 1:
        what = "threads and processes cannot be combined"
        problems.add("solver.threads", what, str(solver.threads), "1", "use more processes instead")
    if solver.skip_at_rest == "tolerance":
        what = "substructures of a class are skipped at rest together, but are distributed over processes"
        problems.add("solver.skip_at_rest", what, "tolerance", "off, exact, round_off")
    if chosen_propagators(discretised.scene, discretised.classes)[0].kind == "cg":
        what, remedy = "conjugate gradients run in one process", "choose another propagator, or use fewer unknowns"
        problems.add("solver.propagator", what, "cg", remedy=remedy)
    if problems:
        raise InputError(problems, "the run cannot be distributed over processes")
