"""A wanted accuracy: which mesh, step and tolerance reach it, and what that costs, before it is paid."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from .. import api
from ..errors import LatinError
from ..fem.elasticity import wave_speeds
from ..latin.settings import tolerance_for
from ..results.estimates import ErrorEstimate, QuantityEstimate
from ..results.quantities_of_interest import FIRST_CONTACT, FLOOR, PEAK_FORCE, SEPARATION, Kind, kind_of
from ..results.solution import Solution
from ..scene.output_settings import Output
from ..scene.schema import Scene
from .estimate import ORDER_BAND, Judged, observed_order, relative, same_way
from .resolution import (
    Resolution,
    aligned,
    at_resolution,
    counts_that_vary,
    in_short_windows,
    meshed_by_the_program,
    sampling_error,
    with_tolerance,
)
from .runs import CostModel, Run, as_run, exponent_of, memory_foreseen, memory_of_the_machine, told
from .study_report import percent

COURANT = 0.75
"""Courant number c_p dt / h aimed at: with the same mesh, a step twice as short gains nothing (impulse of the impact
bar: 1.1 % off at 1.5, 0.51 % at 0.75, 0.56 % at 0.4)."""

_FEWEST_STEPS = 8


@dataclass
class Ladder:
    """Runs by resolution; each is made once.

    Attributes
    ----------
    scene : in short windows, with the tolerance to be used. tell : hears each run as it is done.
    seconds : CPU seconds of all runs. solution : of the run last asked for with its output.
    """

    scene: Scene
    tell: Callable[[str], None]
    seconds: float = 0.0
    solution: Solution | None = None
    _runs: dict[Resolution, Run] = field(default_factory=dict)
    _dearer: set[Resolution] = field(default_factory=set)
    _finest: tuple[Resolution, Output, Solution] | None = None

    @property
    def refines_mesh(self) -> bool:
        """Whether the mesh can change at all."""
        return bool(counts_that_vary(self.scene)) and meshed_by_the_program(self.scene)

    def factor(self, wanted: float) -> float:
        """The factor nearest to one wanted that leaves the largest number of elements whole."""
        if not self.refines_mesh:
            return wanted
        largest = max(counts_that_vary(self.scene))
        return max(1, round(largest * wanted)) / largest

    def at(self, factor: float) -> Resolution:
        """Mesh and steps of a factor: the Courant number goes towards 0.75, by shorter steps only."""
        mesh = factor if self.refines_mesh else 1.0
        return Resolution(mesh, aligned(self.scene, factor * step_ratio(self.scene)))

    def possible(self, factor: float) -> bool:
        """Whether a factor leaves enough steps to learn from."""
        return self.scene.time.n_step * self.at(factor).time >= _FEWEST_STEPS

    def chain(self, factor: float) -> list[float]:
        """A factor, its half, quarter and eighth as far as they exist and differ."""
        found = [factor]
        for part in (0.5, 0.25, 0.125):
            f = self.factor(factor * part)
            if f < 0.8 * found[-1] and self.possible(f):
                found.append(f)
        return found

    def made(self, resolution: Resolution) -> bool:
        """Whether there is a run at a resolution."""
        return resolution in self._runs

    def run(self, resolution: Resolution) -> Run:
        """The run at a resolution, with no output but what its quantities need.

        Raises
        ------
        LatinError : the scene cannot be built or solved there.
        """
        if resolution not in self._runs:
            scene = at_resolution(self.scene, resolution)
            run, solution = self._solved(scene, resolution)
            self._runs[resolution] = run
            if self._finest is None or resolution.time >= self._finest[0].time:
                self._finest = resolution, scene.output, solution
        return self._runs[resolution]

    def whole(self, resolution: Resolution, output: Output) -> Run:
        """The run with the output asked for, kept as ``solution``: the finest made where it holds all of it.

        Raises
        ------
        LatinError : the scene cannot be built or solved there.
        """
        scene = at_resolution(self.scene, resolution)
        output = output.model_copy(update={"fields": output.keeps_fields or bool(self.scene.sensor)})
        kept = output.fields and (output.every > 1 or not scene.output.fields)
        if output.stress or output.energy or output.recovers or kept:
            scene = scene.model_copy(update={"output": output})
        if self._finest is None or self._finest[:2] != (resolution, scene.output):
            run, solution = self._solved(scene, resolution, ", with its output")
            self._finest = resolution, scene.output, solution
            if resolution not in self._runs:
                self._runs[resolution] = run
                self._dearer.add(resolution)
        self.solution = self._finest[2]
        return self._runs[resolution]

    def _solved(self, scene: Scene, resolution: Resolution, note: str = "") -> tuple[Run, Solution]:
        start = clock.process_time()
        solution = api.solve(scene)
        run = as_run(self.scene, solution, resolution, clock.process_time() - start)
        self.seconds += run.cpu
        label = f"{run.cpu:7.2f} s  mesh x {resolution.mesh:.3g}, steps x {resolution.time:.3g}{note}"
        self.tell(label if run.converged else f"{label}: {run.status}")
        return run, solution

    @property
    def runs(self) -> list[Run]:
        """The runs made without output, one a resolution, cheapest first."""
        lean = (run for at, run in self._runs.items() if at not in self._dearer)
        return sorted(lean, key=lambda run: run.cpu)


def step_ratio(scene: Scene) -> float:
    """How many times shorter steps bring the largest Courant number to 0.75; between 1 and 2."""
    largest = 0.0
    for body in scene.substructure.values():
        if body.box is None:
            continue
        material = scene.material[body.material]
        speed = wave_speeds(material.young_modulus, material.poisson_ratio, material.density)[0]
        sizes = [s / n for s, n in zip(body.box.size, body.box.elements, strict=True) if n > 1]
        if sizes:
            largest = max(largest, speed * scene.time.time_step / min(sizes))
    return min(max(largest / COURANT, 1.0), 2.0)


_SAFETY = 1.15
_STEADY, _LEAST_ORDER, _LARGEST_ORDER = 0.35, 0.3, 2.0
_RINGING = 2.0  # weight of the ringing of a peak


def ladder_error(ladder: Ladder, factor: float, quantity: str, needed: int = 2) -> Judged:
    """Estimated relative error of a quantity at a factor.

    Two runs: ``Kind.change`` x what the last refinement changed. Three: the larger of ``Kind.changes`` x the last two
    changes. Four that go one way and agree on the order p: 1.15 x change / (r^p - 1), p the smaller order. It is an
    estimate where the order observed is the expected one or steady, else a bound. Infinite where there is no coarser
    run.

    Parameters
    ----------
    needed : runs made where there are none yet, the one at ``factor`` and those with a half and a quarter of its
        resolution; coarser ones count where they have been made.
    """
    chain = _chain(ladder, factor, needed)
    if len(chain) < 2:
        return Judged(math.inf, math.nan, bound_only=True)
    kind = kind_of(quantity)
    scene = at_resolution(ladder.scene, ladder.at(factor))
    sampling = 0.0 if kind in (FIRST_CONTACT, SEPARATION) else sampling_error(scene)
    iteration = kind.iteration * scene.solver.tolerance
    found = _steady(chain, quantity) if kind is not PEAK_FORCE else None
    if found is None:
        found = _by_change(chain, quantity, kind)
    return Judged(max(found.error, sampling) + iteration, found.order, found.bound_only)


def _chain(ladder: Ladder, factor: float, needed: int) -> list[Run]:
    """The run at a factor and the coarser ones, those needed and those already made, up to the first without answer."""
    found: list[Run] = []
    for f in ladder.chain(factor):
        at = ladder.at(f)
        if len(found) >= needed and not ladder.made(at):
            break
        try:
            run = ladder.run(at)
        except LatinError as error:
            ladder.tell(f"no coarser run: {told(error)}")
            break
        if not run.converged:
            break
        found.append(run)
    return found


def _by_change(chain: list[Run], quantity: str, kind: Kind) -> Judged:
    """The error from what the last refinement changed, and the one before where it is known."""
    fine, last, order = chain[0].measured, _change(chain[0], chain[:2], quantity, kind), math.nan
    error = kind.change * last
    if len(chain) > 2:
        before = _change(chain[0], chain[1:3], quantity, kind)
        error = max(kind.changes[0] * last, kind.changes[1] * before)
        if same_way(quantity, *(run.measured for run in chain[:3])):
            order = _order(chain[:3], chain, quantity)[0]
    if kind is PEAK_FORCE:
        error = max(error, _RINGING * fine.ringing[quantity.rpartition(".")[0]])
    return Judged(error, order, not abs(order - kind.order) <= ORDER_BAND)


def _change(scale: Run, pair: list[Run], quantity: str, kind: Kind) -> float:
    """Relative change between two runs, brought to a refinement by two at the expected order."""
    fine, coarse = pair
    ratio = fine.resolution.time / coarse.resolution.time
    change = relative(quantity, scale.measured, fine.measured, coarse.measured)
    return float(change * (2.0**kind.order - 1.0) / (ratio**kind.order - 1.0))


def _steady(chain: list[Run], quantity: str) -> Judged | None:
    """The extrapolated error, where four runs agree on the order."""
    if len(chain) < 4:
        return None
    one_way = all(same_way(quantity, *(run.measured for run in chain[i : i + 3])) for i in (0, 1))
    (first, half), (second, _) = _order(chain[:3], chain, quantity), _order(chain[1:], chain, quantity)
    order = min(first, second, _LARGEST_ORDER)
    if not (one_way and abs(first - second) <= _STEADY and order >= _LEAST_ORDER):
        return None
    ratio = chain[0].resolution.time / chain[1].resolution.time
    return Judged(_SAFETY * half / (ratio**order - 1.0), order, bound_only=False)


def _order(triple: list[Run], chain: list[Run], quantity: str) -> tuple[float, float]:
    """Observed order of three runs, and the difference of the first two."""
    fine, half, quarter = triple
    scale = chain[0].measured
    first = relative(quantity, scale, fine.measured, half.measured)
    second = relative(quantity, scale, half.measured, quarter.measured)
    time = fine.resolution.time
    return observed_order(first, second, (time / half.resolution.time, time / quarter.resolution.time)), first


Tell = Callable[[str], None]

_LOOSEST, _TIGHTEST = 1e-2, 1e-9
_STARTS = (0.35, 0.5, 0.71, 1.0, 1.41, 2.0, 2.83, 4.0)
"""Resolutions to start from: the first that has a coarser run; errors of still coarser ones tell nothing."""
_MARGIN = 0.95  # of the target, aimed at
_LEAP, _GROWTH = (3.0, 25.0)  # the next run at most this much finer, and this many times dearer: more is not trusted
_NEARLY_TWICE = 1.7
_LEAST = 1.2  # least refinement
_ROUNDS = 16
_STUCK = 1.15  # a refinement by 2 that gains less than this is no convergence


@dataclass(frozen=True)
class Choice:
    """What a search for an accuracy found.

    Attributes
    ----------
    solution : at the chosen resolution and tolerance, with the output asked for and the estimated error of every
        quantity; the best tried where not ``reached``, None where no run could be judged.
    resolution : relative to the scene as written. quantity : the worst of those aimed at, with its judged ``error``.
    cpu : CPU seconds of the chosen run, ``seconds`` of the whole search. sentence : for people.
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


