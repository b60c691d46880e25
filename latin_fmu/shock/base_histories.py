r"""Base accelerations that have a specified shock response spectrum and come to rest.

A history is a sum of waves, one at each twelfth of an octave of the specification, with a size A_k that is sought and
a delay that a seed draws:

wavelets        sin(pi s / L) sin(2 pi f s) for 0 < s < L = n / (2 f), n odd: an odd number of half periods under one
                half sine, without velocity and displacement at its end (Smallwood and Nord, Matching shock spectra with
                sums of decaying sinusoids compensated for shaker velocity and displacement limitations, Shock and
                Vibration Bulletin 44-3 (1974))
damped_sines    exp(-zeta omega s) (sin(omega s) / omega - s cos(omega s + phi)), tan phi = 2 zeta / (1 - zeta^2):
                sudden and decaying, likewise at rest at the end (Fisher and Posehn, Digital control system for a
                multiple-actuator shaker, Shock and Vibration Bulletin 47-3 (1977))

Sampled waves are corrected by a + b s under a half wave squared, so that both integrals of the straight lines between
the samples vanish exactly.

The response of an oscillator is linear in the sizes, and its largest value changes as at the instant of that: the sizes
follow from the ratios of specified and reached values first, and then from damped Gauss-Newton steps on the relative
errors of all of them at once (Levenberg and Marquardt), with r_j(t_j) = sum of A_k (h_j * w_k)(t_j) and h_j the impulse
response of the filter of an oscillator (``oscillators.ramp_filter``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from ..errors import InputError, Problem
from .oscillators import largest_responses, ramp_filter
from .specification import HIGHEST_SHARE, Specification

Array = NDArray[np.float64]
Places = NDArray[np.int64]
Waves = Literal["wavelets", "damped_sines"]
WAVES: Final = ("wavelets", "damped_sines")
RATE: Final = 16.0
"""Samples per period of the highest frequency."""
PERIODS: Final = 6.0
"""Duration over the longest period, where none is asked for."""
_FEWEST_PERIODS: Final = 2.0  # of the lowest frequency in a history
_HALF_WAVES: Final = 3, 13  # of a wavelet
_DAMPING: Final = 0.05, 0.12  # ratios of damped sines
_DECAYED: Final = 12.0  # zeta omega s from which on a damped sine is over: 6e-6
_DELAYED: Final = 0.3  # of the duration: latest beginning of a wave
_COARSE, _FINE = 10, 40  # steps by ratios and by Gauss-Newton
_POWER: Final = 0.7  # of a ratio: neighbours respond, too
_CLOSE: Final = 0.3  # of the tolerance: closer is not sought
_STALLED: Final = 8  # steps that do not improve


@dataclass(frozen=True)
class TestStand:
    """A shaker or a drop table: largest acceleration, m s-2, velocity, m s-1, and displacement, m, that it can do.

    Attributes
    ----------
    duration : of its history, s; None: ``PERIODS`` of the lowest frequency. rate : samples a second; None: ``RATE``
        times the highest frequency.
    """

    __test__ = False  # no tests for pytest

    peak: float = math.inf
    velocity: float = math.inf
    displacement: float = math.inf
    duration: float | None = None
    rate: float | None = None


@dataclass(frozen=True)
class BaseHistory:
    """A base acceleration and how it meets its specification.

    Attributes
    ----------
    time : (n,) equal steps from 0, s. acceleration : (n,) linear in between, m s-2. specification : that it is for.
    frequency, reached : (m,) twelfths of an octave, Hz, and its maximax spectrum there, m s-2. seed : of its delays.
    stand : that it is for.
    """

    time: Array
    acceleration: Array
    specification: Specification
    frequency: Array
    reached: Array
    seed: int
    stand: TestStand

    @cached_property
    def velocity(self) -> Array:
        """(n,), m s-1: exact integral of the straight lines."""
        return np.asarray(cumulative_trapezoid(self.acceleration, dx=self._step, initial=0))

    @cached_property
    def displacement(self) -> Array:
        """(n,), m: exact integral of the velocity."""
        a, h = self.acceleration, self._step
        steps = h * self.velocity[:-1] + h * h * (a[:-1] / 3.0 + a[1:] / 6.0)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def _step(self) -> float:
        return float(self.time[1] - self.time[0])

    @cached_property
    def decibels(self) -> Array:
        """(m,) reached over specified, dB."""
        return np.asarray(20.0 * np.log10(self.reached / self.specification.at(self.frequency)))

    @property
    def error(self) -> float:
        """Largest of these in size, dB."""
        return float(np.abs(self.decibels).max())

    def outside(self, tolerance: float) -> Array:
        """Frequencies, Hz, at which the specification is missed by more than a tolerance, dB."""
        return self.frequency[np.abs(self.decibels) > tolerance]

    @property
    def excess(self) -> dict[str, tuple[float, float]]:
        """Largest acceleration, velocity or displacement beyond its limit, and the limit, by name."""
        largest = {
            "peak": (float(np.abs(self.acceleration).max()), self.stand.peak),
            "velocity": (float(np.abs(self.velocity).max()), self.stand.velocity),
            "displacement": (float(np.abs(self.displacement).max()), self.stand.displacement),
        }
        return {name: values for name, values in largest.items() if values[0] > values[1]}

    def meets(self, tolerance: float) -> bool:
        """Whether specification and limits are met."""
        return self.error <= tolerance and not self.excess


def base_history(
    specification: Specification,
    waves: Waves = "wavelets",
    *,
    tolerance: float = 1.0,
    seeds: Sequence[int] = range(5),
    stand: TestStand | None = None,
    progress: Callable[[str], None] | None = None,
) -> BaseHistory:
    """The base history of a specification with the smallest peak of several seeds; where none of them meets it within
    the tolerance and the limits, the one that comes closest.

    Parameters
    ----------
    waves : see the module docstring. tolerance : dB, at each twelfth of an octave. seeds : of delays and lengths.
    stand : limits and sampling. progress : called with a line a seed.

    Raises
    ------
    InputError : no seeds, a tolerance that is none, a history too short or too coarse (``sampling_problems``).

    Examples
    --------
    >>> specification = latin_fmu.Specification.of([100.0, 1000.0, 4000.0], [200.0, 5000.0, 5000.0])
    >>> history = latin_fmu.base_history(specification, seeds=[0])
    >>> bool(history.error < 1.0), bool(abs(history.velocity[-1]) < 1e-9 * abs(history.velocity).max())
    (True, True)
    """
    stand = stand or TestStand()
    problems = sampling_problems(specification, stand)
    if not seeds:
        problems.append(Problem("seeds", "none", allowed="one or more"))
    if not tolerance > 0.0:
        problems.append(Problem("tolerance", "not positive", f"{tolerance:g}", "dB > 0"))
    if problems:
        raise InputError(problems, "no base history")
    sums = [_Sum(specification, waves, seed, stand) for seed in seeds]
    for sum_ in sums:
        sum_.by_ratios()
    best: BaseHistory | None = None
    for sum_ in sorted(sums, key=lambda s: s.peak):
        sum_.by_newton(_CLOSE * tolerance)
        found = sum_.history()
        if progress is not None:
            peak = float(np.abs(found.acceleration).max())
            progress(f"seed {found.seed}: within {found.error:.2g} dB, peak {peak:.4g} m/s2")
        if best is None or _rank(found, tolerance) < _rank(best, tolerance):
            best = found
    assert best is not None
    return best


def sampling_problems(specification: Specification, stand: TestStand) -> list[Problem]:
    """A rate too low for the highest frequency of a specification, a duration too short for its lowest one."""
    first, last = float(specification.frequency[0]), float(specification.frequency[-1])
    problems = []
    if stand.rate is not None and last > HIGHEST_SHARE * stand.rate:
        allowed = f"up to {HIGHEST_SHARE:g} of the rate, {HIGHEST_SHARE * stand.rate:g} Hz"
        problems.append(Problem("rate", "the specification goes beyond its samples", f"{last:g} Hz", allowed))
    if stand.duration is not None and stand.duration * first < _FEWEST_PERIODS:
        allowed = f"{_FEWEST_PERIODS / first:g} s or more, {_FEWEST_PERIODS:g} of its longest periods"
        what = "the history is too short for its specification"
        problems.append(Problem("duration", what, f"{stand.duration:g} s", allowed))
    return problems


def _rank(history: BaseHistory, tolerance: float) -> tuple[bool, float]:
    """Smaller is better: by peak where all is met, else by the error and what is beyond the limits."""
    if history.meets(tolerance):
        return False, float(np.abs(history.acceleration).max())
    beyond = [20.0 * math.log10(value / limit) for value, limit in history.excess.values()]
    return True, max(history.error / tolerance, *(1.0 + db for db in beyond), 0.0)


class _Sum:
    """Waves of one seed and their sizes.

    Attributes
    ----------
    rows : (m, n) waves. sizes : (m,), m s-2.
    """

    def __init__(self, specification: Specification, waves: Waves, seed: int, stand: TestStand) -> None:
        self.seed, self.specification, self.stand = seed, specification, stand
        self.frequency = specification.grid()
        self.specified = specification.at(self.frequency)
        self.damping = 0.5 / specification.quality
        rate = stand.rate or RATE * float(self.frequency[-1])
        whole = stand.duration or PERIODS / float(self.frequency[0])
        self.step = 1.0 / rate
        self.time: Array = self.step * np.arange(math.ceil(whole * rate) + 1, dtype=float)
        self.rows = np.array(list(_waves(waves, self.frequency, self.time, np.random.default_rng(seed))))
        signs = np.where(np.arange(len(self.frequency)) % 2, 1.0, -1.0)
        self.sizes = signs * self.specified * 2.0 * self.damping
        # a period of the lowest oscillator more: its largest response may follow
        after = math.ceil(rate / float(self.frequency[0]))
        self._rest = np.zeros(after)
        self._filters = [ramp_filter(2.0 * np.pi * f * self.step, self.damping)[1:] for f in self.frequency]

    @property
    def acceleration(self) -> Array:
        """The sum, (n,), m s-2."""
        return np.asarray(self.sizes @ self.rows)

    @property
    def peak(self) -> float:
        """Largest acceleration, m s-2."""
        return float(np.abs(self.acceleration).max())

    def _largest(self, sizes: Array) -> tuple[Array, Places]:
        """Largest responses (m,), signed, m s-2, and their samples."""
        padded = np.concatenate([sizes @ self.rows, self._rest])
        values, places = np.empty(len(sizes)), np.empty(len(sizes), dtype=np.int64)
        for j, (numerator, denominator) in enumerate(self._filters):
            response = lfilter(numerator, denominator, padded)
            places[j] = int(np.abs(response).argmax())
            values[j] = response[places[j]]
        return values, places

    def _error(self, values: Array) -> float:
        """Largest error, dB."""
        return float(np.abs(20.0 * np.log10(np.abs(values) / self.specified)).max())

    def by_ratios(self) -> None:
        """Sizes from the ratios of specified and reached values."""
        best, least = self.sizes, math.inf
        for _ in range(_COARSE):
            values, _ = self._largest(self.sizes)
            if self._error(values) < least:
                best, least = self.sizes, self._error(values)
            self.sizes = self.sizes * (self.specified / np.abs(values)) ** _POWER
        self.sizes = best

    @cached_property
    def _impulses(self) -> Array:
        """Impulse responses (m, n + after) of the filters, backwards."""
        unit = np.concatenate([[1.0], np.zeros(len(self.time) + len(self._rest) - 1)])
        return np.array([lfilter(b, a, unit)[::-1] for b, a in self._filters])

    def by_newton(self, enough: float) -> None:
        """Sizes by Levenberg's and Marquardt's steps until all errors are below ``enough``, dB."""
        values, places = self._largest(self.sizes)
        best, least, stalled, weight = self.sizes, self._error(values), 0, 1e-3
        for _ in range(_FINE):
            if least <= enough or stalled == _STALLED:
                break
            slopes = self._slopes(places) * self.sizes / self.specified[:, None]
            wanted = (np.sign(values) * self.specified - values) / self.specified
            normal = slopes.T @ slopes
            normal[np.diag_indices_from(normal)] += weight * la.norm(slopes, 2) ** 2
            change = la.solve(normal, slopes.T @ wanted, assume_a="pos")
            change *= min(1.0, 0.5 / float(np.abs(change).max()))
            sizes = self.sizes * (1.0 + change)
            tried = self._largest(sizes)
            error = self._error(tried[0])
            stalled += 1
            if error > 1.5 * least:
                weight *= 5.0
                continue
            weight = max(weight / 2.0, 1e-5)
            self.sizes, (values, places) = sizes, tried
            if error < 0.99 * least:
                stalled = 0
            if error < least:
                best, least = sizes, error
        self.sizes = best

    def _slopes(self, places: Places) -> Array:
        """Responses (m, m) of the oscillators to each wave at the ``places`` of their largest ones."""
        slopes = np.empty((len(places), len(places)))
        for j, place in enumerate(places):
            n = min(int(place) + 1, len(self.time))
            start = len(self._impulses[j]) - 1 - int(place)
            slopes[j] = self.rows[:, :n] @ self._impulses[j, start : start + n]
        return slopes

    def history(self) -> BaseHistory:
        """The sum with its spectrum."""
        acceleration = self.acceleration
        spectrum = largest_responses(acceleration[:, None], self.step, self.frequency, self.damping)[0, 0, :, 0]
        return BaseHistory(self.time, acceleration, self.specification, self.frequency, spectrum, self.seed, self.stand)


def _waves(waves: Waves, frequency: Array, time: Array, random: np.random.Generator) -> Iterator[Array]:
    """The waves of all frequencies, (n,) each, of unit size."""
    duration, step = float(time[-1]), float(time[1] - time[0])
    lengths, delays = random.uniform(size=len(frequency)), random.uniform(size=len(frequency))
    for f, length, share in zip(frequency, lengths, delays, strict=True):
        omega, low, high = 2.0 * np.pi * f, *_HALF_WAVES
        if waves == "wavelets":
            # odd, and no more than there is room for
            n = 2 * int((low + length * (high - low)) // 2) + 1
            n = max(min(n, 2 * int((2.0 * f * duration - 1.0) // 2) + 1), low)
            last = n / (2.0 * f)
        else:
            ratio = max(_DAMPING[0] + length * (_DAMPING[1] - _DAMPING[0]), _DECAYED / (omega * 0.9 * duration))
            last = _DECAYED / (ratio * omega)
        delay = step * round(share * max(min(_DELAYED * duration, duration - last), 0.0) / step)
        s = time - delay
        inside = (s >= 0.0) & (s <= last)
        s = s[inside]
        if waves == "wavelets":
            values = np.sin(np.pi * s / last) * np.sin(omega * s)
        else:
            phase = math.atan2(2.0 * ratio, 1.0 - ratio**2)
            values = np.exp(-ratio * omega * s) * (np.sin(omega * s) - omega * s * np.cos(omega * s + phase))
            values /= np.abs(values).max()
        wave = np.zeros(len(time))
        wave[inside] = values
        yield at_rest(wave, inside, duration - time)


def at_rest(wave: Array, inside: NDArray[np.bool_], left: Array) -> Array:
    """A wave without velocity and displacement at its end, as straight lines between its samples: sum of a and of
    a (T - t) are zero; ``left`` : T - t. Its end samples are 0."""
    places = np.flatnonzero(inside)
    share = np.arange(len(places)) / max(len(places) - 1, 1)
    window = np.sin(np.pi * share) ** 2
    shapes = np.zeros((2, len(wave)))
    shapes[0, places], shapes[1, places] = window, window * (share - 0.5)
    wave[places[[0, -1]]] = 0.0
    moments = np.stack([np.ones(len(wave)), left - left[places].mean()])
    return np.asarray(wave - la.solve(moments @ shapes.T, moments @ wave) @ shapes)
