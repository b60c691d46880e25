"""Scalar outputs in the order of the variable table, from what a solved interval left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..latin.record import Array, InterfaceHistory
from .series import InterfaceSeries, impulse_steps
from .variables import ENERGIES

Motion = tuple[Array, Array]  # displacement, velocity (n, 3) of a sensor


def series_of(interfaces: Mapping[str, InterfaceHistory]) -> dict[str, InterfaceSeries]:
    """Resultants of every interface."""
    return {name: InterfaceSeries.of(history) for name, history in interfaces.items()}


def impulses(series: Mapping[str, InterfaceSeries], dt: float, start: Array) -> Array:
    """Running impulses (n, n_interface, 3), N s; ``start`` (n_interface, 3) at the first instant."""
    steps = [impulse_steps(s.force, dt) for s in series.values()]
    return start + np.stack(steps, axis=1) if steps else np.zeros((1, 0, 3))


def rows_of(
    series: Mapping[str, InterfaceSeries],
    impulse: Array,
    sensors: Sequence[Motion],
    solver: Sequence[float],
    energy: Mapping[str, Array] | None,
    n: int,
) -> Array:
    """(n, n_output): one row per instant.

    impulse : (n, n_interface, 3). solver : iterations, indicator, converged, instants of the interval.
    energy : terms (n,), None where the scene asks for none.
    """
    parts = [s.columns(impulse[:, i]) for i, s in enumerate(series.values())]
    for displacement, velocity in sensors:
        parts += [displacement, velocity]
    parts.append(np.tile(np.asarray(solver, dtype=float), (n, 1)))
    if energy is not None:
        parts.append(np.stack([energy[term] for term in ENERGIES], axis=1))
    return np.concatenate(parts, axis=1)
