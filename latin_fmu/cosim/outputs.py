"""Outputs of a co-simulation: resultants of interfaces, sensors, bolts, contact events; rows and arrays of the table.

Contact events are touch, separation and slip: how many there were, and the instant of the last one. An event belongs to
an interface as a whole and lies in the time step from t_(j-1) to t_j in which its state changes:

=============  ====================================  ===============================================================
event          state at t_(j-1), at t_j              instant, kept inside the time step
=============  ====================================  ===============================================================
touch          no point in contact, some             t_(j-1) + min over the points in contact at t_j of g / v
separation     some point in contact, none           t_(j-1) + N / (-dN/dt)
slip           some point in contact sticks, none    t_(j-1) + (q_j - q) / (dq/dt), q = |T| / N
=============  ====================================  ===============================================================

g is the gap at a point and v the speed at which it closes; N and T are the normal and the tangential resultant, and q_j
is on the friction cone. Values without index are those at t_(j-1), rates of N and q those over the time step before it.
Each instant is where a straight line reaches the state that the event begins: its error is of second order in the time
step where g, N or q are smooth before the event. Where the line does not reach it the instant is t_j.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..interface.laws import SEPARATION, SLIP, STICK
from ..latin.outcome import Array, BoltHistory, InterfaceHistory, PointFields, SensorHistory
from .variables import ENERGIES, EVENTS

_TOUCH, _SEPARATION = 0, 1  # of EVENTS, before slip
_PAIR: Final = 2  # columns of an event: how many, instant of the last one
COLUMNS: Final = _PAIR * len(EVENTS)  # of an interface


@dataclass(frozen=True)
class InterfaceSeries:
    """Resultants of one interface at n instants.

    Attributes
    ----------
    force : (n, 3) on side E, N. velocity : (n, 2, 3) means of both sides weighted by area, m s-1.
    normal_force : (n,) positive in compression, N. gap, smallest_gap : (n,), m, None where it cannot open.
    shares : (n, 3) closed, sticking, slipping shares of the area; None where it cannot open.
    """

    force: Array
    velocity: Array
    normal_force: Array
    gap: Array | None
    smallest_gap: Array | None
    shares: Array | None

    @classmethod
    def of(cls, fields: PointFields, areas: Array, share: Array, normals: Array) -> InterfaceSeries:
        """Resultants of fields at points with these areas, their shares of the whole area (n_point,), and normals
        (n_point, 3)."""
        gap = smallest = shares = None
        if fields.gap is not None:
            gap, smallest = fields.gap @ share, fields.gap.min(axis=1)
        if fields.contact_status is not None:
            status = fields.contact_status
            shares = np.empty((len(status), 3))
            for i, state in enumerate((status != SEPARATION, status == STICK, status == SLIP)):
                shares[:, i] = state @ share
        return cls(
            np.einsum("p,tpc->tc", areas, fields.traction),
            np.einsum("p,tspc->tsc", share, fields.velocity),
            0.0 - np.einsum("p,tpc,pc->t", areas, fields.traction, normals),  # no negative zero
            gap,
            smallest,
            shares,
        )

    def last(self) -> InterfaceSeries:
        """The last instant only."""
        cut = (None if v is None else v[-1:] for v in (self.gap, self.smallest_gap, self.shares))
        return InterfaceSeries(self.force[-1:], self.velocity[-1:], self.normal_force[-1:], *cut)

    def columns(self, impulse: Array) -> list[Array]:
        """Scalar outputs (n, ...) of the interface in the order of the variable table.

        impulse : (n, 3), N s.
        """
        relative = self.velocity[:, 1] - self.velocity[:, 0]
        parts = [self.force, impulse, self.velocity[:, 0], self.velocity[:, 1], relative, self.normal_force[:, None]]
        if self.gap is not None and self.smallest_gap is not None and self.shares is not None:
            parts += [self.gap[:, None], self.smallest_gap[:, None], self.shares]
        return parts


def array_output(name: str, time: Array, interfaces: Mapping[str, InterfaceHistory], instant: int) -> Array:
    """An array of the variable table by name; empty where there is none.

    time, interfaces : instants and histories of the window. instant : index of the present instant in ``time``.
    """
    if name == "window.time":
        return time
    _, interface, group, quantity = name.split(".")
    if interface not in interfaces:
        return np.zeros(0)
    history = interfaces[interface]
    window = group == "window"
    values = _over_window(series_of({"": history})[""], quantity) if window else _at_points(history, quantity)
    if values is None:
        return np.zeros(0)
    return values if window else np.asarray(values[instant], dtype=float)


def _over_window(series: InterfaceSeries, quantity: str) -> Array | None:
    shares = ("closed", "sticking", "slipping")
    if quantity in shares:
        return None if series.shares is None else series.shares[:, shares.index(quantity)]
    sides = {"velocityE": series.velocity[:, 0], "velocityEp": series.velocity[:, 1]}
    return {**sides, "force": series.force, "gap": series.gap}[quantity]


def _at_points(history: InterfaceHistory, quantity: str) -> Any:
    field: Any = getattr(history, "contact_status" if quantity == "status" else quantity)
    return field


# -- rows of scalar outputs ---------------------------------------------------------------------------------------


def series_of(interfaces: Mapping[str, InterfaceHistory]) -> dict[str, InterfaceSeries]:
    """Resultants of every interface at the instants of its history."""
    return {name: InterfaceSeries.of(h.points_over_time, *faces_of(h)) for name, h in interfaces.items()}


def faces_of(history: InterfaceHistory) -> tuple[Array, Array, Array]:
    """Areas of the points of an interface, their shares of the whole area, and normals."""
    return history.areas, history.areas / history.areas.sum(), history.normals


def impulses(series: Mapping[str, InterfaceSeries], dt: float, start: Array) -> Array:
    """Running impulses (n, n_interface, 3), N s; ``start`` (n_interface, 3) at the first instant."""
    if not series:
        return np.zeros((1, 0, 3))
    total = np.empty((len(next(iter(series.values())).force), len(series), 3))
    for i, s in enumerate(series.values()):
        total[0, i] = 0.0
        np.cumsum(0.5 * dt * (s.force[1:] + s.force[:-1]), axis=0, out=total[1:, i])  # trapezoidal rule
    total += start
    return total


def output_rows(
    series: Mapping[str, InterfaceSeries],
    impulse: Array,
    sensors: Mapping[str, SensorHistory],
    ports: Sequence[Array],
    bolts: Mapping[str, BoltHistory],
    solver: Sequence[float],
    energy: Mapping[str, Array] | None,
    n: int,
) -> Array:
    """Scalar outputs in the order of the variable table, (n, n_output), one row per instant.

    impulse : (n, n_interface, 3). sensors, ports, bolts : histories (ports: columns (n, k)) whose last n
    instants are taken.
    solver : iterations, indicator, converged, instants of the interval.
    energy : terms (n,), None where the scene requests none.
    """
    parts = [column for i, s in enumerate(series.values()) for column in s.columns(impulse[:, i])]
    for sensor in sensors.values():
        parts += [sensor.displacement[-n:], sensor.velocity[-n:]]
    parts += [columns[-n:] for columns in ports]
    parts += [bolt.force[-n:, None] for bolt in bolts.values()]
    parts.append(np.array([tuple(solver)] * n))
    if energy is not None:
        parts += [energy[term][:, None] for term in ENERGIES]
    return np.concatenate(parts, axis=1)


class ContactEvents:
    """Events of the interfaces that can open, followed from step to step.

    Parameters
    ----------
    names : of these interfaces.

    Attributes
    ----------
    state : (n_interface, ``COLUMNS`` + 2) what the next step needs: counts and instants, rates of N (N/s) and q (1/s)
        over the last time step.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self.reset()

    def reset(self) -> None:
        """Return to the start of a simulation: no event so far."""
        self.state: Array = np.zeros((len(self._names), COLUMNS + 2))

    @property
    def row(self) -> Array:
        """Outputs of the events now, (``COLUMNS`` n_interface,)."""
        return self.state[:, :COLUMNS].ravel()

    def follow(
        self,
        time: Array,
        points: Mapping[str, PointFields],
        series: Mapping[str, InterfaceSeries],
        faces: Mapping[str, tuple[Array, Array, Array]],
    ) -> tuple[Array, Array]:
        """Outputs of the events at instants (n + 1, ``COLUMNS`` n_interface), the first of which is the present one,
        and the state at the last; nothing is changed.

        points, series, faces : fields at these instants, their resultants, areas and normals (``faces_of``).
        """
        rows, states = [], np.empty_like(self.state)
        for i, name in enumerate(self._names):
            following, states[i] = _follow(time, points[name], series[name], faces[name], self.state[i])
            rows.append(following)
        return np.concatenate(rows, axis=1) if rows else np.zeros((len(time), 0)), states


