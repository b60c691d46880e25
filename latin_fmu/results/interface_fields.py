"""What quantities of an interface are made of: its normal force over time, its fields at the points.

The functions take an ``InterfaceFields``, made from a solver history or from a stored group, so that a file and a
fresh solution give the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from ..latin.outcome import Array, InterfaceHistory

if TYPE_CHECKING:
    import xarray as xr

CONTACT_SHARE = 0.01
"""Share of its largest value the normal resultant must exceed for an interface to count as in contact."""

SEPARATION_SHARE: Final = 0.1
"""Share of the peak force below which its running mean stays after the separation. A front leaves a ripple of one or
two per cent in a joint that it has opened: with 1 % of single instants the separation is that of the last ripple."""

NEAR_PEAK: Final = 0.8
"""Share of a peak from which on a history counts as near it."""

PEAK_SHARE: Final = 0.1
"""Duration of the mean that is the peak force over the longest contact, where the scene names none."""

ROUND_OFF = 1e-9
"""A normal resultant below this share of the largest sum of area x |traction| is round-off, not contact."""

_OPEN = 0
_STICK = 1
_SLIP = 2


@dataclass(frozen=True)
class Force:
    """Normal resultant of an interface over time: linear between (time, value); a time met twice is a jump.

    ``time`` (n,), s, never decreasing; ``value`` (n,), N, positive in compression.
    """

    time: Array
    value: Array

    def impulse(self) -> float:
        """Integral over time, N s."""
        return float(np.sum(np.diff(self.time) * 0.5 * (self.value[1:] + self.value[:-1])))

    def impulse_of_size(self) -> float:
        """Integral of the magnitude, N s."""
        return Force(self.time, np.abs(self.value)).impulse()

    def norm(self) -> float:
        """sqrt(integral of value^2 dt), exact for linear pieces."""
        a, b = self.value[:-1], self.value[1:]
        return float(np.sqrt(np.sum(np.diff(self.time) * (a * a + a * b + b * b)) / 3.0))

    def root_mean_square(self) -> float:
        """``norm`` over the root of the time that the history covers, N."""
        span = float(self.time[-1] - self.time[0])
        if span > 0.0:
            return float(self.norm() / span**0.5)
        return self.raw_peak()

    def distance(self, other: Force) -> float:
        """L2 distance to another history over the time both cover."""
        last = min(self.time[-1], other.time[-1])
        grid = np.union1d(self.time, other.time)
        grid = grid[grid <= last]
        a, b = grid[:-1], grid[1:]
        first = self._at(a, "right") - other._at(a, "right")
        second = self._at(b, "left") - other._at(b, "left")
        return float(np.sqrt(np.sum((b - a) * (first**2 + first * second + second**2)) / 3.0))

    def _piece(self, t: Array, side: Literal["left", "right"]) -> tuple[NDArray[np.intp], Array]:
        """Piece that holds the instants ``t``, seen from before (left) or after (right), and the share of it passed."""
        i = np.clip(np.searchsorted(self.time, t, side=side) - 1, 0, len(self.time) - 2)
        span = self.time[i + 1] - self.time[i]
        # a piece of no length is a jump, which is passed
        return i, np.where(span > 0.0, (t - self.time[i]) / np.where(span > 0.0, span, 1.0), 1.0)

    def _at(self, t: Array, side: Literal["left", "right"]) -> Array:
        """Limits at the instants ``t`` from before (left) or after (right)."""
        i, share = self._piece(t, side)
        result: Array = (1.0 - share) * self.value[i] + share * self.value[i + 1]
        return result

    def _integral(self, t: Array) -> Array:
        """Integral from the first instant to the instants ``t``, N s, exact for linear pieces."""
        a = self.value[:-1]
        b = self.value[1:]
        step = np.diff(self.time)
        whole = np.concatenate([[0.0], np.cumsum(0.5 * step * (a + b))])
        i, share = self._piece(t, "right")
        result: Array = whole[i] + step[i] * share * (a[i] + 0.5 * share * (b[i] - a[i]))
        return result

    def raw_peak(self) -> float:
        """Largest magnitude of all instants, N."""
        return float(np.abs(self.value).max(initial=0.0))

    def peak_mean(self, duration: float) -> tuple[float, float]:
        """Largest magnitude of the mean over a moving window of ``duration`` (s), N, and the start of that window, s.

        Exact for linear pieces.

        The mean m(t) over [t, t + T] has m' = (F(t + T) - F(t)) / T, which is linear between the instants at which an
        end of the window meets a knot: m is largest there, or where m' changes its sign in between. A window longer
        than the history is cut to it; one of no length gives the raw peak.
        """
        if len(self.time) < 2 or duration <= 0.0:
            return self.raw_peak(), float(self.time[np.abs(self.value).argmax()])
        duration = min(duration, float(self.time[-1] - self.time[0]))
        last = self.time[-1] - duration
        # either end of the window meets a knot
        starts = np.unique(np.concatenate([self.time, self.time - duration, [last]]))
        starts = starts[(starts >= self.time[0]) & (starts <= last)]
        a, b = starts[:-1], starts[1:]
        first = self._at(a + duration, "right") - self._at(a, "right")
        second = self._at(b + duration, "left") - self._at(b, "left")
        # an extremum inside, where the difference of both ends changes its sign
        turns = first * second < 0.0
        inside = a[turns] + (b - a)[turns] * first[turns] / (first - second)[turns]
        starts = np.concatenate([starts, inside])
        means = np.abs(self._integral(starts + duration) - self._integral(starts)) / duration
        return float(means.max()), float(starts[means.argmax()])

    def largest_mean(self, duration: float) -> float:
        """Largest magnitude of the mean over a moving window of ``duration`` (s), N."""
        return self.peak_mean(duration)[0]

    def jumps(self, duration: float) -> bool:
        """Whether the force changes within ``duration`` (s) by more than half of its raw peak."""
        last = np.minimum(self.time + duration, self.time[-1])
        return bool(np.abs(self._at(last, "left") - self.value).max(initial=0.0) > 0.5 * self.raw_peak())

    def running_mean(self, duration: float, starts: Array) -> Array:
        """Mean over [t, t + duration] (s) for the instants t of ``starts`` (k,), (k,), N; the last value is continued
        beyond the end. The force itself where the duration is zero."""
        if duration <= 0.0:
            return self._at(starts, "right")
        last = float(self.time[-1])
        beyond = np.maximum(starts + duration - last, 0.0) * self.value[-1]
        whole: Array = self._integral(np.minimum(starts + duration, last)) - self._integral(starts) + beyond
        return whole / duration

    def apart_near_peak(self, other: Force, duration: float) -> float:
        """Largest distance of the running means of two histories where that of this one is at least ``NEAR_PEAK`` of
        its largest, N: a bound of the difference of the peak forces that is not small by chance."""
        starts = np.unique(np.concatenate([t for f in (self, other) for t in (f.time, f.time - duration)]))
        last = min(self.time[-1], other.time[-1]) - duration
        starts = starts[(starts >= self.time[0]) & (starts <= last)]
        if not starts.size:
            return abs(self.largest_mean(duration) - other.largest_mean(duration))
        mean, other_mean = (f.running_mean(duration, starts) for f in (self, other))
        near = np.abs(mean) >= NEAR_PEAK * np.abs(mean).max()
        return float(np.abs(mean - other_mean)[near].max())

    def separation(self, duration: float) -> float:
        """Last instant t at which the mean of the magnitude over [t, t + duration] (s) is at least ``SEPARATION_SHARE``
        of the peak force, s; the end of the history where it is still loaded then.

        Beyond the end the force is continued by its last value, or by zero where its mean over the last such interval
        is below the threshold: a contact that begins just before the end is none yet.
        """
        size, end = Force(self.time, np.abs(self.value)), float(self.time[-1])
        level = SEPARATION_SHARE * size.largest_mean(duration)
        if size.running_mean(duration, np.array([max(end - duration, self.time[0])]))[0] < level:
            size = Force(np.append(self.time, end), np.append(size.value, 0.0))
        starts = np.unique(np.concatenate([self.time, self.time - duration]))
        starts = starts[starts >= self.time[0]]
        mean = size.running_mean(duration, starts)
        if level > 0.0 and mean.max() >= level:
            i = int(np.flatnonzero(mean >= level)[-1])
        else:
            i = len(starts) - 1
        if i == len(starts) - 1:
            return end
        first, last = float(starts[i]), float(starts[i + 1])
        # between two starts the mean is a parabola: a + b x + c x^2 over 0 <= x <= 1, which falls below the level once
        a, half, whole = (float(m) for m in size.running_mean(duration, np.linspace(first, last, 3)) - level)
        c = 2.0 * (a - 2.0 * half + whole)
        b = whole - a - c
        root = b * b - 4.0 * a * c
        # 2 a over a sum of one sign: no cancellation where c is small
        if a > 0.0:
            x = -2.0 * a / (b - np.sqrt(max(root, 0.0)))
        else:
            x = 0.0
        return first + float(np.clip(x, 0.0, 1.0)) * (last - first)

    def begin(self) -> float:
        """First instant at which the magnitude exceeds ``CONTACT_SHARE`` of its peak, s."""
        return Force(self.time, np.abs(self.value)).first_above(CONTACT_SHARE * self.raw_peak())

    def first_above(self, level: float) -> float:
        """First instant at which the value exceeds ``level`` (N), s; the first of all where it never does."""
        i = int(np.argmax(self.value > level))
        if i == 0:
            return float(self.time[0])
        share = (level - self.value[i - 1]) / (self.value[i] - self.value[i - 1])
        return float(self.time[i - 1] + share * (self.time[i] - self.time[i - 1]))

    def longest_contact(self) -> float:
        """Longest time for which the force keeps its sign above 1 % of its raw peak, s."""
        level = CONTACT_SHARE * self.raw_peak()
        if len(self.time) < 2 or not level > 0.0:
            return 0.0
        sign = np.where(np.abs(self.value) > level, np.sign(self.value), 0.0)
        # zeros around: a contact may begin or end with the history
        edges = np.flatnonzero(np.diff(np.concatenate([[0.0], sign, [0.0]])))
        begin, after = edges[:-1], edges[1:]
        loaded = sign[begin] != 0.0
        begin, after = begin[loaded], after[loaded]

        def crossing(inner: NDArray[np.intp], outer: NDArray[np.intp]) -> Array:
            """Instant of the level between a knot above it and its neighbour; the knot where there is none."""
            outer = np.clip(outer, 0, len(self.time) - 1)
            value, beyond = sign[inner] * self.value[inner], sign[inner] * self.value[outer]
            fall = np.where(outer == inner, 1.0, value - beyond)
            share = np.where(outer == inner, 0.0, (value - level) / fall)
            result: Array = self.time[inner] + share * (self.time[outer] - self.time[inner])
            return result

        return float((crossing(after - 1, after) - crossing(begin, begin - 1)).max())

    def peak_duration(self, requested: float | None) -> float:
        """Duration of the mean that is the peak force, s: as requested, else a tenth of the longest contact."""
        if requested is None:
            return PEAK_SHARE * self.longest_contact()
        return requested


@dataclass(frozen=True)
class InterfaceFields:
    """Local-stage fields of one interface.

    Attributes
    ----------
    time : (n_time,), s. areas : (n_point,), m2. normals : (n_point, 3), unit, from E to E'.
    traction : (n_time, n_point, 3), what the interface exerts on side E, Pa.
    contact_status : (n_time, n_point), separation 0, stick 1, slip 2; None where it cannot open.
    peak_duration : that the scene names, s; None where it names none.
    gap : (n_time, n_point), m, and velocity : (n_time, 2, n_point, 3), m s-1; None where they are not known.
    """

    time: Array
    areas: Array
    normals: Array
    traction: Array
    contact_status: NDArray[np.int8] | None
    peak_duration: float | None = None
    gap: Array | None = None
    velocity: Array | None = None

    @classmethod
    def of_history(cls, history: InterfaceHistory, time: Array) -> InterfaceFields:
        """Fields of a solver history over the run's instants ``time`` (n_time,), s."""
        status, duration = history.contact_status, history.peak_duration
        moved = history.gap, history.velocity
        return cls(time, history.areas, history.normals, history.traction, status, duration, *moved)

    @classmethod
    def of_dataset(cls, dataset: xr.Dataset, motion: bool = False) -> InterfaceFields:
        """Fields of a stored group ``interfaces/<name>``; gap and velocity, which are large, where ``motion``."""
        status = None
        if "contact_status" in dataset:
            status = dataset["contact_status"].values
        columns = (dataset[name].values for name in ("time", "area", "normal", "traction"))
        time, areas, normals, traction = (np.asarray(values, dtype=float) for values in columns)
        duration = None
        if "peak_force" in dataset:
            duration = dataset["peak_force"].attrs["peak_duration"]
        wanted: tuple[str, ...] = ()
        if motion:
            wanted = ("gap", "velocity")
        moved = (dataset[name].values if name in dataset else None for name in wanted)
        return cls(time, areas, normals, traction, status, duration, *moved)


