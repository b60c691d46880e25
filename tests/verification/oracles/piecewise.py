"""Piecewise-linear functions of time with jumps: the arithmetic of the exact solutions.

A function is a contiguous list of pieces [t0, t1] with a value just after t0 and a value just before t1.
At a jump the value is the one *before* it, unless stated otherwise.
"""

from __future__ import annotations

import itertools
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PiecewiseLinear:
    """A piecewise-linear function that can be extended at its end."""

    def __init__(self, start: float) -> None:
        self.knots: list[float] = [start]
        self.left: list[float] = []  # value just after knots[i]
        self.right: list[float] = []  # value just before knots[i + 1]

    @classmethod
    def constant(cls, value: float, start: float, end: float) -> PiecewiseLinear:
        """The same value on [start, end]."""
        return cls.from_pieces(start, [(end, value, value)])

    @classmethod
    def from_pieces(cls, start: float, pieces: Iterable[tuple[float, float, float]]) -> PiecewiseLinear:
        """Pieces (end time, value after the previous end, value before this end)."""
        out = cls(start)
        for end, first, last in pieces:
            out.append(end, first, last)
        return out

    @classmethod
    def through(cls, times: Sequence[float] | Array, values: Sequence[float] | Array) -> PiecewiseLinear:
        """Continuous function through samples: how a computed history is read between its instants."""
        t, y = [float(v) for v in times], [float(v) for v in values]
        return cls.from_pieces(t[0], zip(t[1:], y[:-1], y[1:], strict=True))

    @property
    def end(self) -> float:
        """Last time at which the function is known."""
        return self.knots[-1]

    def append(self, end: float, first: float, last: float) -> None:
        """Add a piece from the present end to ``end``; a straight continuation extends the last piece."""
        start = self.knots[-1]
        if end <= start:
            return
        if self.left and self._continues(start, end, first, last):
            self.knots[-1], self.right[-1] = end, last
            return
        self.knots.append(end)
        self.left.append(first)
        self.right.append(last)

    def _continues(self, start: float, end: float, first: float, last: float) -> bool:
        a, b = self.left[-1], self.right[-1]
        size = 4e-16 * max(abs(a), abs(b), abs(first), abs(last))
        if abs(first - b) > size:
            return False
        before = self.knots[-2]
        return abs(a + (last - a) * (start - before) / (end - before) - b) <= size

    def _index(self, time: float, after: bool) -> int:
        i = (bisect_right if after else bisect_left)(self.knots, time) - 1
        return min(max(i, 0), len(self.left) - 1)

    def __call__(self, time: float, after: bool = False) -> float:
        """Value at ``time``: the limit from before, or from after."""
        i = self._index(time, after)
        return self._on_piece(i, time)

    def _on_piece(self, i: int, time: float) -> float:
        a, b = self.knots[i], self.knots[i + 1]
        s = (time - a) / (b - a)
        return self.left[i] * (1.0 - s) + self.right[i] * s

    def sample(self, times: Sequence[float] | Array, after: bool = False) -> Array:
        """Values at many times."""
        return np.array([self(float(t), after) for t in times])

    def on(self, a: float, b: float) -> tuple[float, float]:
        """Values at both ends of [a, b], which must lie in one piece (up to round-off)."""
        i = self._index(0.5 * (a + b), after=True)
        return self._on_piece(i, a), self._on_piece(i, b)

    def breaks(self, a: float, b: float) -> list[float]:
        """Knots strictly inside (a, b)."""
        return self.knots[bisect_right(self.knots, a) : bisect_left(self.knots, b)]

    def pieces(self, a: float, b: float) -> list[tuple[float, float, float, float]]:
        """(t0, t1, value after t0, value before t1) covering [a, b]."""
        cuts = [a, *self.breaks(a, b), b]
        return [(s, e, *self.on(s, e)) for s, e in itertools.pairwise(cuts) if e > s]

    def integral(self, a: float, b: float) -> float:
        """Exact integral over [a, b]."""
        return float(sum(0.5 * (y0 + y1) * (t1 - t0) for t0, t1, y0, y1 in self.pieces(a, b)))

    def double_integral(self, a: float, b: float) -> float:
        """Exact integral over [a, b] of (b - t) f(t): the second primitive of f."""
        return product_integral(self, PiecewiseLinear.from_pieces(a, [(b, b - a, 0.0)]), a, b)

    def scaled(self, factor: float) -> PiecewiseLinear:
        """factor x f."""
        out = PiecewiseLinear(self.knots[0])
        out.knots = list(self.knots)
        out.left, out.right = [factor * v for v in self.left], [factor * v for v in self.right]
        return out


def merged_breaks(functions: Sequence[PiecewiseLinear], a: float, b: float, resolution: float) -> list[float]:
    """[a, ..., b] with every knot of the functions; knots closer than ``resolution`` count as one."""
    inside = sorted({t for f in functions for t in f.breaks(a, b)})
    cuts = [a]
    for t in inside:
        if t - cuts[-1] > resolution and b - t > resolution:
            cuts.append(t)
    return [*cuts, b]


def product_integral(f: PiecewiseLinear, g: PiecewiseLinear, a: float, b: float) -> float:
    """Exact integral over [a, b] of f g (Simpson is exact for a product of two linear pieces)."""
    total = 0.0
    cuts = merged_breaks([f, g], a, b, 0.0)
    for s, e in itertools.pairwise(cuts):
        f0, f1 = f.on(s, e)
        g0, g1 = g.on(s, e)
        total += (e - s) / 6.0 * (f0 * g0 + (f0 + f1) * (g0 + g1) + f1 * g1)
    return total
