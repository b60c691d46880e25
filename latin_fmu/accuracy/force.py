"""A force over time: linear pieces and jumps, distances in L2."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..latin.record import Array


@dataclass(frozen=True)
class Force:
    """Normal resultant of an interface over time: linear between (time, value); a time met twice is a jump.

    ``time`` (n,), s, never decreasing; ``value`` (n,), N, positive in compression.
    """

    time: Array
    value: Array

    def norm(self) -> float:
        """sqrt(integral of value^2 dt), exact for linear pieces."""
        return _norm(self.time, self.value)

    def distance(self, other: Force) -> float:
        """L2 distance to another history over the time both cover."""
        last = min(self.time[-1], other.time[-1])
        grid = np.union1d(self.time, other.time)
        grid = grid[grid <= last]
        a, b = grid[:-1], grid[1:]
        first = self._after(a) - other._after(a)
        second = self._before(b) - other._before(b)
        return float(np.sqrt(np.sum((b - a) * (first**2 + first * second + second**2)) / 3.0))

    def _after(self, t: Array) -> Array:
        """Limit from after: the last of equal times, then linear."""
        i = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2)
        return self._on(i, t)

    def _before(self, t: Array) -> Array:
        i = np.clip(np.searchsorted(self.time, t, side="left") - 1, 0, len(self.time) - 2)
        return self._on(i, t)

    def _on(self, i: np.ndarray, t: Array) -> Array:
        span = self.time[i + 1] - self.time[i]
        share = np.where(span > 0.0, (t - self.time[i]) / np.where(span > 0.0, span, 1.0), 1.0)
        result: Array = (1.0 - share) * self.value[i] + share * self.value[i + 1]
        return result


def _norm(time: Array, value: Array) -> float:
    a, b = value[:-1], value[1:]
    return float(np.sqrt(np.sum(np.diff(time) * (a * a + a * b + b * b)) / 3.0))