def normal_resultant(fields: InterfaceFields) -> Array:
    """Resultant along the normals, (n_time,), N, positive in compression."""
    resultant: Array = -np.einsum("p,tpc,pc->t", fields.areas, fields.traction, fields.normals)
    return resultant


def friction_resultant(fields: InterfaceFields) -> Array:
    """Magnitude of the resultant of the tangential tractions, (n_time,), N."""
    along = np.einsum("tpc,pc->tp", fields.traction, fields.normals)
    tangential = np.einsum("p,tpc->tc", fields.areas, fields.traction)
    # before the sum: normals of a curved face differ from point to point
    tangential -= np.einsum("p,tp,pc->tc", fields.areas, along, fields.normals)
    length: Array = np.linalg.norm(tangential, axis=1)
    return length


def slip_in_contact(history: InterfaceHistory, time: Array) -> Array:
    """Motion of side E' along the face of E while the point is closed, summed up from the first instant, (n_time,
    n_point, 3), m: a step counts where the point is closed at both its ends (at its end without inertia).

    Free flight and landing are left out, so that the length is the distance over which friction acts on a straight way.
    """
    path = history.slip_path(time)
    if history.contact_status is None:
        return path
    closed = np.asarray(history.contact_status) != _OPEN
    # without inertia a step is the state at its end
    if history.quasi_static:
        counts = closed[1:]
    else:
        counts = closed[1:] & closed[:-1]
    moved = np.where(counts[:, :, None], np.diff(path, axis=0), 0.0)
    slid: Array = np.concatenate([np.zeros((1, *path.shape[1:])), np.cumsum(moved, axis=0)])
    return slid


