"""Prices of accuracy: what a smaller error of a quantity costs, as data, text, JSON report and dataset."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final, Protocol

import numpy as np

from ..scene.readable_numbers import percent
from .groups import finite
from .quantities import Columns, Named, rows

TARGETS: Final = (0.05, 0.02, 0.01)
"""Relative errors that have a price."""
AS_WRITTEN: Final = "as written"
"""Setting that changes nothing."""
IN_SUMMARY: Final = 6
"""Most quantities in the table of the summary."""


@dataclass(frozen=True)
class Price:
    """Predicted cost of a relative error of one quantity, by the cheapest change of mesh, steps and tolerance.

    Attributes
    ----------
    target : relative error. mesh, steps : elements per length and steps per time, relative to the scene; NaN where it
        cannot be had. tolerance : on sqrt(eta). cpu : CPU time of a run, s, without its output. memory : bytes at most.
    reason : why it cannot be had, empty where it can.
    """

    target: float
    mesh: float = math.nan
    steps: float = math.nan
    tolerance: float = math.nan
    cpu: float = math.nan
    memory: float = math.nan
    reason: str = ""

    @property
    def setting(self) -> str:
        """What changes, in words: numbers of elements along an edge and of time steps over those of the run.

        >>> Price(0.01, mesh=2.0, steps=1.0, cpu=3.0).setting, Price(0.01, mesh=1.5, steps=1.5, cpu=2.0).setting
        ('elements x 2', 'elements, steps x 1.5')
        """
        mesh, steps = f"{self.mesh:.2g}", f"{self.steps:.2g}"
        if mesh == steps == "1":
            return AS_WRITTEN
        if mesh == steps:
            return f"elements, steps x {mesh}"
        parts = [f"{name} x {factor}" for name, factor in (("elements", mesh), ("steps", steps)) if factor != "1"]
        return ", ".join(parts)

    @property
    def text(self) -> str:
        """Cost and setting, or the reason why there are none."""
        if self.reason:
            return self.reason
        if self.setting == AS_WRITTEN:
            return "reached"
        return f"{cpu_time(self.cpu)} ({self.setting})"


def cpu_time(seconds: float) -> str:
    """A CPU time, two digits.

    >>> cpu_time(0.233), cpu_time(47.0), cpu_time(412.0), cpu_time(3e4)
    ('0.23 s', '47 s', '6.9 min', '8.3 h')
    """
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {unit}" if seconds < 100.0 * size else f"{seconds / size:.0f} {unit}"
    return f"{seconds:.2g} s" if seconds < 100.0 else f"{seconds:.0f} s"


_NUMBERS: Final = rows(
    """
    cost_cpu       | s    | quantity target | predicted CPU time of a run with this error | NaN where it cannot be had
    cost_memory    | 1    | quantity target | predicted memory of that run, bytes at most
    cost_mesh      | 1    | quantity target | elements per length of that run over those of this one
    cost_steps     | 1    | quantity target | time steps of that run over those of this one
    cost_tolerance | 1    | quantity target | tolerance on sqrt(eta) of that run
    """,
    {f"cost_{name}": attrgetter(name) for name in ("cpu", "memory", "mesh", "steps", "tolerance")},
)
_LABELS: Final = rows(
    """
    target      | 1 | target          | relative error that has a price
    cost_reason | - | quantity target | why a quantity cannot be had with this error
    """
)


class Priced(Named, Protocol):
    """An estimate of one quantity with its prices."""

    @property
    def error_text(self) -> str:
        """Its error now, in words."""
        ...

    @property
    def prices(self) -> tuple[Price, ...]:
        """Of smaller errors; none where they were not predicted."""
        ...


def price_columns(quantities: Sequence[Priced]) -> tuple[Columns, Columns]:
    """Variables and coordinates of the prices of quantities for the group ``accuracy``; none without prices."""
    if not any(q.prices for q in quantities):
        return (), ()
    absent = tuple(Price(target, reason="not computed") for target in TARGETS)
    table = [q.prices or absent for q in quantities]
    numbers = [(row, np.array([[row.of(p) for p in prices] for prices in table])) for row in _NUMBERS.values()]
    reasons = np.array([[p.reason for p in prices] for prices in table], dtype=np.str_)
    labels = [(_LABELS["target"], np.array(TARGETS)), (_LABELS["cost_reason"], reasons)]
    return numbers, labels


def price_report(prices: Sequence[Price]) -> list[dict[str, Any]]:
    """Plain data for strict JSON, an entry a target."""
    names = "mesh", "steps", "tolerance"
    return [
        {"target": p.target, "cpu_seconds": finite(p.cpu), "memory_bytes": finite(p.memory), "reason": p.reason}
        | {name: finite(getattr(p, name)) for name in names}
        for p in prices
    ]


def price_rows(quantities: Sequence[Priced]) -> list[tuple[str, ...]]:
    """Table: quantity, its error now, and what each target costs; its head alone without prices."""
    head = ("CPU time for an error of", "now", *(percent(target) for target in TARGETS))
    return [head, *((q.quantity, q.error_text, *(p.text for p in q.prices)) for q in quantities if q.prices)]
