"""Time laws: the dimensionless amplitude a(t) that multiplies a load or a prescribed motion.

Jumps
-----
The value at a jump is the value *before* it: a step or a pulse that starts at t = 0 is 0 at t = 0, and a
rectangular pulse is 1 for start < t <= start + duration. An instant closer to the jump than 1e-9 of its own
value counts as lying on it, so that round-off in ``i * dt`` never decides.

Sampling
--------
The solver uses a(t_i) at its instants and is linear in between, so its impulse is the trapezoid rule of the
samples. `sampled_impulse_error` compares it with the exact integral of the law. With the rule of jumps, a
pulse that starts and ends on instants has its exact impulse.
"""

from __future__ import annotations

from typing import Annotated, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field

from .fields import Real, Table, about, tagged
from .point_laws import CsvLaw, TableLaw

Array = NDArray[np.float64]
JUMP_ROUND_OFF = 1e-9
_START = "instant where the law starts"


class TimeLaw(Protocol):
    """What the solver needs of a law."""

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times (s), of the same shape."""
        ...

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        ...


def _is_after(times: Array, jump: float) -> NDArray[np.bool_]:
    """True where a time lies after the jump by more than round-off."""
    return times - jump > JUMP_ROUND_OFF * np.maximum(np.abs(times), abs(jump))


class ConstantLaw(Table):
    """a = 1 at all times, t = 0 included."""

    type: Literal["constant"] = "constant"

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times, s."""
        return np.ones_like(np.asarray(times, dtype=np.float64))

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        return t1 - t0


class StepLaw(Table):
    """a = 0 until `start`, 1 after it."""

    type: Literal["step"] = "step"
    start: Annotated[Real, about(_START, "s")] = 0.0

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times, s."""
        return _is_after(np.asarray(times, dtype=np.float64), self.start).astype(np.float64)

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        return max(0.0, t1 - max(t0, self.start))


class RectangularPulseLaw(Table):
    """a = 1 for start < t <= start + duration, 0 elsewhere."""

    type: Literal["rectangular_pulse"] = "rectangular_pulse"
    start: Annotated[Real, about(_START, "s")] = 0.0
    duration: Annotated[Real, about("length of the pulse", "s", gt=0)]

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times, s."""
        t = np.asarray(times, dtype=np.float64)
        return (_is_after(t, self.start) & ~_is_after(t, self.start + self.duration)).astype(np.float64)

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        return max(0.0, min(t1, self.start + self.duration) - max(t0, self.start))


class HalfSineLaw(Table):
    """a = sin(pi (t - start) / duration) for start <= t <= start + duration, 0 elsewhere."""

    type: Literal["half_sine"] = "half_sine"
    start: Annotated[Real, about(_START, "s")] = 0.0
    duration: Annotated[Real, about("length of the half period", "s", gt=0)]

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times, s."""
        phase = np.clip((np.asarray(times, dtype=np.float64) - self.start) / self.duration, 0.0, 1.0)
        # sin(pi) is 1e-16 in floating point: the rest after the pulse must be exactly zero
        return np.where(phase < 1.0, np.sin(np.pi * phase), 0.0)

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        a, b = np.clip((np.array([t0, t1]) - self.start) / self.duration, 0.0, 1.0)
        # cos a - cos b as a product: exact also for short spans
        span = 2.0 * np.sin(0.5 * np.pi * (b + a)) * np.sin(0.5 * np.pi * (b - a))
        return float(self.duration / np.pi * span)


class InputLaw(Table):
    """Set from outside while running (an FMU input); stays at `start_value` in a run of its own."""

    type: Literal["input"] = "input"
    start_value: Annotated[Real, about("value until it is set", "1")] = 0.0

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times, s."""
        return np.full_like(np.asarray(times, dtype=np.float64), self.start_value)

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        return self.start_value * (t1 - t0)


Law = Annotated[
    Annotated[
        ConstantLaw | StepLaw | RectangularPulseLaw | HalfSineLaw | TableLaw | CsvLaw | InputLaw,
        Field(discriminator="type"),
    ],
    BeforeValidator(
        tagged,
        json_schema_input_type=Literal["constant", "step", "input"]
        | ConstantLaw
        | StepLaw
        | RectangularPulseLaw
        | HalfSineLaw
        | TableLaw
        | CsvLaw
        | InputLaw,
    ),
]


def sampled_impulse_error(law: TimeLaw, times: ArrayLike) -> float:
    """Relative difference between the impulse the solver applies and that of the law.

        |sum of trapezoids of a(t_i) - int a dt| / max(|int a dt|, sum of trapezoids of |a(t_i)|)

    times : (n,) increasing instants, s. The second term of the scale keeps a law of zero mean from dividing
    by nothing. 0 where both impulses vanish.
    """
    t = np.asarray(times, dtype=np.float64)
    samples = law.sample(t)
    exact = law.impulse(float(t[0]), float(t[-1]))
    scale = max(abs(exact), float(np.trapezoid(np.abs(samples), t)))
    return abs(float(np.trapezoid(samples, t)) - exact) / scale if scale > 0.0 else 0.0
