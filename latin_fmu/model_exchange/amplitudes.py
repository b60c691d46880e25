"""Amplitudes of loads and motion of the ground between the jumps of their laws.

A law is smooth between its knots. The integrator stops at each (a time event); inside a segment the law is read
strictly after its first knot and not beyond its last, so that a right-hand side never jumps.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from math import isfinite, nextafter

import numpy as np
from pydantic import TypeAdapter

from ..scene.laws import HalfSineLaw, InputLaw, Law, RectangularPulseLaw, StepLaw, TimeLaw
from ..scene.point_laws import CsvLaw, TableLaw
from .system import Array, ReducedSystem

_AFTER = 4e-9  # of the instant: laws count instants closer to a jump than 1e-9 as before it
_MOST_KNOTS = 100  # of one law: more points are met by the step control of the integrator


class Amplitudes:
    """Laws of a reduced system; ``values`` and ``rates`` hold the loads set from outside, by name."""

    def __init__(self, system: ReducedSystem) -> None:
        read: TypeAdapter[TimeLaw] = TypeAdapter(Law)
        self._laws = [read.validate_python(system.laws[n]) if n else None for n in system.load_names]
        self._names = system.load_names
        self._ground = [(i, v, read.validate_python(law)) for i, v, law in system.ground]
        self._n_interface = len(system.interfaces)
        laws = [law for law in (*self._laws, *(g[2] for g in self._ground)) if law is not None]
        self.knots = sorted({knot for law in laws for knot in _knots(law) if knot >= 0.0})
        self.inputs = [n for n, law in zip(self._names, self._laws, strict=True) if isinstance(law, InputLaw)]
        self.moves = bool(self._ground)

    def segment(self, t: float) -> int:
        """Number of the segment that starts at or before t."""
        return bisect_right(self.knots, t * (1.0 + 1e-12))

    def next_knot(self, segment: int) -> float | None:
        """Where a segment ends; None for the last one."""
        return self.knots[segment] if segment < len(self.knots) else None

    def _inside(self, t: float, segment: int) -> float:
        if segment > 0:
            start = self.knots[segment - 1]
            t = max(t, nextafter(start * (1.0 + _AFTER), np.inf))
        return min(t, self.knots[segment]) if segment < len(self.knots) else t

    def at(self, t: float, segment: int, given: Mapping[str, tuple[float, float, float]]) -> Array:
        """(n_load,) amplitudes; ``given``: value, rate and the time it was set at, of the loads set from outside."""
        inside = self._inside(t, segment)
        found = np.ones(len(self._laws))
        for i, (name, law) in enumerate(zip(self._names, self._laws, strict=True)):
            if name in given:
                value, rate, since = given[name]
                found[i] = value + rate * (t - since)
            elif law is not None:
                found[i] = law.sample(inside)
        return found

    def ground(self, t: float, segment: int) -> tuple[Array, Array]:
        """Displacement and velocity (n_interface, 3) of the ground of every interface."""
        moved, velocity = np.zeros((2, self._n_interface, 3))
        if isfinite(t):
            for i, vector, law in self._ground:
                moved[i] += law.impulse(0.0, max(t, 0.0)) * vector
                velocity[i] += float(law.sample(self._inside(t, segment))) * vector
        return moved, velocity


def _knots(law: TimeLaw) -> Iterator[float]:
    if isinstance(law, StepLaw):
        yield law.start
    elif isinstance(law, RectangularPulseLaw | HalfSineLaw):
        yield from (law.start, law.start + law.duration)
    elif isinstance(law, TableLaw | CsvLaw):
        yield from law.times[:: -(-len(law.times) // _MOST_KNOTS)]
