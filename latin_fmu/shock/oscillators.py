r"""Oscillators on a moving base: their response to a base acceleration that is a straight line between its samples.

An oscillator of frequency f and quality Q (damping ratio zeta = 1 / (2 Q), omega = 2 pi f) on a base with acceleration
a(t) has the relative displacement z and the absolute acceleration y,

    z'' + 2 zeta omega z' + omega^2 z = -a,    y = -(2 zeta omega z' + omega^2 z)

Its pseudo-velocity is omega z. Between two samples a is a straight line: the digital filter is ramp-invariant
(D.O. Smallwood, An improved recursive formula for calculating shock response spectra, Shock and Vibration Bulletin 51
(1981) 211-217; ISO 18431-4:2007). With T the step, r(t) the response to a(t) = t, C = exp(-zeta omega T) cos(omega_d T)
and E = exp(-zeta omega T), the filter with denominator 1 - 2 C z^-1 + E^2 z^-2 has the numerator

    b0 = r(T) / T,    b1 = (r(2T) - 2 r(T)) / T - 2 C b0,    b2 = (r(3T) - 2 r(2T) + r(T)) / T - 2 C y1 + E^2 b0

with y1 the first term of b1. r is summed as a power series where omega T is small: its closed form loses all digits.
Straight lines are sampled again wherever a period has fewer than ``SAMPLES`` of them, so that maxima are not missed.

Primary: during the pulse, which ends with the last sample that counts (``_NOTHING``). Residual: after it, with a = 0,
from the free motion in closed form. Maximax: the larger. Positive and negative: the largest values of y and -omega z of
either sign, during and after the pulse; without damping y = -omega^2 z.
"""

from __future__ import annotations

