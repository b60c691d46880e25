"""What the quantities of a run are computed from: one record for an interface, a sensor, a bolt.

The rows of ``scene.quantity_table`` take their values from the attributes of these records, of the whole run or, for
estimates, of the interval of the scene.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from ..latin.outcome import Array, BoltHistory, InterfaceHistory, SensorHistory
from ..scene.quantity_table import RunScalar, rows_of
from ..scene.sensors import Filter, highest_frequency, nyquist
from .bolt_margins import BoltMargins
from .filters import low_pass, uniform_step
from .groups import finite
from .interface_fields import (
    NEAR_PEAK,
    ROUND_OFF,
    Force,
    InterfaceFields,
    closing_time,
    largest_slip_share,
    normal_resultant,
    slip_in_contact,
)
from .quantities import Columns, StoredQuantity
from .spectra import LINES, ShockSpectrum, shock_response_spectrum

_MEASURED: Final = 0.9  # of the Nyquist frequency of a run, above which it has no motion in the band


@dataclass(frozen=True)
class Signal:
    """Vectors over time (or over frequency), linear between their instants: ``along`` (n,), ``values`` (n, m)."""

    along: Array
    values: Array

    def peak(self) -> float:
        """Largest length of the vectors."""
        return float(np.linalg.norm(self.values, axis=1).max(initial=0.0))

    def peak_at(self) -> int:
        """Number of the instant of the peak."""
        return int(np.argmax(np.linalg.norm(self.values, axis=1)))

    def last(self) -> float:
        """Length of the last vector."""
        return float(np.linalg.norm(self.values, axis=1)[-1])

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

    def until(self, end: float | None) -> Signal:
        """The signal cut at an instant, s; as it is where None."""
        if end is None:
            return self
        inside = self.along < end * (1.0 - 1e-12)
        return Signal(np.append(self.along[inside], end), np.vstack([self.values[inside], self.at(np.array([end]))]))


@dataclass(frozen=True)
class InterfaceRecord:
    """An interface, or an exact force alone.

    Attributes
    ----------
    force : normal resultant. end : of what is looked at, s. requested : duration of the means, s; a share of the
        contact where None. nothing : force that counts as none, N; the round-off of the tractions where None.
    opens : whether it may. fields, history : of all instants of the run, None of a force alone. whole : whether the run
        has kept every instant. cut : whether the end is that of an interval, not of the run.
    """

    force: Force
    end: float
    requested: float | None = None
    nothing: float | None = 0.0
    opens: bool = True
    fields: InterfaceFields | None = None
    history: InterfaceHistory | None = None
    whole: bool = True
    cut: bool = False

    @classmethod
    def of_fields(cls, fields: InterfaceFields, end: float | None = None) -> InterfaceRecord:
        """From fields at the points, of a run or of a file; until an instant ``end``, s, where one is given."""
        whole = Signal(fields.time, normal_resultant(fields)[:, None]).until(end)
        if end is None:
            last = float(fields.time[-1])
        else:
            last = end
        opens = fields.contact_status is not None
        force, cut = Force(whole.along, whole.values[:, 0]), end is not None
        return cls(force, last, fields.peak_duration, None, opens, fields, cut=cut)

    @classmethod
    def of(
        cls, history: InterfaceHistory, time: Array, end: float | None = None, whole: bool = True
    ) -> InterfaceRecord:
        """From the history of a run with its instants (n_time,), s."""
        return replace(cls.of_fields(InterfaceFields.of_history(history, time), end), history=history, whole=whole)

    @cached_property
    def duration(self) -> float:
        """Of the means of the force, s."""
        return self.force.peak_duration(self.requested)

    @cached_property
    def loaded(self) -> bool:
        """Whether it ever carries a normal force above round-off."""
        nothing = self.nothing
        if nothing is None:
            assert self.fields is not None
            # sizes and not components: a resultant may be zero though the faces press
            sizes = np.linalg.norm(self.fields.traction, axis=2)
            nothing = ROUND_OFF * float(np.einsum("p,tp->t", self.fields.areas, sizes).max(initial=0.0))
        return self.force.raw_peak() > nothing

    @cached_property
    def closing(self) -> float | None:
        """Instant at which an initial gap closes, s; None where the force defines the first contact."""
        if self.fields is None:
            return None
        return closing_time(self.fields, self.force.raw_peak())

    @property
    def bonded(self) -> bool:
        """Whether it cannot open."""
        return not self.opens

    @property
    def transient(self) -> bool:
        """Whether its run has inertia."""
        return self.history is None or not self.history.quasi_static

    @property
    def friction(self) -> bool:
        """Whether Coulomb friction acts."""
        return self.history is not None and self.history.has_friction

    @property
    def slides(self) -> bool:
        """Whether the run has kept the power of friction."""
        return self.history is not None and self.history.friction_power is not None and self.history.has_friction

    @property
    def may_slide(self) -> bool:
        """Whether it may open, or slide with friction."""
        return self.opens or self.slides

    @cached_property
    def friction_work(self) -> float | None:
        """Work of friction, J: from tractions and velocities at the points, which derivatives have, too; on an interval
        from the power that the run has kept."""
        history = self.history
        if history is None or self.fields is None or not history.has_friction:
            if history is None:
                return None
            return 0.0
        time = self.fields.time
        if not self.cut:
            return float(history.slid(time)[1][-1] @ history.areas)
        if history.friction_power is None:
            return None
        work = np.concatenate([[0.0], np.cumsum(history.friction_power[1:] * np.diff(time))])
        return float(Signal(time, work[:, None]).until(self.end).values[-1, 0])

    @cached_property
    def largest_velocity(self) -> float:
        """Largest component of the velocities of the faces, m s-1."""
        if self.history is None:
            return 0.0
        return float(np.abs(self.history.velocity).max(initial=0.0))

    @cached_property
    def largest_resultant(self) -> float | None:
        """Largest resultant of all tractions, N."""
        if self.history is None:
            return None
        return float(np.linalg.norm(self.history.force(), axis=1).max())

    @property
    def areas(self) -> Array:
        """Areas of the points, m2."""
        assert self.fields is not None
        return self.fields.areas

    @cached_property
    def way(self) -> Array:
        """Distance that the points have slid in contact, (n_time, n_point), m."""
        assert self.history is not None
        assert self.fields is not None
        return np.asarray(np.linalg.norm(slip_in_contact(self.history, self.fields.time), axis=2))

    @property
    def slip_share(self) -> float | None:
        """Largest share of the area that slips at one instant."""
        if self.fields is None:
            return None
        return largest_slip_share(self.fields)


@dataclass(frozen=True)
class Band:
    """What motions of a sensor are measured in.

    Attributes
    ----------
    chosen : low pass. highest : frequency that the mesh resolves, Hz. frequencies : of the spectrum, Hz, empty where
        none is requested. quality : of its oscillators. spectrum : the spectrum where it exists already.
    """

    chosen: Filter
    highest: float
    frequencies: tuple[float, ...] = ()
    quality: float = 10.0
    spectrum: ShockSpectrum | None = None


@dataclass(frozen=True)
class SensorRecord:
    """A sensor; its motions are those of the whole run, or until the end of an interval.

    Attributes
    ----------
    displacement : m. velocity : m s-1, and acceleration : m s-2; None where it has none. moves : whether it has an
        acceleration. end : of the interval, s; None where all of the run counts. band : of the quantities in a band,
        None where there are none. requested : spectrum of its acceleration, None where there is none.
    """

    history: SensorHistory
    time: Array
    displacement: Signal
    velocity: Signal | None
    acceleration: Signal | None
    end: float | None = None
    band: Band | None = None
    requested: ShockSpectrum | None = None

    @classmethod
    def of(
        cls,
        history: SensorHistory,
        time: Array,
        end: float | None = None,
        band: Band | None = None,
        spectrum: ShockSpectrum | None = None,
    ) -> SensorRecord:
        """From the history of a run with its instants (n_time,), s."""
        motions = (history.displacement, history.velocity, history.acceleration)
        moved, speed, jerked = (None if v is None else Signal(time, v).until(end) for v in motions)
        assert moved is not None
        return cls(history, time, moved, speed, jerked, end, band, spectrum)

    @property
    def moves(self) -> bool:
        """Whether it has an acceleration: none without inertia."""
        return self.acceleration is not None

    @property
    def has_spectrum(self) -> bool:
        """Whether a spectrum is requested."""
        return self.spectrum is not None

    @cached_property
    def spectrum(self) -> ShockSpectrum | None:
        """Shock response spectrum of the acceleration: as requested, or with a band up to the frequency that the steps
        resolve."""
        band, samples = self.band, self.history.acceleration
        if band is None or samples is None or not (step := uniform_step(self.time)):
            return self.requested
        frequencies = np.array([f for f in band.frequencies if f <= highest_frequency(step)])
        if not frequencies.size:
            return None
        if band.spectrum is not None:
            return band.spectrum
        return shock_response_spectrum(samples, step, frequencies, band.quality, interpolation=LINES)

    @property
    def largest_of_spectrum(self) -> tuple[int, ...]:
        """Place of the largest value of the maximax spectrum: frequency and axis."""
        assert self.spectrum is not None
        values = self.spectrum.acceleration[0]
        return tuple(int(i) for i in np.unravel_index(int(np.argmax(values)), values.shape))

    @cached_property
    def maximax(self) -> Signal | None:
        """Maximax spectrum over the frequencies that the mesh resolves; None without a band, or none of these."""
        if self.band is None or self.spectrum is None:
            return None
        n = int(np.count_nonzero(self.spectrum.frequency <= self.band.highest))
        if n:
            return Signal(self.spectrum.frequency[:n], self.spectrum.acceleration[0, :n])
        return None

    def _in_band(self, motion: Array | None) -> Signal | None:
        """A motion behind the filter of the band; it ends half a period of the cut-off before the interval, for the
        filter needs what follows. None where the steps are too long, or the run shorter than a period."""
        band, end = self.band, self.end
        if band is None or end is None or motion is None or not self.moves or not (step := uniform_step(self.time)):
            return None
        cutoff = band.chosen.cutoff
        if cutoff >= _MEASURED * nyquist(step) or cutoff * end < 1.0:
            return None
        return Signal(self.time, low_pass(motion, band.chosen, step)).until(end - 0.5 / cutoff)

    @cached_property
    def velocity_in_band(self) -> Signal | None:
        """Velocity in the band, m s-1."""
        return self._in_band(self.history.velocity)

    @cached_property
    def acceleration_in_band(self) -> Signal | None:
        """Acceleration in the band, m s-2."""
        return self._in_band(self.history.acceleration)


@dataclass(frozen=True)
class BoltRecord:
    """A bolt.

    Attributes
    ----------
    tension : of the whole run, or until the end of an interval, (n_time, 1), N. margin : smallest safety of its checks
        by VDI 2230-1 over the run, less 1 (``BoltMargins.smallest``); None without a check, or the interfaces of the
        run.
    """

    history: BoltHistory
    tension: Signal
    margin: float | None = None

    @classmethod
    def of(
        cls,
        history: BoltHistory,
        time: Array,
        end: float | None = None,
        interfaces: Mapping[str, InterfaceHistory] | None = None,
    ) -> BoltRecord:
        """From the history of a run with its instants (n_time,), s, and its interfaces by name."""
        margin = None
        if interfaces is not None and (smallest := BoltMargins.of(history, interfaces).smallest) is not None:
            margin = smallest.safety - 1.0
        return cls(history, Signal(time, history.force[:, None]).until(end), margin)

    @property
    def checked(self) -> bool:
        """Whether it has a margin."""
        return self.margin is not None


def reported(owner: str, record: Any) -> dict[str, float | None]:
    """Scalars of an owner in the report, by name; None in the place of one that it has not, or that is not finite."""
    rows = (row for row in rows_of(owner) if row.report is not None)
    return {row.report or row.key: finite(row.value(record)) for row in rows}


def stored_rows(owner: str) -> dict[str, StoredQuantity]:
    """Rows of the scalars of an owner in a file, by key."""
    return {row.key: _stored(row, row.stored) for row in rows_of(owner) if row.stored is not None}


def _stored(row: RunScalar, text: str) -> StoredQuantity:
    meaning, _, comment = (part.strip() for part in (text or row.long_name).partition("|"))
    return StoredQuantity(row.key, row.unit, (), meaning, comment or None, row.value)


def stored_scalars(owner: str, record: Any) -> Columns:
    """Scalars of an owner in a file, those that it has."""
    pairs = [(row, row.of(record)) for row in stored_rows(owner).values()]
    return [(row, value) for row, value in pairs if value is not None]
