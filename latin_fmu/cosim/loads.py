"""Loads set from outside: values and rates over a step, or whole histories."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from ..errors import InputError, Problem
from ..latin.record import Array
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from .accepted import AcceptedStep
from .history_file import Histories, check_history
from .variables import HOLD, LINE, RATE, input_loads

Curve = tuple[tuple[float, ...], tuple[float, ...]]
"""Times, s, strictly increasing, and amplitudes between which a load was linear."""

_JUMP: Final = 1e-7  # of a step: how far apart the two times of a jump are written


class Loads:
    """What was set for the next step.

    Attributes
    ----------
    value, rate : amplitude at the start of the next step and its rate (1/s), by load. histories : of prescribed mode.
    """

    def __init__(self, scene: Scene) -> None:
        self._start = {name: _start_value(scene, name) for name in input_loads(scene)}
        self.reset()

    def reset(self) -> None:
        """Loads at their start values, no histories."""
        self.value = dict(self._start)
        self.rate = dict.fromkeys(self._start, 0.0)
        self._reached = dict(self._start)  # at the end of the last step
        self._initial: dict[str, tuple[float, float]] = {}  # value and rate when the simulation began
        self.histories: Histories = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Loads set from outside."""
        return tuple(self._start)

    def set(self, name: str, value: float, rate: float) -> None:
        """Set value and rate. Raises InputError for a load that is not set from outside."""
        self._check(name)
        self.value[name], self.rate[name] = float(value), float(rate)

    def get(self, name: str) -> tuple[float, float]:
        """Value and rate that were set. Raises InputError for a load that is not set from outside."""
        self._check(name)
        return self.value[name], self.rate[name]

    def set_history(self, name: str, times: Sequence[float] | Array, values: Sequence[float] | Array) -> None:
        """Set a history; see ``Session.set_history``."""
        self._check(name)
        checked = check_history(f"history of load {name}", np.asarray(times), np.asarray(values))
        self.histories[name] = checked

    def _check(self, name: str) -> None:
        if name not in self._start:
            allowed = ", ".join(self._start) or 'none: give a load law = "input"'
            raise InputError([Problem(f"load {name}", "not set from outside", None, allowed)])

    def not_finite(self) -> str:
        """The first number that is none, as text; empty where all are finite."""
        for name in self._start:
            for what, number in (("value", self.value[name]), ("rate", self.rate[name])):
                if not math.isfinite(number):
                    return f"load.{name}.{what} = {number!r}"
        return ""

    # -- over a simulation ----------------------------------------------------------------------------------------
    def begin(self) -> None:
        """The simulation begins with the present values."""
        self._reached = dict(self.value)
        self._initial = {name: self.get(name) for name in self._start}

    def changed(self) -> str:
        """The first load that was set to something else since ``begin``; empty where none was."""
        return next((name for name, initial in self._initial.items() if self.get(name) != initial), "")

    def initial_values(self) -> dict[str, float]:
        """Values at ``begin``; the present ones before."""
        return {name: pair[0] for name, pair in self._initial.items()} or dict(self.value)

    def curves(self, end: float) -> dict[str, Curve]:
        """The histories, and constants from 0 to ``end``, s, for loads without."""
        found: dict[str, Curve] = {name: ((0.0, end), (value, value)) for name, value in self.initial_values().items()}
        for name, (times, values) in self.histories.items():
            found[name] = (tuple(map(float, times)), tuple(map(float, values)))
        return found

    def amplitudes(self, h: float, n: int, rule: int) -> dict[str, Array]:
        """Amplitudes (n + 1,) over a step of h, s, in n parts. rule : HOLD, RATE or LINE."""
        return {name: self._amplitude(name, h, n, rule) for name in self._start}

    def _amplitude(self, name: str, h: float, n: int, rule: int) -> Array:
        value = self.value[name]
        if rule == HOLD:
            return np.full(n + 1, value)
        if rule == LINE:
            return np.linspace(self._reached[name], value, n + 1)
        line: Array = value + self.rate[name] * np.linspace(0.0, h, n + 1)
        return line

    def reach(self, amplitudes: Mapping[str, Array]) -> None:
        """The step with these amplitudes was made."""
        self._reached = {name: float(a[-1]) for name, a in amplitudes.items()}

    # -- state ----------------------------------------------------------------------------------------------------
    def tree(self) -> dict[str, Any]:
        """All of it."""
        return {
            "value": self.value,
            "rate": self.rate,
            "reached": self._reached,
            "initial": {name: list(pair) for name, pair in self._initial.items()},
            "histories": {name: list(pair) for name, pair in self.histories.items()},
        }

    def resume(self, tree: Mapping[str, Any]) -> None:
        """Back to a tree."""
        self.value, self.rate, self._reached = tree["value"], tree["rate"], tree["reached"]
        self._initial = {name: (a, b) for name, (a, b) in tree["initial"].items()}
        self.histories = {name: (t, a) for name, (t, a) in tree["histories"].items()}


def _start_value(scene: Scene, name: str) -> float:
    law = scene.load[name].law
    assert isinstance(law, InputLaw)
    return law.start_value


def curves_of(steps: Sequence[AcceptedStep], rule: int, before: Mapping[str, Curve]) -> dict[str, Curve]:
    """What loads did over accepted steps, times from the start of the first one.

    Parameters
    ----------
    rule : HOLD, RATE or LINE. before : curves whose last value is that of the start.
    """
    t0 = steps[0].start
    found: dict[str, Curve] = {}
    for name, (_, given) in before.items():
        times, values = [0.0], [given[-1] if rule == LINE else steps[0].value[name]]
        for step in steps:
            value, h = step.value[name], step.end - step.start
            if rule != LINE and value != values[-1]:
                times.append(times[-1] + _JUMP * h)
                values.append(value)
            times.append(step.end - t0)
            values.append(value + step.rate[name] * h if rule == RATE else value)
        found[name] = (tuple(times), tuple(values))
    return found
