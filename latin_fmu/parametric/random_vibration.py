"""A random vibration of an assembly with contacts: independent windows of one run, and what they have in common.

A window is the run of the scene with another draw of the base motion, which all begin at the same state. Where the
assembly is marched by its modes, each but the first of a process is marched with the operators of the one before, and
nothing is made anew. What builds up at the beginning of a window is left out; the rest of it is stationary.

Groups of a file, ``signals/OWNER/QUANTITY`` with the quantities of ``window_statistics``::

    /                            frequency; number of windows, their durations; provenance and scene, as attributes
    /signals/<owner>/<quantity>  mean, rms, three_sigma, peak with _low and _high at 95 %, largest, kurtosis;
                                 spectrum (frequency) and crossing_rate (level) likewise; linear_rms, linear_spectrum
    /linear                      linear_frequency
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..accuracy.runs import Log
from ..errors import InputError, SolverError
from ..latin.outcome import Array
from ..modal.random_response import LinearResponse, LinearSignal, random_response
from ..reader import scene_from_dict
from ..results.dataset import Stored
from ..results.groups import StoredGroup, StoredVariable, finite, in_units, root_attributes
from ..scene.random_bases import random_bases
from ..scene.readable_numbers import aligned, readable
from ..scene.schema import Scene
from ..scene.units import SI, UnitSystem
from .ensembles import FEWEST, EnsembleBand, mean_band, median_band, positive_band, rate_band
from .point import CONVERGED, MOST_POINTS, WINDOW, Grid, Parameter, Plan, Record
from .study import solved_points, tables_of
from .window_statistics import WindowEvaluation, WindowSignal, frequencies

KIND: Final = "random vibration"
"""Attribute ``kind`` of the file."""
SIGMAS: Final = (-5.0, -4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
"""Levels of the rates of crossings in ``--json``, in standard deviations from the mean."""
_HEADING: Final = "the random vibration cannot be computed"
_PERIODS: Final = 4.0  # of the lowest frequency, in the stationary part of a window at least
_SEGMENTS: Final = 8  # of a window, where no damping gives the resolution of its spectrum
_LINES: Final = 4.0  # of a spectrum, in the narrowest resonance
_KEPT: Final = 2.0  # highest frequency of the spectra over that of the specification
_SQUARED: Final = {"m s-2": "m2 s-4 Hz-1", "m": "m2 Hz-1", "N": "N2 Hz-1"}
_UNRELATED: Final = 1e3  # rms over that of the linear answer, beyond which this is round-off
_SMALL: Final = 1e-4  # of the largest rms of its unit: smaller signals are in the file and in `--json` alone


@dataclass(frozen=True)
class SignalStatistics:
    """What independent windows say of a signal.

    Attributes
    ----------
    name, unit, what : of the signal. mean : with its band. rms : standard deviation about the mean, likewise. peak :
        median of the largest deviation from the mean in a window. largest : of all windows. kurtosis : fourth central
        moment over that of a Gaussian, which has 3. level : (n_level,), in the unit of the signal, and crossing_rate :
        how often it is crossed upwards, s-1. spectrum : (n_frequency,), unit^2 / Hz. linear : answer with joints that
        stay as they are, None where there is none.
    """

    name: str
    unit: str
    what: str
    mean: EnsembleBand
    rms: EnsembleBand
    peak: EnsembleBand
    largest: float
    kurtosis: float
    level: Array
    crossing_rate: EnsembleBand
    spectrum: EnsembleBand
    linear: LinearSignal | None = None

    @staticmethod
    def of(windows: Sequence[WindowSignal], duration: float, linear: LinearSignal | None) -> SignalStatistics:
        """From two windows or more; ``duration`` of each, s."""
        one = windows[0]
        moments = np.array([w.moments for w in windows])
        reference = one.reference
        shift = float(moments[:, 0].mean())
        # central moments of each window about the mean of all
        squares = moments[:, 1] - 2.0 * shift * moments[:, 0] + shift**2
        fourth = moments[:, 3] - 4.0 * shift * moments[:, 2] + 6.0 * shift**2 * moments[:, 1]
        fourth += -4.0 * shift**3 * moments[:, 0] + shift**4
        center = reference + shift
        square = positive_band(np.maximum(squares, 0.0))
        peaks = np.array([max(w.ends[1] - center, center - w.ends[0]) for w in windows])
        level, counts = summed_crossings(windows)
        kurtosis = float(fourth.mean()) / square.value**2 if square.value > 0.0 else np.nan
        mean = mean_band(moments[:, 0])
        return SignalStatistics(
            one.name,
            one.unit,
            one.what,
            EnsembleBand(center, reference + mean.low, reference + mean.high),
            square.root(),
            median_band(peaks),
            float(peaks.max()),
            kurtosis,
            level,
            rate_band(counts, duration),
            positive_band([w.spectrum for w in windows]),
            linear,
        )

    @property
    def three_sigma(self) -> EnsembleBand:
        """Three standard deviations."""
        return self.rms.times(3.0)

    @property
    def of_linear(self) -> float:
        """rms over that of the linear answer; NaN where there is none."""
        if self.linear is None or not self.linear.rms > 0.0:
            return np.nan
        return float(self.rms.value / self.linear.rms)

    def rate_at(self, sigmas: float) -> EnsembleBand:
        """Rate of upward crossings, s-1, of the level so many standard deviations above the mean, between the levels
        that were counted."""
        level = self.mean.value + sigmas * self.rms.value
        rate = self.crossing_rate
        if not len(self.level):
            return EnsembleBand(0.0, 0.0, 0.0)
        ends = (np.interp(level, self.level, of, left=0.0, right=0.0) for of in (rate.value, rate.low, rate.high))
        return EnsembleBand(*(float(end) for end in ends))

    def report(self) -> dict[str, Any]:
        """Plain data: ``unit``, ``what`` it is, ``mean``, ``rms``, ``three_sigma`` and ``peak`` with ``_low`` and
        ``_high``, ``largest``, ``kurtosis``, rates of ``crossings`` at ``SIGMAS``, ``linear_rms`` and ``of_linear``."""
        made: dict[str, Any] = {"unit": self.unit, "what": self.what}
        for key in ("mean", "rms", "three_sigma", "peak"):
            band = getattr(self, key)
            made |= {key: finite(band.value), f"{key}_low": finite(band.low), f"{key}_high": finite(band.high)}
        made |= {"largest": finite(self.largest), "kurtosis": finite(self.kurtosis)}
        rates = [self.rate_at(k) for k in SIGMAS]
        made["crossings"] = {
            "sigmas": list(SIGMAS),
            "rate": [finite(of.value) for of in rates],
            "rate_low": [finite(of.low) for of in rates],
            "rate_high": [finite(of.high) for of in rates],
        }
        if self.linear is not None:
            made |= {"linear_rms": finite(self.linear.rms), "of_linear": finite(self.of_linear)}
        return made


def summed_crossings(windows: Sequence[WindowSignal]) -> tuple[Array, Array]:
    """Levels (n_level,) that all windows have, and how often each window crosses them, (n_window, n_level)."""
    varying = [w for w in windows if w.exponent is not None]
    if not varying:
        return np.zeros(0), np.zeros((len(windows), 0))
    # powers of two: every level of the widest spacing is one of all others
    spacing = max(int(w.exponent or 0) for w in varying)
    numbers = []
    for w in windows:
        each = w.first + np.arange(len(w.crossings))
        ratio = 2 ** (spacing - w.exponent) if w.exponent is not None else 1
        numbers.append((each[each % ratio == 0] // ratio, w.crossings[each % ratio == 0]))
    first = min(int(of[0]) for of, _ in numbers if len(of))
    last = max(int(of[-1]) for of, _ in numbers if len(of))
    counts = np.zeros((len(windows), last - first + 1))
    for row, (places, of) in zip(counts, numbers, strict=True):
        row[places - first] = of
    levels = windows[0].reference + 2.0**spacing * np.arange(first, last + 1, dtype=float)
    return np.asarray(levels), counts


@dataclass(frozen=True)
class RandomVibration(Stored):
    """Statistics of a random vibration.

    Attributes
    ----------
    name, scene : of the scene, and its text. count, left_out : of windows that count, and that failed or did not
        converge. end : of a window, s. how : it was evaluated. frequency : (n,) of the spectra, Hz. signals : by name.
    specified : rms of the acceleration of each base, by name, m s-2. shifted : resonance, Hz, that time steps lower by
        much beside its width, and by which part of it; None where there is none. linear : answer, None where there is
        none, and ``without`` why. marched : how, and cpu : (count,) seconds that each window took.
    """

    name: str
    scene: str
    count: int
    left_out: int
    end: float
    how: WindowEvaluation
    frequency: Array
    signals: Mapping[str, SignalStatistics]
    specified: Mapping[str, float]
    shifted: tuple[float, float] | None
    linear: LinearResponse | None
    without: str
    marched: str
    cpu: Array
    units: UnitSystem = SI

    @property
    def duration(self) -> float:
        """Stationary part of a window, s."""
        return self.end - self.how.begin

    @cached_property
    def shown(self) -> list[SignalStatistics]:
        """Signals that are more than round-off beside others of their unit."""
        largest: dict[str, float] = {}
        for of in self.signals.values():
            largest[of.unit] = max(largest.get(of.unit, 0.0), float(of.rms.value))
        return [of for of in self.signals.values() if of.rms.value > _SMALL * largest[of.unit]]

    def lines(self) -> list[str]:
        """Text: what was done, the base, and a table of the signals."""
        head = f"{self.name}: {self.count} windows of {readable(self.end, 's')}, of which the last "
        head += f"{readable(self.duration, 's')} count; lines of {readable(self._resolution, 'Hz')}"
        made = [head, *self._base_lines()]
        if self.left_out:
            made.append(f"  {self.left_out} more windows failed or did not converge: the bands are without them")
        if self.shifted is not None:
            made.append(
                f"  caution: time steps lower the resonance at {readable(self.shifted[0], 'Hz')} by "
                f"{100.0 * self.shifted[1]:.2g} %, more than a quarter of its width: take smaller ones, time.step"
            )
        if self.count < FEWEST:
            made.append(f"  peaks have bands from {FEWEST} windows on")
        made += ["", *aligned(self._rows()), ""]
        if self.linear is None:
            made.append(f"no linear answer: {self.without}")
        return [*made, self._cost()]

    @property
    def _resolution(self) -> float:
        return float(self.frequency[1] - self.frequency[0]) if len(self.frequency) > 1 else np.nan

    def _base_lines(self) -> list[str]:
        made = []
        for name, specified in self.specified.items():
            of, unit = self.signals[f"{name}.acceleration"], self.units.shown("m s-2")
            change = of.rms.value / specified - 1.0
            made.append(
                f"  {name}: rms {readable(specified, unit)} specified, {readable(float(of.rms.value), unit)} in the "
                f"windows ({100.0 * change:+.2g} %)"
            )
        return made

    def _rows(self) -> list[tuple[str, ...]]:
        head = ("signal", "mean", "rms", "at 95 %", "3 sigma", "peak of a window", "at 95 %", "largest", "kurtosis")
        rows: list[tuple[str, ...]] = [(*head, "linear rms", "of linear")]
        for of in self.shown:
            unit = self.units.shown(of.unit)
            linear = ("-", "-")
            if of.linear is not None and of.of_linear < _UNRELATED:
                linear = readable(of.linear.rms, unit), f"{of.of_linear:.3f}"
            numbers = (of.mean.value, of.rms.value)
            rows.append(
                (
                    of.name,
                    *(readable(float(value), unit, 3) for value in numbers),
                    _ends(of.rms),
                    readable(float(of.three_sigma.value), unit, 3),
                    readable(float(of.peak.value), unit, 3),
                    _ends(of.peak),
                    readable(of.largest, unit, 3),
                    f"{of.kurtosis:.2f}",
                    *linear,
                )
            )
        return rows

    def _cost(self) -> str:
        """What the windows cost, and why."""
        first, total = float(self.cpu[0]), float(self.cpu.sum())
        others = np.sort(self.cpu)[: len(self.cpu) - 1]
        text = f"cost: {total:.3g} s of CPU; each window {float(np.median(others)):.3g} s, the first one {first:.3g} s "
        text += "with its set-up; marched "
        if self.marched:
            return f"{text}by {self.marched}"
        return f'{text}body by body: solver.propagator = "modal" costs less where joints stay closed'

    def report(self) -> dict[str, Any]:
        """Plain data for strict JSON, in the units of the scene: number of ``windows``, ``left_out``, ``end`` and
        ``duration`` (s) of a window, ``resolution`` (Hz), ``specified`` rms of each base, ``shifted`` resonance, and
        ``signals`` (``SignalStatistics.report``)."""
        signals = {name: of.report() for name, of in self.signals.items()}
        for of in signals.values():
            of["unit"] = self.units.label(of["unit"])
        return {
            "scene": self.name,
            "windows": self.count,
            "left_out": self.left_out,
            "end": self.end,
            "duration": self.duration,
            "resolution": finite(self._resolution),
            "specified": dict(self.specified),
            "shifted": None if self.shifted is None else {"frequency": self.shifted[0], "by": self.shifted[1]},
            "linear": self.without or "modes about the clamped state",
            "cpu": float(self.cpu.sum()),
            "signals": signals,
        }

    def groups(self) -> dict[str, StoredGroup]:
        """Groups by path (module docstring)."""
        attrs = root_attributes(KIND, self.name, self.scene)
        attrs |= {"kind": KIND, "windows": self.count, "left_out": self.left_out, "end": self.end}
        attrs |= {"duration": self.duration, "linear": self.without or "modes about the clamped state"}
        along = {"frequency": StoredVariable(("frequency",), self.frequency, _named("frequency", "Hz"))}
        groups = {"/": StoredGroup(along, frozenset(along), attrs)}
        if self.linear is not None:
            attributes = _named("frequency of the linear answer", "Hz")
            grid = StoredVariable(("linear_frequency",), self.linear.frequency, attributes)
            groups["/"] = StoredGroup(
                {**along, "linear_frequency": grid}, frozenset((*along, "linear_frequency")), attrs
            )
        for name, of in self.signals.items():
            owner, _, key = name.partition(".")
            groups[f"/signals/{owner}/{key.replace('.', '_')}"] = _group(of)
        return in_units(groups, self.units)


def _ends(band: EnsembleBand) -> str:
    """Ends of a band over its value, in per cent."""
    if not np.isfinite(band.low) or not band.value > 0.0:
        return "-"
    low, high = (100.0 * (float(end) / float(band.value) - 1.0) for end in (band.low, band.high))
    return f"{low:+.2g} to {high:+.2g} %"


def _named(what: str, unit: str) -> dict[str, Any]:
    return {"long_name": what, "units": unit}


def _group(of: SignalStatistics) -> StoredGroup:
    """Group of a signal."""
    squared = _SQUARED[of.unit]
    bands = {
        "mean": (of.mean, (), of.unit, "mean"),
        "rms": (of.rms, (), of.unit, "standard deviation"),
        "three_sigma": (of.three_sigma, (), of.unit, "three standard deviations"),
        "peak": (of.peak, (), of.unit, "median of the largest deviation from the mean in a window"),
        "crossing_rate": (of.crossing_rate, ("level",), "s-1", "rate at which a level is crossed upwards"),
        "spectrum": (of.spectrum, ("frequency",), squared, "one-sided power spectral density"),
    }
    variables = {"level": StoredVariable(("level",), of.level, _named("level", of.unit))}
    for key, (band, dims, unit, what) in bands.items():
        variables[key] = StoredVariable(dims, np.asarray(band.value), _named(what, unit))
        for end, word in (("low", "lower"), ("high", "upper")):
            attrs = _named(f"{word} end of the band at 95 %: {what}", unit)
            variables[f"{key}_{end}"] = StoredVariable(dims, np.asarray(getattr(band, end)), attrs)
    largest = _named("largest deviation from the mean in all windows", of.unit)
    variables["largest"] = StoredVariable((), np.asarray(of.largest), largest)
    kurtosis = _named("fourth central moment over the square of the second one, 3 of a Gaussian", "1")
    variables["kurtosis"] = StoredVariable((), np.asarray(of.kurtosis), kurtosis)
    if of.linear is not None:
        rms = _named("standard deviation of the linear answer", of.unit)
        variables["linear_rms"] = StoredVariable((), np.asarray(of.linear.rms), rms)
        spectrum = _named("spectral density of the linear answer", squared)
        variables["linear_spectrum"] = StoredVariable(("linear_frequency",), of.linear.spectrum, spectrum)
    return StoredGroup(variables, frozenset({"level"}), {"signal": of.name, "long_name": of.what})


def random_vibration(
    scene: Scene | str | Path,
    windows: int = 50,
    output: str | Path | None = None,
    *,
    settings: Sequence[str] = (),
    startup: float | None = None,
    resolution: float | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    log: Log | None = None,
    max_cpu: float | None = None,
) -> RandomVibration:
    """Statistics of a scene whose base has a random vibration, from independent windows, beside the linear answer.

    Parameters
    ----------
    scene : file, or a scene, with a boundary whose law is of type "psd"; its run is a window. windows : number of them.
    startup : time at the beginning of each window that does not count, s; None: until the base motion is faded in, and
        then until free vibrations of the slowest mode in the band have decayed to a twentieth.
    resolution : distance of the lines of the spectra, Hz; None: a quarter of the narrowest resonance where the window
        is long enough.
    output, settings, jobs, scheduler, log, max_cpu : as for ``sweep``, with windows for points.

    Returns
    -------
    Statistics by signal (``SignalStatistics``), as text, plain data and groups of a file.

    Raises
    ------
    InputError : no random vibration, windows too short or too few. SceneError : the scene cannot be built.
    SolverError : fewer than two windows converge. ResultsError : the output cannot be written.

    Examples
    --------
    >>> found = latin_fmu.random_vibration("examples/random_vibration.toml", 6)
    >>> found.count, bool(abs(found.signals["base.acceleration"].rms.value / found.specified["base"] - 1.0) < 0.1)
    (6, True)
    """
    tables, base_dir = tables_of(scene, settings)
    whole = scene_from_dict(tables, base_dir)
    _check(whole, windows)
    linear, without = _linear(whole)
    how = _evaluation(whole, linear, startup, resolution)
    output_table = dict(tables.get("output", {})) | {"sensitivities": []}
    plain = {key: value for key, value in tables.items() if key != "spread"} | {"output": output_table}
    numbers = tuple(range(windows))
    parameter = Parameter(f"boundary.{next(iter(random_bases(whole)))}.law.window", numbers)
    plan = Plan(Grid(plain, base_dir, (parameter,), True), max_cpu=max_cpu, evaluation=how)
    _, records, done = solved_points(plan, output, jobs, scheduler, log)
    found = _combined(whole, [records[point] for point in sorted(records)], how, linear, without)
    if output is not None:
        found.save(output)
    done()
    return found


def _check(scene: Scene, windows: int) -> None:
    if not random_bases(scene):
        remedy = 'give a boundary of type = "acceleration" the law {type = "psd", file = "..."}'
        raise InputError.of(_HEADING, "boundary", "the scene has no random vibration", remedy=remedy)
    if not 2 <= windows <= MOST_POINTS:
        raise InputError.of(_HEADING, "--windows", "number of windows", str(windows), f"2 to {MOST_POINTS}")


def _linear(scene: Scene) -> tuple[LinearResponse | None, str]:
    """The linear answer; None and why, where there is none."""
    try:
        return random_response(scene.undifferentiated), ""
    except InputError as error:
        return None, "; ".join(f"{problem.where}: {problem.what}" for problem in error.problems)


def _evaluation(
    scene: Scene, linear: LinearResponse | None, startup: float | None, resolution: float | None
) -> WindowEvaluation:
    """How windows are evaluated.

    Raises
    ------
    InputError : no damping and no start-up, or windows that are too short.
    """
    motions = [base.motion for base in random_bases(scene).values()]
    first, last = (f(motion.density.ends[i] for motion in motions) for i, f in ((0, min), (1, max)))
    step, end = scene.time.time_step, scene.time.end
    if startup is None:
        if linear is None or linear.slowest is None:
            what = "the time in which a window becomes stationary follows from the damping, which is not known"
            raise InputError.of(_HEADING, "--startup", what, remedy="give it in s")
        startup = max(motion.faded for motion in motions) + linear.settled
    shortest = startup + _PERIODS / first
    if startup < 0.0 or end < shortest:
        what = f"the windows are too short: they become stationary after {startup:.4g} s"
        raise InputError.of(_HEADING, "time.end", what, f"{end:g} s", f"{shortest:.4g} s or more")
    samples = round((end - startup) / step)
    if resolution is None:
        bandwidth = None if linear is None else linear.bandwidth
        segment = samples // _SEGMENTS if bandwidth is None else round(_LINES / (bandwidth * step))
    else:
        segment = round(1.0 / (resolution * step)) if resolution > 0.0 else 0
        if not 8 <= segment <= samples:
            allowed = f"{1.0 / (samples * step):.4g} to {1.0 / (8 * step):.4g} Hz"
            raise InputError.of(_HEADING, "--resolution", "lines of the spectra", f"{resolution:g} Hz", allowed)
    # the first instant that counts is that of a sample
    return WindowEvaluation(end - samples * step * (1.0 + 1e-12), min(segment, samples), min(_KEPT * last, 0.5 / step))


def _combined(
    scene: Scene, records: Sequence[Record], how: WindowEvaluation, linear: LinearResponse | None, without: str
) -> RandomVibration:
    """Statistics of the records of all windows.

    Raises
    ------
    SolverError : fewer than two have converged.
    """
    kept = [record for record in records if record["state"] == CONVERGED and WINDOW in record]
    if len(kept) < 2:
        reason = next((f": {record['message']}" for record in records if record["state"] != CONVERGED), "")
        raise SolverError(f"{len(kept)} of {len(records)} windows have converged, bands take two at least{reason}")
    by_name: dict[str, list[WindowSignal]] = {}
    for record in kept:
        for plain in record[WINDOW]:
            by_name.setdefault(plain["name"], []).append(WindowSignal(**plain))
    answers = {} if linear is None else linear.signals
    duration = scene.time.end - how.begin
    signals = {name: SignalStatistics.of(of, duration, answers.get(name)) for name, of in by_name.items()}
    return RandomVibration(
        name=scene.name,
        scene=scene.text(),
        count=len(kept),
        left_out=len(records) - len(kept),
        end=scene.time.end,
        how=how,
        frequency=frequencies(scene.time.time_step, how),
        signals=signals,
        specified={name: base.size * base.motion.density.rms for name, base in random_bases(scene).items()},
        shifted=None if linear is None else linear.shifted(scene.time.time_step),
        linear=linear,
        without=without,
        marched=str(kept[0]["marched"]),
        cpu=np.array([record["cpu"] for record in kept]),
        units=scene.unit_system,
    )
