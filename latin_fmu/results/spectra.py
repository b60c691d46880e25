"""Shock response spectra: the largest response of oscillators of many frequencies on a moving base.

Between two samples a record is a straight line, and the filter of an oscillator exact (``shock.oscillators``).
A record that was sampled behind an anti-aliasing filter is no sequence of lines: at a tenth of the sampling rate they
lose 2 to 4 % of a spectrum, from a sixth on 7 to 12 %. It is interpolated in its band first (``BAND``): SciPy's
resampling by a polyphase filter, after the line from the first to the last sample is taken off, so that a jump there
stays one. The spectrum goes up to ``scene.sensors.HIGHEST_SHARE`` of the rate either way.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, Problem
from ..latin.outcome import Array, SensorHistory
from ..scene.boundaries import DRIVEN
from ..scene.readable_numbers import readable
from ..scene.sensors import Spectrum, spectrum_problems
from ..scene.units import SI, UnitSystem
from ..shock.oscillators import KINDS, RESPONSES, largest_responses
from .groups import StoredGroup, children_of
from .quantities import AXES, LABELS, SPECTRUM, named

if TYPE_CHECKING:
    import xarray as xr

Interpolation = Literal["band", "lines"]
BAND: Final = "band"
LINES: Final = "lines"
"""Records of a band-limited signal; laws, own results and what is compared with them."""
LARGER: Final = "larger of band and lines"
"""Of a record that starts or ends with a jump: no band holds one."""
_JUMP = 0.01  # of the largest value: a first or last sample above it is a jump
_FINER = (8, 16, 32, 64)  # factors of the resampling in the band
_OF_BAND = 128  # samples per period of an oscillator there
_LEAST_FINER, _MOST = 8, 40_000_000  # where fewer are taken, so that no array has more numbers
_TAPS, _KAISER = 32, 8.0  # of the filter: samples on each side, and its window: 80 dB, flat to 0.46 of the rate
_STEP: Final = 1e-6  # of the largest acceleration, in the derivatives of spectra
FAINT: Final = 1e-3
"""Share of the largest spectrum below which others are not drawn: mostly round-off."""
_COVERING = 0.85  # of an extrapolated difference of spectra


@dataclass(frozen=True)
class ShockSpectrum:
    """Shock response spectrum of one or several components.

    Attributes
    ----------
    frequency : (n,), Hz. quality : Q of the oscillators.
    A field or property for each of ``KINDS``.
    acceleration : (5, n, ...) largest magnitude of the absolute acceleration, rows ``RESPONSES``, unit of the input.
    pseudo_velocity : (5, n, ...) largest magnitude of omega z, that unit times s.
    interpolation : of the samples: ``BAND``, ``LINES`` or ``LARGER``.
    apart : largest difference of both over the larger one, of a record that starts or ends with a jump, else 0.
    """

    frequency: Array
    quality: float
    acceleration: Array
    pseudo_velocity: Array
    interpolation: str = LINES
    apart: float = 0.0

    @property
    def relative_displacement(self) -> Array:
        """(5, n, ...) largest magnitude of z, that unit times s2."""
        return self.pseudo_velocity / self._omega

    @property
    def equivalent_static_acceleration(self) -> Array:
        """(5, n, ...) largest magnitude of omega^2 z, unit of the input."""
        return self.pseudo_velocity * self._omega

    @property
    def _omega(self) -> Array:
        omega = 2.0 * np.pi * self.frequency
        # (5, n) of a record; (..., 5, n, component) otherwise
        return omega if self.pseudo_velocity.ndim == 2 else omega[:, None]


def shock_response_spectrum(
    acceleration: ArrayLike,
    step: float,
    frequencies: ArrayLike,
    quality: float = 10.0,
    *,
    interpolation: Interpolation = "band",
) -> ShockSpectrum:
    """Shock response spectrum of a base acceleration (module docstring).

    Parameters
    ----------
    acceleration : (n_time,) or (n_time, n_component) samples, m s-2; the base is at rest before the first one.
    step : between samples, s. frequencies : (n,) of the oscillators, Hz. quality : Q > 1/2, infinite without damping.
    interpolation : ``"band"`` of measured records, behind an anti-aliasing filter; ``"lines"`` of laws, of histories of
        a run, and of what is compared with these. A record that starts or ends with a jump has the larger of both.

    Raises
    ------
    InputError : a frequency that is not positive or lies beyond 0.4 / step, too few or infinite samples, Q <= 1/2, an
        unknown interpolation.

    Examples
    --------
    >>> pulse = 1000.0 * np.sin(np.pi * np.arange(101) / 100)  # half sine of 10 ms
    >>> padded = np.append(pulse, np.zeros(900))
    >>> spectrum = latin_fmu.shock_response_spectrum(padded, 1e-4, [80.0])
    >>> float(spectrum.acceleration[0, 0].round(-1))  # Q 10, near the largest amplification of the pulse, 1.65
    1650.0
    """
    samples, f = np.asarray(acceleration, dtype=float), np.atleast_1d(np.asarray(frequencies, dtype=float))
    if step > 0:
        problems = list(spectrum_problems("frequencies", f, step))
    else:
        problems = [Problem("step", "not a positive time")]
    if not (np.isfinite(f) & (f > 0)).all():
        problems.append(Problem("frequencies", "not a positive frequency", f"{f.min():g} Hz", "a frequency > 0 [Hz]"))
    if not quality > 0.5:
        problems.append(Problem("quality", "an oscillator that does not oscillate", f"{quality:g}", "Q > 0.5"))
    if samples.ndim not in (1, 2) or len(samples) < 2 or not np.isfinite(samples).all():
        what = "must be two or more finite samples, (n_time,) or (n_time, n_component)"
        problems.append(Problem("acceleration", what, f"an array {samples.shape}"))
    if interpolation not in (BAND, LINES):
        problems.append(Problem("interpolation", "unknown", repr(interpolation), f'"{BAND}" or "{LINES}"'))
    if problems:
        raise InputError(problems, "no shock response spectrum")
    columns = samples.reshape(len(samples), -1)
    if math.isinf(quality):
        damping = 0.0
    else:
        damping = 0.5 / quality
    shape = (2, len(RESPONSES), len(f), *samples.shape[1:])
    if interpolation == LINES:
        both = largest_responses(columns, step, f, damping).reshape(shape)
        return ShockSpectrum(f, quality, both[0], both[1])
    both = _band_spectra(columns, step, f, damping)
    if not (jumps := _jumps(columns)).any():
        whole = both.reshape(shape)
        return ShockSpectrum(f, quality, whole[0], whole[1], BAND)
    lines = largest_responses(columns, step, f, damping)
    larger = np.where(jumps, np.maximum(both, lines), both)
    apart = np.abs(both - lines)[0, 0][:, jumps] / np.maximum(larger[0, 0][:, jumps], np.finfo(float).tiny)
    whole = larger.reshape(shape)
    return ShockSpectrum(f, quality, whole[0], whole[1], LARGER, float(apart.max()))


def _jumps(columns: Array) -> Any:
    """Whether columns (n_time, n) start or end with a jump, (n,)."""
    ends = np.maximum(np.abs(columns[0]), np.abs(columns[-1]))
    return ends > _JUMP * np.abs(columns).max(axis=0)


def _band_spectra(columns: Array, step: float, f: Array, damping: float) -> Array:
    """``largest_responses`` of records interpolated in their band, by oscillators that need as many samples."""
    needed = np.searchsorted(_FINER, _OF_BAND * f * step)
    largest = np.empty((2, len(RESPONSES), len(f), columns.shape[1]))
    for i, factor in enumerate(_FINER):
        finer = factor
        chosen = np.flatnonzero(np.minimum(needed, len(_FINER) - 1) == i)
        # of a record of millions of samples the lines between fewer ones are sampled again
        while finer > _LEAST_FINER and columns.size * finer > _MOST:
            finer //= 2
        if chosen.size:
            largest[:, :, chosen] = largest_responses(_in_band(columns, finer), step / finer, f[chosen], damping)
    return largest


def _in_band(columns: Array, finer: int) -> Array:
    """Samples ``finer`` times as dense between the first and the last one, of the band-limited signal through them."""
    from scipy.signal import firwin, resample_poly

    window = firwin(2 * _TAPS * finer + 1, 1.0 / finer, window=("kaiser", _KAISER))
    # the stubs of SciPy lack coefficients as a window
    dense = resample_poly(columns, finer, 1, axis=0, window=window, padtype="line")  # type: ignore[call-overload]
    return np.asarray(dense[: (len(columns) - 1) * finer + 1])


# -- of a sensor ------------------------------------------------------------------------------------------------
def sensor_spectrum(history: SensorHistory, time: Array, request: Spectrum) -> ShockSpectrum | None:
    """Spectrum of the acceleration of a sensor along x, y, z at equal steps; None without acceleration, or where the
    frequencies requested lie beyond what the step allows."""
    if history.acceleration is None or len(time) < 2:
        return None
    duration = float(time[-1] - time[0])
    step = duration / (len(time) - 1)
    frequencies = request.frequencies(step, duration)
    if not frequencies:
        return None
    return shock_response_spectrum(history.acceleration, step, frequencies, request.quality, interpolation=LINES)


def spectrum_changes(spectrum: ShockSpectrum, history: SensorHistory, time: Array, changes: Array) -> ShockSpectrum:
    """Derivatives of the ``spectrum`` of a sensor along ``changes`` (n, n_time, 3) of its acceleration, m s-2: its
    fields, but acceleration and pseudo-velocity (n, 3, n_frequency, 3), their changes.

    The response is linear in the acceleration, and its largest magnitude changes as at the instant of that: the central
    difference is exact where both its ends are largest there.
    """
    acceleration = np.asarray(history.acceleration)
    sizes = np.abs(changes).max(axis=(1, 2))
    # of a sensor at rest anything is larger
    steps = _STEP * (float(np.abs(acceleration).max()) or 1.0) / np.where(sizes > 0.0, sizes, 1.0)
    moved = steps[:, None, None] * changes
    ends = np.moveaxis(np.stack([acceleration + moved, acceleration - moved]), 2, 0)  # time, end, change, component
    flat = ends.reshape(len(acceleration), -1)
    shifted = shock_response_spectrum(
        flat, float(time[-1] - time[0]) / (len(time) - 1), spectrum.frequency, spectrum.quality, interpolation=LINES
    )

    def slopes(values: Array) -> Array:
        more, less = np.moveaxis(values.reshape(*values.shape[:2], 2, len(changes), 3), (2, 3), (0, 1))
        return np.asarray((more - less) / (2.0 * steps[:, None, None, None]))

    return replace(spectrum, acceleration=slopes(shifted.acceleration), pseudo_velocity=slopes(shifted.pseudo_velocity))


def spectrum_group(spectrum: ShockSpectrum, error: Array | None = None) -> StoredGroup:
    """Group ``sensors/<name>/spectrum``; ``error`` (5, n, 3): estimated relative error (``spectrum_error``)."""
    fields = {kind: getattr(spectrum, kind) for kind in KINDS} | {"relative_error": error}
    along = {"response": list(RESPONSES), "frequency": spectrum.frequency, "component": AXES}
    attrs = {
        "quality": spectrum.quality,
        "damping_ratio": 0.5 / spectrum.quality,
        "interpolation": spectrum.interpolation,
        "references": "Smallwood (1981), ISO 18431-4:2007: ramp-invariant filter",
    }
    return StoredGroup.of(named(SPECTRUM, fields), named(LABELS, along), attrs)


# -- of a record -------------------------------------------------------------------------------------------------
def record_dataset(spectrum: ShockSpectrum) -> xr.Dataset:
    """Spectrum of one component, in SI."""
    import xarray as xr

    dims = ("response", "frequency")
    data = {
        kind: (dims, getattr(spectrum, kind), {k: v for k, v in SPECTRUM[kind].attributes.items() if k != "comment"})
        for kind in KINDS
    }
    labels = {
        "response": ("response", np.array(RESPONSES, dtype=object), LABELS["response"].attributes),
        "frequency": ("frequency", spectrum.frequency, LABELS["frequency"].attributes),
    }
    attrs = {"quality": spectrum.quality, "interpolation": spectrum.interpolation}
    return xr.Dataset(data, labels, attrs)


def record_csv(spectrum: ShockSpectrum, acceleration: tuple[float, str] = (1.0, "m s-2")) -> str:
    """Spectrum of one component as comma-separated values, one row a frequency, in SI; ``acceleration`` : factor and
    unit of accelerations."""
    names, columns = [], [spectrum.frequency]
    for kind in KINDS:
        size, unit = 1.0, str(SPECTRUM[kind].unit)
        if unit == "m s-2":
            size, unit = acceleration
        names += [f"{response} {kind} [{unit}]" for response in RESPONSES]
        columns += list(size * getattr(spectrum, kind))
    table = np.stack(columns, axis=1)
    rows = [",".join(f"{value:.9g}" for value in row) for row in table]
    return "\n".join([",".join(["frequency [Hz]", *names]), *rows]) + "\n"


def record_lines(spectrum: ShockSpectrum, of: str, units: UnitSystem = SI) -> list[str]:
    """The largest value of the spectrum of one component, and how its samples were interpolated."""
    i = int(spectrum.acceleration[0].argmax())
    lines = [
        f"spectrum of {of}",
        f"Q {spectrum.quality:g}, {spectrum.frequency[0]:.4g} to {spectrum.frequency[-1]:.4g} Hz: largest maximax "
        f"{readable(float(spectrum.acceleration[0, i]), units.shown('m s-2'))} at {spectrum.frequency[i]:.4g} Hz",
    ]
    if spectrum.interpolation == LARGER:
        what = "the record starts or ends with a jump, which no band holds: the larger of both readings, band and lines"
        return [*lines, f"{what}; they differ by {100 * spectrum.apart:.2g} % at most"]
    return [*lines, f"interpolated in its {spectrum.interpolation}"]


def stored_spectrum(node: Any) -> tuple[ShockSpectrum, Array | None]:
    """A spectrum of a results file (``sensors/<name>/spectrum``) and its estimated error."""
    values = [node[name].values for name in ("acceleration", "pseudo_velocity")]
    error = None
    if "relative_error" in node:
        error = node["relative_error"].values
    way = str(node.attrs.get("interpolation", LINES))
    quality = float(node.attrs["quality"])
    return ShockSpectrum(node["frequency"].values, quality, values[0], values[1], interpolation=way), error


def stored_spectra(tree: xr.DataTree) -> dict[str, tuple[ShockSpectrum, Array | None]]:
    """Spectra of the sensors of a file with their estimated errors, by sensor."""
    sensors = children_of(tree, "sensors").items()
    return {name: stored_spectrum(node["spectrum"]) for name, node in sensors if "spectrum" in node.children}


def shock_axis(tree: xr.DataTree) -> int | None:
    """Axis (0, 1, 2) along which the scene of a file drives faces most; None where it drives none along global axes."""
    try:
        boundaries = tomllib.loads(tree.attrs["scene"]).get("boundary", {})
    except (KeyError, tomllib.TOMLDecodeError):
        return None
    size = np.zeros(3)
    for table in boundaries.values():
        if table.get("type") in DRIVEN and "axes" not in table:
            driven = np.abs(np.asarray(table["value"], dtype=float))
            size[["xyz".index(axis) for axis in table["components"]]] += driven
    if not size.any():
        return None
    return int(size.argmax())


def axes_in_order(spectra: Mapping[str, tuple[ShockSpectrum, Array | None]], first: int | None = None) -> list[int]:
    """Axes of spectra of sensors: ``first``, that of the shock, or where it is None that of the largest acceleration,
    then the others as far as any sensor has more than a thousandth of the largest there."""
    largest = np.max([spectrum.acceleration[0].max(axis=0) for spectrum, _ in spectra.values()], axis=0)
    if first is None:
        first = int(largest.argmax())
    return [first, *(axis for axis in range(3) if axis != first and largest[axis] > FAINT * largest.max())]


def spectrum_error(fine: ShockSpectrum, coarse: ShockSpectrum, ratio: float) -> Array:
    """Estimated relative error (5, n, 3) of a spectrum from that of a run coarser by ``ratio`` in mesh and step.

    0.85 times the difference of both over ratio - 1 (the extrapolation of errors of first order), the largest within
    half an octave, so that curves that cross by chance do not look exact; NaN beyond the frequencies of the coarser
    spectrum. The factor was set on random chains of bars.
    """
    n = len(coarse.frequency)
    scale = np.maximum(fine.acceleration[:, :n], np.finfo(float).tiny)
    change = _COVERING * np.abs(fine.acceleration[:, :n] - coarse.acceleration) / scale / (ratio - 1.0)
    octaves = np.log2(fine.frequency[:n])
    near = np.abs(octaves[:, None] - octaves) <= 0.5 + 1e-9
    error = np.full(fine.acceleration.shape, np.nan)
    for i in range(n):
        error[:, i] = change[:, near[i]].max(axis=1)
    return error


def as_csv(
    spectra: Sequence[tuple[str, ShockSpectrum]], units: UnitSystem = SI, acceleration: tuple[float, str] | None = None
) -> str:
    """Spectra of sensors on the same frequencies as comma-separated values, one row a frequency; ``acceleration`` :
    factor and unit of accelerations where they are not to be in ``units``."""
    head = ["frequency [Hz]"]
    table = [spectra[0][1].frequency]
    for name, spectrum in spectra:
        for kind in KINDS:
            values, unit = getattr(spectrum, kind), units.label(str(SPECTRUM[kind].unit))
            if SPECTRUM[kind].unit == "m s-2" and acceleration is not None:
                values, unit = acceleration[0] * values, acceleration[1]
            for r, response in enumerate(RESPONSES):
                head += [f"{name} {response} {kind} {axis} [{unit}]" for axis in AXES]
                table += list(values[r].T)
    rows = [",".join(f"{value:.9g}" for value in row) for row in np.stack(table, axis=1)]
    return "\n".join([",".join(head), *rows]) + "\n"
