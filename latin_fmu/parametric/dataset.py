"""The dataset of a study: its parameters are the dimensions.

================  ==============================  ===========================================================
variable          dimensions                      content
================  ==============================  ===========================================================
``state``         parameters                      0 converged, 1 not converged, 2 failed
``converged``     parameters                      1 where the point converged, else 0
``message``       parameters                      how the run ended, or why there is none
quantities        parameters (, part)             ``point.QUANTITIES``; NaN where a point has none
``force`` ...     parameters, part, time (, axis)  resultants of the interfaces, where histories are kept
================  ==============================  ===========================================================

``part`` is ``interface``, ``sensor``, ``boundary`` or ``energy_term``. The scene is in the attributes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr

from ..machine import provenance
from ..results.dataset import AXES
from ..results.groups import CONVENTIONS, SCHEMA_VERSION
from ..scene.schema import Scene
from .grid import Grid, Index, Parameter, value_text
from .point import CONVERGED, QUANTITIES, STATES, Quantity, Record

KIND: Final = "parametric study"
"""Attribute ``kind`` of the file of a study."""
_HISTORIES: Final = {
    "force": ("N", "force on side E of an interface"),
    "normal_force": ("N", "normal force of an interface, positive in compression"),
}


def dataset_of(grid: Grid, scene: Scene, records: Mapping[Index, Record], histories: bool) -> xr.Dataset:
    """Dataset of a study (module docstring): ``records`` of all points of the ``grid``, ``scene`` as written."""
    dims = tuple(p.key for p in grid.parameters)
    coordinates: dict[str, Any] = {p.key: _coordinate(p) for p in grid.parameters}
    states = np.full(grid.shape, 0, dtype=np.int8)
    messages = np.full(grid.shape, "", dtype=object)
    for point, record in records.items():
        states[point], messages[point] = record["state"], record["message"]
    meanings = {"flag_values": np.arange(len(STATES), dtype=np.int8), "flag_meanings": " ".join(STATES)}
    flags = {"flag_values": np.array([0, 1], dtype=np.int8), "flag_meanings": "no yes"}
    variables: dict[str, Any] = {
        "state": (dims, states, {"long_name": "state of the point", **meanings}),
        "converged": (dims, (states == CONVERGED).astype(np.int8), {"long_name": "whether it converged", **flags}),
        "message": (dims, messages.astype(np.str_), {"long_name": "how the run ended, or why there is none"}),
    }
    for quantity in QUANTITIES:
        _add_quantity(variables, coordinates, grid, records, quantity)
    if histories:
        _add_histories(variables, coordinates, grid, records)
    return xr.Dataset(variables, coordinates, _attributes(scene))


def _coordinate(parameter: Parameter) -> Any:
    values = parameter.values
    written = (
        np.array(values, dtype=float) if parameter.numeric else np.array([value_text(v) for v in values], dtype=np.str_)
    )
    attributes = {"long_name": f"scene key {parameter.key}"}
    if parameter.numeric and (unit := parameter.unit):
        attributes["units"] = unit
    return parameter.key, written, attributes


def _attributes(scene: Scene) -> dict[str, Any]:
    return {
        **provenance(),
        "Conventions": CONVENTIONS,
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "title": f"{scene.name}: parametric study",
        "scene_name": scene.name,
        "scene": scene.text(),
    }


def _parts(records: Mapping[Index, Record], name: str) -> list[str]:
    """Names of the parts that have a quantity at some point, in the order of the first that names them."""
    return list(dict.fromkeys(part for record in records.values() for part in record.get(name, ())))


def _add_quantity(
    variables: dict[str, Any],
    coordinates: dict[str, Any],
    grid: Grid,
    records: Mapping[Index, Record],
    quantity: Quantity,
) -> None:
    """Add one quantity, where some point has it; parts are a coordinate that all quantities of their kind share."""
    given = {point: record[quantity.name] for point, record in records.items() if quantity.name in record}
    if not given:
        return
    dims, shape = tuple(p.key for p in grid.parameters), grid.shape
    if not quantity.of:
        values = np.full(shape, np.nan)
        for point, value in given.items():
            values[point] = value
    else:
        parts = _all_parts(coordinates, records, quantity.of)
        dims, values = (*dims, quantity.of), np.full((*shape, len(parts)), np.nan)
        for point, by_part in given.items():
            for part, value in by_part.items():
                values[(*point, parts.index(part))] = value
    variables[quantity.name] = (dims, values, {"units": quantity.unit, "long_name": quantity.long_name})


def _all_parts(coordinates: dict[str, Any], records: Mapping[Index, Record], kind: str) -> list[str]:
    """Names of the parts of one kind, as a coordinate."""
    if kind not in coordinates:
        names = [q.name for q in QUANTITIES if q.of == kind]
        parts = list(dict.fromkeys(part for name in names for part in _parts(records, name)))
        coordinates[kind] = (kind, np.array(parts, dtype=np.str_), {"long_name": kind.replace("_", " ")})
    return [str(part) for part in coordinates[kind][1]]


def _add_histories(
    variables: dict[str, Any], coordinates: dict[str, Any], grid: Grid, records: Mapping[Index, Record]
) -> None:
    """Add the resultants of the interfaces over time; points cut short have no values at the instants they lack."""
    given = {point: record for point, record in records.items() if "histories" in record}
    if not given:
        return
    time = max((np.asarray(record["time"]) for record in given.values()), key=len)
    coordinates["time"] = ("time", time, {"units": "s", "long_name": "time since the start"})
    coordinates["axis"] = ("axis", np.array(AXES, dtype=np.str_))
    parts = _all_parts(coordinates, records, "interface")
    for name, (unit, long_name) in _HISTORIES.items():
        more, more_dims = ((len(AXES),), ("axis",)) if name == "force" else ((), ())
        values = np.full((*grid.shape, len(parts), len(time), *more), np.nan)
        for point, record in given.items():
            for part, history in record["histories"][name].items():
                values[point][parts.index(part), : len(history)] = history
        dims = (*(p.key for p in grid.parameters), "interface", "time", *more_dims)
        variables[name] = (dims, values, {"units": unit, "long_name": long_name})
