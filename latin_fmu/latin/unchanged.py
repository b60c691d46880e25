"""Substructures that see what they have answered before are not asked again.

While a window is iterated, an interface that has converged sends its substructures the same q = F_hat + k W_hat again
and again. A class whose q has changed by less than a hundredth of tolerance since its last answer, in the norm of the
error indicator and as its share of all classes, keeps that answer. In a window of several instants the instants before
the first one that has changed are kept, and the march starts at a state kept close before it.
"""

from __future__ import annotations

from math import isqrt
from typing import Final

import numpy as np

from .layout import Array, Index
from .settings import Settings

SHARE: Final = 1e-2
"""Change of q that calls for no new answer, in tolerances."""


def negligible(settings: Settings) -> float:
    """Squared relative change of the fields that calls for no new answer; below zero where every change does."""
    if not settings.skip_unchanged or settings.quasi_static:
        return -1.0
    return (SHARE * min(settings.tolerance, 0.1 * settings.force_tolerance)) ** 2


class Answers:
    """Last answers of the classes in one window of n instants.

    Parameters
    ----------
    weights : (n_flat,) of the squared change of q in the indicator. enough : see ``negligible``. n_class : classes.
    """

    def __init__(self, n: int, weights: Array, enough: float, n_class: int) -> None:
        self._q, self._w = np.zeros((2, n, len(weights)))
        self._weights, self._enough, self._n_class = weights, enough, n_class
        self._scale = 0.0
        self._states: list[dict[int, object]] = [{} for _ in range(n_class)]
        self._known = [False] * n_class
        self._stride = isqrt(n) + 1

    def begin(self, scale: float) -> None:
        """Next iteration; ``scale`` : field scale of the indicator."""
        self._scale = scale

    def forget(self) -> None:
        """The state at the start of the window is another one."""
        self._known = [False] * self._n_class

    def first_changed(self, c: int, channels: Index, q: Array) -> int:
        """First instant of the window at which class c has to answer anew to q (n, n_flat); n where at none."""
        n = len(q)
        if not self._known[c] or self._enough < 0.0:
            return 0
        flat = channels.ravel()
        change = np.cumsum(((q[:, flat] - self._q[:, flat]) ** 2) @ self._weights[flat])
        level = self._enough * self._scale * n / self._n_class
        return int(np.searchsorted(change, level, side="right"))

    def answer(self, channels: Index, rows: slice) -> Array:
        """Answers kept (rows, n_channel, n_member)."""
        return self._w[rows, channels]

    def keep(self, c: int, channels: Index, first: int, q: Array, w: Array) -> None:
        """Class c has answered w to q from the instant ``first`` on, both (n, n_flat)."""
        self._q[first:, channels], self._w[first:, channels] = q[first:, channels], w[first:, channels]
        self._known[c] = True

    def state_before(self, c: int, first: int) -> tuple[int, object | None]:
        """Latest instant up to ``first`` before which the state of class c is kept, and that state (None: the start of
        the window)."""
        at = max((i for i in self._states[c] if i <= first), default=0)
        return at, self._states[c].get(at)

    def keep_state(self, c: int, i: int, state: object) -> None:
        """The state of class c before instant i."""
        self._states[c][i] = state

    def wants_state(self, i: int) -> bool:
        """Whether the states before instant i are to be kept."""
        return i > 0 and i % self._stride == 0
