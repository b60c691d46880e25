r"""A stationary Gaussian base motion of a specified power spectral density, which begins at rest.

The motion is a sum of harmonics k / P, P its period, with complex Gaussian amplitudes,

    a(t) = Re sum of c_k exp(i omega_k t),    E |c_k|^2 / 2 = integral of the density over k / P -+ 1 / (2 P),

so that its mean square is that of the specification whatever P is, and any number of values is Gaussian (Shinozuka and
Deodatis, Simulation of stochastic processes by spectral representation, Appl. Mech. Rev. 44 (1991) 191-204, here with
random amplitudes, too). There is no harmonic below the lowest frequency of the specification by more than half a line:
velocity and displacement have no mean and do not drift.

So that the base begins at rest, its displacement d is faded in by w(t), a polynomial of degree five:

    a = w d'' + 2 w' d' + w'' d,    w = s^3 (10 - 15 s + 6 s^2),    s = t / t_f,

t_f being ``FADED`` periods of the lowest frequency. From t_f on the motion is stationary.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, Problem
from .specification import breakpoint_problems

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
FADED: Final = 2.0
"""Periods of the lowest frequency in which a motion is faded in."""
_ON_GRID: Final = 1e-6  # of a step: distance of an instant from the sample that it stands for
_AT_ONCE: Final = 2**22  # cosines at a time
_FLAT: Final = 1e-9  # exponents closer to -1 have a logarithm for an integral
_END: Final = 1e-9  # of a frequency: round-off at the ends of a specification


@dataclass(frozen=True)
class AccelerationDensity:
    """One-sided power spectral density of an acceleration: breakpoints, straight lines in the logarithms of both in
    between, nothing outside.

    Attributes
    ----------
    frequency : (n,) of the breakpoints, increasing, Hz. density : (n,) there, (m s-2)^2 / Hz.

    Examples
    --------
    >>> density = latin_fmu.AccelerationDensity.of([20.0, 80.0, 2000.0], [1.0, 4.0, 4.0])
    >>> density.at([40.0, 100.0, 3000.0]).round(6).tolist(), round(density.rms, 3)
    ([2.0, 4.0, 0.0], 88.487)
    """

    frequency: Array
    density: Array

    @staticmethod
    def of(frequency: ArrayLike, density: ArrayLike) -> AccelerationDensity:
        """A density of checked numbers.

        Raises
        ------
        InputError : breakpoints that are none (``specification.breakpoint_problems``).
        """
        f, s = np.asarray(frequency, dtype=float).ravel(), np.asarray(density, dtype=float).ravel()
        faults = breakpoint_problems(f.tolist(), s.tolist())
        if faults:
            problems = [Problem(f"breakpoint {row}", what, value, allowed) for row, what, value, allowed in faults]
            raise InputError(problems, "no specification of a random vibration")
        return AccelerationDensity(f, s)

    @property
    def ends(self) -> tuple[float, float]:
        """Lowest and highest frequency, Hz."""
        return float(self.frequency[0]), float(self.frequency[-1])

    def at(self, frequency: ArrayLike) -> Array:
        """The density at frequencies, (m s-2)^2 / Hz, 0 outside of the breakpoints."""
        f = np.asarray(frequency, dtype=float)
        first, last = self.ends
        inside = (f >= first * (1.0 - _END)) & (f <= last * (1.0 + _END))
        logs = np.interp(np.log(np.where(inside, f, first)), np.log(self.frequency), np.log(self.density))
        return np.where(inside, np.exp(logs), 0.0)

    def below(self, frequency: ArrayLike) -> Array:
        """Mean square of what is below frequencies, (m s-2)^2: the exact integral of the power laws between the
        breakpoints."""
        f = np.clip(np.asarray(frequency, dtype=float), *self.ends)
        start, values = self.frequency[:-1], self.density[:-1]
        slope = np.diff(np.log(self.density)) / np.diff(np.log(self.frequency))
        i = np.clip(np.searchsorted(self.frequency, f, side="right") - 1, 0, len(start) - 1)
        whole = np.concatenate([[0.0], np.cumsum(_of_power(start, values, slope, self.frequency[1:]))])
        return np.asarray(whole[i] + _of_power(start[i], values[i], slope[i], f))

    @property
    def rms(self) -> float:
        """Root mean square of the acceleration, m s-2."""
        return float(np.sqrt(self.below(self.ends[1])))


def _of_power(start: Array, value: Array, slope: Array, end: Array) -> Array:
    """Integrals of value (f / start)^slope from start to end."""
    exponent, ratio = slope + 1.0, np.log(end / start)
    flat = np.abs(exponent) < _FLAT
    return np.asarray(value * start * np.where(flat, ratio, np.expm1(exponent * ratio) / np.where(flat, 1.0, exponent)))


@dataclass(frozen=True)
class RandomMotion:
    """A base motion (module docstring).

    Attributes
    ----------
    density : that it has. period : P, s. seed : of its amplitudes, and which of the motions of this seed it is.

    Examples
    --------
    >>> density = latin_fmu.AccelerationDensity.of([20.0, 2000.0], [1.0, 1.0])
    >>> motion = latin_fmu.RandomMotion(density, period=1.0, seed=(3, 0))
    >>> a = motion.acceleration(np.arange(10000) * 1e-4)
    >>> bool(abs(a[1000:].std() / density.rms - 1.0) < 0.05), float(a[0])
    (True, 0.0)
    """

    density: AccelerationDensity
    period: float
    seed: tuple[int, int] = (0, 0)

    @property
    def faded(self) -> float:
        """t_f, s, from which on it is stationary."""
        return FADED / self.density.ends[0]

    @cached_property
    def lines(self) -> tuple[NDArray[np.int64], Complex]:
        """Numbers k of the harmonics and their amplitudes c, m s-2."""
        first, last = (end * self.period for end in self.density.ends)
        number = np.arange(max(1, int(np.floor(first + 0.5))), int(np.floor(last + 0.5)) + 1)
        edges = np.append(number - 0.5, number[-1:] + 0.5) / self.period
        squares = np.diff(self.density.below(edges))
        normal = np.random.default_rng(self.seed).standard_normal((len(number), 2))
        return number, np.sqrt(squares) * (normal[:, 0] + 1j * normal[:, 1])

    def acceleration(self, times: ArrayLike) -> Array:
        """m s-2, at times of any shape, s; 0 before t = 0."""
        w, rise, bend = self._fade(np.asarray(times, dtype=float))
        total = w * self._sum(times, 0)
        if not (rise.any() or bend.any()):
            return np.asarray(total)
        return np.asarray(total + 2.0 * rise * self._sum(times, 1) + bend * self._sum(times, 2))

    def velocity(self, times: ArrayLike) -> Array:
        """m s-1: the exact integral of the acceleration."""
        w, rise, _ = self._fade(np.asarray(times, dtype=float))
        return np.asarray(w * self._sum(times, 1) + rise * self._sum(times, 2))

    def displacement(self, times: ArrayLike) -> Array:
        """m: the exact integral of the velocity."""
        return np.asarray(self._fade(np.asarray(times, dtype=float))[0] * self._sum(times, 2))

    def _fade(self, times: Array) -> tuple[Array, Array, Array]:
        """w, w', s-1, and w'', s-2."""
        t_f = self.faded
        s = np.clip(times / t_f, 0.0, 1.0)
        w = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
        rise = 30.0 * s * s * (1.0 - s) ** 2 / t_f
        return w, rise, 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / t_f**2

    def _sum(self, times: ArrayLike, integrals: int) -> Array:
        """The sum of the harmonics, integrated once or twice, at times of any shape."""
        t = np.asarray(times, dtype=float)
        number, amplitude = self.lines
        amplitude = amplitude / (2j * np.pi * number / self.period) ** integrals
        flat = t.ravel()
        sample, count = self._samples(flat)
        if count > 2 * int(number[-1]):
            spectrum = np.zeros(count // 2 + 1, dtype=complex)
            spectrum[number] = 0.5 * count * amplitude
            return np.asarray(np.fft.irfft(spectrum, count)[sample].reshape(t.shape))
        parts = np.array_split(flat, max(1, len(flat) * len(number) // _AT_ONCE))
        angle = 2j * np.pi * number / self.period
        return np.concatenate([(np.exp(part[:, None] * angle) @ amplitude).real for part in parts]).reshape(t.shape)

    def _samples(self, times: Array) -> tuple[NDArray[np.int64], int]:
        """Numbers of the samples that times are, and how many samples the period has; 0 where they are none."""
        none = np.zeros(0, dtype=np.int64), 0
        if len(times) < 3:
            return none
        step = float(times[-1] - times[0]) / (len(times) - 1)
        if not step > 0.0:
            return none
        count = round(self.period / step)
        if count < 1:
            return none
        # of the period, not of the times: their own step has round-off
        places = times * (count / self.period)
        sample = np.rint(places).astype(np.int64)
        if np.abs(places - sample).max() > _ON_GRID:
            return none
        return sample % count, count


@lru_cache(maxsize=16)
def motion_of(
    frequency: tuple[float, ...], density: tuple[float, ...], period: float, seed: tuple[int, int]
) -> RandomMotion:
    """The motion of these numbers, whose harmonics are made once."""
    return RandomMotion(AccelerationDensity(np.array(frequency), np.array(density)), period, seed)