def choose(scene: Scene, target: float, limit: float, tell: Tell) -> Choice:
    """Mesh, time step and tolerance for a relative error ``target`` of ``scene.accuracy.quantity``.

    A coarse and a once-refined run (a sixth and a third of the scene's resolution), their extrapolated error, then
    the refinement it asks for; its own error is judged before it is accepted. Runs grow geometrically, so that
    those made on the way cost a fraction of the last; they are made without output, the last is made again with it
    where the scene asks for more than the quantities need. The target holds for the largest error where the quantity
    belongs to several interfaces. LATIN stops at a tenth of the target.

    Parameters
    ----------
    limit : CPU seconds one run may take. tell : hears what is run, foreseen and spent.

    Raises
    ------
    LatinError : the scene itself cannot be built or solved.
    """
    kind = kind_of(scene.accuracy.quantity)
    tolerance = min(max(tolerance_for(target, kind.iteration), _TIGHTEST), _LOOSEST)
    lean = in_short_windows(scene).model_copy(update={"solver": with_tolerance(in_short_windows(scene), tolerance)})
    search = _Search(scene, Ladder(lean, tell), target, limit, tell)
    return search.run()


class _Search:
    """The search for the factor; ``tried`` holds the worst judged error by factor."""

    def __init__(self, scene: Scene, ladder: Ladder, target: float, limit: float, tell: Tell) -> None:
        self.scene, self.ladder, self.target, self.limit, self.tell = scene, ladder, target, limit, tell
        self.tried: dict[float, tuple[str, Judged]] = {}

    def run(self) -> Choice:
        factor, trusted = self._start(), False
        for _ in range(_ROUNDS):
            why = self._try(factor, trusted)
            if why:
                return self._refused(why)
            quantity, judged = self.tried[factor]
            if judged.error <= self.target:
                return self._chosen(factor, quantity, judged)
            if self._stuck():
                return self._refused(
                    f"{quantity} does not converge: {percent(judged.error)} is the best bound after refinements"
                )
            factor, trusted = self._next(factor, self._wanted(factor, quantity, judged))
        return self._refused("the target is not met after many refinements")

    def _start(self) -> float:
        """A third of the scene's resolution (more where that leaves no coarser run to learn from)."""
        for wanted in _STARTS:
            factor = self.ladder.factor(wanted)
            if len(self.ladder.chain(factor)) >= 2:
                return factor
        return self.ladder.factor(_STARTS[-1])

    def _wanted(self, factor: float, quantity: str, judged: Judged) -> float:
        """The factor that brings the error to the target at the observed order, at the expected one where none is."""
        order = judged.order if 0.3 <= judged.order <= 2.0 else kind_of(quantity).order
        refinement = (judged.error / (_MARGIN * self.target)) ** (1.0 / order)
        return factor * float(max(refinement, _LEAST))

    def _next(self, factor: float, wanted: float) -> tuple[float, bool]:
        """The next factor, and whether it is trusted to reach the target.

        The wanted one, as far as an extrapolation is trusted; twice the factor where that is little more, because the
        runs made so far are then those it is judged by. Measured times play no part: a search gives one answer.
        """
        longest = min(_LEAP, _GROWTH ** (1.0 / (1.0 + exponent_of(self.scene))))
        new = factor * min(wanted / factor, longest)
        if _NEARLY_TWICE * factor < new < 2.0 * factor:
            new = 2.0 * factor
        while (found := self.ladder.factor(new)) <= factor:
            new *= 1.1
        return found, wanted <= found

    def _model(self) -> CostModel:
        return CostModel.fitted(self.scene, self.ladder.runs)

    def _try(self, factor: float, trusted: bool) -> str:
        """Run a factor, with its output where it is ``trusted`` to be the last, and judge it; a sentence where that
        cannot be done."""
        at = self.ladder.at(factor)
        if self.ladder.runs:
            foreseen = self._model().seconds(at.mesh, at.time)
            if foreseen > self.limit:
                return f"the next run would take about {foreseen:.0f} CPU s, above the limit of {self.limit:g} s"
            if (need := memory_foreseen(self.scene, at)) > memory_of_the_machine():
                return f"the next run would need about {need / 1e9:.0f} GB of memory"
            self.tell(f"foreseen {foreseen:.2g} CPU s for mesh x {at.mesh:.3g}, steps x {at.time:.3g}")
        try:
            coarser = self.ladder.chain(factor)[1:2]
            for f in coarser:
                self.ladder.run(self.ladder.at(f))
            run = self.ladder.whole(at, self.scene.output) if trusted else self.ladder.run(at)
            if not run.converged:
                return f"mesh x {at.mesh:.3g}: {run.status}"
            names = [q for q in run.measured.values if wanted_by(self.scene, q)]
            if not names:
                return f"no quantity {self.scene.accuracy.quantity} in this scene"
            for needed in (2, 3):  # the third is cheap, and not wanted where two are enough
                found = [(q, ladder_error(self.ladder, factor, q, needed)) for q in names]
                self.tried[factor] = max(found, key=lambda pair: pair[1].error)
                if self.tried[factor][1].error <= self.target:
                    break
        except LatinError as error:
            return told(error)
        quantity, judged = self.tried[factor]
        order = "" if math.isnan(judged.order) else f", observed order {judged.order:.1f}"
        self.tell(f"         {quantity}: {'bound' if judged.bound_only else 'error'} {percent(judged.error)}{order}")
        return ""

    def _stuck(self) -> bool:
        """Whether the last refinements by four together hardly gain."""
        factors = sorted(self.tried)
        last = factors[-1]
        before = [f for f in factors if f <= last / 3.9]
        return bool(before) and self.tried[before[-1]][1].error < _STUCK**2 * self.tried[last][1].error

    def _chosen(self, factor: float, quantity: str, judged: Judged) -> Choice:
        at = self.ladder.at(factor)
        sentence = (
            f"{quantity} within {percent(self.target)}: estimated error {percent(max(judged.error, FLOOR))} at "
            f"mesh x {at.mesh:.3g}, steps x {at.time:.3g}, tolerance {self.ladder.scene.solver.tolerance:.2g}"
        )
        return self._choice(factor, quantity, judged, sentence, reached=True)

    def _refused(self, why: str) -> Choice:
        sentence = f"an accuracy of {percent(self.target)} cannot be promised: {why}"
        best = min(self.tried, key=lambda f: self.tried[f][1].error, default=None)
        if best is None:
            lost, quantity = Resolution(), self.scene.accuracy.quantity
            return Choice(None, lost, quantity, math.inf, False, math.nan, self.ladder.seconds, sentence)
        quantity, judged = self.tried[best]
        at = self.ladder.at(best)
        sentence += f". Best: {quantity} {percent(judged.error)} at mesh x {at.mesh:.3g}, steps x {at.time:.3g}"
        return self._choice(best, quantity, judged, sentence, reached=False)

    def _choice(self, factor: float, quantity: str, judged: Judged, sentence: str, reached: bool) -> Choice:
        at = self.ladder.at(factor)
        run = self.ladder.whole(at, self.scene.output)
        solution = self.ladder.solution
        if solution is not None:
            solution = replace(solution, estimate=self._estimate(factor, run))
        return Choice(solution, at, quantity, judged.error, reached, run.cpu, self.ladder.seconds, sentence)

    def _estimate(self, factor: float, run: Run) -> ErrorEstimate:
        """Estimated errors of every quantity of the chosen run, from the runs of the search."""
        found = []
        for quantity, value in run.measured.values.items():
            judged, kind = ladder_error(self.ladder, factor, quantity), kind_of(quantity)
            orders = (judged.order, kind.order, judged.bound_only)
            found.append(QuantityEstimate(quantity, value, kind.unit, judged.error, *orders, math.nan, math.nan))
        return ErrorEstimate(tuple(found), (), self.ladder.seconds - run.cpu, FLOOR)


def wanted_by(scene: Scene, quantity: str) -> bool:
    """Whether ``owner.key`` is what the scene aims at (a key alone stands for every owner)."""
    owner, _, key = scene.accuracy.quantity.rpartition(".")
    return quantity.rpartition(".")[2] == key and owner in ("", quantity.rpartition(".")[0])
