"""A specified shock response spectrum: breakpoints, straight lines in the logarithms of both between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, Problem

Array = NDArray[np.float64]
PER_OCTAVE: Final = 12
"""Frequencies an octave at which a history is held to its specification."""
HIGHEST_SHARE: Final = 0.45
"""Highest frequency of a specification over the sampling rate of its history."""


@dataclass(frozen=True)
class Specification:
    """A maximax spectrum of absolute acceleration, or another one where a limit says so.

    Attributes
    ----------
    frequency : (n,) of the breakpoints, increasing, Hz. acceleration : (n,) value of the spectrum there, m s-2 unless
    it is another one. quality : Q of the oscillators.

    Examples
    --------
    >>> specification = latin_fmu.Specification.of([100.0, 1000.0], [200.0, 2000.0])
    >>> float(specification.at(400.0).round(6))
    800.0
    """

    frequency: Array
    acceleration: Array
    quality: float = 10.0

    @staticmethod
    def of(frequency: ArrayLike, acceleration: ArrayLike, quality: float = 10.0) -> Specification:
        """A specification of checked numbers.

        Raises
        ------
        InputError : breakpoints that are no spectrum (``breakpoint_problems``).
        """
        f, a = np.asarray(frequency, dtype=float).ravel(), np.asarray(acceleration, dtype=float).ravel()
        problems = [Problem(f"breakpoint {row}", what, value, allowed) for row, what, value, allowed in _faults(f, a)]
        if not 0.5 < quality < np.inf:
            problems.append(Problem("quality", "no Q of an oscillator", f"{quality:g}", "Q > 0.5"))
        if problems:
            raise InputError(problems, "no specification of a shock")
        return Specification(f, a, float(quality))

    def at(self, frequency: ArrayLike) -> Array:
        """The specified acceleration, m s-2, at frequencies, Hz."""
        logs = np.interp(np.log(frequency), np.log(self.frequency), np.log(self.acceleration))
        return np.asarray(np.exp(logs))

    def grid(self) -> Array:
        """Twelfths of an octave from the first breakpoint to the last one, and this, Hz."""
        first, last = float(self.frequency[0]), float(self.frequency[-1])
        count = int(np.floor(PER_OCTAVE * np.log2(last / first) + 1e-9))
        inside = first * 2.0 ** (np.arange(count + 1) / PER_OCTAVE)
        if last > inside[-1] * 2.0 ** (0.25 / PER_OCTAVE):
            return np.append(inside, last)
        return np.append(inside[:-1], last)


def _faults(frequency: Array, acceleration: Array) -> Iterator[tuple[int, str, str, str]]:
    """Row from 1, what is wrong, value and what is allowed, of every breakpoint that is none."""
    if len(frequency) < 2 or len(frequency) != len(acceleration):
        yield 1, "a spectrum needs two breakpoints or more", f"{len(frequency)}", "frequency and acceleration, twice"
    for i, (f, a) in enumerate(zip(frequency, acceleration, strict=False)):
        if not (np.isfinite(f) and f > 0.0):
            yield i + 1, "the frequency is not positive", f"{f:g}", "a frequency > 0 Hz"
        elif i and not f > frequency[i - 1]:
            before = f"{f:g} Hz after {frequency[i - 1]:g} Hz"
            yield i + 1, "frequencies do not increase", before, "breakpoints in the order of their frequencies"
        if not (np.isfinite(a) and a > 0.0):
            yield i + 1, "the value is not positive", f"{a:g}", "a value > 0"


def breakpoint_problems(frequency: Sequence[float], acceleration: Sequence[float]) -> list[tuple[int, str, str, str]]:
    """Faults of breakpoints: row from 1, what is wrong, value, what is allowed."""
    return list(_faults(np.asarray(frequency, dtype=float), np.asarray(acceleration, dtype=float)))
