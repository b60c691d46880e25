"""A scene made ready to run: discretised, and the march chosen that solves it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import NamedTuple

from .assembly.models import KeptOperators
from .assembly.problem import DiscretisedProblem, SolverReadyProblem
from .assembly.propagator_choice import by_modes, chosen_propagators
from .assembly.yielding_bolts import Yielding
from .building import discretise, solver_ready
from .effects.cost import Prediction, check_memory
from .errors import InputError, Problems
from .interface import Behaviour
from .joined.tied_assembly import TieError
from .latin.processes import Processes
from .machine import one_thread
from .remarks import remarks_of
from .scene.schema import Scene
from .sensitivities.tangents import Tangents
from .statics.free_bodies import loss_of_equilibrium


@dataclass(frozen=True)
class Attempt:
    """How a run is made, which may have to be made anew.

    Attributes
    ----------
    leave_out : as for ``discretise``. yielding : bolts that yield. looked_at : whether iterates are looked at.
    modes_open : whether a march by modes may be tried. modes_refused : why it was given up.
    """

    leave_out: bool
    yielding: Yielding
    looked_at: bool
    modes_open: bool
    modes_refused: str = ""


class Prepared(NamedTuple):
    """A problem that is ready to run, what it will take, its derivatives where the scene names parameters, and whether
    the program has chosen to try the modes of the assembly."""

    problem: SolverReadyProblem
    prediction: Prediction
    tangent: Tangents | None
    tries_modes: bool = False


def prepared(
    scene: Scene,
    behaviours: Mapping[str, Behaviour] | None,
    kept: KeptOperators | None,
    stream: bool,
    processes: Processes | None,
    attempt: Attempt,
) -> Prepared:
    """The problem of a scene, ready to run; parameters and errors as for ``api.solve``."""
    wanted = bool(scene.differentiated)
    # shared with the scenes in which the parameters are varied
    kept = KeptOperators() if kept is None and wanted else kept
    with one_thread(), nullcontext() if processes is None else processes.agreed():
        discretised = discretise(scene, behaviours, kept, attempt.leave_out and not wanted)
        discretised = replace(discretised, elongation=attempt.yielding.elongation)
        prediction = Prediction(discretised)
        check_memory(prediction, stream)
        if processes is not None:
            check_distributable(discretised, processes.size)
        tangent = Tangents.of(scene, discretised, processes is not None or behaviours is not None) if wanted else None
        stages = None if tangent is None else tangent.stages
        size = 1 if processes is None else processes.size
        looks_at_bodies = wanted or size > 1 or attempt.looked_at  # what needs the iterates of single bodies
        restricted = behaviours is not None or looks_at_bodies
        modal, reasons = by_modes(scene, restricted)
        tries = attempt.modes_open and not restricted and prediction.tries_modes
        if tries:
            from .effects.modal_choice import by_choice

            prediction.discretised = discretised = by_choice(discretised)
        try:
            at_once = False
            if scene.time.quasi_static:
                from .statics.static_fields import solved_at_once

                at_once = solved_at_once(scene, discretised, looks_at_bodies)
            grouped, why = None, ""
            if not (modal or tries or reasons or scene.time.quasi_static or scene.solver.bonds == "iterate"):
                from .effects.march_choice import cheaper_march

                grouped, prediction, why = cheaper_march(discretised, prediction, restricted)
            problem = solver_ready(discretised, {}, size, stages, modal or tries, at_once, grouped)
            problem = replace(problem, bonds=f"iterated: {why}") if why else problem
        except TieError as error:
            if tries:
                return prepared(scene, behaviours, kept, stream, processes, replace(attempt, modes_open=False))
            modal, reasons = False, [str(error)]
        if reasons:
            # with the time scheme that suits the bodies
            plain, direct = scene.replace("solver.propagator", "automatic"), replace(attempt, modes_open=False)
            found = prepared(plain, behaviours, kept, stream, processes, direct)
            return found._replace(problem=_marched_by_bodies(found.problem, reasons))
        if attempt.modes_refused:
            problem = _marched_by_bodies(problem, [attempt.modes_refused])
        if scene.time.quasi_static:
            lost = loss_of_equilibrium(discretised)
            for held in (problem.assembly, problem.assembly if problem.reduced is None else problem.reduced.assembly):
                held.lost = lost
    return Prepared(problem, prediction, tangent, tries)


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
        problems.add("solver.threads", what, str(solver.threads), "1", "start more processes instead")
    if solver.skip_at_rest == "tolerance":
        what = "substructures of a class are skipped at rest together, but are distributed over processes"
        problems.add("solver.skip_at_rest", what, "tolerance", "off, exact, round_off")
    if chosen_propagators(discretised.scene, discretised.classes)[0].kind == "cg":
        what, remedy = "conjugate gradients run in one process", "choose another propagator, or use fewer unknowns"
        problems.add("solver.propagator", what, "cg", remedy=remedy)
    if problems:
        raise InputError(problems, "the run cannot be distributed over processes")