def first_event(rows: Array) -> int | None:
    """Index of the first instant whose events are not those of the instant before; None where there is none."""
    counts = rows[:, ::_PAIR]
    changed = np.flatnonzero((counts[1:] != counts[:-1]).any(axis=1))
    return int(changed[0]) + 1 if len(changed) else None


def between(first: Array, second: Array, time: float) -> Array:
    """Outputs of the events at a time between two instants: each event is there from its instant on."""
    here = np.repeat(second[1::_PAIR] <= time, _PAIR)
    return np.where(here, second, first)


def shifted(row: Array, start: float) -> Array:
    """Outputs of the events with their instants counted from a zero that is ``start``, s, earlier."""
    late = row.copy()
    late[1::_PAIR] += np.where(row[::_PAIR] > 0.0, start, 0.0)
    return late


def _follow(
    time: Array, fields: PointFields, series: InterfaceSeries, face: tuple[Array, Array, Array], before: Array
) -> tuple[Array, Array]:
    """Outputs (n + 1, ``COLUMNS``) of one interface, and its state at the last instant."""
    assert series.shares is not None
    closed, sticks = series.shares.T[:2] > 0.0
    if not ((closed[1:] != closed[:-1]) | (sticks[:-1] > sticks[1:])).any():
        state = before.copy()
        state[COLUMNS:] = _rates(time, fields, series, face, slice(-2, None))[-1] if closed[-1] else 0.0
        return before[None, :COLUMNS].repeat(len(time), axis=0), state
    began = (  # in the order of EVENTS
        closed[1:] & ~closed[:-1],
        closed[:-1] & ~closed[1:],
        closed[:-1] & sticks[:-1] & closed[1:] & ~sticks[1:],
    )
    rates = _rates(time, fields, series, face, slice(None))
    earlier, steps = np.concatenate([before[None, COLUMNS:], rates[:-1]]), np.diff(time)
    rows = before[None, :COLUMNS].repeat(len(time), axis=0)
    for event, where in enumerate(began):
        for j in np.flatnonzero(where).tolist():
            if event == _TOUCH:
                after = _time_to_touch(fields, face[2], j)
            elif event == _SEPARATION:
                after = _ratio(series.normal_force[j], -earlier[j, 0])
            else:
                after = _ratio(rates[j, 1] * steps[j], earlier[j, 1])
            rows[j + 1 :, _PAIR * event] += 1.0
            rows[j + 1 :, _PAIR * event + 1] = time[j] + after if after < steps[j] else time[j + 1]
    last = rates[-1] if closed[-1] else np.zeros(2)
    return rows, np.concatenate([rows[-1], last])


