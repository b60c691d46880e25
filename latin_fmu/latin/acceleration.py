"""Fixed-point iteration on q: relaxation and Anderson acceleration.

LATIN with k+ = k- is Peaceman-Rachford splitting; relaxation 1/2 makes it Douglas-Rachford, the safe fall-back.
Anderson acceleration of depth m (Walker and Ni 2011, type II) replaces q + r by

    q + r - (DQ + DR) gamma,   gamma = argmin || r - DR gamma ||

with the last m differences DQ, DR of iterates and residuals, in the norm sum area / k q^2 (a power).
"""

from __future__ import annotations

import numpy as np

from .kernels import anderson
from .layout import Array
from .stopping import RANK

# Iterations between run-ups, and relative change of the residual below which nothing has changed.
_PERIOD, _SAME = 8, 0.05


class Relaxation:
    """q + relaxation * r."""

    def __init__(self, relaxation: float) -> None:
        self.relaxation = relaxation

    def next(self, q: Array, residual: Array) -> Array:
        """Next iterate (shape of q)."""
        return q + self.relaxation * residual


class Anderson:
    """Anderson acceleration.

    Parameters
    ----------
    weight : (n_flat,) square root of area / k. depth : differences kept. relaxation : factor on the residual.
    longest : longest step, in lengths of the residual. A body that slides back to where it sticks has the same residual
        iteration after iteration, and differences that vanish would throw it anywhere.
    """

    def __init__(self, weight: Array, depth: int, relaxation: float, longest: float = np.inf) -> None:
        self._weight, self._depth, self._relaxation = weight * weight, depth, relaxation
        self._longest = longest
        self._count = 0  # differences seen so far; they are kept in a ring of ``depth`` rows
        self._last: tuple[Array, Array] | None = None

    def next(self, q: Array, residual: Array) -> Array:
        """Next iterate (shape of q)."""
        if self._last is None:
            self._dq = np.empty((self._depth, *q.shape))
            self._dr = np.empty((self._depth, *q.shape))
            self._gram = np.zeros((self._depth, self._depth))
            self._last = (q, residual)
            return q + self._relaxation * residual
        out = np.empty_like(q)
        anderson(
            self._weight, q, residual, *self._last, self._dq, self._dr, self._gram, self._count, self._relaxation,
            RANK, out,
        )  # fmt: skip
        self._count += 1
        self._last = (q, residual)
        return out if np.isinf(self._longest) else self._shortened(q, out - q, residual)

    def _shortened(self, q: Array, step: Array, residual: Array) -> Array:
        length, allowed = (
            float(np.vdot(self._weight * x, x)) ** 0.5 for x in (step, self._longest * residual)
        )
        shortened: Array = q + step * min(1.0, allowed / max(length, np.finfo(float).tiny))
        return shortened


class Slide:
    """Relaxation 1/2 with run-ups, for bodies that slide or topple back to where they stick under a small excess of
    force: the residual is the same iteration after iteration, and so is the step.

    Every ``_PERIOD`` iterations that changed nothing the last step is taken many times at once, twice as many as the
    time before; the relaxations in between take out what else the run-up has stirred up.

    Parameters
    ----------
    weight : (n_flat,) square root of area / k.
    """

    def __init__(self, weight: Array) -> None:
        self._weight = weight * weight
        self._steps, self._size, self._times = 0, np.inf, 8.0

    def next(self, q: Array, residual: Array) -> Array:
        """Next iterate (shape of q)."""
        self._steps += 1
        if self._steps % _PERIOD:
            return q + 0.5 * residual
        size = float(np.vdot(self._weight * residual, residual)) ** 0.5
        same, self._size = abs(size - self._size) < _SAME * size, size
        if not same:
            return q + 0.5 * residual
        self._times *= 2.0
        return q + 0.5 * self._times * residual
