"""Settings of a session, fixed before it starts, and the report of a communication step."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from ..errors import InputError, Problem
from ..scene.overrides import number_at
from ..scene.schema import Scene
from ..scene.settings import MAX_ITERATIONS
from .variables import CAUSAL, PRESCRIBED, WINDOWED

MAX_INSTANTS = 1_000_000  # of one communication step, or of the interval of prescribed mode
EARLY = 1e-6  # of the step: largest distance of its start from the present time


@dataclass(frozen=True)
class Settings:
    """Settings of a session; None: the value of the scene.

    Attributes
    ----------
    mode : WINDOWED (0) or PRESCRIBED (1). interpolation : of loads inside a step, HOLD (0), RATE (1), LINE (2),
        CAUSAL (3: RATE for a load that was given a rate, else the straight line through its last two values).
    time_step : of the run, s; communication steps may be of any length. end_time : end of the interval solved in
        prescribed mode, s. tolerance : on sqrt(eta). max_iterations : of a window. values : other numbers of the scene,
        each with its dotted name as for ``Scene.replace``.
    keep : keep the accepted steps in memory, for ``Session.dataset`` and ``Session.estimate_error``. Windowed mode: a
        time step then takes ten to twenty times the CPU time and, of a small scene, 5 to 15 kB.
    """

    mode: int = WINDOWED
    interpolation: int = CAUSAL
    time_step: float | None = None
    end_time: float | None = None
    tolerance: float | None = None
    max_iterations: int | None = None
    keep: bool = False
    values: tuple[tuple[str, float], ...] = ()

    @property
    def prescribed(self) -> bool:
        """Whether the mode is prescribed, not windowed."""
        return self.mode == PRESCRIBED

    def choices(self) -> tuple[object, ...]:
        """The settings that change the numbers."""
        numbers = self.time_step, self.end_time, self.tolerance, self.max_iterations
        return (self.mode, self.interpolation, *numbers, *self.values)

    def step_of(self, scene: Scene) -> float:
        """Time step of a scene under these settings, s."""
        if self.time_step is None:
            return scene.time.time_step
        return self.time_step

    def problems(self) -> list[Problem]:
        """Problems of the settings that are out of range; mode and interpolation are looked at by the runtime."""
        tolerance = self.tolerance
        n = self.max_iterations
        span = ("must be a time span", "a finite number > 0")
        # round-off of doubles ends no iteration below it
        in_range = tolerance is None or 1e-14 <= tolerance < 1.0
        checks = (
            ("timeStep", self.time_step, _is_span(self.time_step), *span),
            ("endTime", self.end_time, _is_span(self.end_time), *span),
            ("tolerance", tolerance, in_range, "out of range", "1e-14 <= tolerance < 1"),
            ("maxIterations", n, n is None or 1 <= n <= MAX_ITERATIONS, "out of range", f"1 to {MAX_ITERATIONS}"),
        )
        return [Problem(name, what, repr(value), allowed) for name, value, good, what, allowed in checks if not good]

    def _longer_than(self, scene: Scene) -> list[Problem]:
        """Problems of time steps that do not suit the interval."""
        step, end = self.time_step, scene.time.end if self.end_time is None else self.end_time
        if not (_is_span(step) and _is_span(end)):
            return []
        step = self.step_of(scene)
        if self.time_step is not None and step > end * (1.0 + EARLY):
            return [Problem("timeStep", "is longer than the simulation", f"{step:g} s", f"at most {end:g} s")]
        if self.mode == PRESCRIBED and end / step > MAX_INSTANTS:
            what = f"gives more than {MAX_INSTANTS} time steps of {step:g} s"
            return [Problem("endTime", what, f"{end:g} s", f"at most {MAX_INSTANTS * step:g} s", "longer time steps")]
        return []

    def with_values(self, scene: Scene) -> Scene:
        """The scene with its other numbers, as it is written: before interfaces are found.

        Raises
        ------
        SceneError : a value that does not fit.
        """
        tables = scene.tables() if self.values else {}
        for name, value in self.values:
            if number_at(tables, name) != value:
                scene = scene.replace(name, value)
        return scene

    def applied(self, scene: Scene) -> Scene:
        """The scene with these settings, but for the tolerance, which is given to the run, and for ``values``.

        Raises
        ------
        InputError : a setting out of range; all are listed.
        """
        if problems := [*self.problems(), *self._longer_than(scene)]:
            raise InputError(problems, "the settings cannot be used")
        changes: dict[str, object] = {}
        if self.max_iterations is not None and self.max_iterations != scene.solver.max_iterations:
            changes["solver"] = scene.solver.model_copy(update={"max_iterations": self.max_iterations})
        step, end = self.step_of(scene), scene.time.end
        if self.mode == PRESCRIBED and self.end_time is not None:
            end = self.end_time
        if (step, end) != (scene.time.time_step, scene.time.end):
            # prescribed: a whole number of steps, the end is met exactly
            n = max(1, round(end / step))
            if self.mode != PRESCRIBED:  # the step is kept, not the end, up to which time laws are tabulated
                n = min(max(n, math.ceil(end / step - EARLY)), MAX_INSTANTS)
                end = n * step
            changes["time"] = scene.time.model_copy(update={"end": end, "step": None, "instants": n})
        if changes:
            return scene.model_copy(update=changes)
        return scene


def _is_span(value: float | None) -> bool:
    return value is None or (math.isfinite(value) and value > 0.0)


class StepReport(NamedTuple):
    """Result of a communication step; where it is not accepted, ``message`` says why and the state is as before.

    ``again``: a shorter step, or the same with another input, may be accepted. ``early``: time, s, at which the step
    ended before its end, after a contact event; None where it did not.
    """

    accepted: bool
    message: str = ""
    instants: int = 0
    iterations: int = 0
    error_indicator: float = 0.0
    again: bool = False
    early: float | None = None

    def __bool__(self) -> bool:
        return self.accepted


def refused(message: str, again: bool = False) -> StepReport:
    """Report of a step that was not made; ``again``: a shorter one, or another input, may help."""
    return StepReport(False, message, again=again)
