"""Fields of windows of several instants at neighbouring points of a study: first guesses of the next point.

The iterate of a window is its history of tractions and velocities on the interfaces. Where a parameter changes a
little, the converged history of a neighbour is close to the solution (P.A. Boucard, L. Champaney, "A suitable
computational strategy for the parametric analysis of problems with multiple contact", Int. J. Numer. Meth. Engng 57
(2003) 1259-1281); two neighbours on a line are continued linearly, which is exact between two changes of a contact
state. The guess changes the number of iterations, not the tolerance that ends them: results agree with those of other
first guesses within it. A window that does not converge from a guess starts again without it.

Windows of one instant have no use for it: each begins with the fields of the instant before, which are closer.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ..latin.record import Array
from .grid import Index

_MOST_BYTES: Final = 256e6  # of fields kept by one process
_JUDGED: Final = 4  # guessed points after which their cost is compared with that of others
_BACK: Final = (0, 1, 2, 4, 8)  # steps between the two points of a continuation
_FADING: Final = 0.5  # weight of the errors of earlier points
_AGAIN: Final = 12  # points without a guess after which one is tried again


@dataclass
class _Solved:
    """Fields of a point by the first instant of the window; ``place`` : in parameter space."""

    point: Index
    place: Array
    fields: dict[int, tuple[Array, Array]] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Memory of the fields, bytes."""
        return sum(f.nbytes + w.nbytes for f, w in self.fields.values())


class FirstGuesses:
    """First guesses of the points that one process solves, one after the other (``latin.windows.WindowFields``).

    Guesses stop where they cost more than they save, by the mean number of substructure-instants of the last points,
    and are tried again some points later.

    Attributes
    ----------
    used : whether a window of the present point began with fields of its neighbours.
    """

    def __init__(self) -> None:
        self._solved: list[_Solved] = []
        self._now = _Solved((), np.zeros(0))
        self._costs: dict[bool, list[float]] = {True: [], False: []}
        self._since = 0
        self._errors = {back: 0.0 if back == 1 else 1e-9 for back in _BACK}
        self.used = False

    def begin(self, point: Index, place: list[float]) -> None:
        """Begin a point of the study."""
        self._now, self.used = _Solved(point, np.array(place)), False

    def end(self, cost: float, converged: bool) -> None:
        """End the point: ``cost`` in substructure-instants."""
        self._costs[self.used] = [*self._costs[self.used], cost][-_JUDGED:]
        self._since = 0 if self.used else self._since + 1
        if converged and self._now.fields:
            self._compare()
            self._solved.append(self._now)
        while len(self._solved) > 2 and sum(s.size for s in self._solved) > _MOST_BYTES:
            del self._solved[0]

    def first_guess(self, first: int, n: int, n_flat: int) -> tuple[Array, Array] | None:
        """Tractions and velocities (n, n_flat) of a window of the present point; None where no neighbour has them."""
        if not self._pays():
            return None
        guess = self._continued(first, (n, n_flat), min(_BACK, key=lambda back: self._errors[back]))
        self.used |= guess is not None
        return guess

    def _continued(self, first: int, shape: tuple[int, int], back: int) -> tuple[Array, Array] | None:
        """Fields of a window of the nearest point, continued along the line through a point ``back`` steps from it (0:
        as they are); None where no point has them."""
        here = self._now.place
        known = [s for s in self._solved if first in s.fields and s.fields[first][0].shape == shape]
        if not known:
            return None
        near = min(reversed(known), key=lambda s: float(np.linalg.norm(s.place - here)))
        steps = [(t, s) for s in known if s is not near and (t := _along(s.place, near.place, here)) is not None]
        f, w = near.fields[first]
        if not steps or not back:
            return f, w
        steps.sort(key=lambda step: -abs(step[0]))  # the nearest ones first
        t, other = steps[min(back, len(steps)) - 1]
        before = other.fields[first]
        return f + t * (f - before[0]), w + t * (w - before[1])

    def _compare(self) -> None:
        """Errors that the continuations would have had at the present point, over the change from its neighbour."""
        sizes = dict.fromkeys(_BACK, 0.0)
        for first, (f_hat, _) in self._now.fields.items():
            for back in _BACK:
                guess = self._continued(first, f_hat.shape, back)
                if guess is None:
                    return
                sizes[back] += float(np.linalg.norm(guess[0] - f_hat))
        if sizes[0] > 0.0:
            self._errors = {b: _FADING * self._errors[b] + sizes[b] / sizes[0] for b in _BACK}

    def keep(self, first: int, f_hat: Array, w_hat: Array) -> None:
        """Keep the converged fields (n, n_flat) of a window of the present point."""
        self._now.fields[first] = f_hat, w_hat

    def _pays(self) -> bool:
        """Whether guesses have been cheaper than no guesses so far."""
        with_guess, without = self._costs[True], self._costs[False]
        if len(with_guess) < _JUDGED or not without or self._since >= _AGAIN:
            return True
        return float(np.mean(with_guess)) < float(np.mean(without))


def _along(first: Array, second: Array, third: Array) -> float | None:
    """t with third = second + t (second - first); None where the three are on no line, or second is far off."""
    step = second - first
    length = float(step @ step)
    t = float((third - second) @ step) / length if length > 0.0 else 0.0
    off = float(np.abs(third - second - t * step).max(initial=0.0))
    return t if abs(t) <= _FARTHEST and t != 0.0 and off <= _ON_LINE * length**0.5 else None


_FARTHEST: Final = 2.0  # continuation, in distances of the two points
_ON_LINE: Final = 1e-6
