"""A wanted accuracy: which mesh, step and tolerance reach it, and what that costs, before it is paid."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from ..errors import LatinError
from ..latin.wanted_accuracy import tolerance_for
from ..results.estimates import ErrorEstimate, QuantityEstimate
from ..results.solution import Solution
from ..scene.schema import Scene
from .bench import CostModel, exponent_of, told
from .extrapolation import Judged
from .kinds import FLOOR, kind_of
from .ladder import Ladder
from .ladder_error import ladder_error
from .memory_model import memory_foreseen, memory_of_the_machine
from .refinement import Resolution, in_short_windows, with_tolerance
from .report import percent
from .runs import Run

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
