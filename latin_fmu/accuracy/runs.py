"""One run: quantities of interest, contact instants interpolated between its instants; its cost; time and memory of
other runs predicted from it."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import api
from ..assembly.propagator_choice import factor_bytes
from ..errors import LatinError
from ..latin.outcome import Array, InterfaceHistory, SensorHistory, Timings
from ..results.quantities_of_interest import (
    CONTACT_SHARE,
    DISPLACEMENT,
    FIRST_CONTACT,
    FORCE_HISTORY,
    FRICTION_WORK,
    IMPULSE,
    PEAK_FORCE,
    PEAK_FORCE_RAW,
    ROUND_OFF,
    SEPARATION,
    Force,
)
from ..results.solution import Solution
from ..scene.schema import Scene
from .resolution import Resolution, at_resolution, mesh_files


@dataclass(frozen=True)
class Quantities:
    """Quantities of a run (or of an exact solution).

    Attributes
    ----------
    values : by name ``owner.key``; the value of a force history is its L2 norm. scales : what errors are divided by.
    forces : normal resultants by interface. vectors : displacement (3,) of sensors at the end, m.
    durations : of the mean that is the peak force, by interface, s. spacings : of its points, by interface, m.
    """

    values: dict[str, float] = field(default_factory=dict)
    scales: dict[str, float] = field(default_factory=dict)
    forces: dict[str, Force] = field(default_factory=dict)
    vectors: dict[str, Array] = field(default_factory=dict)
    durations: dict[str, float] = field(default_factory=dict)
    spacings: dict[str, float] = field(default_factory=dict)

    def add(self, owner: str, entries: Mapping[str, tuple[float, float]]) -> None:
        """Add values and scales, by key, of an interface or sensor."""
        for key, (value, scale) in entries.items():
            self.values[f"{owner}.{key}"], self.scales[f"{owner}.{key}"] = value, scale

    def value(self, quantity: str, defining: Quantities) -> float:
        """Value of a quantity; the peak force is the mean over the duration that another run defines."""
        owner, _, key = quantity.rpartition(".")
        if key == PEAK_FORCE.key and owner in self.forces and owner in defining.durations:
            return self.forces[owner].largest_mean(defining.durations[owner])
        return self.values[quantity]

    def distance(self, quantity: str, other: Quantities, defining: Quantities | None = None) -> float:
        """Distance of a quantity to that of another run, in its unit.

        defining : the run whose contact defines the duration of the mean that is the peak force; this one where None.
        """
        owner, _, key = quantity.rpartition(".")
        defining = self if defining is None else defining
        if key == FORCE_HISTORY.key:
            return self.forces[owner].distance(other.forces[owner])
        if key == DISPLACEMENT.key and owner in self.vectors and owner in other.vectors:
            return float(np.linalg.norm(self.vectors[owner] - other.vectors[owner]))
        return abs(self.value(quantity, defining) - other.value(quantity, defining))

    def error(self, quantity: str, reference: Quantities) -> float:
        """Relative error of a quantity against a reference."""
        scale = reference.scales[quantity]
        apart = self.distance(quantity, reference)
        return apart / scale if scale > 0.0 else (0.0 if apart == 0.0 else np.inf)


def measure(
    time: Array,
    interfaces: Mapping[str, InterfaceHistory],
    end: float,
    sensors: Mapping[str, tuple[Array, Array]] | None = None,
) -> Quantities:
    """Quantities of the interfaces that may open (of all where none may) and of sensors, on [0, end].

    Parameters
    ----------
    time : (n_time,), s. end : s; what happens later is cut off. sensors : times (n,) and displacements (n, 3).
    """
    chosen = [h for h in interfaces.values() if h.contact_status is not None] or list(interfaces.values())
    quantities = Quantities()
    for history in chosen:
        _add_interface(quantities, time, history, end)
    for name, (instants, displacement) in (sensors or {}).items():
        last = np.array([np.interp(end, instants, displacement[:, i]) for i in range(3)])
        quantities.vectors[name] = last
        largest = float(np.linalg.norm(displacement, axis=1).max())
        quantities.add(name, {DISPLACEMENT.key: (float(np.linalg.norm(last)), largest)})
    return quantities


def _add_interface(quantities: Quantities, time: Array, history: InterfaceHistory, end: float) -> None:
    """Add impulse, instants, peak, friction work and force history of one interface."""
    force = _until(time, history.normal_resultant(), end)
    quantities.forces[history.name] = force
    duration = quantities.durations[history.name] = force.peak_duration(history.peak_duration)
    quantities.spacings[history.name] = float(np.sqrt(history.areas.mean()))
    largest = float(np.einsum("p,tp->t", history.areas, np.linalg.norm(history.traction, axis=2)).max(initial=0.0))
    entries = of_force(force, end, history.contact_status is not None, ROUND_OFF * largest, duration)
    if (closing := _closing(time, history, force.raw_peak())) is not None:
        entries[FIRST_CONTACT.key] = (closing, max(closing, 1e-2 * end))
    if history.friction_power is not None and history.has_friction:
        work = np.concatenate([[0.0], np.cumsum(history.friction_power[1:] * np.diff(time))])
        last = float(_until(time, work, end).value[-1])
        least = 1e-3 * entries[IMPULSE.key][1] * float(np.abs(history.velocity).max(initial=0.0))
        entries[FRICTION_WORK.key] = (last, max(last, least))
    quantities.add(history.name, entries)


def _closing(time: Array, history: InterfaceHistory, peak: float) -> float | None:
    """Instant at which an initial gap closes, from gap and velocity at the instant before the first contact.

    None where the sides touch from the start, never touch, or where the force defines the instant.
    """
    if history.gap is None:
        return None
    force = np.abs(history.normal_resultant())
    i = int(np.argmax(force > CONTACT_SHARE * peak))
    if i == 0:
        return None
    pressed = np.einsum("pc,pc->p", history.traction[i], history.normals) < 0.0
    gap = history.gap[i - 1][pressed]
    if not gap.size or gap.min() <= 0.0:
        return None
    jump = history.velocity[i - 1, 1] - history.velocity[i - 1, 0]
    closing = -np.einsum("pc,pc->p", jump, history.normals)[pressed]
    with np.errstate(divide="ignore"):
        wait = float(np.min(np.where(closing > 0.0, gap / closing, np.inf)))
    return float(min(time[i - 1] + wait, time[i]))


def of_force(
    force: Force, end: float, opens: bool, nothing: float = 0.0, duration: float | None = None
) -> dict[str, tuple[float, float]]:
    """Value and scale of the quantities that a force history gives, by key.

    First contact and separation of a contact whose force never exceeds ``nothing`` (N) are at the ``end``.
    duration : of the mean that is the peak force, s; a tenth of the longest contact where None.
    """
    size = np.abs(force.value)
    peak = force.raw_peak()
    mean = force.largest_mean(force.peak_duration(duration))
    steps = np.diff(force.time)
    impulse = float(np.sum(steps * 0.5 * (force.value[1:] + force.value[:-1])))
    whole = float(np.sum(steps * 0.5 * (size[1:] + size[:-1])))
    entries = {IMPULSE.key: (impulse, whole)}
    if opens:
        level = CONTACT_SHARE * peak
        never = peak <= nothing
        first = end if never else _first_above(force.time, size, level)
        last = (
            end if never else float(force.time[-1]) - _first_above(force.time[-1] - force.time[::-1], size[::-1], level)
        )
        entries[FIRST_CONTACT.key] = (first, max(first, 1e-2 * end))
        entries[SEPARATION.key] = (last, max(last, 1e-2 * end))
    entries[PEAK_FORCE.key] = (mean, mean)
    entries[PEAK_FORCE_RAW.key] = (peak, peak)
    entries[FORCE_HISTORY.key] = (force.norm(), force.norm())
    return entries


def _first_above(time: Array, size: Array, level: float) -> float:
    i = int(np.argmax(size > level))
    if i == 0:
        return float(time[0])
    share = (level - size[i - 1]) / (size[i] - size[i - 1])
    return float(time[i - 1] + share * (time[i] - time[i - 1]))


def _until(time: Array, values: Array, end: float) -> Force:
    """A history cut at ``end``."""
    inside = time < end * (1.0 - 1e-12)
    last = np.interp(end, time, values)
    return Force(np.append(time[inside], end), np.append(values[inside], last))


@dataclass(frozen=True)
class Run:
    """Quantities and cost of a run; NaN and no quantities where it was not made.

    Attributes
    ----------
    resolution : relative to the scene. quantities : of the run. cpu : CPU seconds of the process, set-up included.
    timings : by part. iterations : per window, mean and largest. converged, status : as of the solution; the reason
        where the run was not made, then ``steps`` is 0.
    steps : time steps. time, sensors : instants, s, and motions of the sensors.
    """

    resolution: Resolution
    quantities: Quantities = field(default_factory=Quantities)
    cpu: float = math.nan
    timings: Timings = field(default_factory=lambda: Timings(math.nan, math.nan, math.nan, math.nan))
    iterations: tuple[float, int] = (math.nan, 0)
    converged: bool = False
    status: str = ""
    steps: int = 0
    passes: float = math.nan
    time: Array = field(default_factory=lambda: np.zeros(0))
    sensors: Mapping[str, SensorHistory] = field(default_factory=dict)


def run_at(scene: Scene, resolution: Resolution, **options: Any) -> Run:
    """Solve the scene at a resolution; options as for ``api.solve`` (``progress``, ``processes``, ``stream``,
    ``max_cpu``).

    Raises
    ------
    SceneError : the scene cannot be built at this resolution.
    """
    run, solution = solved(scene, at_resolution(scene, resolution), resolution, **options)
    if solution.outcome.stream is not None:
        solution.outcome.stream.close()
    return run


def solved(scene: Scene, lean: Scene, resolution: Resolution, **options: Any) -> tuple[Run, Solution]:
    """The run and the solution of ``lean``, which is the scene at a resolution: its last instant may be a step later,
    so that quantities are those until the end of ``scene``. Options as for ``api.solve``.

    Raises
    ------
    LatinError : the scene cannot be built or solved.
    """
    start = clock.process_time()
    solution = api.solve(lean, **options)
    cpu = clock.process_time() - start
    counts = [window.iterations for window in solution.windows] or [0]
    run = Run(
        resolution=resolution,
        quantities=measure_solution(scene, solution),
        cpu=cpu,
        timings=solution.timings,
        iterations=(float(np.mean(counts)), max(counts)),
        converged=solution.trustworthy,
        status=solution.status,
        steps=len(solution.time) - 1,
        passes=solution.passes,
        time=solution.time,
        sensors=solution.sensors,
    )
    return run, solution


def measure_solution(scene: Scene, solution: Solution) -> Quantities:
    """Quantities of a solution on the interval of the scene."""
    sensors = {name: (solution.time, sensor.displacement) for name, sensor in solution.sensors.items()}
    return measure(solution.outcome.interface_time, solution.interfaces, scene.time.end, sensors)


Log = Callable[[str], None]
"""Takes a line of text."""


def message_of(error: LatinError) -> str:
    """The problems of an error as one line of text."""
    problems = getattr(error, "problems", ())
    return "; ".join(f"{p.where}: {p.what}" for p in problems) or str(error)


@dataclass(frozen=True)
class RunTimeFit:
    """CPU seconds of a run at another resolution: fixed + rate x mesh^exponent x steps, fitted to measured runs."""

    fixed: float
    rate: float
    exponent: float

    @classmethod
    def of(cls, scene: Scene, runs: list[Run]) -> RunTimeFit:
        """Fit to the largest and the cheapest of runs at different resolutions (at least one).

        The first run of a process includes the time to load kernels, so the smallest may not be the cheapest.
        """
        exponent = cost_exponent(scene)
        work = [r.resolution.mesh**exponent * r.resolution.time for r in runs]
        large = max(range(len(runs)), key=work.__getitem__)
        cheap = min(range(len(runs)), key=lambda i: runs[i].cpu)
        if work[cheap] == work[large]:
            return cls(0.0, runs[large].cpu / work[large], exponent)
        rate = (runs[large].cpu - runs[cheap].cpu) / (work[large] - work[cheap])
        return cls(max(runs[cheap].cpu - rate * work[cheap], 0.0), rate, exponent)

    def seconds(self, mesh: float, time: float) -> float:
        """Predicted CPU seconds at a resolution."""
        return float(self.fixed + self.rate * mesh**self.exponent * time)


def cost_exponent(scene: Scene) -> float:
    """Growth of the cost of a step with the number of elements along an edge: solves with banded factors in bars,
    about n^1.2 for the n nodes of plates and n^(4/3) of solids."""
    if mesh_files(scene):
        return 4.0
    directions = {i for b in scene.substructure.values() if b.box for i, n in enumerate(b.box.elements) if n > 1}
    return (0.0, 1.0, 2.4, 4.0)[len(directions)]


def memory_at(scene: Scene, at: Resolution) -> float:
    """Bytes of the Cholesky factors of the boxes at a resolution (``assembly.propagator_choice.factor_bytes``)."""
    boxes = [b.box for b in at_resolution(scene, Resolution(at.mesh)).substructure.values() if b.box is not None]
    return sum(factor_bytes(3 * math.prod(n + 1 for n in box.elements)) for box in boxes)
