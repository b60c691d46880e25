"""Hard cases: what is expected, measured numbers that must stay below limits, and laws that hold in every run."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from ..api import solve
from ..errors import LatinError
from ..latin.outcome import Array
from ..reader import scene_from_dict
from ..results.solution import Solution
from .scenes import Description


@dataclass(frozen=True)
class Measure:
    """One number of a case: it must be at most ``limit`` (a number that is not finite fails)."""

    what: str
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """Whether the limit is kept."""
        return math.isfinite(self.value) and self.value <= self.limit

    @property
    def margin(self) -> float:
        """Value over limit (infinite where a limit of zero is broken)."""
        if not math.isfinite(self.value):
            return math.inf
        if self.limit == 0:
            if self.value <= 0:
                return 0.0
            return math.inf
        return self.value / self.limit


class LimitError(Exception):
    """A case that its limit of CPU time has stopped."""


@dataclass
class Bench:
    """Solves the scenes of a case and counts what they cost; ``end``: of the CPU time of the process, s, or None."""

    iterations: list[int] = field(default_factory=list)
    fallbacks: int = 0
    end: float | None = None

    def solve(self, description: Description, counted: bool = True) -> Solution:
        """Solution of a description, converged or not; ``counted``: its iterations go into the row."""
        budget = None
        if self.end is not None:
            budget = max(self.end - time.process_time(), 0.0)
        # a description serves several runs, and the reader may change it
        solution = solve(scene_from_dict(copy.deepcopy(description)), max_cpu=budget)
        if solution.interrupted:
            raise LimitError(solution.interrupted)
        if counted:
            self.iterations += [window.iterations for window in solution.windows]
            self.fallbacks += sum(bool(window.fallbacks) for window in solution.windows)
        return solution

    def converged(self, description: Description, counted: bool = True) -> Solution:
        """As ``solve``; raises ArithmeticError with the status where the run did not converge."""
        solution = self.solve(description, counted)
        if not solution.converged:
            raise ArithmeticError(solution.status)
        return solution


Check = Callable[[Bench], Sequence[Measure]]


@dataclass(frozen=True)
class Case:
    """One hard case.

    Attributes
    ----------
    name : family and parameters, e.g. "contrast E 1e4, bars". family : groups the rows of the report.
    expectation : what must hold, one sentence. check : solves and measures. quick : part of the quick suite.
    fault : of the package, for which the case does not hold, with the number measured; empty where it holds.
    """

    name: str
    family: str
    expectation: str
    check: Check
    quick: bool = True
    fault: str = ""


def make_case(
    family: str,
    name: str,
    expectation: str,
    check: Callable[..., Any],
    *arguments: Any,
    quick: bool = True,
    fault: str = "",
) -> Case:
    """A case that calls ``check`` with ``arguments`` and a bench."""
    return Case(name, family, expectation, partial(check, *arguments), quick, fault)


@dataclass(frozen=True)
class CaseResult:
    """Outcome of one case.

    ``margin`` is the largest value over limit of its measures, ``nearest`` that measure; ``iterations`` the largest
    number of LATIN iterations in a window, ``mean_iterations`` their mean, ``fallbacks`` the windows in which one was
    used; ``known_fault`` whether it fails by a known fault.
    """

    case: str
    family: str
    expected: str
    measured: str
    passed: bool
    margin: float
    iterations: int
    mean_iterations: float
    fallbacks: int
    seconds: float
    known_fault: bool = False
    nearest: str = ""


def run_case(case: Case, end: float | None = None) -> CaseResult:
    """Row of one case. A case whose run fails is a failed row, with the message of the error as its measure.

    Raises
    ------
    LimitError : the CPU time of the process has reached ``end``, s.
    """
    start = time.perf_counter()
    bench = Bench(end=end)
    measures: list[Measure] = []
    failure = ""
    try:
        measures = list(case.check(bench))
    # ``LimitError`` is none of these: it ends the suite
    except (ArithmeticError, LatinError, ValueError) as error:
        failure = f"{type(error).__name__}: {error}"
    limits = "; ".join(f"{m.what} <= {m.limit:.3g}" for m in measures)
    counts = bench.iterations
    nearest = max(measures, key=lambda m: m.margin, default=None)
    passed = bool(measures) and all(m.passed for m in measures)  # a case without measures has shown nothing
    expected = case.expectation
    if limits:
        expected = f"{expected}: {limits}"
    mean = 0.0
    if counts:
        mean = sum(counts) / len(counts)
    closest = failure
    if nearest is not None:
        closest = f"{nearest.what} {nearest.value:.3g} <= {nearest.limit:.3g}"
    return CaseResult(
        case=case.name,
        family=case.family,
        expected=expected,
        measured=failure or "; ".join(f"{m.value:.3g}" for m in measures),
        passed=passed,
        margin=max((m.margin for m in measures), default=math.inf),
        iterations=max(counts, default=0),
        mean_iterations=mean,
        fallbacks=bench.fallbacks,
        seconds=time.perf_counter() - start,
        # a case that holds again is not marked
        known_fault=bool(case.fault) and not passed,
        nearest=closest,
    )


def run_suite(
    cases: Iterable[Case], report: Callable[[CaseResult], None] | None = None, max_cpu: float | None = None
) -> list[CaseResult]:
    """Rows of all cases, in their order; ``report`` is called with each. After ``max_cpu`` seconds of CPU time the case
    that runs is given up, and those after it are left out."""
    rows: list[CaseResult] = []
    end = None
    if max_cpu is not None:
        end = time.process_time() + max_cpu
    for case in cases:
        if end is not None and time.process_time() >= end:
            break
        try:
            rows.append(run_case(case, end))
        except LimitError:
            break
        if report is not None:
            report(rows[-1])
    return rows


TIGHT: Mapping[str, Any] = MappingProxyType({"tolerance": 1e-9, "max_iterations": 3000})
"""Solver settings of a run to round-off: the same discrete problem, whatever the search direction."""


def pressure_force(solution: Solution, interface: str = "meet") -> Array:
    """Compressive normal resultant, (n_time,)."""
    return solution.interfaces[interface].normal_resultant()


def energies(solution: Solution) -> dict[str, Array]:
    """Terms of the energy balance, (n_time,) each, of a scene that requests it."""
    assert solution.energy is not None
    return solution.energy


def distance(computed: Array, reference: Array) -> float:
    """Largest difference over the largest reference value."""
    largest = float(np.abs(reference).max())
    apart = float(np.abs(computed - reference).max())
    if largest > 0:
        return apart / largest
    return apart


def impulse(solution: Solution, interface: str = "meet") -> float:
    """Time integral of the compressive resultant (end-of-step forces: the force acts over the step it ends)."""
    force = pressure_force(solution, interface)
    return float(np.trapezoid(force, solution.time))


def mean_iterations(solution: Solution) -> float:
    """LATIN iterations per window."""
    return float(np.mean([window.iterations for window in solution.windows]))


def turns(force: Array, level: float) -> int:
    """How often a force turns back by more than ``level``."""
    # as if it rose before: a first fall counts as a turn
    count = 0
    peak = float(force[0])
    rising = True
    for value in map(float, force[1:]):
        if (value - peak) * (1 if rising else -1) > 0:
            # the extreme moves on; a step back counts from it, however many instants it takes
            peak = value
        elif abs(value - peak) > level:
            count = count + 1
            rising = not rising
            peak = value
    return count


def openings(force: Array, level: float) -> int:
    """How often a force falls to zero after it has exceeded ``level``."""
    state, count = False, 0
    for value in force:
        if not state and value > level:
            state = True
        elif state and value <= 0.0:
            state, count = False, count + 1
    return count


def resultant(solution: Solution, interface: str = "meet") -> Array:
    """Force on side E, (n_time, 3)."""
    return solution.interfaces[interface].force()


def force_off(
    solution: Solution, reference: Solution, limit: float, interface: str = "meet", what: str = "force off by"
) -> Measure:
    """Largest difference of the force on an interface from that of another run, over the largest force of that run."""
    return Measure(what, distance(resultant(solution, interface), resultant(reference, interface)), limit)


def against_round_off(bench: Bench, scene: Description) -> list[Measure]:
    """The force, to the force tolerance of 1e-2, is that of the same discrete problem iterated to round-off; and the
    laws of every run."""
    solution = bench.converged(scene)
    exact = bench.converged(scene | {"solver": dict(TIGHT)}, counted=False)
    return [force_off(solution, exact, 1e-2), *laws(solution)]


def laws(solution: Solution, round_off: float = 1.2e-10) -> list[Measure]:
    """Laws that hold in every run: no tension, Coulomb's cone, energy balance to ``round_off``, no energy gained."""
    return [*contact_laws(solution), *energy_laws(solution, round_off)]


