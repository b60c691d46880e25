"""Loads and motions set from outside: values and rates over a step, or whole histories.

Causal line: a load whose rate is not set goes on as the straight line through its last two values,

    u(t) = u_k + (u_k - u_(k-1)) / (t_k - t_(k-1)) (t - t_k),    u_k set at the start t_k of step k.

It is held over the first step, which has no value before it, and over a step at whose start it leaves a value that was
held before (u_(k-1) = u_(k-2)): a jump. A load may jump where a step begins. A motion goes on from the amplitude it has
reached: a jump of its value takes the first time step. A displacement enters through its rate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..errors import InputError, Problem
from ..latin.outcome import Array
from ..scene.schema import Scene
from .engine import wrong_history
from .input_table import given_of
from .variable import is_wave, variable_of
from .variables import HOLD, LINE

Curve = tuple[tuple[float, ...], tuple[float, ...]]
"""Times, s, strictly increasing, and amplitudes between which a load was linear."""

Histories = dict[str, tuple[Array, Array]]
"""Times, s, and amplitudes by load."""


_HEADING = "the load histories cannot be used"


def rule_of(name: str, rule: int, rate: float) -> int:
    """Rule of one input. A wave without a rate is the straight line from its last value, as if it had travelled for the
    step: a wave that is held gains energy, and so does one that is extrapolated."""
    if is_wave(name) and rule != HOLD and rate == 0.0:
        return LINE
    return rule


class GivenLoads:
    """Loads as they are set from outside: values and rates, and histories of prescribed mode.

    Attributes
    ----------
    value, rate : amplitude at the start of the next step and its rate (1/s), by load. table : (n, 2) both, in the order
    of the loads. histories : by load.
    """

    def __init__(self, scene: Scene) -> None:
        self._start = {source.name: source.start for source in given_of(scene)}
        self.reset()

    def reset(self) -> None:
        """Set every load to its start value; remove the histories."""
        self.value = dict(self._start)
        self.rate = dict.fromkeys(self._start, 0.0)
        self._set_table()
        self._initial = dict(self._start)  # values when the simulation began
        self.histories: Histories = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the loads set from outside."""
        return tuple(self._start)

    def set(self, name: str, value: float, rate: float) -> None:
        """Set value and rate. Raises InputError for a load that is not set from outside."""
        self._check(name)
        self.value[name], self.rate[name] = float(value), float(rate)
        self._set_table()

    def get(self, name: str) -> tuple[float, float]:
        """Value and rate that were set. Raises InputError for a load that is not set from outside."""
        self._check(name)
        return self.value[name], self.rate[name]

    def set_history(self, name: str, times: Sequence[float] | Array, values: Sequence[float] | Array) -> None:
        """Set the history of a load; see ``Session.set_history``."""
        self._check(name)
        checked = check_history(f"history of load {name}", np.asarray(times), np.asarray(values))
        self.histories[name] = checked

    def _check(self, name: str) -> None:
        if name not in self._start:
            allowed = ", ".join(self._start) or 'none: set law = "input" for a load, a driven face or the ground'
            raise InputError([Problem(variable_of(name), "not an input", None, allowed)])

    def _set_table(self) -> None:
        self.table: Array = np.array([[*self.value.values()], [*self.rate.values()]]).T.copy()

    def begin(self) -> None:
        """Start a simulation with the present values."""
        self._initial = dict(self.value)

    def starts(self) -> dict[str, float]:
        """Amplitudes at the start of a simulation that begins now."""
        return self.value | {name: float(np.interp(0.0, *history)) for name, history in self.histories.items()}

    def curves(self, end: float) -> dict[str, Curve]:
        """Histories of the loads; a constant from 0 to ``end``, s, for a load without history."""
        curves: dict[str, Curve] = {name: ((0.0, end), (value, value)) for name, value in self._initial.items()}
        for name, (times, values) in self.histories.items():
            curves[name] = (tuple(map(float, times)), tuple(map(float, values)))
        return curves

    def take(self, now: Array, first: Array, histories: Mapping[int, tuple[Array, Array]]) -> None:
        """Take the inputs of a restored state: values and rates as they are and at the start, (n, 2), histories by
        number."""
        names = self.names
        self.value, self.rate = (dict(zip(names, column.tolist(), strict=True)) for column in now.T)
        self._set_table()
        self._initial = dict(zip(names, first[:, 0].tolist(), strict=True))
        self.histories = {names[i]: history for i, history in histories.items()}


def check_history(where: str, times: Array, values: Array) -> tuple[Array, Array]:
    """A history as double precision arrays.

    Raises InputError unless both are of one length >= 1 and as the runtime takes them: finite, with times that increase
    strictly.
    """
    t, a = np.atleast_1d(np.asarray(times, dtype=float)), np.atleast_1d(np.asarray(values, dtype=float))
    if t.ndim != 1 or t.shape != a.shape or not len(t):
        what = f"{t.shape} times and {a.shape} values: both must be lists of equal length"
    else:
        what = wrong_history(t, a)
    if what:
        raise InputError([Problem(where, what)], _HEADING)
    return t, a
