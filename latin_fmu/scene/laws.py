"""Time laws: the dimensionless amplitude a(t) that multiplies a load or a prescribed motion.

Jumps
-----
The value at a jump is the value *before* it: a step or a pulse that starts at t = 0 is 0 at t = 0, and a
rectangular pulse is 1 for start < t <= start + duration. A load released at t = 0 (one that falls there at once) has
its value before the release in a static start, and the one after it in the march: see ``sampled``. An instant closer
to the jump than 1e-9 of its own value counts as lying on it, so that round-off in ``i * dt`` has no effect.

Sampling
--------
The solver uses a(t_i) (``sampled``) at its instants and is linear in between, so its impulse is the trapezoid rule of
the samples. `sampled_impulse_error` compares it with the exact integral of the law. With the rule of jumps, a
pulse that starts and ends on instants has its exact impulse."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from .fields import Real, SceneTable, Series, Text, _as_list, about, entry, refusal, tagged, units_in
from .number_files import MULTIPLIED, AccelerationUnit, Column, DensityUnit, TimeUnit, ValueUnit, is_column
from .records import GAPS, STARTS, filled
from .unit_texts import DENSITY, names_for

if TYPE_CHECKING:
    from ..shock.random_motion import RandomMotion


def base_dir_of(context: Any) -> Path:
    """Folder that relative file names start from: that of the scene file, else the current one."""
    base_dir = entry(context, "base_dir")
    if isinstance(base_dir, Path):
        return base_dir
    return Path()


Array = NDArray[np.float64]
Points = tuple[float, ...]


def _interpolated(t: ArrayLike, times: Points, values: Points) -> Array:
    return np.asarray(np.interp(np.asarray(t, dtype=np.float64), times, values), dtype=np.float64)


def _integral(t0: float, t1: float, times: Points, values: Points) -> float:
    knots = np.asarray(times)
    # exact: the knots inside are ends of trapezoids
    t = np.concatenate(([t0], knots[(knots > t0) & (knots < t1)], [t1]))
    return float(np.trapezoid(_interpolated(t, times, values), t))


def _check_points(times: Points, values: Points) -> None:
    if len(times) < 2:
        raise refusal("a table needs two points or more", value=len(times), allowed="at least 2 times")
    if len(times) != len(values):
        raise refusal(
            "times and values differ in number",
            value=f"{len(times)} times, {len(values)} values",
            allowed="one value per time",
        )
    t = np.asarray(times)
    falls = np.flatnonzero(t[1:] <= t[:-1])
    if falls.size:
        i = int(falls[0])
        raise refusal(
            "times do not increase",
            value=f"times[{i + 1}] = {times[i + 1]!r} after {times[i]!r}",
            allowed="strictly increasing times",
            remedy="write a jump as two close times",
        )


class _PointsLaw(SceneTable):
    """Points in time, linear in between, held at both ends."""

    if TYPE_CHECKING:  # fields of the laws below, each with a description of its own
        times: Series
        values: Series

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _check_points(self.times, self.values)
        return self

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times, s."""
        return _interpolated(times, self.times, self.values)

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        return _integral(t0, t1, self.times, self.values)


class TableLaw(_PointsLaw):
    """Given points, linear in between, held at both ends."""

    type: Literal["table"] = "table"
    times: Annotated[Series, about("strictly increasing times, two or more", "s")]
    values: Annotated[Series, about("a at these times", "1")]