STUCK: Final = 1e-3
"""Slip over the largest elastic relative motion up to which a joint sticks: below, points whose force vanishes slide by
round-off of the motion of the faces."""


def elastic_relative_motion(history: InterfaceHistory, time: Array) -> float:
    """Largest motion of a point of a face relative to the rigid motion of this face (least squares), over sides and
    instants, m: the elastic deformation of the joint since the first instant."""
    x = history.points - history.points.mean(axis=0)
    one, zero = np.ones(len(x)), np.zeros(len(x))
    turns = [np.stack(t, 1) for t in ((zero, -x[:, 2], x[:, 1]), (x[:, 2], zero, -x[:, 0]), (-x[:, 1], x[:, 0], zero))]
    shifts = [np.outer(one, axis) for axis in np.eye(3)]
    # columns of one size: lengths of the rotations are those of the face
    motions = np.stack([(m / (np.abs(m).max() or 1.0)).ravel() for m in (*shifts, *turns)], axis=1)
    basis = np.linalg.svd(motions, full_matrices=False)[0]
    largest = 0.0
    for side in (0, 1):
        velocity = history.velocity[:, side].reshape(len(time), -1)
        # without inertia velocities are those over the step that ends at the instant
        if history.quasi_static:
            mean = velocity[1:]
        else:
            mean = 0.5 * (velocity[1:] + velocity[:-1])
        motion = np.cumsum(mean * np.diff(time)[:, None], axis=0)
        motion -= (motion @ basis) @ basis.T
        largest = max(largest, float(np.linalg.norm(motion.reshape(-1, len(x), 3), axis=2).max(initial=0.0)))
    return largest


