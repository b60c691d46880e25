"""Exact travelling waves in elastic bars (or shear columns) in series.

rho dv/dt = ds/dx + f,  ds/dt = E dv/dx,  Z = rho c.  Along dx = +c dt the quantity  right = s - Z v  changes
by -f dx; along dx = -c dt the quantity  left = s + Z v  changes by f dx. A bar is therefore two functions of
time: what its left end emits to the right, what its right end emits to the left. Both are known on
[t, t + shortest transit] once the past is, whatever the connections do, so the solution marches by that
interval and is exact for data that are piecewise linear in time: no grid, events fall where they fall.

For an axial bar take modulus E and x along it; for a shear column modulus G and v, s transverse.
Per unit area of cross-section throughout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .connections import Connection, Interval, Pieces
from .piecewise import Array, PiecewiseLinear, merged_breaks


@dataclass(frozen=True)
class Bar:
    """One bar at its start: uniform velocity and stress, constant body force (N m-3)."""

    length: float
    modulus: float
    density: float
    velocity: float = 0.0
    stress: float = 0.0
    body_force: float = 0.0

    @property
    def speed(self) -> float:
        return float(np.sqrt(self.modulus / self.density))

    @property
    def impedance(self) -> float:
        return float(np.sqrt(self.modulus * self.density))

    @property
    def transit(self) -> float:
        return self.length / self.speed


class Waves:
    """The solution on [0, end].

    ``rightward[i]``, ``leftward[i]``: what bar i emits at its left and right ends, from -transit on.
    ``stress[j]``, ``velocity[j]`` (bar on the left, bar on the right): at
    connection j (0 is the left end of the row).
    """

    def __init__(
        self,
        bars: Sequence[Bar],
        connections: Sequence[Connection],
        end: float,
        wall_velocity: tuple[PiecewiseLinear | None, PiecewiseLinear | None] = (None, None),
    ) -> None:
        if len(connections) != len(bars) + 1:
            raise ValueError(f"{len(bars)} bars need {len(bars) + 1} connections, not {len(connections)}")
        self.bars, self.connections, self.end = tuple(bars), tuple(connections), end
        rest = PiecewiseLinear.constant(0.0, 0.0, end)
        self._walls = tuple(rest if w is None else w for w in wall_velocity)
        self.rightward = [_initial(b, b.stress - b.impedance * b.velocity, b.body_force) for b in bars]
        self.leftward = [_initial(b, b.stress + b.impedance * b.velocity, -b.body_force) for b in bars]
        self.stress = [PiecewiseLinear(0.0) for _ in connections]
        self.velocity = [(PiecewiseLinear(0.0), PiecewiseLinear(0.0)) for _ in connections]
        self._march()

    def _march(self) -> None:
        stride = min(b.transit for b in self.bars)
        time = 0.0
        while time < self.end:
            until = min(time + stride, self.end)
            if self.end - until < 1e-9 * stride:
                until = self.end
            emitted = [self._connect(j, time, until) for j in range(len(self.connections))]
            for j, (to_left, to_right) in enumerate(emitted):
                for piece in to_left:
                    self.leftward[j - 1].append(*piece)
                for piece in to_right:
                    self.rightward[j].append(*piece)
            time = until

    def _connect(self, j: int, start: float, until: float) -> tuple[Pieces, Pieces]:
        """March connection j over [start, until]; returns what it emits to bar j-1 and to bar j."""
        law, last = self.connections[j], j == len(self.bars)
        first = self._arrival(self.bars[j - 1], self.rightward[j - 1], start, until, -1.0) if j else None
        second = None if last else self._arrival(self.bars[j], self.leftward[j], start, until, 1.0)
        y1 = 1.0 / self.bars[j - 1].impedance if j else 0.0
        y2 = 0.0 if last else 1.0 / self.bars[j].impedance
        v1 = first.scaled(-y1) if first else self._walls[0]
        v2 = second.scaled(y2) if second else self._walls[1]
        shortest = 1e-12 * min(b.transit for b in self.bars)
        cuts = merged_breaks([v1, v2, *law.knots()], start, until, shortest)
        to_left, to_right = Pieces(), Pieces()
        for a, b in pairwise(cuts):
            (a1, b1), (a2, b2) = v1.on(a, b), v2.on(a, b)
            part = Interval(a, b, a2 - a1, b2 - b1, y1 + y2, self._quiet(), shortest)
            begin = a
            for stop, s0, s1 in law.solve(part):
                (p0, p1), (q0, q1) = v1.on(begin, stop), v2.on(begin, stop)
                self.stress[j].append(stop, s0, s1)
                self.velocity[j][0].append(stop, p0 + y1 * s0, p1 + y1 * s1)
                self.velocity[j][1].append(stop, q0 - y2 * s0, q1 - y2 * s1)
                if y1:
                    to_left.append((stop, 2.0 * s0 + p0 / y1, 2.0 * s1 + p1 / y1))
                if y2:
                    to_right.append((stop, 2.0 * s0 - q0 / y2, 2.0 * s1 - q1 / y2))
                begin = stop
        return to_left, to_right

    def _quiet(self) -> float:
        """The velocity that is round-off: 1e-12 of the largest emitted lately."""
        sizes = [
            max(map(abs, [*w.left[-64:], *w.right[-64:]])) / b.impedance
            for waves in (self.rightward, self.leftward)
            for b, w in zip(self.bars, waves, strict=True)
        ]
        return 1e-12 * max(sizes)

    @staticmethod
    def _arrival(bar: Bar, wave: PiecewiseLinear, start: float, until: float, sign: float) -> PiecewiseLinear:
        """What reaches the far end over [start, until]: emitted one transit before, plus the body force."""
        shift, gain = bar.transit, sign * bar.body_force * bar.length
        out = PiecewiseLinear(start)
        for _, e, y0, y1 in wave.pieces(start - shift, until - shift):
            out.append(e + shift, y0 + gain, y1 + gain)
        if until > out.end:  # round-off of the two shifts
            out.append(until, out.right[-1], out.right[-1])
        return out

    def field(self, bar: int, x: Sequence[float] | Array, time: float, after: bool = False) -> tuple[Array, Array]:
        """Stress and velocity at places x of a bar at one time (limit from before, or from after)."""
        b, near = self.bars[bar], np.asarray(x, float)
        far = b.length - near
        right = self.rightward[bar].sample(time - near / b.speed, after) - b.body_force * near
        left = self.leftward[bar].sample(time - far / b.speed, after) + b.body_force * far
        return 0.5 * (left + right), 0.5 * (left - right) / b.impedance

    def displacement(self, bar: int, x: float, time: float) -> float:
        """Displacement since t = 0 at place x of a bar (exact)."""
        b, r = self.bars[bar], self.bars[bar].length - x
        left = self.leftward[bar].integral(-r / b.speed, time - r / b.speed) + b.body_force * r * time
        right = self.rightward[bar].integral(-x / b.speed, time - x / b.speed) - b.body_force * x * time
        return 0.5 * (left - right) / b.impedance

    def gap(self, connection: int, initial: float, time: float) -> float:
        """Opening of a connection at ``time``, from the end velocities."""
        first, second = self.velocity[connection]
        return initial + second.integral(0.0, time) - first.integral(0.0, time)


def _initial(bar: Bar, value: float, body_force: float) -> PiecewiseLinear:
    """The wave emitted before t = 0 that leaves the uniform initial state of the bar."""
    early = value + body_force * bar.length
    return PiecewiseLinear.from_pieces(-bar.transit, [(0.0, early, value)])
