"""Table [sensor], by name: where motions are kept, filtered, and turned into shock response spectra."""

import math
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, model_validator

from ..errors import Problem, shown
from .fields import Count, Face, Name, Real, SceneTable, Vector, about, by_type, refusal, split_face
from .raw_scene import RawTable, face_problems, given, named_tables, number, reference_problems, single_table

CFC_RATE: Final = 10.0
"""Least sampling rate of SAE J211-1 over the number of the channel frequency class, in Hz."""
MAX_FREQUENCIES: Final = 10_000


class ChannelClass(SceneTable):
    """Channel frequency class of SAE J211-1 (ISO 6487): Butterworth with two poles, run forwards and backwards, so that
    the phase stays."""

    type: Literal["cfc"] = "cfc"
    channel_class: Annotated[Literal[60, 180, 600, 1000], about("number of the class")]

    @property
    def cutoff(self) -> float:
        """Cut-off of one pass (-3 dB), Hz: 2.0775 times the class, of which both passes make 1.65 (about)."""
        return 2.0775 * self.channel_class

    @property
    def label(self) -> str:
        """Name for attributes and figures."""
        return f"SAE J211 CFC {self.channel_class}, phaseless"


class LowPass(SceneTable):
    """Butterworth low pass; forwards and backwards (`phaseless`) its order counts twice, and the cut-off is that of
    both passes."""

    type: Literal["low_pass"] = "low_pass"
    cutoff: Annotated[Real, about("frequency at which half of the power is left (-3 dB)", "Hz", gt=0)]
    order: Annotated[Count, about("poles of one pass", "1", ge=1, le=10)] = 4
    phaseless: Annotated[bool, Field(strict=True), about("forwards and backwards, so that the phase stays")] = True

    @property
    def label(self) -> str:
        """Name for attributes and figures."""
        return f"Butterworth low pass {self.cutoff:g} Hz, order {self.order}{', phaseless' * self.phaseless}"


_Filter = ChannelClass | LowPass
Filter = Annotated[Annotated[_Filter, Field(discriminator="type")], by_type(_Filter, "cfc")]


def with_quality(data: Any) -> Any:
    """The keys of oscillators with the Q that follows from their damping.

    Raises the refusal of the table: a Q that is another one.
    """
    if not isinstance(data, dict) or data.get("damping") is None:
        return data
    ratio = data["damping"]
    if isinstance(ratio, bool) or not isinstance(ratio, int | float) or not 0.0 < ratio < 1.0:
        return data
    if "quality" in data and not math.isclose(data["quality"], 0.5 / ratio):
        raise refusal("Q and damping contradict each other", value=[data["quality"], ratio], remedy="omit one")
    return data | {"quality": 0.5 / ratio}


class Spectrum(SceneTable):
    """Shock response spectrum of the acceleration of a sensor: largest response of oscillators on it."""

    lowest: Annotated[Real | None, about("first frequency; default: one over the duration of the run", "Hz", gt=0)] = (
        None
    )
    highest: Annotated[
        Real | None, about("last frequency; default: a tenth of the sampling rate of the run", "Hz", gt=0)
    ] = None
    per_octave: Annotated[Count, about("frequencies per octave", "1", ge=1, le=96)] = 12
    quality: Annotated[
        Real, about("amplification Q = 1 / (2 damping ratio) of the oscillators; follows from damping", "1", gt=0.5)
    ] = 10.0
    damping: Annotated[Real | None, about("damping ratio of the oscillators, instead of quality", "1", gt=0, lt=1)] = (
        None
    )

    @model_validator(mode="before")
    @classmethod
    def _quality_of(cls, data: Any) -> Any:
        return with_quality(data)

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if self.lowest is not None and self.highest is not None and self.lowest >= self.highest:
            raise refusal("the last frequency must be above the first", value=[self.lowest, self.highest])
        return self

    def last(self, step: float) -> float:
        """Last frequency of the spectrum of a run in steps ``step``, s, at most, Hz."""
        return min(0.1 / step if self.highest is None else self.highest, highest_frequency(step))

    def frequencies(self, step: float, duration: float) -> tuple[float, ...]:
        """Frequencies of the spectrum of a run, Hz, spaced by equal ratios, up to ``highest_frequency`` at most; the
        highest one that is requested comes last, whatever the ratio. ``step`` and ``duration`` of the run, s."""
        if self.lowest is None:
            first = 1.0 / duration
        else:
            first = self.lowest
        last = self.last(step)
        # a range of whole octaves keeps its last frequency whatever the round-off
        if last > first:
            count = math.floor(self.per_octave * math.log2(last / first) * (1 + 1e-9) + 1e-9)
        else:
            count = -1
        centres = tuple(first * 2.0 ** (i / self.per_octave) for i in range(min(count + 1, MAX_FREQUENCIES)))
        short = (
            self.highest is not None and centres and centres[-1] < last * (1 - 1e-9) and len(centres) < MAX_FREQUENCIES
        )
        if short:
            return (*centres, last)
        return centres


class Sensor(SceneTable):
    """Displacement, velocity and acceleration of a point of a substructure, or their mean over a face.

    It has `point` with `substructure`; or `face`, and then `point` is one that follows the mean motion of the face,
    translation and rotation, by a rigid arm.
    """

    substructure: Annotated[Name | None, about("name of a [substructure.NAME] table, with `point`")] = None
    point: Annotated[
        Vector | None, about("where to measure, before any motion; in or on the body without `face`", "m")
    ] = None
    face: Annotated[Face | None, about('face whose mean by area is measured, "substructure.face"')] = None
    filter: Annotated[Filter | None, about("low-pass filter; the results contain the unfiltered motion as well")] = None
    spectrum: Annotated[Spectrum | None, about("shock response spectrum in the results ({}: default values)")] = None

    @property
    def body(self) -> str:
        """Substructure that the sensor is on."""
        if self.face is not None:
            return split_face(self.face)[0]
        return str(self.substructure)


