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
from typing import Final

import numpy as np

from .assembly.body import elasticity_of
from .latin.outcome import Array, BoltHistory, InterfaceHistory, SensorHistory
from .results.quantities_of_interest import (
    ACCELERATION_PEAK,
    CONTACT_SHARE,
    DISPLACEMENT,
    DISPLACEMENT_PEAK,
    DISPLACEMENT_RMS,
    FIRST_CONTACT,
    FORCE_RMS,
    FRICTION_WORK,
    IMPULSE,
    LARGEST_BOLT_FORCE,
    NEAR_PEAK,
    PEAK_FORCE,
    PEAK_FORCE_RAW,
    ROUND_OFF,
    SEPARATION,
    SPECTRUM,
    VELOCITY_PEAK,
    VELOCITY_RMS,
    Force,
    InterfaceFields,
    closing_time,
    definition_of,
)
from .results.sensors import low_pass, uniform_step
from .results.solution import Solution
from .results.spectra import LINES, ShockSpectrum, shock_response_spectrum
from .scene.schema import Scene
from .scene.sensors import Filter, LowPass, Sensor, highest_frequency, nyquist

ELEMENTS_PER_WAVE: Final = 8
"""Elements per length of a pressure wave at the highest frequency of the band."""
STEPS_PER_WAVE: Final = 10
"""Time steps per period there."""
_MEASURED: Final = 0.9  # of the Nyquist frequency of a run, above which it has no motion in the band


@dataclass(frozen=True)
class Signal:
    """Vectors over time (or over frequency), linear between their instants: ``along`` (n,), ``values`` (n, m)."""

    along: Array
    values: Array

    def peak(self) -> float:
        """Largest length of the vectors."""
        return float(np.linalg.norm(self.values, axis=1).max(initial=0.0))

    def at(self, instants: Array) -> Array:
        """Vectors at instants (k,), (k, m)."""
        return np.stack([np.interp(instants, self.along, column) for column in self.values.T], axis=1)

    def root_mean_square(self) -> float:
        """sqrt(mean of |v|^2), exact for linear pieces."""
        return math.hypot(*(Force(self.along, column).root_mean_square() for column in self.values.T))

    def distance(self, other: Signal) -> float:
        """Root of the integral of the squared difference from another signal, over what both cover, per length of this
        one: in the unit of the values."""
        pairs = zip(self.values.T, other.values.T, strict=True)
        apart = math.hypot(*(Force(self.along, a).distance(Force(other.along, b)) for a, b in pairs))
        return apart / math.sqrt(self.along[-1] - self.along[0])

    def apart_near_peak(self, other: Signal) -> float:
        """Largest distance of the vectors where this one is at least ``NEAR_PEAK`` of its peak: a bound of the
        difference of both peaks that is not small by chance."""
        grid = np.union1d(self.along, other.along)
        grid = grid[grid <= min(self.along[-1], other.along[-1])]
        values = self.at(grid)
        size = np.linalg.norm(values, axis=1)
        near = size >= NEAR_PEAK * size.max(initial=0.0)
        return float(np.linalg.norm((values - other.at(grid))[near], axis=1).max(initial=0.0))

    def largest_ratio(self, other: Signal) -> float:
        """Largest difference of a component over the largest component here, over the points that both have; NaN where
        the other one has fewer (a spectrum up to a lower frequency)."""
        if len(other.along) < len(self.along):
            return math.nan
        size = np.abs(self.values).max(axis=1)
        apart = np.abs(self.values - other.values[: len(self.along)]).max(axis=1)
        return float(np.divide(apart, size, out=np.zeros_like(size), where=size > 0.0).max(initial=0.0))


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

    def add_signal(self, quantity: str, signal: Signal, value: float | None = None) -> None:
        """Add a history, its value the peak where None, which is its scale too."""
        size = signal.peak() if value is None else value
        self.values[quantity] = self.scales[quantity] = size
        self.signals[quantity] = signal

    def value(self, quantity: str, defining: Quantities) -> float:
        """Value of a quantity; peak force and separation are by means over the duration that another run defines."""
        owner, _, key = quantity.rpartition(".")
        if owner in self.forces and owner in defining.durations:
            if key == PEAK_FORCE.key:
                return self.forces[owner].largest_mean(defining.durations[owner])
            if key == SEPARATION.key and self.forces[owner].raw_peak() > ROUND_OFF * defining.forces[owner].raw_peak():
                return self.forces[owner].separation(defining.durations[owner])
        return self.values[quantity]

    def distance(self, quantity: str, other: Quantities, defining: Quantities | None = None) -> float:
        """Distance of a quantity to that of another run, in its unit.

        defining : the run whose contact defines the duration of means of the force; this one where None.
        """
        owner, _, key = quantity.rpartition(".")
        defining = self if defining is None else defining
        if key == FORCE_RMS.key:
            force = self.forces[owner]
            return force.distance(other.forces[owner]) / math.sqrt(force.time[-1] - force.time[0])
        if key == DISPLACEMENT.key and owner in self.vectors and owner in other.vectors:
            return float(np.linalg.norm(self.vectors[owner] - other.vectors[owner]))
        if key in (DISPLACEMENT_RMS.key, VELOCITY_RMS.key):
            return self.signals[quantity].distance(other.signals[quantity])
        if key == SPECTRUM.key:
            return self.values[quantity] * self.signals[quantity].largest_ratio(other.signals[quantity])
        return abs(self.value(quantity, defining) - other.value(quantity, defining))

    def change(self, quantity: str, other: Quantities, defining: Quantities) -> float:
        """What an estimate takes for the distance to a run at another resolution, in the unit of the quantity.

        Of peaks it is the largest distance of the histories near the peak (of the running means, for the mean peak): it
        bounds the difference of both peaks, and is not small where two curves have the same peak by chance.
        """
        owner, _, key = quantity.rpartition(".")
        if key in (PEAK_FORCE.key, PEAK_FORCE_RAW.key):
            duration = defining.durations.get(owner, 0.0) if key == PEAK_FORCE.key else 0.0
            return self.forces[owner].apart_near_peak(other.forces[owner], duration)
        if definition_of(quantity).norm and quantity in self.signals and key.endswith(("peak", LARGEST_BOLT_FORCE.key)):
            return self.signals[quantity].apart_near_peak(other.signals[quantity])
        return self.distance(quantity, other, defining)

    def error(self, quantity: str, reference: Quantities) -> float:
        """Relative error of a quantity against a reference."""
        scale = reference.scales[quantity]
        apart = self.distance(quantity, reference)
        return apart / scale if scale > 0.0 else (0.0 if apart == 0.0 else np.inf)


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
    """Add impulse, instants, peak, friction work and force history of one interface."""
    force = _until(time, history.normal_resultant(), end)
    quantities.forces[history.name] = force
    duration = quantities.durations[history.name] = force.peak_duration(history.peak_duration)
    quantities.spacings[history.name] = float(np.sqrt(history.areas.mean()))
    quantities.sides[history.name] = history.sides
    # sizes and not components: a resultant may be zero though the faces press
    largest = float(np.einsum("p,tp->t", history.areas, np.linalg.norm(history.traction, axis=2)).max(initial=0.0))
    entries = of_force(force, end, history.contact_status is not None, ROUND_OFF * largest, duration)
    if (closing := closing_time(InterfaceFields.of_history(history, time), force.raw_peak())) is not None:
        # a hundredth of the run: an instant near 0 would have any relative error
        entries[FIRST_CONTACT.key] = (closing, max(closing, 1e-2 * end))
    if history.friction_power is not None and history.has_friction:
        work = np.concatenate([[0.0], np.cumsum(history.friction_power[1:] * np.diff(time))])
        last = float(_until(time, work, end).value[-1])
        # N s m/s = J, a floor: the error of a joint that hardly slides would be relative to next to 0
        least = 1e-3 * entries[IMPULSE.key][1] * float(np.abs(history.velocity).max(initial=0.0))
        entries[FRICTION_WORK.key] = (last, max(last, least))
    quantities.add(history.name, entries)


