"""Quantities of interest of one run, contact instants interpolated between the instants of the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..latin.outcome import Array, InterfaceHistory
from ..results.quantities_of_interest import (
    CONTACT_SHARE,
    DISPLACEMENT,
    FIRST_CONTACT,
    FORCE_HISTORY,
    FRICTION_WORK,
    IMPULSE,
    PEAK_FORCE,
    PEAK_FORCE_RAW,
    ROUND_OFF,
    SEPARATION,
    Force,
)


@dataclass(frozen=True)
class Quantities:
    """Quantities of a run (or of an exact solution).

    Attributes
    ----------
    values : by name ``owner.key``; the value of a force history is its L2 norm. scales : what errors are divided by.
    forces : normal resultants by interface. vectors : displacement (3,) of sensors at the end, m.
    durations : of the mean that is the peak force, by interface, s. spacings : of its points, by interface, m.
    """

    values: dict[str, float] = field(default_factory=dict)
    scales: dict[str, float] = field(default_factory=dict)
    forces: dict[str, Force] = field(default_factory=dict)
    vectors: dict[str, Array] = field(default_factory=dict)
    durations: dict[str, float] = field(default_factory=dict)
    spacings: dict[str, float] = field(default_factory=dict)

    def add(self, owner: str, entries: Mapping[str, tuple[float, float]]) -> None:
        """Add values and scales, by key, of an interface or sensor."""
        for key, (value, scale) in entries.items():
            self.values[f"{owner}.{key}"], self.scales[f"{owner}.{key}"] = value, scale

    def value(self, quantity: str, defining: Quantities) -> float:
        """Value of a quantity; the peak force is the mean over the duration that another run defines."""
        owner, _, key = quantity.rpartition(".")
        if key == PEAK_FORCE.key and owner in self.forces and owner in defining.durations:
            return self.forces[owner].largest_mean(defining.durations[owner])
        return self.values[quantity]

    def distance(self, quantity: str, other: Quantities, defining: Quantities | None = None) -> float:
        """Distance of a quantity to that of another run, in its unit.

        defining : the run whose contact defines the duration of the mean that is the peak force; this one where None.
        """
        owner, _, key = quantity.rpartition(".")
        defining = self if defining is None else defining
        if key == FORCE_HISTORY.key:
            return self.forces[owner].distance(other.forces[owner])
        if key == DISPLACEMENT.key and owner in self.vectors and owner in other.vectors:
            return float(np.linalg.norm(self.vectors[owner] - other.vectors[owner]))
        return abs(self.value(quantity, defining) - other.value(quantity, defining))

    def error(self, quantity: str, reference: Quantities) -> float:
        """Relative error of a quantity against a reference."""
        scale = reference.scales[quantity]
        apart = self.distance(quantity, reference)
        return apart / scale if scale > 0.0 else (0.0 if apart == 0.0 else np.inf)


def measure(
    time: Array,
    interfaces: Mapping[str, InterfaceHistory],
    end: float,
    sensors: Mapping[str, tuple[Array, Array]] | None = None,
) -> Quantities:
    """Quantities of the interfaces that may open (of all where none may) and of sensors, on [0, end].

    Parameters
    ----------
    time : (n_time,), s. end : s; what happens later is cut off. sensors : times (n,) and displacements (n, 3).
    """
    chosen = [h for h in interfaces.values() if h.contact_status is not None] or list(interfaces.values())
    quantities = Quantities()
    for history in chosen:
        _add_interface(quantities, time, history, end)
    for name, (instants, displacement) in (sensors or {}).items():
        last = np.array([np.interp(end, instants, displacement[:, i]) for i in range(3)])
        quantities.vectors[name] = last
        largest = float(np.linalg.norm(displacement, axis=1).max())
        quantities.add(name, {DISPLACEMENT.key: (float(np.linalg.norm(last)), largest)})
    return quantities


def _add_interface(quantities: Quantities, time: Array, history: InterfaceHistory, end: float) -> None:
    """Add impulse, instants, peak, friction work and force history of one interface."""
    force = _until(time, history.normal_resultant(), end)
    quantities.forces[history.name] = force
    duration = quantities.durations[history.name] = force.peak_duration(history.peak_duration)
    quantities.spacings[history.name] = float(np.sqrt(history.areas.mean()))
    largest = float(np.einsum("p,tp->t", history.areas, np.linalg.norm(history.traction, axis=2)).max(initial=0.0))
    entries = of_force(force, end, history.contact_status is not None, ROUND_OFF * largest, duration)
    if (closing := _closing(time, history, force.raw_peak())) is not None:
        entries[FIRST_CONTACT.key] = (closing, max(closing, 1e-2 * end))
    if history.friction_power is not None and history.has_friction:
        work = np.concatenate([[0.0], np.cumsum(history.friction_power[1:] * np.diff(time))])
        last = float(_until(time, work, end).value[-1])
        least = 1e-3 * entries[IMPULSE.key][1] * float(np.abs(history.velocity).max(initial=0.0))
        entries[FRICTION_WORK.key] = (last, max(last, least))
    quantities.add(history.name, entries)


def _closing(time: Array, history: InterfaceHistory, peak: float) -> float | None:
    """Instant at which an initial gap closes, from gap and velocity at the instant before the first contact.

    None where the sides touch from the start, never touch, or where the force defines the instant.
    """
    if history.gap is None:
        return None
    force = np.abs(history.normal_resultant())
    i = int(np.argmax(force > CONTACT_SHARE * peak))
    if i == 0:
        return None
    pressed = np.einsum("pc,pc->p", history.traction[i], history.normals) < 0.0
    gap = history.gap[i - 1][pressed]
    if not gap.size or gap.min() <= 0.0:
        return None
    jump = history.velocity[i - 1, 1] - history.velocity[i - 1, 0]
    closing = -np.einsum("pc,pc->p", jump, history.normals)[pressed]
    with np.errstate(divide="ignore"):
        wait = float(np.min(np.where(closing > 0.0, gap / closing, np.inf)))
    return float(min(time[i - 1] + wait, time[i]))


def of_force(
    force: Force, end: float, opens: bool, nothing: float = 0.0, duration: float | None = None
) -> dict[str, tuple[float, float]]:
    """Value and scale of the quantities that a force history gives, by key.

    First contact and separation of a contact whose force never exceeds ``nothing`` (N) are at the ``end``.
    duration : of the mean that is the peak force, s; a tenth of the longest contact where None.
    """
    size = np.abs(force.value)
    peak = force.raw_peak()
    mean = force.largest_mean(force.peak_duration(duration))
    steps = np.diff(force.time)
    impulse = float(np.sum(steps * 0.5 * (force.value[1:] + force.value[:-1])))
    whole = float(np.sum(steps * 0.5 * (size[1:] + size[:-1])))
    entries = {IMPULSE.key: (impulse, whole)}
    if opens:
        level = CONTACT_SHARE * peak
        never = peak <= nothing
        first = end if never else _first_above(force.time, size, level)
        last = (
            end if never else float(force.time[-1]) - _first_above(force.time[-1] - force.time[::-1], size[::-1], level)
        )
        entries[FIRST_CONTACT.key] = (first, max(first, 1e-2 * end))
        entries[SEPARATION.key] = (last, max(last, 1e-2 * end))
    entries[PEAK_FORCE.key] = (mean, mean)
    entries[PEAK_FORCE_RAW.key] = (peak, peak)
    entries[FORCE_HISTORY.key] = (force.norm(), force.norm())
    return entries


def _first_above(time: Array, size: Array, level: float) -> float:
    i = int(np.argmax(size > level))
    if i == 0:
        return float(time[0])
    share = (level - size[i - 1]) / (size[i] - size[i - 1])
    return float(time[i - 1] + share * (time[i] - time[i - 1]))


def _until(time: Array, values: Array, end: float) -> Force:
    """A history cut at ``end``."""
    inside = time < end * (1.0 - 1e-12)
    last = np.interp(end, time, values)
    return Force(np.append(time[inside], end), np.append(values[inside], last))
