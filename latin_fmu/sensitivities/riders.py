"""What is found after a run from the run itself: derivatives by parameters, their checks by other runs, and bands.

A rider takes a solution and gives it back with more in it. The results of the run do not depend on it: where it cannot
be computed, or the limit of CPU time leaves no time, a remark says why.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, Protocol

from ..arithmetic import computable
from ..assembly.models import KeptOperators
from ..errors import InputError, LatinError, SolverError
from ..latin.outcome import Outcome
from ..machine import one_thread
from ..march import MarchedRun, ProgressSink, RunClock
from ..remarks import remarks_of
from ..results.sensitivities import CHECKED, Sensitivities, scalars_of
from ..results.sensors import spectra_of
from ..results.solution import Solution
from ..results.spectra import ShockSpectrum
from ..results.spread import Bands
from ..scene.schema import Scene
from .copies import Marched, marched_beside
from .tangents import Tangents

_UNCHECKED: Final = (
    "fields",
    "stress",
    "nodal_stress",
    "principal_stress",
    "strain",
    "surfaces",
    "reactions",
    "energy",
)


class Solve(Protocol):
    """Solves a scene, as ``api.solve`` does."""

    def __call__(
        self,
        scene: Scene,
        *,
        kept: KeptOperators | None = None,
        progress: ProgressSink | None = None,
        max_cpu: float | None = None,
    ) -> Solution:
        """The solution of a scene."""


@dataclass(frozen=True)
class Ride:
    """What riders have of a run beside its solution.

    Attributes
    ----------
    scene, run : that was run, and its end. tangent : derivatives that were asked for; None where none are. progress :
        called with the instants of their march. started : clock of the run. solve : for runs of other scenes.
    """

    scene: Scene
    run: MarchedRun
    tangent: Tangents | None
    progress: ProgressSink | None
    started: RunClock
    solve: Solve

    def check_time(self) -> None:
        """Make sure that the limit of CPU time leaves some.

        Raises
        ------
        SolverError : it does not.
        """
        if self.started.left == 0.0:
            if self.scene.spread:
                what = "the derivatives and the bands"
            else:
                what = "the derivatives"
            raise SolverError(self.started.sentence(what))

    def report(self, done: int, total: int) -> None:
        """Receive the progress of the march of derivatives; ends it where there is no time left."""
        if done < total:
            self.check_time()
        if self.progress is not None:
            self.progress.update(done, total, 0, 0.0)


Rider = Callable[[Solution, Ride], Solution]
"""Gives a solution back with more in it."""


def with_derivatives(solution: Solution, ride: Ride) -> Solution:
    """Derivatives by the parameters that the scene names."""
    if ride.tangent is None:
        return solution
    outcome = solution.outcome
    lost = "the run has not converged to its end"
    if outcome.converged and outcome.complete:
        try:
            ride.check_time()
            with one_thread():
                changes = ride.tangent.march(ride.run, ride.report)
                return replace(solution, sensitivities=Sensitivities.of(outcome, changes, _spectra(ride, outcome)))
        except SolverError as error:
            lost = str(error)
    return _with_remarks(solution, [f"no derivatives: {lost}"])


def with_checks(solution: Solution, ride: Ride) -> Solution:
    """Derivatives checked by runs, for every parameter or those by which a quantity is flagged, and remarks on those of
    them that have none."""
    found = solution.sensitivities
    if ride.tangent is None or found is None or ride.scene.output.check_sensitivities == "none":
        return solution
    larger, why = _larger(ride.scene, found)
    runs: list[dict[str, float] | None] = [None] * len(found.derivatives)
    values = {q.quantity: q.value for q in found.quantities}
    for (i, other), marched in zip(larger.items(), _marched_together(ride, larger), strict=True):
        if marched is None:
            runs[i], reason = _of_other_run(ride, other)
            if reason:
                why[i] = reason
            continue
        more, same = (_scalars(ride, copy) for copy in marched)
        runs[i] = {key: values[key] + more[key] - same[key] for key in values.keys() & more.keys() & same.keys()}
    missing = dict[str, list[str]]()
    for i in sorted(why):
        missing.setdefault(why[i], []).append(found.derivatives[i].name)
    remarks = [f"the derivatives by {', '.join(names)} are not checked: {reason}" for reason, names in missing.items()]
    return replace(_with_remarks(solution, remarks), sensitivities=found.checked(runs))


def with_bands(solution: Solution, ride: Ride) -> Solution:
    """Bands of the results by the parameters that scatter."""
    found, scene = solution.sensitivities, ride.scene
    if found is None or not scene.spread:
        return solution
    outcome = solution.outcome
    spectra = _spectra(ride, outcome)
    return replace(solution, bands=Bands.of(outcome, found, scene.distributions, scene.sensor, spectra))


RIDERS: Final[tuple[Rider, ...]] = (with_derivatives, with_checks, with_bands)
"""Of every run, in this order."""


def _marched_together(ride: Ride, larger: dict[int, Scene]) -> list[tuple[Marched, Marched] | None]:
    """Copies of the run with the parameter of each of these scenes and without, marched side by side; None of those
    that cannot be computed so."""
    # by modes a run costs less than copies of all bodies
    if ride.tangent is None or ride.run.problem.reduced is not None:
        return [None] * len(larger)
    outcome, budget = ride.run.outcome, ride.started.left
    if budget is None or budget > (len(larger) + 1) * outcome.timings.march:
        newton = sum(window.newton_steps for window in outcome.windows) / max(len(outcome.windows), 1)
        motion = ride.tangent.motion(ride.run)
        report = None if ride.progress is None else ride.progress.update
        # what cannot be computed together is run alone, and its error has the reason
        with suppress(LatinError), computable(), one_thread():
            return marched_beside(motion, list(larger.values()), ride.tangent.statics, newton, report)
    return [None] * len(larger)


def _of_other_run(ride: Ride, scene: Scene) -> tuple[dict[str, float] | None, str]:
    """Scalar quantities of a scene that is run alone, and why there are none."""
    outcome, budget = ride.run.outcome, ride.started.left
    if budget is not None and budget <= outcome.timings.march:
        return None, ride.started.sentence("their checks")
    operators = None if ride.tangent is None else ride.tangent.problem.kept
    if operators is None:
        store = KeptOperators()
    else:
        store = operators.copy()
    try:
        solution = ride.solve(scene, kept=store, progress=ride.progress, max_cpu=budget)
    except LatinError as error:
        return None, str(error.problems[0] if isinstance(error, InputError) else error)
    if solution.converged:
        return scalars_of(replace(solution.outcome, energy=outcome.energy), solution.spectra), ""
    return None, ride.started.sentence("their checks") if solution.interrupted else solution.status


def _larger(scene: Scene, found: Sensitivities) -> tuple[dict[int, Scene], dict[int, str]]:
    """Scenes with a parameter larger by CHECKED that check derivatives, by its number, and why others have none."""
    plain = scene.undifferentiated
    unkept = plain.output.model_copy(update=dict.fromkeys(_UNCHECKED, False))
    plain = plain.model_copy(update={"output": unkept})
    larger, why = dict[int, Scene](), dict[int, str]()
    every = scene.output.check_sensitivities == "all"
    for i, (d, flagged) in enumerate(zip(found.derivatives, found.flagged, strict=True)):
        if not (every or flagged):
            continue
        if d.value == 0.0:
            why[i] = "its value is 0"
            continue
        try:
            larger[i] = plain.replace(d.name, (1.0 + CHECKED) * d.value)
        except InputError as error:
            why[i] = str(error.problems[0])
    return larger, why


def _scalars(ride: Ride, copy: Marched) -> dict[str, float]:
    """Scalar quantities of a copy of the run."""
    ended = replace(ride.run.outcome, interfaces=copy.interfaces, sensors=copy.sensors, bolts=copy.bolts)
    return scalars_of(ended, _spectra(ride, ended))


def _spectra(ride: Ride, outcome: Outcome) -> dict[str, ShockSpectrum]:
    """Shock response spectra of the sensors of the scene."""
    return spectra_of(outcome, ride.scene.sensor)


def _with_remarks(solution: Solution, texts: list[str]) -> Solution:
    """The solution with remarks on its accuracy."""
    outcome = solution.outcome
    return replace(solution, outcome=replace(outcome, warnings=(*outcome.warnings, *remarks_of("accuracy", texts))))