def friction_used(history: InterfaceHistory, fields: InterfaceFields) -> float:
    """Largest ratio of the resultant of friction to its limit, mu times the normal one, of loaded instants."""
    normal = np.abs(history.normal_resultant())
    loaded = normal > CONTACT_SHARE * normal.max(initial=0.0)
    return float((friction_resultant(fields)[loaded] / normal[loaded]).max(initial=0.0) / history.mu)


_NO_SLIP: Final = 1e-12
"""Slip over the size of a face that is round-off: of a joint that is tightened and then left alone."""


def sticks(history: InterfaceHistory, fields: InterfaceFields, time: Array) -> bool:
    """Whether a joint with friction sticks: nearly no point ever slips; or friction stays below its limit as a whole at
    every instant, and no point slips by more than ``STUCK`` times the largest elastic relative motion."""
    if (largest_slip_share(fields) or 0.0) < LITTLE_AREA:
        return True
    if friction_used(history, fields) > AS_A_WHOLE:
        return False
    slid = float(np.linalg.norm(slip_in_contact(history, time), axis=2).max(initial=0.0))
    if slid < _NO_SLIP * float(np.linalg.norm(np.ptp(history.points, axis=0))):
        return True
    return slid < STUCK * elastic_relative_motion(history, time)


LITTLE_AREA: Final = 5e-3
"""Share of an area that sentences leave out."""
AS_A_WHOLE: Final = 0.99
"""Share of the limit of friction from which a joint slips as a whole."""


