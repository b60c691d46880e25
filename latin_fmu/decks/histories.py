"""Steps of a deck on one axis of time, and what loads and motions do over it: piecewise linear laws.

Steps follow each other. A value without an amplitude grows evenly over a static step from that of the step before, and
is there at once in a dynamic one (``AMPLITUDE`` of *STEP says otherwise). One with an amplitude a(t) is value times a;
t counts in the step that sets it, and its last value stays, or, with ``TIME=TOTAL TIME``, from the start of the deck.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Final

import numpy as np

from ..mesh_files.deck_card import Card

Points = list[tuple[float, float]]
"""Times, ascending, and values; a jump is a time that stands twice."""
Law = Mapping[str, Any] | None
"""Table of a law; None where a quantity is the same at all times."""
_MOST_STEPS: Final = 1_000_000
_SAME: Final = 1e-9  # of the largest value, and of the step


@dataclass(frozen=True)
class Amplitude:
    """An *AMPLITUDE: linear between its points, held before and after.

    Attributes
    ----------
    times, values : its points. total : whether times count from the start of the deck.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]
    total: bool

    def over(self, start: float, end: float, shift: float) -> Points:
        """Points from ``start`` to ``end``; ``shift`` : from its own time to that of the points."""
        inner = [t + shift for t in self.times if start < t + shift < end]
        at = [start, *inner, end]
        values = np.interp(np.array(at) - shift, self.times, self.values)
        return list(zip(at, values.tolist(), strict=True))


@dataclass
class DeckStep:
    """A *STEP.

    Attributes
    ----------
    card : *STEP. procedure : its card, *STATIC or *DYNAMIC; None of a step that is left out. start, period, increment :
    times. at_once : whether values without an amplitude come at once. kept : whether it is on the axis of time; a step
    that does nothing but tighten bolts is not.
    """

    card: Card
    procedure: Card | None = None
    start: float = 0.0
    period: float = 1.0
    increment: float = 1.0
    at_once: bool = False
    kept: bool = True

    @property
    def dynamic(self) -> bool:
        """Whether it has inertia."""
        return self.procedure is not None and self.procedure.keyword == "DYNAMIC"


@dataclass(frozen=True)
class DeckQuantity:
    """What a line of a deck sets.

    Attributes
    ----------
    kind : of load or motion. target : face, set or body. axis : component, from 0. direction : of a load with one.
    point : on the axis of a rotation, whose direction that is.
    """

    kind: str
    target: str
    axis: int = 0
    direction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Setting:
    """A value of a quantity from a step on.

    Attributes
    ----------
    step : number, from 1; 0 before the first. card : that sets it.
    """

    step: int
    value: float
    amplitude: Amplitude | None
    card: Card


@dataclass
class DeckHistory:
    """The values of one quantity over the steps of a deck.

    Attributes
    ----------
    settings : in order. ended : steps in which OP=NEW takes it away.
    """

    settings: list[Setting] = field(default_factory=list)
    ended: list[int] = field(default_factory=list)

    def at_step(self, number: int) -> Setting | None:
        """The setting that counts in a step; None before the first, and where it was taken away."""
        last = None
        for setting in self.settings:
            if setting.step <= number:
                last = setting
        gone = [step for step in self.ended if last is None or last.step < step <= number]
        return None if gone else last

    def points(self, steps: Sequence[DeckStep], before: float = 0.0) -> Points:
        """Times and values over the steps; ``before`` : value until it is set."""
        found: Points = []
        value = before
        for number, step in enumerate(steps, 1):
            setting = self.at_step(number)
            end = step.start + step.period
            if setting is None:
                piece = _towards(step, value, before)
            elif setting.amplitude is not None and setting.step < number and not setting.amplitude.total:
                piece = [(step.start, value), (end, value)]
            elif setting.amplitude is not None:
                shift = 0.0 if setting.amplitude.total else step.start
                piece = [(t, setting.value * a) for t, a in setting.amplitude.over(step.start, end, shift)]
            else:
                piece = _towards(step, value, setting.value)
            value = piece[-1][1]
            if step.kept and step.procedure is not None:
                found += piece
        return found


