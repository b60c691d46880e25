"""Quantities of interest of one run, contact instants interpolated between the instants of the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from ..latin.record import Array, InterfaceHistory
from ..results.quantities_of_interest import (
    CONTACT_SHARE,
    DISPLACEMENT,
    FIRST_CONTACT,
    FORCE_HISTORY,
    FRICTION_WORK,
    IMPULSE,
    PEAK_FORCE,
    ROUND_OFF,
    SEPARATION,
)

_SMOOTH: Final = 7
"""Steps; a front rings at a wavelength of a few elements, and a step is about the wave transit of an element."""


@dataclass(frozen=True)
class Force:
    """Normal resultant of an interface over time: linear between (time, value); a time met twice is a jump.

    ``time`` (n,), s, never decreasing; ``value`` (n,), N, positive in compression.
    """

    time: Array
    value: Array

    def norm(self) -> float:
        """sqrt(integral of value^2 dt), exact for linear pieces."""
        a, b = self.value[:-1], self.value[1:]
        return float(np.sqrt(np.sum(np.diff(self.time) * (a * a + a * b + b * b)) / 3.0))

    def distance(self, other: Force) -> float:
        """L2 distance to another history over the time both cover."""
        last = min(self.time[-1], other.time[-1])
        grid = np.union1d(self.time, other.time)
        grid = grid[grid <= last]
        a, b = grid[:-1], grid[1:]
        first = self._at(a, "right") - other._at(a, "right")
        second = self._at(b, "left") - other._at(b, "left")
        return float(np.sqrt(np.sum((b - a) * (first**2 + first * second + second**2)) / 3.0))

    def _at(self, t: Array, side: Literal["left", "right"]) -> Array:
        """Limits at the instants ``t`` from before (left) or after (right)."""
        i = np.clip(np.searchsorted(self.time, t, side=side) - 1, 0, len(self.time) - 2)
        span = self.time[i + 1] - self.time[i]
        share = np.where(span > 0.0, (t - self.time[i]) / np.where(span > 0.0, span, 1.0), 1.0)
        result: Array = (1.0 - share) * self.value[i] + share * self.value[i + 1]
        return result


@dataclass(frozen=True)
class Quantities:
    """Quantities of a run (or of an exact solution).

    Attributes
    ----------
    values : by name ``owner.key``; the value of a force history is its L2 norm. scales : what errors are divided by.
    forces : normal resultants by interface. vectors : displacement (3,) of sensors at the end, m.
    ringing : by interface, relative height of the peak above that of the force averaged over ``_SMOOTH`` steps.
    """

    values: dict[str, float] = field(default_factory=dict)
    scales: dict[str, float] = field(default_factory=dict)
    forces: dict[str, Force] = field(default_factory=dict)
    vectors: dict[str, Array] = field(default_factory=dict)
    ringing: dict[str, float] = field(default_factory=dict)

    def add(self, owner: str, entries: Mapping[str, tuple[float, float]]) -> None:
        """Add values and scales, by key, of an interface or sensor."""
        for key, (value, scale) in entries.items():
            self.values[f"{owner}.{key}"], self.scales[f"{owner}.{key}"] = value, scale

    def distance(self, quantity: str, other: Quantities) -> float:
        """Distance of a quantity to that of another run, in its unit."""
        owner, _, key = quantity.rpartition(".")
        if key == FORCE_HISTORY.key:
            return self.forces[owner].distance(other.forces[owner])
        if key == DISPLACEMENT.key and owner in self.vectors and owner in other.vectors:
            return float(np.linalg.norm(self.vectors[owner] - other.vectors[owner]))
        return abs(self.values[quantity] - other.values[quantity])

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
    largest = float(np.einsum("p,tp->t", history.areas, np.linalg.norm(history.traction, axis=2)).max(initial=0.0))
    entries = of_force(force, end, history.contact_status is not None, ROUND_OFF * largest)
    peak = entries[PEAK_FORCE.key][0]
    if (closing := _closing(time, history, peak)) is not None:
        entries[FIRST_CONTACT.key] = (closing, max(closing, 1e-2 * end))
    if history.friction_power is not None and history.has_friction:
        work = np.concatenate([[0.0], np.cumsum(history.friction_power[1:]) * float(time[1] - time[0])])
        last = float(_until(time, work, end).value[-1])
        least = 1e-3 * entries[IMPULSE.key][1] * float(np.abs(history.velocity).max(initial=0.0))
        entries[FRICTION_WORK.key] = (last, max(last, least))
    quantities.add(history.name, entries)
    smooth = np.convolve(force.value, np.full(_SMOOTH, 1.0 / _SMOOTH), mode="same")
    quantities.ringing[history.name] = 0.0 if peak <= 0.0 else float(np.abs(peak - np.abs(smooth).max())) / peak


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


def of_force(force: Force, end: float, opens: bool, nothing: float = 0.0) -> dict[str, tuple[float, float]]:
    """Value and scale of the quantities that a force history gives, by key.

    First contact and separation of a contact whose force never exceeds ``nothing`` (N) are at the ``end``.
    """
    size = np.abs(force.value)
    peak = float(size.max(initial=0.0))
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
    entries[PEAK_FORCE.key] = (peak, peak)
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
