"""A run in figures: what scripts read (``--json``)."""

from __future__ import annotations

import math
from typing import Any

from ..latin.record import InterfaceHistory, Outcome, Timings
from .measures import InterfaceFields, first_contact_time, peak_force, separation_time


def report(outcome: Outcome) -> dict[str, Any]:
    """Plain data that strict JSON can hold (a number that is not finite becomes None).

    Keys: ``status``, ``converged``, ``iterations`` (one count per window), ``passes``, ``error_indicator``
    (the amplitude sqrt(eta), largest over windows), ``cpu_seconds`` by part, ``peak_memory_bytes``,
    ``penetration`` (m), ``warnings``, and ``interfaces``: per name ``impulse`` (vector, N s), ``peak_force``
    (N, of the normal resultant), ``first_contact_time`` and ``separation_time`` (s; first and last instant at
    which the normal resultant exceeds 1 % of its peak, None if never) and ``error_indicator``. A solution with an
    error estimate adds ``error_estimate``, see ``results.estimates``.
    """
    return {
        "status": outcome.status,
        "converged": bool(outcome.converged),
        "iterations": [window.iterations for window in outcome.windows],
        "passes": _number(outcome.passes),
        "error_indicator": _number(outcome.error_indicator),
        "cpu_seconds": cpu_seconds(outcome.timings),
        "peak_memory_bytes": int(outcome.timings.peak_memory),
        "penetration": _number(outcome.penetration()),
        "warnings": list(outcome.warnings),
        "interfaces": {name: _interface(outcome, history) for name, history in outcome.interfaces.items()},
    }


def cpu_seconds(timings: Timings) -> dict[str, float | None]:
    """CPU seconds of the process by part, and their sum."""
    parts = {
        "set_up": timings.setup,
        "march": timings.march,
        "other": timings.other,
        "output": timings.output,
        "total": timings.total,
    }
    return {part: _number(seconds) for part, seconds in parts.items()}


def _interface(outcome: Outcome, history: InterfaceHistory) -> dict[str, Any]:
    fields = InterfaceFields.of_history(history, outcome.time)
    return {
        "impulse": [_number(value) for value in history.impulse(outcome.time)[-1]],
        "peak_force": _number(peak_force(fields)),
        "first_contact_time": _number(first_contact_time(fields)),
        "separation_time": _number(separation_time(fields)),
        "error_indicator": _number(outcome.interface_indicator.get(history.name)),
    }


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
