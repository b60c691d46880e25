"""Choices of a session, fixed before it starts."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..errors import InputError, Problem
from ..scene.schema import Scene
from .variables import HOLD, LINE, PRESCRIBED, RATE, WINDOWED


@dataclass(frozen=True)
class Settings:
    """None stands for what the scene says.

    Attributes
    ----------
    mode : WINDOWED (0) or PRESCRIBED (1). interpolation : of loads inside a step, HOLD (0), RATE (1), LINE (2).
    time_step : longest time step inside a communication step, s. end_time : end of the interval solved in
        prescribed mode, s. tolerance : on sqrt(eta). max_iterations : of a window.
    keep : keep the accepted steps in memory, for ``Session.dataset``.
    """

    mode: int = WINDOWED
    interpolation: int = RATE
    time_step: float | None = None
    end_time: float | None = None
    tolerance: float | None = None
    max_iterations: int | None = None
    keep: bool = True

    def choices(self) -> tuple[object, ...]:
        """All that has a say in the numbers."""
        return (self.mode, self.interpolation, self.time_step, self.end_time, self.tolerance, self.max_iterations)

    def step_of(self, scene: Scene) -> float:
        """Longest time step, s."""
        return scene.time.time_step if self.time_step is None else self.time_step

    def problems(self) -> list[Problem]:
        """What is out of range."""
        found = []
        if self.mode not in (WINDOWED, PRESCRIBED):
            found.append(Problem("mode", "no such mode", str(self.mode), "0 (windowed) or 1 (prescribed)"))
        if self.interpolation not in (HOLD, RATE, LINE):
            found.append(
                Problem("inputInterpolation", "no such rule", str(self.interpolation), "0 (hold), 1 (rate), 2 (line)")
            )
        for name, value in (("timeStep", self.time_step), ("endTime", self.end_time)):
            if value is not None and not (math.isfinite(value) and value > 0.0):
                found.append(Problem(name, "must be a time span", repr(value), "a finite number > 0"))
        if self.tolerance is not None and not 1e-14 <= self.tolerance < 1.0:
            found.append(Problem("tolerance", "out of range", repr(self.tolerance), "1e-14 <= tolerance < 1"))
        if self.max_iterations is not None and self.max_iterations < 1:
            found.append(Problem("maxIterations", "out of range", str(self.max_iterations), "1 or more"))
        return found

    def applied(self, scene: Scene) -> Scene:
        """The scene with these settings (all but the tolerance, which the run takes by itself).

        Raises
        ------
        InputError : a setting out of range; all are listed.
        """
        if found := self.problems():
            raise InputError(found, "the settings cannot be used")
        changes: dict[str, object] = {}
        if self.max_iterations is not None and self.max_iterations != scene.solver.max_iterations:
            changes["solver"] = scene.solver.model_copy(update={"max_iterations": self.max_iterations})
        step = self.step_of(scene)
        end = scene.time.end if self.end_time is None else self.end_time
        if self.mode == PRESCRIBED and (step, end) != (scene.time.time_step, scene.time.end):
            n = max(1, round(end / step))
            changes["time"] = scene.time.model_copy(update={"end": end, "step": None, "instants": n})
        return scene.model_copy(update=changes) if changes else scene


# -- What became of a communication step.
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