class CsvLaw(_PointsLaw):
    """Points read from a file of a recorder, linear in between, held at both ends.

    A file of text has columns of times and values below any number of lines that describe them, decimal points or
    decimal commas; of a universal file a function of time is read (dataset 58). The points are kept with the scene in
    its units (`times`, `values`), which no longer needs the file afterwards.

    Samples before t = 0, and intervals longer than three medians of ten samples or more, are refused unless `start`,
    `shift` and `gaps` say what they mean.
    """

    type: Literal["csv"] = "csv"
    file: Annotated[
        Text, about("file, relative to the scene file; the lines above the numbers name columns and units, or nothing")
    ]
    time_column: Annotated[
        Column | None, about("column of the times: name in the header, or number from 1; default: the first", "1")
    ] = None
    column: Annotated[
        Column | None,
        about(
            "column of the values; default: the second of a file with two columns. In a universal file the function "
            "of time: number from 1, name, or point",
            "1",
        ),
    ] = None
    time_unit: Annotated[
        TimeUnit | None,
        about(f"unit of the times: {names_for('s')}, or the factor to s; default: that of the header, or s", "s"),
    ] = None
    value_unit: Annotated[
        ValueUnit | None,
        about(
            "unit of the values, of the quantity that the law multiplies (which then is 1 along its direction): "
            f"{', '.join(map(names_for, MULTIPLIED))}, or the factor to the units of the scene; default: 1, which is "
            "refused if the header has another unit",
            "1",
        ),
    ] = None
    start: Annotated[
        Literal["file", "record", "cut"],
        about(
            "where t = 0 of the run is: at that of the file, whose samples before it are refused; at the first sample "
            "(record); or at that of the file without the samples before it (cut)"
        ),
    ] = "file"
    shift: Annotated[Real, about("time that is added to all samples, after `start`", "s")] = 0.0
    gaps: Annotated[Literal["refused", "linear"], about("where samples are missing: an error, or straight lines")] = (
        "refused"
    )
    times: Annotated[Series, about("filled from the file; where given, the file is not read", "s")] = ()
    values: Annotated[Series, about("filled from the file, in the units of the scene", "1")] = ()
    header_units: Annotated[
        tuple[Text, Text], BeforeValidator(_as_list), about("filled from the file: units of times and values it names")
    ] = ("", "")
    read_as: Annotated[Text, about("filled from the file: columns, units and samples that were read")] = ""

    @model_validator(mode="before")
    @classmethod
    def _load(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("file"), str) or {"times", "values"} & data.keys():
            return data
        # keys that are wrong by themselves are reported as such
        if not all(data.get(key) is None or is_column(data[key]) for key in ("time_column", "column")):
            return data
        if data.get("start", STARTS[0]) not in STARTS or data.get("gaps", GAPS[0]) not in GAPS:
            return data
        shift = data.get("shift", 0.0)
        if isinstance(shift, bool) or not isinstance(shift, int | float) or not math.isfinite(shift):
            return data
        return filled(data, base_dir_of(info.context), units_in(info.context))

    @property
    def units(self) -> tuple[str | float | None, str | float | None]:
        """Units of times and values in the file, by the scene or by the header; None where neither names one."""
        return self.time_unit or self.header_units[0] or None, self.value_unit or self.header_units[1] or None


class SrsLaw(_PointsLaw):
    """A base acceleration whose shock response spectrum is a specification: a sum of waves that comes to rest, the one
    with the smallest peak of several seeds.

    The breakpoints are those of a file with two columns, frequency in Hz and acceleration, or of the scene; in between
    both are straight lines in logarithms. The points are kept with the scene (`times`, `values`).
    """

    type: Literal["srs"] = "srs"
    file: Annotated[
        Text, about("file with two columns, frequency in Hz and acceleration; its header or `unit` names the unit")
    ] = ""
    unit: Annotated[
        AccelerationUnit | None,
        about(
            f"unit of the accelerations of the file: {names_for('m s-2')}, or the factor to the units of the scene", "1"
        ),
    ] = None
    frequency: Annotated[Series, about("breakpoints instead of a file: increasing", "Hz")] = ()
    acceleration: Annotated[Series, about("maximax of the absolute acceleration at these", "m s-2")] = ()
    quality: Annotated[Real, about("amplification Q of the oscillators of the specification", "1", gt=0.5)] = 10.0
    waves: Annotated[
        Literal["wavelets", "damped_sines"],
        about("what the history is a sum of: wavelets, or damped sines, which begin suddenly and decay"),
    ] = "wavelets"
    tolerance: Annotated[Real, about("largest deviation at any twelfth of an octave, dB", "1", gt=0, le=12)] = 1.0
    seeds: Annotated[int, about("how many histories to choose from", "1", ge=1, le=100)] = 5
    duration: Annotated[
        Real | None, about("of the history; default: six periods of the lowest frequency", "s", gt=0)
    ] = None
    rate: Annotated[
        Real | None, about("samples a second; default: 16 to a period of the highest frequency", "Hz", gt=0)
    ] = None
    peak: Annotated[Real | None, about("largest acceleration of the test stand", "m s-2", gt=0)] = None
    velocity: Annotated[Real | None, about("largest velocity of the test stand", "m s-1", gt=0)] = None
    displacement: Annotated[Real | None, about("largest displacement of the test stand", "m", gt=0)] = None
    times: Annotated[Series, about("filled from the specification; where given, it is not read", "s")] = ()
    values: Annotated[Series, about("filled from the specification, in the units of the scene", "m s-2")] = ()
    read_as: Annotated[Text, about("filled from the specification: how well it is met")] = ""

    @model_validator(mode="before")
    @classmethod
    def _load(cls, data: Any, info: ValidationInfo) -> Any:
        from .specifications import with_history

        if not isinstance(data, dict) or {"times", "values"} & data.keys():
            return data
        return with_history(data, base_dir_of(info.context), units_in(info.context))

    @property
    def units(self) -> tuple[str | float | None, str | float | None]:
        """As of the law of a file: times and values are in the units of the scene."""
        return None, None