def of_force(
    force: Force, end: float, opens: bool, nothing: float = 0.0, duration: float | None = None
) -> dict[str, tuple[float, float]]:
    """Value and scale of the quantities that a force history gives, by key.

    First contact and separation of a contact whose force never exceeds ``nothing`` (N) are at the ``end``.
    duration : of the means of peak force and separation, s; a tenth of the longest contact where None.
    """
    size = np.abs(force.value)
    peak = force.raw_peak()
    duration = force.peak_duration(duration)
    mean = force.largest_mean(duration)
    steps = np.diff(force.time)
    impulse = float(np.sum(steps * 0.5 * (force.value[1:] + force.value[:-1])))
    whole = float(np.sum(steps * 0.5 * (size[1:] + size[:-1])))
    # scale by |F|: forces of both signs may have no impulse at all
    entries = {IMPULSE.key: (impulse, whole)}
    if opens:
        level = CONTACT_SHARE * peak
        never = peak <= nothing
        first = end if never else Force(force.time, size).first_above(level)
        last = end if never else force.separation(duration)
        entries[FIRST_CONTACT.key] = (first, max(first, 1e-2 * end))
        entries[SEPARATION.key] = (last, max(last, 1e-2 * end))
    entries[PEAK_FORCE.key] = (mean, mean)
    entries[PEAK_FORCE_RAW.key] = (peak, peak)
    entries[FORCE_RMS.key] = (force.root_mean_square(), force.root_mean_square())
    return entries


def _until(time: Array, values: Array, end: float) -> Force:
    """A history cut at ``end``."""
    inside = time < end * (1.0 - 1e-12)
    last = np.interp(end, time, values)
    return Force(np.append(time[inside], end), np.append(values[inside], last))


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
        limits.append(float(1.0 / (ELEMENTS_PER_WAVE * (transits[several] if several.any() else transits).max())))
    return min(limits)


