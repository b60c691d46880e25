"""A rigid block on a rough floor under the horizontal force 8 cos t, event by event in closed form.

m = 1, mu = 0.8, g = 9.81, from rest at x = 3 (a test case of the Solfec code). While it slips with sign s
its acceleration is 8 cos t - s mu g, integrated exactly; it stops where the velocity vanishes, and starts
again where |8 cos t| reaches mu m g.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.optimize import brentq

FORCE, FRICTION, START = 8.0, 0.8 * 9.81, 3.0


@dataclass(frozen=True)
class Slip:
    """One slip phase: from ``begin`` at ``place`` to ``end``, in the direction ``sign``."""

    begin: float
    end: float
    place: float
    sign: float

    def velocity(self, time: float) -> float:
        t = min(max(time, self.begin), self.end)
        return FORCE * (math.sin(t) - math.sin(self.begin)) - self.sign * FRICTION * (t - self.begin)

    def position(self, time: float) -> float:
        t = min(max(time, self.begin), self.end)
        s = t - self.begin
        path = FORCE * (math.cos(self.begin) - math.cos(t) - math.sin(self.begin) * s)
        return self.place + path - 0.5 * self.sign * FRICTION * s * s


def slips(until: float) -> list[Slip]:
    """Every slip phase that begins before ``until`` (the force is largest at 0, pi, 2 pi, ...)."""
    half_width = math.acos(FRICTION / FORCE)  # |8 cos t| > friction within this of k pi
    out: list[Slip] = []
    place, k = START, 0
    while max(k * math.pi - half_width, 0.0) < until:
        begin, sign = max(k * math.pi - half_width, 0.0), (-1.0) ** k
        trial = Slip(begin, math.inf, place, sign)
        end = brentq(trial.velocity, k * math.pi + half_width, (k + 0.5) * math.pi, xtol=1e-15)
        out.append(Slip(begin, end, place, sign))
        place, k = out[-1].position(end), k + 1
    return out


def position(time: float) -> float:
    """Position of the block."""
    return next((s.position(time) for s in reversed(slips(time)) if s.begin <= time), START)


def velocity(time: float) -> float:
    """Velocity of the block."""
    active = [s for s in slips(time) if s.begin <= time <= s.end]
    return active[0].velocity(time) if active else 0.0
