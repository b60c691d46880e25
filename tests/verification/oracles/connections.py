"""What holds between two bars, or at the end of one: the law that gives the stress of an interface.

Seen from an interface the bar on its left ends with free velocity v1 (the one without stress) and moves at
v1 + y1 s under a stress s (tension positive); the bar on its right at v2 - y2 s, with y = 1/Z the inverse
of the wave impedance. A wall is y = 0. Every law therefore reads only w = v2 - v1, the free opening
velocity, and y = y1 + y2. On an interval where w is linear a law returns pieces (end, s after, s before).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

from .piecewise import PiecewiseLinear

Pieces = list[tuple[float, float, float]]


@dataclass(frozen=True)
class Interval:
    """[a, b] on which the free opening velocity goes linearly from ``w0`` to ``w1``.

    ``y`` is the sum of the inverse impedances, ``quiet`` the velocity that counts as zero (round-off),
    ``shortest`` the time that counts as zero.
    """

    a: float
    b: float
    w0: float
    w1: float
    y: float
    quiet: float
    shortest: float

    @property
    def slope(self) -> float:
        """Rate of the free opening velocity."""
        return (self.w1 - self.w0) / (self.b - self.a)

    def at(self, time: float) -> float:
        """Free opening velocity, round-off cut to zero."""
        s = (time - self.a) / (self.b - self.a)
        value = self.w0 * (1.0 - s) + self.w1 * s
        return 0.0 if abs(value) <= self.quiet else value


class Connection(Protocol):
    """A law; ``knots`` are the functions of time in it, whose breaks the solver must respect."""

    def knots(self) -> list[PiecewiseLinear]: ...

    def solve(self, part: Interval) -> Pieces: ...


@dataclass
class Joint:
    """Perfect connection: one velocity, one stress. Towards a wall: a prescribed velocity."""

    def knots(self) -> list[PiecewiseLinear]:
        return []

    def solve(self, part: Interval) -> Pieces:
        return [(part.b, part.w0 / part.y, part.w1 / part.y)]


@dataclass
class PrescribedStress:
    """End under the stress s(t) (tension positive): a pressure p is s = -p."""

    stress: PiecewiseLinear

    def knots(self) -> list[PiecewiseLinear]:
        return [self.stress]

    def solve(self, part: Interval) -> Pieces:
        return [(part.b, *self.stress.on(part.a, part.b))]


@dataclass
class Absorbing:
    """End that lets waves out, and sends in the wave of stress ``incident``.

    A dashpot of the bar's impedance under a traction of size 2 x incident does exactly this.
    """

    incident: PiecewiseLinear

    def knots(self) -> list[PiecewiseLinear]:
        return [self.incident]

    def solve(self, part: Interval) -> Pieces:
        s0, s1 = self.incident.on(part.a, part.b)
        return [(part.b, s0 + 0.5 * part.w0 / part.y, s1 + 0.5 * part.w1 / part.y)]


@dataclass
class Friction:
    """Frictional interface under a constant normal stress: |s| <= threshold, slip beyond."""

    threshold: float

    def knots(self) -> list[PiecewiseLinear]:
        return []

    def solve(self, part: Interval) -> Pieces:
        limit = self.threshold * part.y
        cuts = [part.a]
        if part.slope != 0.0:
            crossings = sorted(part.a + (level - part.w0) / part.slope for level in (-limit, limit))
            cuts += [t for t in crossings if part.a + part.shortest < t < part.b - part.shortest]
        cuts.append(part.b)
        clip = [min(max(part.at(t), -limit), limit) / part.y for t in cuts]
        return [(t, s0, s1) for t, s0, s1 in zip(cuts[1:], clip[:-1], clip[1:], strict=True)]


@dataclass
class Contact:
    """Unilateral contact: 0 <= gap perpendicular to -s >= 0. Keeps the opening between intervals."""

    gap: float
    closings: list[float] = field(default_factory=list)
    openings: list[float] = field(default_factory=list)

    def knots(self) -> list[PiecewiseLinear]:
        return []

    def solve(self, part: Interval) -> Pieces:
        time, pieces = part.a, Pieces()
        while part.b - time > part.shortest:
            if self.gap > 0.0 or self._opens(part, time):
                time = self._fly(part, time)
                pieces.append((time, 0.0, 0.0))
            else:
                start, time = time, self._press(part)
                pieces.append((time, min(part.at(start), 0.0) / part.y, min(part.at(time), 0.0) / part.y))
        if not pieces:
            return [(part.b, 0.0, 0.0)]
        return [*pieces[:-1], (part.b, *pieces[-1][1:])]

    @staticmethod
    def _opens(part: Interval, time: float) -> bool:
        w = part.at(time)
        return w > 0.0 or (w == 0.0 and part.at(part.b) > 0.0)

    def _fly(self, part: Interval, time: float) -> float:
        """Open flight from ``time`` to the closing instant or to the end of the interval."""
        w, rate, rest = part.at(time), part.slope, part.b - time
        if self.gap == 0.0:
            self.openings.append(time)
        flight = closing_time(self.gap, w, rate)
        if flight > rest:
            self.gap = max(self.gap + w * rest + 0.5 * rate * rest * rest, 0.0)
            return part.b
        self.gap = 0.0
        self.closings.append(time + flight)
        return time + flight

    @staticmethod
    def _press(part: Interval) -> float:
        """Closed (or touching without pressure) until the free opening velocity changes sign."""
        if part.at(part.b) <= 0.0:
            return part.b
        return min(part.a - part.w0 / part.slope, part.b)


def closing_time(gap: float, velocity: float, rate: float) -> float:
    """Smallest positive s with gap + velocity s + rate s^2/2 = 0, infinite when there is none."""
    if gap == 0.0:
        return -2.0 * velocity / rate if rate < 0.0 < velocity else math.inf
    inside = velocity * velocity - 2.0 * gap * rate
    if inside < 0.0:
        return math.inf
    # Both roots without cancellation: q = -(v + sign(v) sqrt(...)), roots q/rate and 2 gap/q.
    q = -(velocity + math.copysign(math.sqrt(inside), velocity))
    roots = [2.0 * gap / q] if q != 0.0 else []
    if rate != 0.0:
        roots.append(q / rate)
    return min((s for s in roots if s > 0.0), default=math.inf)