LawMaker = Callable[[DeckQuantity, DeckHistory], tuple[float, Law, Points]]
"""Amount, law and points of a quantity over the scene."""


def _towards(step: DeckStep, before: float, value: float) -> Points:
    """A value without an amplitude over a step."""
    end = step.start + step.period
    if step.at_once:
        return [(step.start, value), (end, value)]
    return [(step.start, before), (end, value)]


def shifted(points: Points, start: float) -> Points:
    """Points from ``start`` on, which becomes 0."""
    return [(t - start, value) for t, value in points if t >= start * (1.0 - 1e-12)]


def law_of(points: Points, before: float | None, step: float) -> tuple[float, Mapping[str, Any] | None]:
    """Amount and time law of values over time: their product is the value.

    Parameters
    ----------
    points : from t = 0 on. before : value before t = 0, of a static start; None without one: a value at t = 0 comes
        with the first instant. step : of time: a later jump goes over one.

    Returns
    -------
    Amount, and the table of the law; None where the value is the same at all times.
    """
    clean = _without_jumps(points, points[0][1] if before is None else before, step)
    values = [value for _, value in clean]
    amount = values[-1]
    if abs(amount) <= _SAME * max(map(abs, values)):
        amount = max(values, key=abs)
    amount = tidy(amount)
    if amount == 0.0 or all(math.isclose(v, amount, rel_tol=_SAME) for v in values):
        return amount, None
    if len(clean) < 2:
        return amount, None
    times = [tidy(t) for t, _ in clean]
    return amount, {"type": "table", "times": times, "values": [tidy(v / amount) for v in values]}


def _without_jumps(points: Points, before: float, step: float) -> Points:
    """Points at different times: a jump goes over the step after it, as the instants take it."""
    kept: Points = [(points[0][0], before)]
    for t, value in points if before != points[0][1] else points[1:]:
        last, old = kept[-1]
        if t - last > _SAME * step:
            kept.append((t, value))
        elif value != old and t + step < points[-1][0] + step * 0.5:
            kept.append((t + step, _value_at(points, t + step)))
    # what lies on the line between its neighbours says nothing
    slim = kept[:1]
    for i in range(1, len(kept)):
        if kept[i][0] <= slim[-1][0]:
            continue
        if i + 1 < len(kept) and _between(slim[-1], kept[i], kept[i + 1]):
            continue
        slim.append(kept[i])
    return slim


def _between(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether b lies on the line from a to c."""
    if c[0] <= b[0]:
        return False
    on_line = a[1] + (c[1] - a[1]) * (b[0] - a[0]) / (c[0] - a[0])
    return abs(on_line - b[1]) <= _SAME * max(abs(a[1]), abs(b[1]), abs(c[1]))


def _value_at(points: Points, time: float) -> float:
    """Value at a time, after a jump there."""
    times = np.array([t for t, _ in points])
    i = int(np.searchsorted(times, time * (1.0 + 1e-12), side="right")) - 1
    if i + 1 >= len(points) or times[i + 1] == times[i]:
        return points[i][1]
    share = (time - times[i]) / (times[i + 1] - times[i])
    return points[i][1] + float(share) * (points[i + 1][1] - points[i][1])


def tidy(value: float) -> float:
    """A number without the digits of its round-off."""
    # + 0.0: no minus of a zero
    return float(f"{value:.12g}") + 0.0


def common_step(periods: Sequence[float], increments: Sequence[float]) -> float | None:
    """Largest step, at most the smallest increment, of which every period is a multiple; None where only an absurdly
    small one is.

    >>> common_step([1.0, 0.5], [0.3, 0.25])
    0.25
    """
    exact = [Fraction(str(period)) for period in periods]
    whole = exact[0]
    for period in exact[1:]:
        whole = _divisor(whole, period)
    parts = math.ceil(float(whole) / min(increments) * (1.0 - 1e-9))
    if sum(exact) / whole * parts > _MOST_STEPS:
        return None
    return float(whole / max(parts, 1))


def _divisor(a: Fraction, b: Fraction) -> Fraction:
    """Greatest common divisor of two fractions."""
    return Fraction(math.gcd(a.numerator * b.denominator, b.numerator * a.denominator), a.denominator * b.denominator)