@dataclass(frozen=True)
class Band:
    """What motions of a sensor are measured in.

    Attributes
    ----------
    chosen : low pass. highest : frequency that the mesh resolves, Hz. frequencies : of the spectrum, Hz, empty where
        none is requested. quality : of its oscillators. spectrum : that one where it exists already.
    """

    chosen: Filter
    highest: float
    frequencies: tuple[float, ...] = ()
    quality: float = 10.0
    spectrum: ShockSpectrum | None = None

    @classmethod
    def of(cls, scene: Scene, sensor: Sensor, spectrum: ShockSpectrum | None = None) -> Band:
        """That of a sensor of a scene by its mesh and step as written; ``spectrum``: its own in a run of that."""
        highest, request = resolved_frequency(scene), sensor.spectrum
        chosen = LowPass(cutoff=highest) if sensor.filter is None else sensor.filter
        if request is None:
            return cls(chosen, highest)
        frequencies = request.frequencies(scene.time.time_step, scene.time.end)
        return cls(chosen, highest, frequencies, request.quality, spectrum)


def add_sensor(quantities: Quantities, time: Array, history: SensorHistory, end: float, band: Band) -> None:
    """Add what a sensor gives on [0, end]: peaks and histories of its motion, in the band those of velocity (peak) and
    acceleration; the spectrum of the acceleration.

    The band ends half a period of its cut-off before the end: the filter needs what follows an instant. Motions that
    the steps of a run are too long for are left out, as is what does not move.
    """
    name, moved = history.name, _until_vectors(time, history.displacement, end)
    largest, last = moved.peak(), moved.values[-1]
    quantities.vectors[name] = last
    quantities.add(name, {DISPLACEMENT.key: (float(np.linalg.norm(last)), largest)})
    quantities.add_signal(f"{name}.{DISPLACEMENT_PEAK.key}", moved)
    quantities.add_signal(f"{name}.{DISPLACEMENT_RMS.key}", moved, moved.root_mean_square())
    if history.acceleration is None:
        return
    speed = _until_vectors(time, history.velocity, end)
    quantities.add_signal(f"{name}.{VELOCITY_RMS.key}", speed, speed.root_mean_square())
    if not (step := uniform_step(time)):
        return
    frequencies = np.array([f for f in band.frequencies if f <= highest_frequency(step)])
    if frequencies.size:
        spectrum = band.spectrum
        if spectrum is None:
            samples = history.acceleration
            spectrum = shock_response_spectrum(samples, step, frequencies, band.quality, interpolation=LINES)
        quantities.spectra[name] = spectrum
        if n := int(np.count_nonzero(spectrum.frequency <= band.highest)):
            maximax = Signal(spectrum.frequency[:n], spectrum.acceleration[0, :n])
            quantities.add_signal(f"{name}.{SPECTRUM.key}", maximax, float(maximax.values.max()))
    cutoff = band.chosen.cutoff
    # nothing of the band is left in a run shorter than a period of its cut-off
    if cutoff >= _MEASURED * nyquist(step) or cutoff * end < 1.0:
        return
    for definition, motion in ((VELOCITY_PEAK, history.velocity), (ACCELERATION_PEAK, history.acceleration)):
        signal = _until_vectors(time, low_pass(motion, band.chosen, step), end - 0.5 / cutoff)
        quantities.add_signal(f"{name}.{definition.key}", signal)


def add_bolt(quantities: Quantities, time: Array, bolt: BoltHistory, end: float) -> None:
    """Add the largest tension of a bolt on [0, end]."""
    quantities.add_signal(f"{bolt.name}.{LARGEST_BOLT_FORCE.key}", _until_vectors(time, bolt.force[:, None], end))


def measure_solution(scene: Scene, solution: Solution) -> Quantities:
    """Quantities of a solution on the interval of the scene, motions in the band of its mesh and step as written."""
    end = scene.time.end
    quantities = measure(solution.outcome.interface_time, solution.interfaces, end)
    for name, history in solution.sensors.items():
        # with other steps than those as written its frequencies are others
        spectrum = solution.spectra.get(name) if len(solution.time) == scene.time.n_step + 1 else None
        band = Band.of(scene, scene.sensor[name], spectrum)
        add_sensor(quantities, solution.time, history, end, band)
    for bolt in solution.bolts.values():
        add_bolt(quantities, solution.time, bolt, end)
    return quantities


def _until_vectors(time: Array, values: Array, end: float) -> Signal:
    """Vectors cut at ``end``."""
    inside = time < end * (1.0 - 1e-12)
    whole = Signal(time, values)
    return Signal(np.append(time[inside], end), np.vstack([values[inside], whole.at(np.array([end]))]))


def relative(quantity: str, scale: Quantities, a: Quantities, b: Quantities) -> float:
    """Change of a quantity between two runs, divided by its scale in a third; 0 where the scale is 0, NaN where a run
    does not have it."""
    if quantity not in a.values or quantity not in b.values:
        return math.nan
    divisor = scale.scales[quantity]
    return a.change(quantity, b, scale) / divisor if divisor > 0.0 else 0.0
