"""Spectra of several records as one specification: the largest, or a normal tolerance limit of their logarithms.

    log x = mean(log x_i) + k s,    k = t'(confidence; n - 1, z sqrt(n)) / sqrt(n)

with the standard deviation s of n records, the quantile z of the share of a normal population that the limit covers,
and the quantile t' of the noncentral t distribution (NASA-HDBK-7005, section 6.1; Owen, Technometrics 10 (1968)
445-478).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]


def largest_of(spectra: Array) -> Array:
    """Largest value (m,) of spectra (n, m)."""
    return np.asarray(spectra.max(axis=0))


def tolerance_factor(count: int, covered: float = 0.95, confidence: float = 0.5) -> float:
    """k for ``count`` >= 2 records: ``covered`` of all records lie below the limit with this ``confidence``.

    >>> round(tolerance_factor(5), 2), round(tolerance_factor(10, 0.95, 0.9), 2)
    (1.78, 2.57)
    """
    z = float(stats.norm.ppf(covered))
    return float(stats.nct.ppf(confidence, count - 1, z * math.sqrt(count))) / math.sqrt(count)


def tolerance_limit(spectra: Array, covered: float = 0.95, confidence: float = 0.5) -> Array:
    """Normal tolerance limit (m,) of the logarithms of spectra (n, m), n >= 2."""
    logs = np.log(spectra)
    factor = tolerance_factor(len(spectra), covered, confidence)
    return np.asarray(np.exp(logs.mean(axis=0) + factor * logs.std(axis=0, ddof=1)))