class PsdLaw(SceneTable):
    """A base acceleration with a specified power spectral density: one window of a random vibration, drawn by a seed,
    that begins at rest and is stationary after two periods of the lowest frequency.

    The breakpoints are those of a file with two columns, frequency in Hz and density, or of the scene; in between both
    are straight lines in logarithms. Those of a file are kept with the scene (`frequency`, `density`).
    """

    type: Literal["psd"] = "psd"
    file: Annotated[
        Text, about("file with two columns, frequency in Hz and density; its header or `unit` names the unit")
    ] = ""
    unit: Annotated[
        DensityUnit | None,
        about(f"unit of the densities of the file: {names_for(DENSITY)}, or the factor to the units of the scene", "1"),
    ] = None
    frequency: Annotated[Series, about("breakpoints instead of a file: increasing", "Hz")] = ()
    density: Annotated[Series, about("one-sided power spectral density of the acceleration at these", DENSITY)] = ()
    seed: Annotated[
        int, about("what the motion is drawn by: the same one gives the same motion", "1", ge=0, lt=2**53)
    ] = 0
    window: Annotated[
        int,
        about("number of the motion among those of the seed, which are independent of each other", "1", ge=0, lt=2**31),
    ] = 0
    duration: Annotated[
        Real | None, about("period of the motion, which a run must not exceed; default: `time.end`", "s", gt=0)
    ] = None
    read_as: Annotated[Text, about("filled from the file: its name and breakpoints")] = ""

    @model_validator(mode="before")
    @classmethod
    def _load(cls, data: Any, info: ValidationInfo) -> Any:
        from .specifications import with_density

        if not isinstance(data, dict):
            return data
        return with_density(data, base_dir_of(info.context), units_in(info.context))

    @property
    def motion(self) -> "RandomMotion":
        """The motion, in units of the scene.

        Raises
        ------
        ValueError : a law outside of a scene, without duration.
        """
        from ..shock.random_motion import motion_of

        if self.duration is None:
            raise ValueError("a random vibration has the duration of its scene: give one outside of a scene")
        return motion_of(self.frequency, self.density, self.duration, (self.seed, self.window))

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times, s."""
        return self.motion.acceleration(times)

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        before, after = self.motion.velocity([t0, t1])
        return float(after - before)


_JUMP_ROUND_OFF = 1e-9
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
    # relative to the larger of the two: after a jump at 0 is every instant above 0
    return times - jump > _JUMP_ROUND_OFF * np.maximum(np.abs(times), abs(jump))


class ConstantLaw(SceneTable):
    """a = 1 at all times, t = 0 included."""

    type: Literal["constant"] = "constant"

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times, s."""
        return np.ones_like(np.asarray(times, dtype=np.float64))

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        return t1 - t0


class StepLaw(SceneTable):
    """a = 0 until `start`, 1 after it."""

    type: Literal["step"] = "step"
    start: Annotated[Real, about(_START, "s")] = 0.0

    def sample(self, times: ArrayLike) -> Array:
        """a(t) at the times, s."""
        return _is_after(np.asarray(times, dtype=np.float64), self.start).astype(np.float64)

    def impulse(self, t0: float, t1: float) -> float:
        """Exact integral of a from t0 to t1 >= t0, s."""
        return max(0.0, t1 - max(t0, self.start))


class RectangularPulseLaw(SceneTable):
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


class HalfSineLaw(SceneTable):
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


class InputLaw(SceneTable):
    """Set from outside while running (an FMU input); stays at `start_value` in a run without a host."""

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
        ConstantLaw | StepLaw | RectangularPulseLaw | HalfSineLaw | TableLaw | CsvLaw | SrsLaw | PsdLaw | InputLaw,
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
        | SrsLaw
        | PsdLaw
        | InputLaw,
    ),
]


_JUST_AFTER = 1e-3  # of the first step; a law that has changed by more than half until then jumps at t = 0


def sampled(law: TimeLaw, times: ArrayLike) -> Array:
    """The law at the instants of a march, (n,); at t = 0 the value after the release of a load that is released there.

    The march is linear between its instants: with the value before the release the load would act for half a step more.
    """
    t = np.asarray(times, dtype=np.float64)
    values = law.sample(t)
    if len(t) > 1 and t[0] == 0.0:
        after = float(law.sample(_JUST_AFTER * t[1:2])[0])
        # falls at once, by more than half of what the whole first step changes
        if abs(after) < abs(values[0]) and abs(after - values[0]) > 0.5 * abs(values[1] - values[0]):
            values = np.concatenate([[after], values[1:]])
    return values


def sampled_impulse_error(law: TimeLaw, times: ArrayLike) -> float:
    """Relative difference between the impulse the solver applies and that of the law.

        |sum of trapezoids of a(t_i) - int a dt| / max(|int a dt|, sum of trapezoids of |a(t_i)|)

    times : (n,) increasing instants, s. The second term of the scale keeps a law of zero mean from dividing
    by nothing; so does the first step under a(0), for a load that is released there. 0 where all of them vanish.
    """
    t = np.asarray(times, dtype=np.float64)
    samples = sampled(law, t)
    exact = law.impulse(float(t[0]), float(t[-1]))
    if len(t) > 1:
        first = abs(float(law.sample(t[:1])[0])) * float(t[1] - t[0])
    else:
        first = 0.0
    scale = max(abs(exact), float(np.trapezoid(np.abs(samples), t)), first)
    if scale > 0.0:
        return abs(float(np.trapezoid(samples, t)) - exact) / scale
    return 0.0
