"""What became of a communication step."""

from __future__ import annotations

import math
from dataclasses import dataclass

SHORTEST = 1e-9  # of a time step: shorter communication steps are round-off
EARLY = 1e-6  # of the step: how far its start may be from the present time


@dataclass(frozen=True)
class StepReport:
    """``accepted`` False: the state is as before, ``message`` says why and what to do."""

    accepted: bool
    message: str = ""
    instants: int = 0
    iterations: int = 0
    error_indicator: float = 0.0

    def __bool__(self) -> bool:
        return self.accepted


def refused(message: str) -> StepReport:
    """A step that was not made."""
    return StepReport(False, message)


def why_not(t: float, h: float, now: float, time_step: float) -> str:
    """Why no step can be made from t by h at the time ``now``, all in s; empty where it can."""
    if not (math.isfinite(t) and math.isfinite(h)):
        return f"time {t!r} or step size {h!r} is not a finite number"
    if h <= SHORTEST * time_step or t + h <= t:
        return f"the step size {h!r} s is too short; it must exceed {SHORTEST * time_step:.3g} s"
    if abs(t - now) > EARLY * h:
        return f"the step starts at {t!r} s, but the present time is {now!r} s: restore a state to go back"
    return ""