def closing_time(fields: InterfaceFields, peak: float) -> float | None:
    """Instant at which an initial gap closes, from gap and velocity at the instant before the first contact, s.

    None where the sides touch from the start, never touch, or where the force defines the instant. peak : raw, N.
    """
    if fields.gap is None or fields.velocity is None:
        return None
    i = int(np.argmax(np.abs(normal_resultant(fields)) > CONTACT_SHARE * peak))
    if i == 0:
        return None
    # traction on E along its outward normal: pressure is negative
    pressed = np.einsum("pc,pc->p", fields.traction[i], fields.normals) < 0.0
    gap = fields.gap[i - 1][pressed]
    if not gap.size or gap.min() <= 0.0:
        return None
    jump = fields.velocity[i - 1, 1] - fields.velocity[i - 1, 0]
    closing = -np.einsum("pc,pc->p", jump, fields.normals)[pressed]
    with np.errstate(divide="ignore"):
        wait = float(np.min(np.where(closing > 0.0, gap / closing, np.inf)))
    # the gap has closed by the instant at which there is a force
    return float(min(fields.time[i - 1] + wait, fields.time[i]))


def status_shares(fields: InterfaceFields) -> Array:
    """Share of the area in separation, stick and slip, (n_time, 3); rows add up to 1.

    Raises ``ValueError`` for an interface that cannot open (no contact status).
    """
    if fields.contact_status is None:
        raise ValueError("this interface has no contact status: it cannot open")
    share = fields.areas / fields.areas.sum()
    states = (_OPEN, _STICK, _SLIP)
    return np.stack([(fields.contact_status == state) @ share for state in states], axis=1)


def largest_slip_share(fields: InterfaceFields) -> float | None:
    """Largest share of the area that slips at one instant; None for an interface that cannot open."""
    if fields.contact_status is None:
        return None
    return float(status_shares(fields)[:, _SLIP].max(initial=0.0))