def contact_laws(solution: Solution, round_off: float = 1e-15) -> list[Measure]:
    """No tension and, to ``round_off``, Coulomb's cone at every point and instant, relative to the largest traction."""
    tension = cone = 0.0
    for history in solution.interfaces.values():
        if history.behaviour != "contact":
            continue
        # nothing touches: 0 over 1
        size = float(np.abs(history.traction).max()) or 1.0
        normal = np.einsum("tpc,pc->tp", history.traction, history.normals)
        shear = np.linalg.norm(history.traction - normal[..., None] * history.normals, axis=2)
        # traction on E along its outward normal: compression is negative
        tension = max(tension, float(normal.max()) / size)
        excess = shear - history.mu * np.maximum(-normal, 0.0)
        cone = max(cone, float(excess.max()) / size)
    return [Measure("tension", tension, 0.0), Measure("friction outside the cone", cone, round_off)]


def energy_laws(solution: Solution, round_off: float = 1.2e-10) -> list[Measure]:
    """Discrete balance (relative to the largest energy), and energy gained.

    Gained: stored energy minus work of loads above its start, at any instant; under loads at the end only (HHT
    weights the loads of three instants, so that its work is counted up to a step late), where interfaces may have
    passed on half of the force tolerance (1e-2) too much; iterated far the gain is negative.
    """
    energy = solution.energy
    if energy is None:
        return []
    stored = energy["kinetic"] + energy["elastic"]
    scale = max(float(stored.max()), float(np.abs(energy["work_of_loads"]).max())) or 1.0
    excess = stored - energy["work_of_loads"]
    loaded = bool(energy["work_of_loads"].any())
    growth = float(excess[-1] - excess[0] if loaded else (excess - excess[0]).max()) / scale
    return [
        Measure("energy balance", float(np.abs(energy["balance"]).max()) / scale, round_off),
        Measure("energy gained", growth, 4e-5 if loaded else 1e-14),
    ]


def penetration_bound(solution: Solution) -> float:
    """Largest penetration over its bound.

    Bound: half a step times the range of the opening velocity (an impact is met at the end of a step, and nothing
    pushes a penetrated point out), plus what the tolerance lets pass: in each step anew the velocities of both
    sides agree to the force tolerance (1e-2) of their sum, at most twice the largest in the assembly.
    """
    # equal steps from 0: the second instant is the step
    worst = 0.0
    step = float(solution.time[1])
    span = float(solution.time[-1])
    fastest = max(float(np.abs(history.velocity).max()) for history in solution.interfaces.values())
    for history in solution.interfaces.values():
        if history.gap is None:
            continue
        relative = history.velocity[:, 1] - history.velocity[:, 0]
        opening = np.einsum("tpc,pc->tp", relative, history.normals)
        change = float(np.ptp(opening, axis=0).max())
        bound = 0.5 * step * change + 2e-2 * span * fastest
        if bound > 0:
            worst = max(worst, history.penetration() / bound)
    return worst
