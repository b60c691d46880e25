"""Outputs of a co-simulation: resultants of interfaces, sensors, bolts; rows and arrays of the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..interface.laws import SEPARATION, SLIP, STICK
from ..latin.record import Array, BoltHistory, InterfaceHistory, PointFields, SensorHistory
from .variables import ENERGIES


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
