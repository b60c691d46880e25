"""Sensors and reactions in the results: groups of the file, filters, lines of the summary, report; ends of tensions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..latin.outcome import Array, Outcome, SensorHistory
from ..scene.quantity_table import BOUNDARY, FLOOR
from ..scene.quantity_table import SENSOR as OF_SENSOR
from ..scene.readable_numbers import percent, readable, readable_vector
from ..scene.sensors import ChannelClass, LowPass, Sensor, filter_problems
from ..scene.units import SI, UnitSystem
from .filters import low_pass, uniform_step
from .groups import StoredGroup, finite
from .owner_records import SensorRecord, reported, stored_scalars
from .quantities import AXES, FILTERED, LABELS, REACTION, SENSOR, SENSOR_PLACE, StoredQuantity, columns, named
from .spectra import ShockSpectrum, sensor_spectrum, spectrum_group


def sensor_group(history: SensorHistory, time: Array, chosen: ChannelClass | LowPass | None = None) -> StoredGroup:
    """Group ``sensors/<name>``: motions (time, component), behind a filter too where one is given, and the place of the
    sensor."""
    motions = columns(SENSOR, history)
    behind = filtered_motions(history, time, chosen)
    motions += [(FILTERED[row.name], behind[row.name]) for row, _ in motions if row.name in behind]
    attrs: dict[str, object] = {"substructure": history.substructure}
    if history.face is not None:
        attrs["face"] = history.face
    if history.acceleration is None:
        attrs["acceleration"] = f"none: {history.remark}"
    place = [*named(LABELS, {"time": time, "component": AXES}), *columns(SENSOR_PLACE, history)]
    group = StoredGroup.of(motions, place, attrs)
    for row, _ in motions:
        if chosen is not None and row.name.endswith("_filtered"):
            group.variables[row.name].attrs["filter"] = chosen.label
        if history.face is not None:
            group.variables[row.name].attrs["cell_methods"] = "area: mean"
    if history.acceleration is not None and history.remark:
        group.variables["acceleration"].attrs["comment"] = history.remark
    return group


def filtered_motions(history: SensorHistory, time: Array, chosen: ChannelClass | LowPass | None) -> dict[str, Array]:
    """Motions (n_time, 3) behind a filter, by name; none without a filter that suits the instants."""
    if chosen is None or not (step := uniform_step(time)) or list(filter_problems("", chosen, step, time[-1])):
        return {}
    return {row.name: low_pass(values, chosen, step) for row, values in columns(SENSOR, history)}


def spectra_of(outcome: Outcome, requests: Mapping[str, Sensor]) -> dict[str, ShockSpectrum]:
    """Shock response spectra of the sensors that request one and have an acceleration, by name."""
    spectra = {}
    for name, history in outcome.sensors.items():
        request = None
        if name in requests:
            request = requests[name].spectrum
        if request is not None and uniform_step(outcome.time):
            spectrum = sensor_spectrum(history, outcome.time, request)
            if spectrum is not None:
                spectra[name] = spectrum
    return spectra


def filter_of(requests: Mapping[str, Sensor], name: str) -> ChannelClass | LowPass | None:
    """The filter that a sensor has in the scene; None where it has none, or no table there."""
    if name in requests:
        return requests[name].filter
    return None


def sensor_groups(
    outcome: Outcome, requests: Mapping[str, Sensor], errors: Mapping[str, Array] | None = None
) -> dict[str, StoredGroup]:
    """Groups of all sensors of a run by path; ``requests``: their tables in the scene; ``errors`` of their spectra."""
    groups = {}
    for name, history in outcome.sensors.items():
        group = groups[f"/sensors/{name}"] = sensor_group(history, outcome.time, filter_of(requests, name))
        scalars = stored_scalars(OF_SENSOR, SensorRecord.of(history, outcome.time))
        group.variables.update(StoredGroup.of(scalars).variables)
    for name, spectrum in spectra_of(outcome, requests).items():
        groups[f"/sensors/{name}/spectrum"] = spectrum_group(spectrum, (errors or {}).get(name))
    return groups


def reaction_groups(outcome: Outcome) -> dict[str, StoredGroup]:
    """Groups ``reactions/<boundary>`` of the supports of a run by path."""
    along = named(LABELS, {"time": outcome.time, "component": AXES})
    return {
        f"/reactions/{name}": StoredGroup.of(
            [*columns(REACTION, history), *stored_scalars(BOUNDARY, history)],
            along,
            {"substructure": history.substructure, "face": history.face},
        )
        for name, history in outcome.reactions.items()
    }


def reaction_rows(outcome: Outcome, units: UnitSystem = SI) -> list[tuple[str, ...]]:
    """Table of the largest reactions."""
    rows: list[tuple[str, ...]] = [("boundary", "on", "largest reaction", "at", "last (x, y, z)")]
    for name, history in outcome.reactions.items():
        largest, when = largest_of(history.force, outcome.time)
        last = readable_vector([float(x) for x in history.force[-1]], units.label("N"))
        rows.append((name, history.face, readable(largest, units.label("N")), readable(when, "s"), last))
    return rows if len(rows) > 1 else []


def reaction_report(outcome: Outcome) -> dict[str, Any]:
    """Per boundary ``face``, its scalars, ``largest`` (magnitude over time), and ``last`` (vector), N."""
    return {
        name: {"face": history.face}
        | reported(BOUNDARY, history)
        | {"last": [finite(float(x)) for x in history.force[-1]]}
        for name, history in outcome.reactions.items()
    }


def largest_of(values: Array, time: Array) -> tuple[float, float]:
    """Largest magnitude over time of vectors (n_time, 3), and when."""
    size = np.linalg.norm(values, axis=1)
    i = int(np.argmax(size))
    return float(size[i]), float(time[i])


def _largest(history: SensorHistory, row: StoredQuantity, time: Array) -> tuple[float, float] | None:
    """``largest_of`` a motion of a sensor, None where it has none."""
    values = row.of(history)
    if values is None:
        return None
    return largest_of(values, time)


_TIGHT: Final = 0.1  # of the largest tension: a bolt with less at the start is loaded by the run, not by tightening


_LAST: Final = (0.5, 0.25, 0.125)  # of a run: stretches before its end whose range is the size of a swing
_SWING: Final = 0.25  # of that range: smaller returns are no swings
_PERIODS: Final = 3  # at the end, over which the mean is taken


@dataclass(frozen=True)
class TensionEnd:
    """Tension of a bolt at the end of a run.

    Attributes
    ----------
    mean : over the last whole periods where it oscillates, else the last value, N. low, high : range from their
        beginning on, N. begin : of these periods, s. half_periods : their number times two, 1 for half a period; 0
        where it does not oscillate.
    """

    mean: float
    low: float
    high: float
    begin: float
    half_periods: int = 0

    @classmethod
    def of(cls, tension: Array, time: Array, still: bool = False) -> TensionEnd:
        """That of a tension (n_time,), N, at the instants ``time`` (n_time,), s; ``still`` : of a run without inertia,
        in which it follows the loads and does not oscillate.

        It oscillates at the end where it has turned at least twice, by at least a quarter of its range over the last
        half, quarter or eighth of the run each time, and no more than a period before the end. A range below a
        thousandth of the largest tension counts as none.
        """
        for share in () if still else _LAST:
            first = int(np.searchsorted(time, time[-1] - share * (time[-1] - time[0])))
            size = float(np.ptp(tension[first:]))
            if size <= FLOOR * float(np.abs(tension).max(initial=0.0)):
                break
            turns = _turns(tension, _SWING * size)
            if len(turns) < 2 or time[-1] - time[turns[-1]] > 2.0 * (time[turns[-1]] - time[turns[-2]]):
                continue
            halves = min(len(turns) - 1, 2 * _PERIODS)
            # whole periods where there is one
            if halves > 1:
                halves -= halves % 2
            begin, end = turns[-1 - halves], turns[-1]
            of, steps = tension[begin : end + 1], np.diff(time[begin : end + 1])
            mean = float(0.5 * (of[1:] + of[:-1]) @ steps / steps.sum())
            return cls(mean, float(tension[begin:].min()), float(tension[begin:].max()), float(time[begin]), halves)
        last = float(tension[-1])
        return cls(last, last, last, float(time[-1]))

    @property
    def periods(self) -> str:
        """What the mean is taken over, in words."""
        if self.half_periods < 3:
            if self.half_periods == 2:
                return "last period"
            return "last half period"
        return f"last {self.half_periods // 2} periods"


def bolt_ends(outcome: Outcome) -> dict[str, TensionEnd]:
    """Tensions of the bolts at the end of a run, by name."""
    still = bool(outcome.resultants)  # of a run without inertia, also of one without interfaces
    return {name: TensionEnd.of(bolt.force, outcome.time, still) for name, bolt in outcome.bolts.items()}


def _turns(values: Array, least: float) -> list[int]:
    """Indices of the extremes, largest and smallest in turn, from each of which the values (n,) return by ``least``;
    the values at the start are none."""
    turns = list[int]()
    low = 0
    high = 0
    sense = 0
    for i, value in enumerate(values):
        if value < values[low]:
            low = i
        if value > values[high]:
            high = i
        if sense >= 0 and values[high] - value >= least:
            if values[high] - values[0] >= least or turns:
                turns += [high]
            sense, low = -1, i
        elif sense <= 0 and value - values[low] >= least:
            if values[0] - values[low] >= least or turns:
                turns += [low]
            sense, high = 1, i
    return turns


def share_lost(tension: Array, end: float) -> float | None:
    """Share of the tension (n_time,) of a bolt at the start that is lost at the ``end``, N; < 0 where it has gained.
    None where the bolt was never tight: its tension at the start is less than a tenth of the largest."""
    first = float(tension[0])
    if first > _TIGHT * float(tension.max()):
        return (first - end) / first
    return None


def loss_text(tension: Array, end: float) -> str:
    """What a bolt has lost or gained of its tension (n_time,) at the ``end``, N."""
    lost = share_lost(tension, end)
    if lost is None:
        return "never tight"
    if abs(lost) < FLOOR:
        return "nothing lost"
    if lost > 0.0:
        return f"{percent(lost)} lost"
    return f"{percent(-lost)} gained"


def sensor_rows(outcome: Outcome, units: UnitSystem = SI) -> list[tuple[str, ...]]:
    """Table of the largest motions of the sensors."""
    heads = (f"largest {row.meaning.partition(' of ')[0]}" for row in SENSOR.values())
    rows: list[tuple[str, ...]] = [("sensor", "on", *heads, "at")]
    for name, history in outcome.sensors.items():
        largest = [_largest(history, row, outcome.time) for row in SENSOR.values()]
        cells = [
            readable(None if pair is None else pair[0], units.shown(str(row.unit)))
            for pair, row in zip(largest, SENSOR.values(), strict=True)
        ]
        # the highest derivative there is: of a quasi-static run the displacement
        last = next(pair for pair in reversed(largest) if pair is not None)
        rows.append((name, history.face or history.substructure, *cells, readable(last[1], "s")))
    return rows if len(rows) > 1 else []


def spectrum_rows(spectra: Mapping[str, ShockSpectrum], units: UnitSystem = SI) -> list[tuple[str, ...]]:
    """Table of the largest values of shock response spectra."""
    rows: list[tuple[str, ...]] = [("spectrum of", "Q", "frequencies", "largest maximax", "at", "along")]
    for name, s in spectra.items():
        i, axis = np.unravel_index(int(np.argmax(s.acceleration[0])), s.acceleration[0].shape)
        ends = f"{readable(s.frequency[0], 'Hz', 3)} to {readable(s.frequency[-1], 'Hz', 3)}"
        largest = readable(float(s.acceleration[0, i, axis]), units.shown("m s-2"))
        rows.append((name, f"{s.quality:g}", ends, largest, readable(s.frequency[i], "Hz", 3), "xyz"[axis]))
    return rows if len(rows) > 1 else []


def sensor_report(outcome: Outcome) -> dict[str, Any]:
    """Per sensor ``substructure``, ``face`` (None of a point), ``point`` (m) and its scalars, None where it has none:
    ``largest_displacement`` (m), ``largest_unfiltered_velocity`` (m s-1), ``largest_unfiltered_acceleration`` (m s-2),
    largest magnitudes over time. Estimates have those in a band, ``velocity_peak`` and ``acceleration_peak``."""
    return {
        name: {"substructure": history.substructure, "face": history.face, "point": [float(x) for x in history.point]}
        | reported(OF_SENSOR, SensorRecord.of(history, outcome.time))
        for name, history in outcome.sensors.items()
    }