HIGHEST_SHARE: Final = 0.4
"""Of the sampling rate: the highest frequency of a spectrum. Above, no interpolation between the samples is exact."""


def highest_frequency(step: float) -> float:
    """Highest frequency of a shock response spectrum of instants ``step`` apart (s), Hz."""
    return HIGHEST_SHARE / step


def nyquist(step: float) -> float:
    """Nyquist frequency of instants ``step`` apart (s), Hz."""
    return 0.5 / step


def beyond_nyquist(where: str, what: str, frequency: float, step: float) -> Problem:
    """The problem of a frequency, Hz, that instants ``step`` apart (s) cannot hold."""
    return Problem(
        where,
        f"{what} lies beyond the Nyquist frequency of the run, 1 / (2 step) = {nyquist(step):.4g} Hz",
        f"{frequency:g} Hz",
        f"at most {nyquist(step):.4g} Hz",
        f"take a time step of at most {0.5 / frequency:.4g} s (it is {step:.4g} s)",
    )


def spectrum_problems(where: str, frequencies: Iterable[float], step: float) -> Iterator[Problem]:
    """What is wrong with frequencies, Hz, of a spectrum of a run with this step, s."""
    largest, limit = max(frequencies, default=0.0), highest_frequency(step)
    if largest > limit * (1 + 1e-9):
        what = f"a frequency of the spectrum lies beyond {HIGHEST_SHARE:g} of the sampling rate"
        remedy = f"take a time step of at most {HIGHEST_SHARE / largest:.4g} s (it is {step:.4g} s)"
        yield Problem(where, what, f"{largest:g} Hz", f"at most {limit:.4g} Hz", remedy)


def filter_problems(where: str, chosen: ChannelClass | LowPass, step: float, duration: float) -> Iterator[Problem]:
    """What is wrong with a filter on a run with this step and duration, s."""
    if chosen.cutoff >= nyquist(step):
        yield beyond_nyquist(where, f"the cut-off of {chosen.label}", chosen.cutoff, step)
    # 1e-9: a step that is meant to be the longest one allowed
    elif isinstance(chosen, ChannelClass) and CFC_RATE * chosen.channel_class * step > 1 + 1e-9:
        least = CFC_RATE * chosen.channel_class
        yield Problem(
            where,
            f"SAE J211 requires at least {least:g} samples a second for CFC {chosen.channel_class}",
            f"{1 / step:.4g} samples a second",
            None,
            f"take a time step of at most {1 / least:.4g} s (it is {step:.4g} s)",
        )
    elif duration * chosen.cutoff < 1:
        yield Problem(
            where,
            f"the run is shorter than one period of the cut-off of {chosen.label} ({1 / chosen.cutoff:.4g} s)",
            f"{duration:.4g} s",
            None,
            "a higher cut-off or class, or a longer run",
        )


def sensor_problems(raw: Any) -> Iterator[Problem]:
    """Problems of the sensors of a scene as written, with other tables too."""
    time = single_table(raw, "time")
    for name, table in named_tables(raw, "sensor").items():
        where, body = f"sensor.{name}", table.get("substructure")
        if not given(table, "point") and not given(table, "face"):
            allowed = "'face', or 'substructure' with 'point'"
            yield Problem(where, "neither 'point' nor 'face' is given", None, allowed)
        if given(table, "point") and not given(table, "substructure") and not given(table, "face"):
            allowed = "name of a [substructure.NAME] table"
            yield Problem(f"{where}.substructure", "a point needs its body", None, allowed)
        if given(table, "face") and given(table, "substructure"):
            yield Problem(f"{where}.substructure", "the face names the body already", shown(body), None, "remove it")
        yield from face_problems(raw, f"{where}.face", table.get("face"))
        yield from reference_problems(raw, f"{where}.substructure", "substructure", body)
        yield from _processing_problems(where, table, time)


def _processing_problems(where: str, table: RawTable, time: RawTable) -> Iterator[Problem]:
    """Problems of the filter and the spectrum with the instants of the run."""
    if time.get("quasi_static") is True:
        for key in ("filter", "spectrum"):
            if given(table, key):
                what = "a quasi-static run has no acceleration, and its time only orders the increments of load"
                yield Problem(f"{where}.{key}", what, None, None, "remove it, or omit quasi_static")
        return
    end = number(time, "end")
    step = number(time, "step")
    instants = number(time, "instants")
    if end is not None and step is None and instants is not None and instants > 0:
        step = end / instants
    if end is None or step is None or not 0 < step <= end:
        return
    spectrum = table.get("spectrum")
    if isinstance(spectrum, dict):
        requested = [number(spectrum, key) for key in ("lowest", "highest")]
        yield from spectrum_problems(f"{where}.spectrum", [f for f in requested if f is not None], step)
    if isinstance(table.get("filter"), dict) and (chosen := _filter(table["filter"])) is not None:
        yield from filter_problems(f"{where}.filter", chosen, step, end)


def _filter(table: RawTable) -> ChannelClass | LowPass | None:
    """The filter that a table writes; None where it is wrong by itself."""
    kind: type[ChannelClass | LowPass] = LowPass
    if table.get("type", "cfc") == "cfc":
        kind = ChannelClass
    try:
        return kind.model_validate(table)
    except ValueError:
        return None
