"""What a smaller error of each quantity costs, predicted from a run and the coarser runs of its estimate.

The estimated error D of a quantity without that of the iteration is split between mesh and time step by the changes
from the run (h, dt) to (2 h, dt) and from there to (2 h, 2 dt). With m elements per length and n steps over those of
the run, and the order p of the estimate,

    error(m, n) = D (w m^-p + (1 - w) n^-p) + iteration

The price of an error is the least CPU time (``runs.RunTimeFit``) of all m, n that the scene allows with that error at
most. Without the run (2 h, dt) mesh and steps change at one ratio; without a coarser mesh the steps alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from ..latin.outcome import Timings
from ..latin.settings import tolerance_for
from ..machine import memory_room
from ..results.estimates import ErrorEstimate, QuantityEstimate
from ..results.prices import TARGETS, Price, cpu_time
from ..run_quantities import Quantities, relative
from ..scene.quantity_table import definition_of
from ..scene.schema import Scene
from .runs import (
    FEWEST_STEPS,
    Resolution,
    RunCost,
    RunTimeFit,
    cost_exponent,
    counts_that_vary,
    memory_at,
    mesh_factor,
    mesh_files,
)

MARGIN: Final = 0.88
"""Share of a target that a predicted error may take."""
FINEST: Final = 4.0
"""Most elements per length, and steps per time, over those of the run: beyond, an order says little."""
_MOST_STEPS: Final = 8.0  # of steps alone
_FACTORS: Final = tuple(2.0 ** (k / 6.0) for k in range(-12, 13))  # from 1/4 to 4
_PYTHON: Final = 1e8  # bytes of a process that has solved nothing


@dataclass(frozen=True)
class PricedRuns:
    """What prices are predicted from.

    Attributes
    ----------
    fine, half : quantities of the run, and of the one with mesh and steps about twice as coarse. split : of the one
        with that mesh and the steps of the run; None where it was not made.
    costs : of these runs. timings : of the run.
    """

    fine: Quantities
    half: Quantities
    split: Quantities | None
    costs: Sequence[RunCost]
    timings: Timings


def priced(scene: Scene, estimate: ErrorEstimate, measured: PricedRuns) -> ErrorEstimate:
    """The estimate with the prices of its quantities; without a coarser mesh it stays, with its error."""
    ways = _Ways(scene, measured)
    quantities = tuple(
        replace(q, prices=tuple(ways.price(q, target) for target in TARGETS)) for q in estimate.quantities
    )
    return replace(estimate, quantities=quantities)


class _Ways:
    """Ways to change mesh and steps, and their cost."""

    def __init__(self, scene: Scene, measured: PricedRuns) -> None:
        self.scene = scene
        self.measured = measured
        self.fit = RunTimeFit.of(scene, measured.costs)
        self.coarsest = min(cost.at.time for cost in measured.costs)
        self.meshes = [1.0]
        coarsest = min(cost.at.mesh for cost in measured.costs)
        if coarsest < 1.0:
            reached = {mesh_factor(scene, factor) for factor in _FACTORS}
            self.meshes = sorted(m for m in reached if coarsest <= m <= FINEST)
        self.memory = {mesh: self._memory(mesh) for mesh in self.meshes}
        self.room = memory_room()[0] or math.inf

    def price(self, quantity: QuantityEstimate, target: float) -> Price:
        """Price of one quantity with one error."""
        row = definition_of(quantity.quantity)
        if row.unlimited:
            return Price(target, reason="no limit as the mesh is refined")
        if not math.isfinite(quantity.error):
            return Price(target, reason="error unknown")
        now = self.scene.solver.tolerance
        iteration = row.iteration * now
        tolerance = now
        # the iteration gets a tenth of the target, as in a search
        if iteration > 0.1 * target:
            tolerance = min(now, tolerance_for(target, row.iteration))
        allowed = MARGIN * target - row.iteration * tolerance
        ways = list(self._ways(quantity, allowed))
        # nothing is predicted of the run itself
        if quantity.error <= target:
            ways.append(Resolution())
            tolerance = now
        found = min(ways, key=lambda at: self.fit.seconds(at.mesh, at.time), default=None)
        if found is None:
            if quantity.bound_only:
                return Price(target, reason="changes do not decrease yet")
            most = FINEST if len(self.meshes) > 1 else _MOST_STEPS
            beyond = self.fit.seconds(self.meshes[-1], most)
            return Price(target, reason=f"more than {cpu_time(beyond)}")
        memory = self.memory[found.mesh]
        if memory > self.room:
            return Price(target, reason=f"needs {memory / 1e9:.2g} GB of memory")
        return Price(target, found.mesh, found.time, tolerance, self.fit.seconds(found.mesh, found.time), memory)

    def _ways(self, quantity: QuantityEstimate, allowed: float) -> Iterator[Resolution]:
        """Resolutions at which the error of discretisation is at most ``allowed``: of each mesh the fewest steps."""
        iteration = definition_of(quantity.quantity).iteration * self.scene.solver.tolerance
        error = max(quantity.error - iteration, 0.0)
        order = quantity.likely_order
        share = self._share_of_mesh(quantity.quantity)
        for mesh in self.meshes:
            if share is None:
                if error * mesh**-order <= allowed:
                    yield Resolution(mesh, mesh)
                continue
            rest = allowed - error * share * mesh**-order
            if rest <= 0.0:
                continue
            steps = max((error * (1.0 - share) / rest) ** (1.0 / order), self.coarsest, self._fewest)
            if steps <= _MOST_STEPS:
                yield Resolution(mesh, steps)

    @property
    def _fewest(self) -> float:
        return FEWEST_STEPS / self.scene.time.n_step

    def _share_of_mesh(self, quantity: str) -> float | None:
        """Share of the mesh in the error of discretisation; None where it was not measured."""
        if len(self.meshes) == 1:
            return 0.0
        m = self.measured
        if m.split is None:
            return None
        of_mesh, of_steps = relative(quantity, m.fine, m.fine, m.split), relative(quantity, m.fine, m.split, m.half)
        total = of_mesh + of_steps
        # NaN compares as none
        if not total > 0.0:
            return None
        return of_mesh / total

    def _memory(self, mesh: float) -> float:
        """Bytes of a run with another mesh, at most."""
        now = float(self.measured.timings.peak_memory)
        if mesh_files(self.scene) or not counts_that_vary(self.scene):
            return float(_PYTHON + max(now - _PYTHON, 0.0) * max(mesh, 1.0) ** max(cost_exponent(self.scene), 1.0))
        return now + max(memory_at(self.scene, Resolution(mesh)) - memory_at(self.scene, Resolution()), 0.0)


def split_of(scene: Scene, half: Resolution) -> Resolution | None:
    """The run that splits an error between mesh and step: the mesh of ``half`` with the steps of the scene; None where
    it would take more than a fifth of the time steps' work of the run."""
    if half.mesh == 1.0 or half.mesh ** cost_exponent(scene) > 0.2:
        return None
    return Resolution(half.mesh, 1.0)
