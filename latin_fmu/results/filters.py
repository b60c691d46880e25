"""Filters of the motions of sensors, and the steps that they need."""

from __future__ import annotations

import numpy as np

from ..latin.outcome import Array
from ..scene.sensors import ChannelClass, LowPass


def low_pass(values: Array, chosen: ChannelClass | LowPass, step: float) -> Array:
    """Values (n_time, ...) behind a filter of a sensor; ``step`` between the instants, s.

    A phaseless filter runs forwards and backwards over the values, which are continued at both ends by their mirror
    image about the end point, for three periods of the cut-off.
    """
    from scipy.signal import butter, sosfilt, sosfiltfilt

    warped, order = np.tan(np.pi * chosen.cutoff * step), 2  # of the bilinear transform; two poles by SAE J211-1
    if isinstance(chosen, LowPass):
        order = chosen.order
        if not chosen.phaseless:
            return np.asarray(sosfilt(causal_sections(chosen, step), values, axis=0))
        warped /= (np.sqrt(2.0) - 1.0) ** (0.5 / order)  # -3 dB after both passes
    sections = butter(order, np.arctan(warped) / (np.pi * step), fs=1 / step, output="sos")
    # at most n - 1: the mirror image has no more points
    beyond = min(len(values) - 1, int(np.ceil(3.0 / (chosen.cutoff * step))))
    return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=beyond))


def causal_sections(chosen: LowPass, step: float) -> Array:
    """Sections (n, 6) of two poles, b0 b1 b2 a0 = 1 a1 a2, of a low pass that runs forwards alone."""
    from scipy.signal import butter

    return np.asarray(butter(chosen.order, chosen.cutoff, fs=1 / step, output="sos"))


def uniform_step(time: Array) -> float:
    """Length of the steps of instants, s; 0 where they differ (by more than 1e-6 of it)."""
    steps = np.diff(time)
    uniform = len(steps) > 0 and np.ptp(steps) <= 1e-6 * steps.mean()
    # the mean has more digits than a difference of two instants
    if uniform:
        return float(time[-1] - time[0]) / len(steps)
    return 0.0
