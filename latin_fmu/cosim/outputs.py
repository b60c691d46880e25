"""Outputs of a co-simulation: resultants of interfaces, arrays of the table, contact events.

``kernels.outputs`` makes the rows of scalar outputs, with coefficients that are read from ``InterfaceSeries``
(``signals``), and follows the contact events.

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

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..interface.laws import SEPARATION, SLIP, STICK
from ..latin.outcome import Array, InterfaceHistory, PointFields
from .variables import EVENTS

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


def series_of(interfaces: Mapping[str, InterfaceHistory]) -> dict[str, InterfaceSeries]:
    """Resultants of every interface at the instants of its history."""
    return {name: InterfaceSeries.of(h.points_over_time, *faces_of(h)) for name, h in interfaces.items()}


def faces_of(history: InterfaceHistory) -> tuple[Array, Array, Array]:
    """Areas of the points of an interface, their shares of the whole area, and normals."""
    return history.areas, history.areas / history.areas.sum(), history.normals


def first_event(rows: Array) -> int | None:
    """Index of the first instant whose events are not those of the instant before; None where there is none. ``rows`` :
    outputs of the events."""
    counts = rows[:, ::_PAIR]
    changed = np.flatnonzero((counts[1:] != counts[:-1]).any(axis=1))
    return int(changed[0]) + 1 if len(changed) else None


def between(first: Array, second: Array, time: float) -> Array:
    """Outputs of the events at a time between two instants: each event is there from its instant on."""
    here = np.repeat(second[1::_PAIR] <= time, _PAIR)
    return np.where(here, second, first)


def shifted(row: Array, inner_time: int, of_event: int, start: float) -> Array:
    """Outputs with their instants (the place of ``innerTime``, those of the events from ``of_event`` on) counted from a
    zero that is ``start``, s, earlier."""
    late = row.copy()
    late[inner_time] += start
    late[of_event + 1 :: _PAIR] += np.where(row[of_event::_PAIR] > 0.0, start, 0.0)
    return late