def _rates(
    time: Array, fields: PointFields, series: InterfaceSeries, face: tuple[Array, Array, Array], part: slice
) -> Array:
    """Rates (n, 2) of N (N/s) and of q = |T| / N (1/s), 0 without pressure, over the time steps of a part."""
    areas, _, normals = face
    force, pressing = series.force[part], series.normal_force[part]
    normal = (fields.traction[part] * normals).sum(axis=2) * areas
    tangential = force - normal @ normals
    values = np.zeros((2, len(force)))
    values[0] = pressing
    np.divide(np.sqrt((tangential**2).sum(axis=1)), pressing, out=values[1], where=pressing > 0.0)
    times = time[part]
    rates: Array = ((values[:, 1:] - values[:, :-1]) / (times[1:] - times[:-1])).T
    return rates


def _ratio(way: float, speed: float) -> float:
    """Time in which a speed covers a way; infinite where it leads elsewhere."""
    return max(float(way), 0.0) / float(speed) if speed > 0.0 else np.inf


def _time_to_touch(fields: PointFields, normals: Array, j: int) -> float:
    """Time from instant j until the first of the points that touch at the next instant has no gap."""
    assert fields.gap is not None
    assert fields.contact_status is not None
    touched = fields.contact_status[j + 1] != 0
    closing = np.einsum("pc,pc->p", fields.velocity[j, 0] - fields.velocity[j, 1], normals)
    return min((_ratio(g, v) for g, v in zip(fields.gap[j][touched], closing[touched], strict=True)), default=np.inf)
