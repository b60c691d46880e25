"""Sensors in the results: their group of the file, their lines of the summary, their part of the report."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ..latin.record import Array, Outcome, SensorHistory
from .groups import SENSOR, Columns, Group, annotated
from .summary import aligned, finite, readable

MOTIONS: Final = {"displacement": "m", "velocity": "m s-1", "acceleration": "m s-2"}
"""What a sensor measures, with units."""


def motions_of(history: SensorHistory) -> dict[str, Array]:
    """Displacement, velocity and, where there is one, acceleration of a sensor, (n_time, 3) each."""
    every = {name: getattr(history, name) for name in MOTIONS}
    return {name: values for name, values in every.items() if values is not None}


def sensor_group(history: SensorHistory, time: Array) -> Group:
    """Group ``sensors/<name>``: motions (time, component), and the place of the sensor."""
    columns: Columns = {name: (("time", "component"), values) for name, values in motions_of(history).items()}
    labels: dict[str, object] = {"time": time, "component": ["x", "y", "z"]}
    labels |= {axis: ((), float(history.point[i])) for i, axis in enumerate("xyz")}
    attrs: dict[str, object] = {"substructure": history.substructure}
    if history.face is not None:
        attrs["face"] = history.face
    if history.acceleration is None:
        attrs["acceleration"] = f"none: {history.remark}"
    group = annotated(Group.of(columns, labels, attrs), SENSOR)
    for name in columns:
        if history.face is not None:
            group.variables[name].attrs["cell_methods"] = "area: mean"
    if history.acceleration is not None and history.remark:
        group.variables["acceleration"].attrs["comment"] = history.remark
    return group


def sensor_groups(outcome: Outcome) -> dict[str, Group]:
    """Groups of all sensors of a run by path."""
    return {f"/sensors/{name}": sensor_group(history, outcome.time) for name, history in outcome.sensors.items()}


def _largest(values: Array | None, time: Array) -> tuple[float, float] | None:
    """Largest magnitude over time of vectors (n_time, 3), and when."""
    if values is None:
        return None
    size = np.linalg.norm(values, axis=1)
    i = int(np.argmax(size))
    return float(size[i]), float(time[i])


def _shown(largest: tuple[float, float] | None, unit: str) -> str:
    """A largest value; accelerations without prefix."""
    if largest is None:
        return "-"
    return f"{largest[0]:.4g} {unit}" if unit == "m s-2" else readable(largest[0], unit)


def sensor_lines(outcome: Outcome) -> list[str]:
    """Table of the largest motions of the sensors."""
    rows: list[tuple[str, ...]] = [("sensor", "on", *(f"largest {name}" for name in MOTIONS), "at")]
    for name, history in outcome.sensors.items():
        largest = [_largest(getattr(history, motion), outcome.time) for motion in MOTIONS]
        cells = [_shown(pair, unit) for pair, unit in zip(largest, MOTIONS.values(), strict=True)]
        last = next(pair for pair in reversed(largest) if pair is not None)
        rows.append((name, history.face or history.substructure, *cells, readable(last[1], "s")))
    return aligned(rows) if len(rows) > 1 else []


def sensor_report(outcome: Outcome) -> dict[str, Any]:
    """Per sensor ``substructure``, ``face`` (None of a point), ``point`` (m) and ``largest_displacement`` (m),
    ``largest_velocity`` (m s-1), ``largest_acceleration`` (m s-2), None in quasi-static runs: largest magnitudes over
    time."""
    return {
        name: {"substructure": history.substructure, "face": history.face, "point": [float(x) for x in history.point]}
        | {
            f"largest_{motion}": None if pair is None else finite(pair[0])
            for motion in MOTIONS
            for pair in [_largest(getattr(history, motion), outcome.time)]
        }
        for name, history in outcome.sensors.items()
    }
