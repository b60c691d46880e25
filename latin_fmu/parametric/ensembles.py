"""Bands at 95 % of what independent windows have in common.

A mean over N windows has the band of Student's t with N - 1 degrees of freedom. That of a positive number (mean square,
spectral density) is taken of its logarithm, whose standard deviation is that of the windows over the mean: it stays
positive, and suits the skewed distribution of squares. The median of the largest values has a band between two of
them in order, whatever their distribution is (order statistics): with B binomial (N, 1/2), the band from the r-th
smallest to the r-th largest holds the median with the probability P(r <= B <= N - r). A count has the exact band of
Poisson's distribution (Garwood), or that of Student's t where windows differ by more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
CONFIDENCE: Final = 0.95
FEWEST: Final = 6
"""Windows from which on the median of the largest values has a band."""


@dataclass(frozen=True)
class EnsembleBand:
    """A number, or an array of them, and the ends of its band at 95 %."""

    value: Any
    low: Any
    high: Any

    def root(self) -> EnsembleBand:
        """Of the square root."""
        return EnsembleBand(np.sqrt(self.value), np.sqrt(self.low), np.sqrt(self.high))

    def times(self, factor: float) -> EnsembleBand:
        """Of a positive multiple."""
        return EnsembleBand(factor * self.value, factor * self.low, factor * self.high)


def _t(n: int) -> float:
    from scipy.special import stdtrit

    return float(stdtrit(n - 1, 0.5 * (1.0 + CONFIDENCE)))


def mean_band(values: ArrayLike) -> EnsembleBand:
    """Of the mean over the first axis."""
    every = np.asarray(values, dtype=float)
    n, mean = len(every), every.mean(axis=0)
    half = _t(n) * every.std(axis=0, ddof=1) / np.sqrt(n)
    return EnsembleBand(mean, mean - half, mean + half)


def positive_band(values: ArrayLike) -> EnsembleBand:
    """Of the mean over the first axis of numbers >= 0; zero without band where all of them are."""
    every = np.asarray(values, dtype=float)
    n, mean = len(every), every.mean(axis=0)
    spread = every.std(axis=0, ddof=1) / np.sqrt(n)
    factor = np.exp(_t(n) * np.divide(spread, mean, out=np.zeros_like(np.asarray(mean)), where=mean > 0.0))
    return EnsembleBand(mean, mean / factor, mean * factor)


def median_band(values: ArrayLike) -> EnsembleBand:
    """Of the median of the population that values (n,) come from; NaN at its ends for fewer than ``FEWEST``."""
    from scipy.special import bdtr

    ordered = np.sort(np.asarray(values, dtype=float))
    n = len(ordered)
    middle = float(np.median(ordered))
    if n < FEWEST:
        return EnsembleBand(middle, np.nan, np.nan)
    # the narrowest that is wide enough: P(B <= r - 1) on either side
    ranks = [r for r in range(1, n // 2 + 1) if 1.0 - 2.0 * float(bdtr(r - 1, n, 0.5)) >= CONFIDENCE]
    return EnsembleBand(middle, float(ordered[ranks[-1] - 1]), float(ordered[-ranks[-1]]))


def rate_band(counts: ArrayLike, duration: float) -> EnsembleBand:
    """Of the rate, s-1, of events counted over the first axis in windows of a ``duration``, s."""
    from scipy.special import gammaincinv

    every = np.asarray(counts, dtype=float)
    n, total = len(every), every.sum(axis=0)
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = np.where(total > 0.0, gammaincinv(np.maximum(total, 1.0), tail), 0.0)
    high = gammaincinv(total + 1.0, 1.0 - tail)
    between = mean_band(every)
    exposure = n * duration
    return EnsembleBand(
        total / exposure,
        np.minimum(low / exposure, np.maximum(between.low, 0.0) / duration),
        np.maximum(high / exposure, between.high / duration),
    )
