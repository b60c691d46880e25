"""Quantities of interest of a run (or of an exact solution), and how far those of two runs are apart.

Contact instants are interpolated between the instants of a run. The motion of a sensor is measured in a band: behind a
front the velocity jumps, so that the peak of its acceleration grows without limit as mesh and step are refined. In the
band it is that of a low pass, the filter of the sensor or a Butterworth of fourth order, forwards and backwards, whose
cut-off the mesh of the scene as written resolves (``resolved_frequency``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from .assembly.body import elasticity_of
from .latin.outcome import Array, InterfaceHistory, SensorHistory
from .results.interface_fields import ROUND_OFF, Force
from .results.owner_records import Band, BoltRecord, InterfaceRecord, SensorRecord, Signal
from .results.solution import Solution
from .results.spectra import ShockSpectrum
from .scene.quantity_table import BOLT, INTERFACE, QUANTITIES_OF_INTEREST, SENSOR, definition_of
from .scene.schema import Scene
from .scene.sensors import LowPass, Sensor

ELEMENTS_PER_WAVE: Final = 8
"""Elements per length of a pressure wave at the highest frequency of the band."""
STEPS_PER_WAVE: Final = 10
"""Time steps per period there."""


@dataclass(frozen=True)
class Quantities:
    """Quantities of a run (or of an exact solution).

    Attributes
    ----------
    values : by name ``owner.key``; the value of a history is its root mean square. scales : what errors are divided by.
    forces : normal resultants by interface. vectors : displacement (3,) of sensors at the end, m.
    signals : histories of sensors and bolts, in the band where they are; maximax spectra over frequency; by quantity.
    spectra : shock response spectra of sensors, by name.
    durations : of the mean that is the peak force, by interface, s. spacings : of its points, by interface, m.
    sides : faces of interfaces.
    """

    values: dict[str, float] = field(default_factory=dict)
    scales: dict[str, float] = field(default_factory=dict)
    forces: dict[str, Force] = field(default_factory=dict)
    vectors: dict[str, Array] = field(default_factory=dict)
    signals: dict[str, Signal] = field(default_factory=dict)
    spectra: dict[str, ShockSpectrum] = field(default_factory=dict)
    durations: dict[str, float] = field(default_factory=dict)
    spacings: dict[str, float] = field(default_factory=dict)
    sides: dict[str, tuple[str, str]] = field(default_factory=dict)

    def add(self, owner: str, entries: Mapping[str, tuple[float, float]]) -> None:
        """Add values and scales, by key, of an interface, sensor or bolt."""
        for key, (value, scale) in entries.items():
            self.values[f"{owner}.{key}"], self.scales[f"{owner}.{key}"] = value, scale

    def add_record(self, kind: str, owner: str, record: Any) -> None:
        """Add what an owner of a kind has, with the histories that distances are of."""
        for row in (row for row in QUANTITIES_OF_INTEREST if row.owner == kind and row.serves("estimate", record)):
            history = None
            if row.history is not None:
                history = row.history(record)
                if history is None:
                    continue
            if (entry := row.with_scale(record)) is not None:
                self.add(owner, {row.key: entry})
                if history is not None:
                    self.signals[f"{owner}.{row.key}"] = history

    def history(self, quantity: str) -> Signal:
        """History of a quantity; the normal force of an interface."""
        if quantity in self.signals:
            return self.signals[quantity]
        force = self.forces[quantity.rpartition(".")[0]]
        return Signal(force.time, force.value[:, None])

    def value(self, quantity: str, defining: Quantities) -> float:
        """Value of a quantity; means of the force are over the duration that another run defines."""
        owner, row = quantity.rpartition(".")[0], definition_of(quantity)
        if row.mean and owner in self.forces and owner in defining.durations:
            force, duration = self.forces[owner], defining.durations[owner]
            if row.instant:
                nothing = ROUND_OFF * defining.forces[owner].raw_peak()
            else:
                nothing = 0.0
            found = row.value(InterfaceRecord(force, float(force.time[-1]), duration, nothing))
            if found is not None:
                return found
        return self.values[quantity]

    def distance(self, quantity: str, other: Quantities, defining: Quantities | None = None) -> float:
        """Distance of a quantity to that of another run, in its unit.

        defining : the run whose contact defines the duration of means of the force; this one where None.
        """
        owner, how = quantity.rpartition(".")[0], definition_of(quantity).distance
        if how == "history":
            return self.history(quantity).distance(other.history(quantity))
        if how == "vector" and owner in self.vectors and owner in other.vectors:
            return float(np.linalg.norm(self.vectors[owner] - other.vectors[owner]))
        if how == "spectrum":
            return self.values[quantity] * self.history(quantity).largest_ratio(other.history(quantity))
        if defining is None:
            defining = self
        return abs(self.value(quantity, defining) - other.value(quantity, defining))

    def change(self, quantity: str, other: Quantities, defining: Quantities) -> float:
        """What an estimate takes for the distance to a run at another resolution, in the unit of the quantity.

        Of peaks it is the largest distance of the histories near the peak (of the running means, for the mean peak): it
        bounds the difference of both peaks, and is not small where two curves have the same peak by chance.
        """
        owner, row = quantity.rpartition(".")[0], definition_of(quantity)
        if row.distance == "peak" and owner in self.forces:
            if row.mean:
                duration = defining.durations.get(owner, 0.0)
            else:
                duration = 0.0
            return self.forces[owner].apart_near_peak(other.forces[owner], duration)
        if row.distance == "peak" and quantity in self.signals:
            return self.signals[quantity].apart_near_peak(other.signals[quantity])
        return self.distance(quantity, other, defining)

    def error(self, quantity: str, reference: Quantities) -> float:
        """Relative error of a quantity against a reference."""
        scale = reference.scales[quantity]
        apart = self.distance(quantity, reference)
        if scale > 0.0:
            return apart / scale
        if apart == 0.0:
            return 0.0
        return np.inf


# -- Interfaces -------------------------------------------------------------------------------------------------------
def measure(time: Array, interfaces: Mapping[str, InterfaceHistory], end: float) -> Quantities:
    """Quantities of the interfaces that may open (of all where none may), on [0, end].

    Parameters
    ----------
    time : (n_time,), s. end : s; what happens later is cut off.
    """
    chosen = [h for h in interfaces.values() if h.contact_status is not None] or list(interfaces.values())
    quantities = Quantities()
    for history in chosen:
        _add_interface(quantities, time, history, end)
    return quantities


def _add_interface(quantities: Quantities, time: Array, history: InterfaceHistory, end: float) -> None:
    """Add the quantities of one interface, its force, and what means of that are over."""
    record = InterfaceRecord.of(history, time, end)
    quantities.forces[history.name] = record.force
    quantities.durations[history.name] = record.duration
    quantities.spacings[history.name] = float(np.sqrt(history.areas.mean()))
    quantities.sides[history.name] = history.sides
    quantities.add_record(INTERFACE, history.name, record)


def of_force(
    force: Force, end: float, opens: bool, nothing: float = 0.0, duration: float | None = None
) -> dict[str, tuple[float, float]]:
    """Value and scale of the quantities that a force history gives, by key.

    First contact and separation of a contact whose force never exceeds ``nothing`` (N) are at the ``end``.
    duration : of the means of peak force and separation, s; a tenth of the longest contact where None.
    """
    record, quantities = InterfaceRecord(force, end, duration, nothing, opens), Quantities()
    quantities.add_record(INTERFACE, "", record)
    return {name[1:]: (value, quantities.scales[name]) for name, value in quantities.values.items()}


# -- Sensors and bolts ------------------------------------------------------------------------------------------------
def resolved_frequency(scene: Scene) -> float:
    """Highest frequency of motions that a scene resolves, Hz.

    c / (8 h), the smallest of its elastic boxes and of the axes along which they have several elements of edge h, with
    c the speed of pressure waves along that axis, and at least ten time steps per period. A body whose mesh is from a
    file sets no limit.
    """
    limits = [1.0 / (STEPS_PER_WAVE * scene.time.time_step)]
    for body in scene.substructure.values():
        if body.box is None or body.rigid:
            continue
        speeds = elasticity_of(scene.material[body.material]).pressure_speed(np.eye(3))
        transits = np.divide(body.box.size, body.box.elements) / speeds  # along each axis
        several = np.array(body.box.elements) > 1
        if several.any():
            transits = transits[several]
        limits.append(float(1.0 / (ELEMENTS_PER_WAVE * transits.max())))
    return min(limits)


def band_of(scene: Scene, sensor: Sensor, spectrum: ShockSpectrum | None = None) -> Band:
    """Band of a sensor of a scene by its mesh and step as written; ``spectrum``: of it, in a run of that."""
    highest, request = resolved_frequency(scene), sensor.spectrum
    chosen = sensor.filter or LowPass(cutoff=highest)
    if request is None:
        return Band(chosen, highest)
    frequencies = request.frequencies(scene.time.time_step, scene.time.end)
    return Band(chosen, highest, frequencies, request.quality, spectrum)


def add_sensor(quantities: Quantities, time: Array, history: SensorHistory, end: float, band: Band) -> None:
    """Add what a sensor gives on [0, end]: peaks and histories of its motion, in the band those of velocity (peak) and
    acceleration; the spectrum of the acceleration.

    The band ends half a period of its cut-off before the end: the filter needs what follows an instant. Motions that
    the steps of a run are too long for are left out, as is what does not move.
    """
    record = SensorRecord.of(history, time, end, band)
    quantities.vectors[history.name] = record.displacement.values[-1]
    quantities.add_record(SENSOR, history.name, record)
    if record.spectrum is not None:
        quantities.spectra[history.name] = record.spectrum


def measure_solution(scene: Scene, solution: Solution) -> Quantities:
    """Quantities of a solution on the interval of the scene, motions in the band of its mesh and step as written."""
    end = scene.time.end
    quantities = measure(solution.outcome.interface_time, solution.interfaces, end)
    for name, history in solution.sensors.items():
        # with other steps than those as written its frequencies are others
        spectrum = None
        if len(solution.time) == scene.time.n_step + 1:
            spectrum = solution.spectra.get(name)
        band = band_of(scene, scene.sensor[name], spectrum)
        add_sensor(quantities, solution.time, history, end, band)
    for bolt in solution.bolts.values():
        quantities.add_record(BOLT, bolt.name, BoltRecord.of(bolt, solution.time, end, solution.interfaces))
    return quantities


def relative(quantity: str, scale: Quantities, a: Quantities, b: Quantities) -> float:
    """Change of a quantity between two runs, divided by its scale in a third; 0 where the scale is 0, NaN where a run
    does not have it."""
    if quantity not in a.values or quantity not in b.values:
        return math.nan
    divisor = scale.scales[quantity]
    if divisor > 0.0:
        return a.change(quantity, b, scale) / divisor
    return 0.0
