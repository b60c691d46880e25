"""Files of a study: xarray dataset (one entry a run, derived tables beside it) and plain data for JSON."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import xarray as xr

from ..machine import provenance
from ..results.groups import CONVENTIONS
from ..results.prices import TARGETS
from ..scene.quantity_table import definition_of
from .study import Study, cheapest, sources, useful_tolerances

_SOURCES = ("total", "space", "time", "iteration", "reduction", "order_together", "order_space", "order_time")


def datatree(study: Study) -> xr.DataTree:
    """Groups ``runs``, ``sources``, ``tolerances``, ``windows``; the reference and the scene in the root attributes.

    ``runs``: per run its series, scheme, resolution, cost by part, and error and value of every quantity (NaN where
    the run failed; ``failure`` is the reason).
    """
    root = xr.Dataset(
        attrs={
            **provenance(),
            "Conventions": CONVENTIONS,
            "title": f"{study.scene.name}: cost of accuracy",
            "scene_name": study.scene.name,
            "scene": study.scene.text(),
            "reference": study.reference.text,
            "reference_is_exact": np.int8(study.reference.exact),
            "cpu_seconds": study.seconds,
        }
    )
    groups = {"/": root, "/runs": _runs(study), "/sources": _sources(study), "/tolerances": _tolerances(study)}
    if study.windows:
        groups["/windows"] = _windows(study)
    return xr.DataTree.from_dict(groups, name=study.scene.name)


def _runs(study: Study) -> xr.Dataset:
    rows = study.rows
    quantities = study.quantities
    label = study.scene.unit_system.label
    table = xr.Dataset(coords={"quantity": _texts(quantities)})
    # texts are labels: numbers of two studies can be subtracted
    table.coords["quantity_unit"] = ("quantity", _texts([label(definition_of(q).unit) for q in quantities]))
    for name, text in (("series", "series of the study"), ("variant", "scheme"), ("failure", "reason of a failure")):
        table.coords[name] = ("run", _texts([getattr(r, name) for r in rows]), {"long_name": text})
    numbers: list[tuple[str, list[float], str, str]] = [
        ("mesh", [r.resolution.mesh for r in rows], "1", "elements per length, relative to the scene"),
        ("steps", [r.resolution.time for r in rows], "1", "steps per time, relative to the scene"),
        ("tolerance", [r.tolerance for r in rows], "1", "tolerance on sqrt(eta)"),
        ("iterations", [r.run.iterations[0] for r in rows], "1", "mean iterations of a window"),
        ("passes", [r.run.passes for r in rows], "1", "substructure-instants solved over all"),
        ("cpu", [r.run.cpu for r in rows], "s", "CPU time, set-up included, output not"),
    ]
    for part, _ in _PARTS:
        seconds = [getattr(r.run.timings, part) for r in rows]
        numbers.append((f"cpu_{part}", seconds, "s", f"CPU time: {part}"))
    for name, values, unit, long_name in numbers:
        _add(table, name, ("run",), values, long_name, unit)
    dims = ("run", "quantity")
    _add(table, "error", dims, [study.error(r, q) for r in rows for q in quantities], "relative error")
    read = [r.run.quantities.values.get(q, np.nan) if r.run.converged else np.nan for r in rows for q in quantities]
    _add(table, "value", dims, read, "value, over its unit")
    return table


def _add(
    table: xr.Dataset, name: str, dims: tuple[str, ...], values: list[float], long_name: str, unit: str = "1"
) -> None:
    """Add a variable whose values (flat, in the order of ``dims``) fill the sizes that the table has."""
    sizes = [table.sizes.get(dim, -1) for dim in dims]
    attributes = {"long_name": long_name, "units": unit}
    table[name] = (dims, np.array(values, dtype=float).reshape(sizes), attributes)


def _sources(study: Study) -> xr.Dataset:
    split = [sources(study, q) for q in study.quantities]
    table = xr.Dataset(coords={"quantity": _texts(study.quantities)})
    for name in _SOURCES:
        if name.startswith("order"):
            long_name = "observed order, " + name[6:]
        else:
            long_name = f"relative error, {name}"
        _add(table, name, ("quantity",), [getattr(s, name) for s in split], long_name)
    return table


def _tolerances(study: Study) -> xr.Dataset:
    useful = {q: useful_tolerances(study, q) for q in study.quantities}
    meshes = sorted({m for by_mesh in useful.values() for m in by_mesh})
    table = xr.Dataset(coords={"quantity": _texts(study.quantities), "mesh": np.array(meshes, dtype=float)})
    table["mesh"].attrs.update(units="1", long_name="refinement factor of the mesh")
    values = [by_mesh.get(m, np.nan) for by_mesh in useful.values() for m in meshes]
    long_name = "tolerance on sqrt(eta) below which the iteration error is negligible"
    _add(table, "useful_tolerance", ("quantity", "mesh"), values, long_name)
    return table


def _windows(study: Study) -> xr.Dataset:
    lengths = list(dict.fromkeys(length for length, _ in study.windows))
    directions = list(dict.fromkeys(direction for _, direction in study.windows))
    table = xr.Dataset(coords={"window": _texts(lengths), "search_direction": _texts(directions)})
    counts = [study.windows.get((n, d), (np.nan, np.nan)) for n in lengths for d in directions]
    for i, (name, long_name) in enumerate((("iterations", "mean iterations of a window"), ("passes", "passes"))):
        _add(table, name, ("window", "search_direction"), [pair[i] for pair in counts], long_name)
    return table


def _texts(values: list[str]) -> np.ndarray:
    return np.array(values, dtype=np.str_)


_PARTS: Final = (("setup", "set-up"), ("march", "march"), ("other", "other"), ("output", "output"))


def as_data(study: Study) -> dict[str, Any]:
    """Plain data for strict JSON."""
    estimate = study.reference.own_error
    return {
        "scene": study.scene.name,
        "cpu_seconds": study.seconds,
        "reference": {
            "exact": study.reference.exact,
            "source": study.reference.text,
            "values": {q: _plain(v) for q, v in study.reference.quantities.values.items()},
            "error_estimate": None if estimate is None else estimate.report(),
        },
        "runs": [
            {
                "series": row.series,
                "scheme": row.variant,
                "mesh": row.resolution.mesh,
                "steps": row.resolution.time,
                "tolerance": _plain(row.tolerance),
                "cpu_seconds": _plain(row.run.cpu),
                "iterations": _plain(row.run.iterations[0]),
                "failure": row.failure or None,
                "errors": {q: _plain(study.error(row, q)) for q in study.quantities},
            }
            for row in study.rows
        ],
        "sources": {q: {k: _plain(v) for k, v in vars(sources(study, q)).items()} for q in study.quantities},
        "prices": {q: [_price_data(study, q, t) for t in TARGETS] for q in study.quantities},
        "useful_tolerances": {
            q: [{"mesh": m, "tolerance": _plain(t)} for m, t in useful_tolerances(study, q).items()]
            for q in study.quantities
        },
        "searches": [
            {
                "target": search.target,
                "cpu_seconds": search.cpu,
                "mesh": search.resolution.mesh,
                "steps": search.resolution.time,
                "told": {q: _plain(error) for q, error in search.told.items()},
                "errors": {
                    q: _plain(study.error_of(search.quantities, search.resolution, q)) for q in study.quantities
                },
            }
            for search in study.searches
        ],
        "windows": [
            {"window": length, "search_direction": direction, "iterations": iterations, "passes": passes}
            for (length, direction), (iterations, passes) in study.windows.items()
        ],
    }


def _price_data(study: Study, quantity: str, target: float) -> dict[str, Any]:
    row = cheapest(study, quantity, target)
    if row is None:
        return {"target": target, "reached": False}
    setting = {"scheme": row.variant, "mesh": row.resolution.mesh, "steps": row.resolution.time}
    cost = {"target": target, "reached": True, "cpu_seconds": row.run.cpu}
    return {**cost, **setting, "error": _plain(study.error(row, quantity))}


def _plain(value: Any) -> Any:
    if not isinstance(value, float) or math.isfinite(value):
        return value
    return None
