"""Adaptive resolution: mesh, time step and tolerance for a target accuracy, and their cost before the run.

Runs of a refinement sequence (mesh and time step refined at one ratio) are made from coarse to fine until the estimated
error of the target quantity (``estimate.quantity_estimate``) is below the target.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final

from ..assembly.body import fast_elasticity_of
from ..errors import LatinError
from ..latin.settings import tolerance_for
from ..machine import memory_room
from ..results.estimates import ErrorEstimate, QuantityEstimate
from ..results.solution import Solution
from ..run_quantities import relative
from ..scene.quantity_table import FLOOR, definition_of
from ..scene.readable_numbers import percent
from ..scene.schema import Scene
from ..scene.settings import Output
from .estimate import FACETED, quantity_estimate
from .price_list import MARGIN
from .runs import (
    FEWEST_STEPS,
    Log,
    MeasuredRun,
    Resolution,
    RunTimeFit,
    aligned,
    at_resolution,
    cost_exponent,
    counts_that_vary,
    in_short_windows,
    memory_at,
    mesh_factor,
    mesh_files,
    message_of,
    solved,
    with_tolerance,
)

COURANT: Final = 0.75
"""Target of the Courant number c_p dt / h: with the same mesh, a step twice as short gains nothing (impulse of the
impact bar: 1.1 % off at 1.5, 0.51 % at 0.75, 0.56 % at 0.4)."""

_LOOSEST, _TIGHTEST = 1e-2, 1e-9  # tolerances
_STRICT = 1e-5  # tolerance below which a run that does not converge is not repeated with a tenth of it
_FIRST_FACTORS = (0.35, 0.5, 0.71, 1.0, 1.41, 2.0, 2.83, 4.0)  # the search starts at the first with a coarser run
_LARGEST_REFINEMENT, _LARGEST_COST_RATIO = 3.0, 25.0  # of the next run: limits of the extrapolation
_NEARLY_TWICE = 1.7
_NEAR = 0.25  # relative difference from the half, or the quarter, of a factor
_LEAST_REFINEMENT = 1.4
_ROUNDS = 16
_FINEST = 8.0  # refinement beyond which no next factor is searched
_LEAST_GAIN = 1.15  # of a refinement by 2; a smaller one counts as no convergence
_MEMORY_SHARE = 0.8  # of the machine


@dataclass
class RefinementSequence:
    """Runs of one scene on finer and finer meshes and steps at one ratio; each is made once.

    Attributes
    ----------
    scene : in short windows, with the tolerance to use: a tenth of it after a run for which it did not suffice.
    log : called with a line of text after each run. limit : CPU seconds of all runs, at which the last one is stopped;
        the run that is chosen is repeated with its output beyond them.
    seconds : those of all runs so far.
    solution : of the last run ``with_output``.
    """

    scene: Scene
    log: Log
    limit: float | None = None
    seconds: float = 0.0
    solution: Solution | None = None
    _runs: dict[Resolution, MeasuredRun] = field(default_factory=dict)
    _with_output: set[Resolution] = field(default_factory=set)
    _diagonal: set[float] = field(default_factory=set)
    _finest: tuple[Resolution, Output, Solution] | None = None

    @property
    def refines_mesh(self) -> bool:
        """Whether the mesh can change."""
        return bool(mesh_files(self.scene) or counts_that_vary(self.scene))

    def factor(self, wanted: float) -> float:
        """The factor nearest to ``wanted`` that the meshes allow."""
        if self.refines_mesh:
            return mesh_factor(self.scene, wanted)
        return wanted

    def at(self, factor: float) -> Resolution:
        """Mesh and steps of a factor: shorter steps where the Courant number is above 0.75."""
        if self.refines_mesh:
            mesh = factor
        else:
            mesh = 1.0
        return Resolution(mesh, aligned(self.scene, factor * step_ratio(self.scene)))

    def chain(self, factor: float) -> list[float]:
        """A factor, its half and quarter, as far as they exist, differ and have enough steps.

        A run that exists serves in their place where it is 1.6 to 2.7 times, or 3.2 to 5.3 times, as coarse.
        """
        factors = [factor]
        for part in (0.5, 0.25):
            near = [f for f in self._diagonal if abs(f / (factor * part) - 1.0) < _NEAR and self.at(f) in self._runs]
            f = min(near, key=lambda f: abs(f / (factor * part) - 1.0), default=self.factor(factor * part))
            # whole elements: half of few elements may be nearly as many
            if f < 0.8 * factors[-1] and self.scene.time.n_step * self.at(f).time >= FEWEST_STEPS:
                factors.append(f)
        return factors

    def run(self, resolution: Resolution) -> MeasuredRun:
        """The run at a resolution, with the output that its quantities need.

        Raises
        ------
        LatinError : the scene cannot be built or solved there.
        """
        if resolution not in self._runs:
            scene = at_resolution(self.scene, resolution)
            run, solution = self._solve(scene, resolution)
            self._runs[resolution] = run
            # a run stopped at the limit is no result: the one before it may be
            if solution.complete and (self._finest is None or _fineness(resolution) >= _fineness(self._finest[0])):
                self._finest = resolution, scene.output, solution
        return self._runs[resolution]

    def with_output(self, resolution: Resolution, output: Output, limited: bool = True) -> MeasuredRun:
        """The run with the requested output, stored as ``solution``; the finest run serves where it has that output.

        limited : whether the run stops at the limit.

        Raises
        ------
        LatinError : the scene cannot be built or solved there.
        """
        scene = at_resolution(self.scene, resolution)
        output = output.model_copy(update={"fields": output.keeps_fields})
        more_fields = output.fields and (output.every > 1 or not scene.output.fields)
        more = output.stress or output.energy or output.recovers or output.surfaces or output.reactions
        if more or more_fields:
            scene = scene.model_copy(update={"output": output})
        if self._finest is None or self._finest[:2] != (resolution, scene.output):
            run, solution = self._solve(scene, resolution, ", with its output", limited)
            self._finest = resolution, scene.output, solution
            if resolution not in self._runs:
                self._runs[resolution] = run
                self._with_output.add(resolution)
        self.solution = self._finest[2]
        return self._runs[resolution]

    def _solve(
        self, scene: Scene, resolution: Resolution, note: str = "", limited: bool = True
    ) -> tuple[MeasuredRun, Solution]:
        while True:
            budget = None if self.limit is None or not limited else max(self.limit - self.seconds, 0.0)
            tolerance = self.scene.solver.tolerance
            scene = scene.model_copy(update={"solver": with_tolerance(scene, tolerance)})
            run, solution = solved(self.scene, scene, resolution, max_cpu=budget)
            self.seconds += run.cpu
            label = f"{run.cpu:7.2f} s  mesh x {resolution.mesh:.3g}, steps x {resolution.time:.3g}{note}"
            self.log(label if run.converged else f"{label}: {run.status}")
            # every instant met the tolerance, and what is left adds up to too much work
            left_over = not run.converged and solution.complete and all(w.converged for w in solution.windows)
            if not left_over or tolerance <= _STRICT:
                return run, solution
            self.scene = self.scene.model_copy(update={"solver": with_tolerance(self.scene, 0.1 * tolerance)})

    @property
    def runs(self) -> list[MeasuredRun]:
        """The runs made without output, one a resolution, cheapest first."""
        # runs with output take longer, which would spoil the fit of the run time
        lean = (run for at, run in self._runs.items() if at not in self._with_output)
        return sorted(lean, key=lambda run: run.cpu)

    def estimate(self, factor: float, quantity: str) -> QuantityEstimate:
        """Estimated error of a quantity at a factor; infinite without a coarser run.

        From the run at ``factor``, the one with half its resolution, and one with a quarter where it exists already.
        """
        runs: list[MeasuredRun] = []
        for f in self.chain(factor):
            at = self.at(f)
            if len(runs) >= 2 and at not in self._runs:
                break
            run = self._if_converged(at)
            if run is None:
                break
            self._diagonal.add(f)
            runs.append(run)
        if len(runs) < 2:
            if runs:
                value = runs[0].quantities.values[quantity]
            else:
                value = math.nan
            return QuantityEstimate(quantity, value, math.inf)
        scene = at_resolution(self.scene, self.at(factor))
        return quantity_estimate(scene, quantity, [(run.resolution, run.quantities) for run in runs])

    def _if_converged(self, at: Resolution) -> MeasuredRun | None:
        """The run at a resolution; None where it cannot be made or does not converge."""
        try:
            run = self.run(at)
        except LatinError as error:
            self.log(f"no coarser run: {message_of(error)}")
            return None
        if run.converged:
            return run
        return None


def _fineness(at: Resolution) -> tuple[float, float]:
    return at.mesh, at.time


def step_ratio(scene: Scene) -> float:
    """Factor on the number of steps that brings the largest Courant number to 0.75; between 1 and 2."""
    largest = 0.0
    for body in scene.substructure.values():
        if body.box is None:
            continue
        speed = fast_elasticity_of(scene.material[body.material]).wave_speeds[0]
        # a single element across is the width of a bar, along which no wave is resolved
        sizes = [s / n for s, n in zip(body.box.size, body.box.elements, strict=True) if n > 1]
        if sizes:
            largest = max(largest, speed * scene.time.time_step / min(sizes))
    return min(max(largest / COURANT, 1.0), 2.0)


@dataclass(frozen=True)
class Choice:
    """Result of a search for a target accuracy.

    Attributes
    ----------
    solution : at the chosen resolution and tolerance, with the requested output and the estimated error of every
        quantity; the best one where the target is not ``reached``, None where no run has an estimate.
    resolution : relative to the scene as written. quantity : the worst of the target quantities, with its ``error``.
    cpu : CPU seconds of the chosen run, ``seconds`` of the whole search. sentence : the result as text.
    """

    solution: Solution | None
    resolution: Resolution
    quantity: str
    error: float
    reached: bool
    cpu: float
    seconds: float
    sentence: str

    def report(self) -> dict[str, Any]:
        """Plain data for strict JSON."""
        return {
            "quantity": self.quantity,
            "reached": self.reached,
            "estimated_error": self.error if math.isfinite(self.error) else None,
            "mesh": self.resolution.mesh,
            "steps": self.resolution.time,
            "cpu_seconds": self.cpu if math.isfinite(self.cpu) else None,
            "cpu_seconds_of_the_search": self.seconds,
            "sentence": self.sentence,
        }


def choose(scene: Scene, target: float, limit: float, log: Callable[[str], None]) -> Choice:
    """Mesh, time step and tolerance for a relative error ``target`` of ``scene.accuracy.quantity``.

    A coarse run and one twice as fine (a sixth and a third of the scene's resolution) give an estimated error, and
    its order the next refinement. A target that the estimate meets is promised where the estimate of the run with
    half the resolution is confirmed by this one (``_Search._confirmed``). Runs grow geometrically, so that all
    coarser ones cost a fraction of the last; they are made without output, the last one is repeated where the scene
    requests more output than the quantities need. The target holds for the largest error where the quantity belongs
    to several interfaces. The iteration error is a tenth of the target.

    Parameters
    ----------
    limit : CPU seconds of all runs together; a run that is predicted to exceed them does not begin, and one that does
        is stopped. The chosen run is repeated with the scene's output where it needs more, beyond the limit if need be.
    log : called with lines of text about runs, predicted and used time.

    Raises
    ------
    LatinError : the scene itself cannot be built or solved.
    """
    iteration = definition_of(scene.accuracy.quantity).iteration
    tolerance = min(max(tolerance_for(target, iteration), _TIGHTEST), _LOOSEST)
    lean = in_short_windows(scene)
    lean = lean.model_copy(update={"solver": with_tolerance(lean, tolerance)})
    return _Search(scene, RefinementSequence(lean, log, limit), target, limit, log).run()


class _Search:
    """The search for the factor; ``estimates`` holds the largest estimated error of the target quantities by factor."""

    def __init__(self, scene: Scene, sequence: RefinementSequence, target: float, limit: float, log: Log) -> None:
        self.scene = scene
        self.sequence = sequence
        self.target = target
        self.limit = limit
        self.log = log
        self.estimates: dict[float, QuantityEstimate] = {}

    def run(self) -> Choice:
        factor, expected_last = self._first(), False
        for _ in range(_ROUNDS):
            why = self._try(factor, expected_last)
            if why:
                return self._refused(why)
            estimate = self.estimates[factor]
            if estimate.error <= self.target and self._confirmed(factor):
                estimate = self._estimated(factor)  # with the third run, which the confirmation has made
                if estimate.error <= self.target and self._regular(estimate):
                    return self._chosen(factor, estimate)
            if self._stagnates():
                raw = definition_of(estimate.quantity).unlimited
                if raw:
                    remedy = "; use peak_force, a time-averaged force"
                else:
                    remedy = ""
                what = f"{estimate.quantity} does not converge, the smallest bound is {percent(estimate.error)}"
                return self._refused(what + remedy)
            following, expected_last = self._next(factor, estimate)
            if following <= factor:
                return self._refused("the mesh cannot be refined further")
            factor = following
        return self._refused(f"the target is not reached after {_ROUNDS} refinements")

    def _first(self) -> float:
        """A third of the scene's resolution, or more where that leaves no coarser run."""
        factors = [self.sequence.factor(f) for f in _FIRST_FACTORS]
        return next((f for f in factors if len(self.sequence.chain(f)) >= 2), factors[-1])

    def _next(self, factor: float, estimate: QuantityEstimate) -> tuple[float, bool]:
        """The next factor, and whether it is expected to reach the target.

        The one that reaches the target at the observed order (the expected one where none is observed), within the
        limits of the extrapolation; twice the factor where that is little more, because the runs so far are then its
        coarser runs. Measured times are not used: the search is reproducible.
        """
        order = estimate.likely_order
        refinement = max((estimate.error / (MARGIN * self.target)) ** (1.0 / order), _LEAST_REFINEMENT)
        # cost ~ factor^(1 + exponent), as the steps are refined with the mesh
        longest = min(_LARGEST_REFINEMENT, _LARGEST_COST_RATIO ** (1.0 / (1.0 + cost_exponent(self.scene))))
        new = factor * min(refinement, longest)
        if _NEARLY_TWICE * factor < new < 2.0 * factor:
            new = 2.0 * factor
        # meshes change by whole elements: a factor a little larger may be the same mesh
        while (following := self.sequence.factor(new)) <= factor and new < _FINEST * factor:
            new *= 1.1
        return following, factor * refinement <= following

    def _try(self, factor: float, expected_last: bool) -> str:
        """Run a factor, with its output where it is ``expected_last``, and estimate its error; the reason where that
        cannot be done, else an empty string."""
        at = self.sequence.at(factor)
        try:
            # the coarser run first: the time of this one is predicted from it
            for f in self.sequence.chain(factor)[1:2]:
                self.sequence.run(self.sequence.at(f))
            if why := self._too_large(at):
                return why
            if expected_last:
                run = self.sequence.with_output(at, self.scene.output)
            else:
                run = self.sequence.run(at)
            if not run.converged:
                return f"mesh x {at.mesh:.3g}: {run.status}"
            if not any(is_target(self.scene, q) for q in run.quantities.values):
                return f"the scene has no quantity {self.scene.accuracy.quantity}"
            self._estimated(factor)
        except LatinError as error:
            return message_of(error)
        estimate = self.estimates[factor]
        if math.isnan(estimate.order):
            order = ""
        else:
            order = f", observed order {estimate.order:.1f}"
        if estimate.bound_only:
            what = "bound"
        else:
            what = "error"
        self.log(f"         {estimate.quantity}: {what} {percent(estimate.error)}{order}")
        return ""

    def _too_large(self, at: Resolution) -> str:
        """Why a run would take too much time or memory, else an empty string; its predicted time is logged."""
        if not self.sequence.runs:
            return ""
        seconds = RunTimeFit.of(self.scene, [run.cost for run in self.sequence.runs]).seconds(at.mesh, at.time)
        budget = self.limit - self.sequence.seconds
        if seconds > budget:
            used = f"of the limit of {self.limit:g} s for all runs {max(budget, 0.0):.2g} s are left"
            return f"the next run would take about {seconds:.2g} CPU s; {used}"
        memory = memory_at(self.scene, at)
        # 0: the system does not report its memory
        if memory > _MEMORY_SHARE * (memory_room()[0] or math.inf):
            return f"the next run would need about {memory / 1e9:.0f} GB of memory"
        self.log(f"predicted {seconds:.2g} CPU s for mesh x {at.mesh:.3g}, steps x {at.time:.3g}")
        return ""

    def _estimated(self, factor: float) -> QuantityEstimate:
        """The largest estimated error of the target quantities of a run, kept in ``estimates``."""
        names = [q for q in self.sequence.run(self.sequence.at(factor)).quantities.values if is_target(self.scene, q)]
        estimates = [self.sequence.estimate(factor, quantity) for quantity in names]
        self.estimates[factor] = max(estimates, key=lambda estimate: estimate.error)
        return self.estimates[factor]

    def _regular(self, estimate: QuantityEstimate) -> bool:
        """Whether a quantity is past its pre-asymptotic regime.

        On meshes that do not resolve where a face slips the work of friction changes by as much from one refinement to
        the next, and estimated errors can be half the true ones: it is promised where its changes decrease at an
        observed order of at least half the expected one.
        """
        if not definition_of(estimate.quantity).steady:
            return True
        regular = not estimate.bound_only and estimate.order >= 0.5 * estimate.expected_order
        if not regular:
            self.log(f"         not confirmed: {estimate.quantity} does not converge steadily yet")
        return regular

    def _confirmed(self, factor: float) -> bool:
        """Whether the run with half the resolution was promised well: no target quantity has changed from there by more
        than was estimated there. Else two values agree by chance, or before the mesh resolves what happens."""
        half = next(iter(self.sequence.chain(factor)[1:]), None)
        if half is None:
            return False
        fine, coarse = (self.sequence.run(self.sequence.at(f)).quantities for f in (factor, half))
        for quantity in (q for q in fine.values if is_target(self.scene, q)):
            told = self.sequence.estimate(half, quantity)
            changed = relative(quantity, fine, fine, coarse)
            # "not <=": NaN does not confirm the estimate
            if not changed <= max(told.error, FLOOR):
                within, by = percent(told.error), percent(changed)
                self.log(f"         not confirmed: {quantity} was estimated within {within} and has changed by {by}")
                return False
        return True

    def _stagnates(self) -> bool:
        """Whether the last refinements, by four together, hardly reduce the estimated error."""
        last = max(self.estimates)
        # 3.9: factors rounded to whole elements may miss 4
        before = max((f for f in self.estimates if f <= last / 3.9), default=None)
        # squared: two refinements by 2
        return before is not None and self.estimates[before].error < _LEAST_GAIN**2 * self.estimates[last].error

    def _chosen(self, factor: float, estimate: QuantityEstimate) -> Choice:
        at = self.sequence.at(factor)
        sentence = (
            f"{estimate.quantity} within {percent(self.target)}: estimated error {percent(max(estimate.error, FLOOR))} "
            f"at mesh x {at.mesh:.3g}, steps x {at.time:.3g}, tolerance {self.sequence.scene.solver.tolerance:.2g}"
        )
        return self._choice(factor, estimate, sentence, reached=True)

    def _refused(self, why: str) -> Choice:
        sentence = f"an accuracy of {percent(self.target)} cannot be guaranteed: {why}"
        best = min(self.estimates, key=lambda f: self.estimates[f].error, default=None)
        if best is None:
            quantity, seconds = self.scene.accuracy.quantity, self.sequence.seconds
            return Choice(None, Resolution(), quantity, math.inf, False, math.nan, seconds, sentence)
        estimate = self.sequence.estimate(best, self.estimates[best].quantity)
        at = self.sequence.at(best)
        sentence += f". Best: {estimate.quantity} {percent(estimate.error)} at mesh x {at.mesh:.3g}, "
        return self._choice(best, estimate, f"{sentence}steps x {at.time:.3g}", reached=False)

    def _choice(self, factor: float, estimate: QuantityEstimate, sentence: str, reached: bool) -> Choice:
        at = self.sequence.at(factor)
        # the estimate holds for the whole run: stopped at the limit it would be another answer
        run = self.sequence.with_output(at, self.scene.output, limited=False)
        solution = self.sequence.solution
        if solution is not None:
            estimates = tuple(self.sequence.estimate(factor, quantity) for quantity in run.quantities.values)
            # the price of the estimate: all runs but the chosen one
            cpu = self.sequence.seconds - run.cpu
            remarks = (FACETED,) if mesh_files(self.scene) else ()
            solution = replace(solution, estimate=ErrorEstimate(estimates, remarks, cpu))
        seconds = self.sequence.seconds
        return Choice(solution, at, estimate.quantity, estimate.error, reached, run.cpu, seconds, sentence)


def is_target(scene: Scene, quantity: str) -> bool:
    """Whether ``owner.key`` is the target quantity of the scene (a key alone stands for every owner)."""
    owner, _, key = scene.accuracy.quantity.rpartition(".")
    return quantity.rpartition(".")[2] == key and owner in ("", quantity.rpartition(".")[0])
