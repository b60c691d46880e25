"""Damping by strain: the generalised Maxwell model whose damping ratio follows a line over a band of frequencies.

The complex modulus of a material over the static one is

    1 + i w b + sum_j g_j i w tau_j / (1 + i w tau_j),      b, g_j >= 0,

and the damping ratio of a mode whose strain energy is all in this material is half the loss factor at its frequency,
Im / (2 Re). A line zeta(w) between two given ratios, straight in the logarithms, is fitted by as few branches as hold
it within ``PRECISION`` over the band: for given tau_j the condition Im = 2 zeta Re is linear in b and g_j, which are
the nonnegative least-squares solution. The tau_j minimise the largest deviation of a line of about this height and
slope: they depend on both in steps, b and g_j smoothly, so that there are derivatives by the ratios.

No causal damping does without a rise of the modulus with frequency (Kramers, Kronig): about 4 zeta / pi per factor e.
A ratio can fall no faster than 1 / w, and only at a modulus that rises without bound; it can rise no faster than w.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PRECISION: Final = 0.05
"""Largest deviation of the fitted from the given ratio in the band, over the given one."""
MOST_BRANCHES: Final = 5
WIDEST: Final = 1e3
"""Largest band, as a ratio of frequencies."""
_SAMPLES: Final = 60  # frequencies of the band
_GRID: Final = {1: 40, 2: 28, 3: 16, 4: 12, 5: 10}  # corner frequencies tried, by number of branches
_SLOPES: Final = 0.05  # steps of the slope of the line for which corner frequencies are chosen
_HEIGHTS: Final = 0.2  # and of its height, in logarithms
_LOWEST: Final = 0.15  # corner frequency over the lower end of the band: below, the modulus rises far under the band


@dataclass(frozen=True)
class StrainDamping:
    """Complex modulus of a material over its static one (module docstring).

    Attributes
    ----------
    viscosity : b, s. strengths : g_j. times : tau_j, s. deviation : largest one from the given ratio in the band, over
        that ratio.
    """

    viscosity: float = 0.0
    strengths: tuple[float, ...] = ()
    times: tuple[float, ...] = ()
    deviation: float = 0.0

    def modulus(self, frequencies: Array) -> NDArray[np.complex128]:
        """Complex modulus (n,) over the static one at frequencies (n,), Hz."""
        turns = 2j * math.pi * np.asarray(frequencies, dtype=float)
        each = turns[..., None] * np.array(self.times)
        modulus: NDArray[np.complex128] = (
            1.0 + self.viscosity * turns + (each / (1.0 + each)) @ np.array(self.strengths)
        )
        return modulus

    def ratio(self, frequencies: Array) -> Array:
        """Damping ratio (n,) at frequencies (n,), Hz."""
        modulus = self.modulus(frequencies)
        ratios: Array = modulus.imag / (2.0 * modulus.real)
        return ratios

    def rise(self, frequencies: Array) -> Array:
        """Rise of natural frequencies (n,) at frequencies (n,), Hz, over those of the static modulus."""
        rises: Array = np.sqrt(self.modulus(frequencies).real) - 1.0
        return rises


@lru_cache(maxsize=256)
def fitted(first: float, last: float, low: float, high: float) -> StrainDamping:
    """Damping whose ratio goes from ``low`` at the frequency ``first`` to ``high`` at ``last``, Hz (module docstring).

    The fewest branches, at most ``MOST_BRANCHES``, that hold it within ``PRECISION``; else those that come closest.
    """
    width = last / first
    w = np.geomspace(1.0, width, _SAMPLES)  # in the lower end of the band
    slope = math.log(high / low) / math.log(width)
    target = low * w**slope
    best: tuple[float, Array, Array] | None = None
    for n in range(1, MOST_BRANCHES + 1):
        height = round(math.log(low * high) / (2.0 * _HEIGHTS)) * _HEIGHTS
        corners = _corners(width, round(slope / _SLOPES) * _SLOPES, height, n)
        shares, deviation = _shares(w, target, corners)
        if best is None or deviation < best[0]:
            best = deviation, corners, shares
        if best[0] <= PRECISION:
            break
    assert best is not None
    deviation, corners, shares = best
    unit = 2.0 * math.pi * first
    used = shares[:-1] > 0.0
    strengths, times = shares[:-1][used], 1.0 / (unit * corners[used])
    return StrainDamping(float(shares[-1]) / unit, tuple(strengths.tolist()), tuple(times.tolist()), deviation)


def nearest(first: float, last: float, low: float, high: float) -> float:
    """The ratio at ``last`` closest to ``high`` that branches can follow from ``low`` at ``first``."""
    good, bad = math.log(low), math.log(high)
    for _ in range(12):
        middle = 0.5 * (good + bad)
        if fitted(first, last, low, math.exp(middle)).deviation <= PRECISION:
            good = middle
        else:
            bad = middle
    return math.exp(good)


def _shares(w: Array, target: Array, corners: Array) -> tuple[Array, float]:
    """Strengths of branches with these corner frequencies, then the viscosity (n + 1,), and the largest deviation."""
    from scipy.optimize import nnls  # a scene without such damping does not load it

    x = w[:, None] / corners
    loss, rise = x / (1.0 + x * x), x * x / (1.0 + x * x)
    rows = np.column_stack([loss - 2.0 * target[:, None] * rise, w]) / (2.0 * target[:, None])
    size = np.abs(rows).max(axis=0)
    shares = nnls(rows / size, np.ones(len(w)))[0] / size
    return shares, float(np.abs(rows @ shares - 1.0).max())


@lru_cache(maxsize=256)
def _corners(width: float, slope: float, height: float, n: int) -> Array:
    """Corner frequencies (n,), in the lower end of a band, of branches with the least largest deviation from a line:
    the best of a grid, then improved. ``slope``, ``height`` : of the logarithms of the ratios, the latter in the middle
    of the band."""
    from scipy.optimize import minimize

    w = np.geomspace(1.0, width, _SAMPLES)
    target = math.exp(height) * (w / math.sqrt(width)) ** slope
    lowest, highest = math.log(_LOWEST), math.log(2.0 * w[-1])
    grid = np.exp(np.linspace(lowest, highest, _GRID[n]))
    start = min(combinations(grid, n), key=lambda corners: _shares(w, target, np.array(corners))[1])

    def deviation(logarithms: Array) -> float:
        return _shares(w, target, np.exp(np.clip(logarithms, lowest, highest)))[1]

    options: Any = {"xatol": 1e-3, "fatol": 1e-5, "maxiter": 300}
    found = minimize(deviation, np.log(np.array(start)), method="Nelder-Mead", options=options)
    corners: Array = np.exp(np.clip(found.x, lowest, highest))
    return corners