import math
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SAMPLES: Final = 32
"""Samples per period of an oscillator: a maximum between two of them is at most 0.5 % larger."""
Response = Literal["maximax", "primary", "residual", "positive", "negative"]
RESPONSES: Final[tuple[Response, ...]] = get_args(Response)
"""Responses of ISO 18431-4: during or after the pulse, during, after, of either sign."""
Kind = Literal["acceleration", "pseudo_velocity", "relative_displacement", "equivalent_static_acceleration"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
"""Spectra of ISO 18431-4."""
_NOTHING: Final = 1e-9  # of the largest sample: what is below it at the end of a record is no part of the pulse
_SERIES, _TERMS = 1.0, 40  # omega t up to which the ramp response is a power series, and its terms


def largest_responses(columns: Array, step: float, f: Array, damping: float) -> Array:
    """Largest magnitudes (2, 5, n, n_component) of y and omega z, by response, with lines between the samples."""
    columns = _pulse(columns)
    # sign, kind, frequency, component
    during = np.stack([_primary(columns, step, 2 * math.pi * x, damping) for x in f], axis=2)
    after = _residual(columns, step, 2 * math.pi * f, damping)
    primary, residual, signed = during.max(axis=0), after.max(axis=0), np.maximum(during, after)
    return np.stack([np.maximum(primary, residual), primary, residual, *signed], axis=1)


def _pulse(columns: Array) -> Array:
    """A record (n_time, n) up to its last sample that counts in any column, and one more, which is where it ends."""
    counts = np.flatnonzero((np.abs(columns) > _NOTHING * np.abs(columns).max(initial=0.0)).any(axis=1))
    last = int(counts[-1]) if len(counts) else 0
    return columns[: max(last + 2, 2)]


def ramp_filter(angle: float, damping: float) -> tuple[Array, Array, Array]:
    """Numerators of omega^2 z and of y (3,) each, denominator (3,), for omega T = ``angle``."""
    decay = math.exp(-damping * angle)
    cosine = decay * math.cos(angle * math.sqrt(1 - damping * damping))
    denominator = np.array([1.0, -2 * cosine, decay * decay])
    numerators = []
    for response in _ramp_responses(np.array([1.0, 2.0, 3.0]) * angle, damping):
        one, two, three = response
        y0, y1, y2 = np.array([one, two - 2 * one, three - 2 * two + one]) / angle
        numerators.append(np.array([y0, y1 + denominator[1] * y0, y2 + denominator[1] * y1 + denominator[2] * y0]))
    return numerators[0], numerators[1], denominator


def _ramp_responses(t: Array, damping: float) -> tuple[Array, Array]:
    """omega^2 z and y at omega times ``t`` under a base acceleration a = omega t, for omega = 1."""
    if t.max() <= _SERIES * 3:
        c = _impulse_series(damping)
        power = np.arange(_TERMS)
        once = (c / (power + 1)) @ (t ** (power[:, None] + 1))
        twice = (c / ((power + 1) * (power + 2))) @ (t ** (power[:, None] + 2))
    else:
        root = math.sqrt(1 - damping * damping)
        decay = np.exp(-damping * t)
        cosine = np.cos(root * t)
        sine = np.sin(root * t) / root
        once = 1 - decay * (cosine + damping * sine)
        twice = t - 2 * damping + decay * (2 * damping * cosine + (2 * damping**2 - 1) * sine)
    return -twice, 2 * damping * once + twice


def _impulse_series(damping: float) -> Array:
    """Coefficients c of the impulse response sum of c_k (omega t)^k."""
    c = np.zeros(_TERMS)
    c[1] = 1.0
    for k in range(_TERMS - 2):
        c[k + 2] = -(2 * damping * (k + 1) * c[k + 1] + c[k]) / ((k + 2) * (k + 1))
    return c


def _primary(columns: Array, step: float, omega: float, damping: float) -> Array:
    """Largest values of either sign (2, 2, n_component), as magnitudes, of y and -omega z during the pulse."""
    from scipy.signal import lfilter

    finer = max(1, math.ceil(SAMPLES * omega * step / (2 * math.pi)))
    if finer > 1:
        places = np.arange((len(columns) - 1) * finer + 1) / finer
        columns = np.stack([np.interp(places, np.arange(len(columns)), column) for column in columns.T], axis=1)
    of_z, of_y, denominator = ramp_filter(omega * step / finer, damping)
    # before the first sample the base is at rest: the filter alone would begin with a ramp from 0 to it. Its state is
    # that of an oscillator at rest at the first sample, under a jump to the acceleration there
    jumped = _step_responses(omega * step / finer, damping)
    largest = []
    for numerator, after in ((of_y, jumped[1]), (-of_z, -jumped[0])):
        state = np.array([-numerator[0], after - numerator[0] - numerator[1]])
        y, _ = lfilter(numerator, denominator, columns, axis=0, zi=state[:, None] * columns[:1])
        largest.append(np.maximum([y.max(axis=0), -y.min(axis=0)], 0.0))
    return np.stack([largest[0], largest[1] / omega], axis=1)


def _step_responses(angle: float, damping: float) -> tuple[float, float]:
    """omega^2 z and y at omega t = ``angle`` under a unit acceleration from t = 0 on."""
    if angle <= _SERIES:
        c, power = _impulse_series(damping), np.arange(_TERMS)
        once = float((c / (power + 1)) @ angle ** (power + 1))
        return -once, once + 2 * damping * float(c @ angle**power)
    root = math.sqrt(1 - damping * damping)
    decay = math.exp(-damping * angle)
    cosine = math.cos(root * angle)
    sine = math.sin(root * angle) / root
    return -(1 - decay * (cosine + damping * sine)), 1 - decay * (cosine - damping * sine)


def _residual(columns: Array, step: float, omega: Array, damping: float) -> Array:
    """Largest values of either sign (2, 2, n, n_component), as magnitudes, of y and -omega z after the pulse, where the
    base does not accelerate.

    z at the time s after the end is -Im(G exp(lambda s)) / omega_d, with lambda = -zeta omega + i omega_d and
    G = int a(t) exp(lambda (t_end - t)) dt, exact for the straight lines.
    """
    damped = omega * math.sqrt(1 - damping * damping)
    rate = -damping * omega + 1j * damped
    x = rate * step
    # int over a step of the share of its end and of its start, times exp(rate (end of the step - t))
    late = np.where(np.abs(x) < 0.3, _phi(x, 2), (np.exp(x) - 1 - x) / x**2) * step
    early = np.where(np.abs(x) < 0.3, _phi(x, 1), (np.exp(x) - 1) / x) * step - late
    g = late[:, None] * _decaying_sums(columns[1:], x) + early[:, None] * _decaying_sums(columns[:-1], x)
    of_z = g * (omega / damped)[:, None]
    of_y = g * ((2 * damping * omega * rate + omega**2) / damped)[:, None]
    return np.stack([_largest_decay(amplitude, rate[:, None]) for amplitude in (of_y, of_z)], axis=1)


def _decaying_sums(columns: Array, x: Array) -> Array:
    """Sums (n, n_component) over the samples k of a_k exp(x (last - k)), from blocks of them: their exponentials are
    those of one block times one of the block."""
    size = max(1, math.isqrt(len(columns)))
    blocks = -(-len(columns) // size)  # rounded up
    padded = np.concatenate([np.zeros((blocks * size - len(columns), columns.shape[1])), columns])
    inside = np.exp(x[:, None] * np.arange(size - 1, -1, -1))
    along = np.exp(x[:, None] * (size * np.arange(blocks - 1, -1, -1)))
    sums = np.empty((len(x), columns.shape[1]), dtype=complex)
    for i, column in enumerate(padded.T):
        table = column.reshape(blocks, size)
        sums[:, i] = ((inside @ table.T) * along).sum(axis=1)
    return sums


def _phi(x: Array, order: int) -> Array:
    """(e^x - 1) / x or (e^x - 1 - x) / x^2 for small x, by their series."""
    return np.asarray(sum(x**k / math.factorial(k + order) for k in range(16)))


def _largest_decay(amplitude: Array, rate: Array) -> Array:
    """Largest values of either sign (2, ...), as magnitudes, of Im(amplitude exp(rate s)) over s >= 0: at s = 0, at the
    first extreme after it, or at the next one, which has the other sign."""
    slope = amplitude * rate  # the derivative is Im(slope exp(rate s)), zero at a multiple of pi of its phase
    wait = np.mod(-np.angle(slope), np.pi) / rate.imag
    first = (amplitude * np.exp(rate * wait)).imag
    second = (amplitude * np.exp(rate * (wait + np.pi / rate.imag))).imag
    values = np.stack([amplitude.imag, first, second])
    return np.maximum([values.max(axis=0), -values.min(axis=0)], 0.0)
