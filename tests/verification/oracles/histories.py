"""Distance between a computed history and an exact one, and the order of its decrease.

A computed history is read as linear between its instants, so every integral below is exact.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from .piecewise import Array, PiecewiseLinear, merged_breaks, product_integral


def l2_norm(f: PiecewiseLinear, a: float, b: float) -> float:
    """sqrt of the integral of f^2 over [a, b]."""
    return math.sqrt(max(product_integral(f, f, a, b), 0.0))


def difference(f: PiecewiseLinear, g: PiecewiseLinear, a: float, b: float) -> PiecewiseLinear:
    """f - g on [a, b]."""
    cuts = merged_breaks([f, g], a, b, 0.0)
    out = PiecewiseLinear(a)
    for s, e in itertools.pairwise(cuts):
        (f0, f1), (g0, g1) = f.on(s, e), g.on(s, e)
        out.append(e, f0 - g0, f1 - g1)
    return out


def relative_l2_error(time: Array, values: Array, exact: PiecewiseLinear) -> float:
    """||computed - exact|| / ||exact|| over the instants given, both in L2(0, T)."""
    a, b = float(time[0]), min(float(time[-1]), exact.end)
    computed = PiecewiseLinear.through(time, values)
    return l2_norm(difference(computed, exact, a, b), a, b) / l2_norm(exact, a, b)


def relative_integral_error(time: Array, values: Array, exact: PiecewiseLinear) -> float:
    """Signed relative error of the integral of a history (an impulse, a displacement)."""
    a, b = float(time[0]), min(float(time[-1]), exact.end)
    reference = exact.integral(a, b)
    return (PiecewiseLinear.through(time, values).integral(a, b) - reference) / reference


def observed_orders(steps: Sequence[float], errors: Sequence[float]) -> list[float]:
    """Order between successive refinements: log(e1/e2)/log(h1/h2)."""
    h, e = np.log(np.asarray(steps, float)), np.log(np.asarray(errors, float))
    return [float(v) for v in np.diff(e) / np.diff(h)]


def fitted_order(steps: Sequence[float], errors: Sequence[float]) -> float:
    """Order of the whole series: slope of log(error) over log(step), least squares."""
    return float(np.polyfit(np.log(np.asarray(steps, float)), np.log(np.asarray(errors, float)), 1)[0])
