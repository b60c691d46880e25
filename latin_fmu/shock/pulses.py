"""Classical pulses, and the loads before and after them that leave a test stand where it was.

A pulse leaves its base with a velocity. A shaker takes it back by half sines of a small share of its size before the
pulse, for t_1, and after it, for t_2 (pre- and post-load). With the impulse I of the pulse, its first moment m about
its beginning, its duration D and c = 2/pi times the size of these loads, velocity and displacement vanish at the end
where

    t_1 + t_2 = I / c = S,    t_1 = (S D + S^2 / 2 - m / c) / (D + S)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .base_histories import at_rest

Array = NDArray[np.float64]
RISE: Final = 0.1
"""Share of the duration in which a trapezoid rises, and falls."""
FALL: Final = 0.02
"""Share of the duration in which a sawtooth falls after its peak."""
PULSES: Final[Mapping[str, Callable[[Array], Array]]] = MappingProxyType(
    {
        "half_sine": lambda s: np.sin(np.pi * s),
        "haversine": lambda s: np.sin(np.pi * s) ** 2,
        "sawtooth": lambda s: np.where(s <= 1.0 - FALL, s / (1.0 - FALL), (1.0 - s) / FALL),
        "trapezoid": lambda s: np.minimum(np.minimum(s, 1.0 - s) / RISE, 1.0),
    }
)
"""Pulses over 0 <= s <= 1, of size 1: ISO 8568, MIL-STD-810 method 516."""
_FEWEST: Final = 200  # samples of a pulse


def pulse_history(kind: str, size: float, duration: float, share: float = 0.1) -> tuple[Array, Array]:
    """Times (n,), s, and accelerations (n,) of a pulse with its pre- and post-load, linear in between.

    Parameters
    ----------
    kind : one of ``PULSES``. size : its peak. duration : s. share : of the size, that of the loads; 0: none, the base
    keeps the velocity of the pulse.

    Examples
    --------
    >>> time, acceleration = pulse_history("half_sine", 500.0, 11e-3)
    >>> float(acceleration.max().round(1)), bool(abs(np.trapezoid(acceleration, time)) < 1e-9)
    (500.0, True)
    """
    shape = PULSES[kind]
    step = duration / _FEWEST
    s = np.linspace(0.0, 1.0, _FEWEST + 1)
    values = shape(s)
    impulse = float(np.trapezoid(values, s)) * duration
    if share == 0.0:
        return duration * s, size * values
    moment = float(np.trapezoid(values * s, s)) * duration**2
    c = 2.0 * share / math.pi
    whole = impulse / c
    before = (whole * duration + 0.5 * whole**2 - moment / c) / (duration + whole)
    first, last = (math.ceil(length / step) for length in (before, whole - before))
    time: Array = step * np.arange(first + _FEWEST + last + 1, dtype=float)
    history = np.zeros(len(time))
    history[first : first + _FEWEST + 1] = values
    for begin, n in ((0, first), (first + _FEWEST, last)):
        history[begin : begin + n + 1] -= share * np.sin(np.pi * np.arange(n + 1) / n)
    inside = np.ones(len(time), dtype=bool)
    # whole samples, and straight lines between them
    return time, size * at_rest(history, inside, time[-1] - time)
