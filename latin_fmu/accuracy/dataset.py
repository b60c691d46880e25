"""A study as xarray: one entry a run, derived tables beside it."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from ..results.attributes import CONVENTIONS
from ..results.provenance import provenance
from .analysis import sources, useful_tolerances
from .bench import Row
from .kinds import kind_of
from .study import Study

_SOURCES = ("total", "space", "time", "iteration", "reduction", "order_together", "order_space", "order_time")


def datatree(study: Study) -> xr.DataTree:
    """Groups ``runs``, ``sources``, ``tolerances``, ``windows``; the reference and the scene in the root attributes.

    ``runs``: per run its series, scheme, resolution, cost by part, and error and value of every quantity (NaN where
    the run failed; ``failure`` says why).
    """
    root = xr.Dataset(
        attrs={
            **provenance(),
            "Conventions": CONVENTIONS,
            "title": f"{study.scene.name}: what accuracy costs",
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
    rows, quantities = study.rows, study.quantities
    table = xr.Dataset(coords={"quantity": _texts(quantities)})
    table["quantity_unit"] = ("quantity", _texts([kind_of(q).unit for q in quantities]))
    for name, text in (("series", "series of the study"), ("variant", "scheme"), ("failure", "why there is no answer")):
        table[name] = ("run", _texts([getattr(r, name) for r in rows]), {"long_name": text})
    numbers: dict[str, tuple[list[float], str, str]] = {
        "mesh": ([r.resolution.mesh for r in rows], "1", "elements per length, relative to the scene"),
        "steps": ([r.resolution.time for r in rows], "1", "steps per time, relative to the scene"),
        "tolerance": ([r.tolerance for r in rows], "1", "tolerance on sqrt(eta)"),
        "iterations": ([_of(r, lambda run: run.iterations[0]) for r in rows], "1", "mean iterations of a window"),
        "passes": ([_of(r, lambda run: run.passes) for r in rows], "1", "substructure-instants solved over all"),
        "cpu": ([_of(r, lambda run: run.cpu) for r in rows], "s", "CPU time, set-up included, output not"),
    }
    for part in ("setup", "march", "other", "output"):
        seconds = [_of(r, lambda run, part=part: getattr(run.timings, part)) for r in rows]
        numbers[f"cpu_{part}"] = (seconds, "s", f"CPU time: {part.replace('_', ' ')}")
    for name, (values, unit, meaning) in numbers.items():
        table[name] = ("run", np.array(values, dtype=float), {"units": unit, "long_name": meaning})
    errors = np.array([[study.error(r, q) for q in quantities] for r in rows]).reshape(len(rows), len(quantities))
    table["error"] = (("run", "quantity"), errors, {"units": "1", "long_name": "relative error"})
    read = [[_of(r, lambda run, q=q: run.measured.values.get(q, np.nan)) for q in quantities] for r in rows]
    table["value"] = (
        ("run", "quantity"),
        np.array(read, dtype=float).reshape(errors.shape),
        {"long_name": "value, in its unit"},
    )
    return table


def _of(row: Row, read: Any) -> float:
    return float("nan") if row.run is None else float(read(row.run))


def _sources(study: Study) -> xr.Dataset:
    found = [sources(study, q) for q in study.quantities]
    table = xr.Dataset(coords={"quantity": _texts(study.quantities)})
    for name in _SOURCES:
        what = "observed order, " + name[6:] if name.startswith("order") else f"relative error, {name}"
        attributes = {"units": "1", "long_name": what}
        table[name] = ("quantity", np.array([getattr(s, name) for s in found], dtype=float), attributes)
    return table


def _tolerances(study: Study) -> xr.Dataset:
    found = {q: useful_tolerances(study, q) for q in study.quantities}
    meshes = sorted({m for table in found.values() for m in table})
    values = [[table.get(m, np.nan) for m in meshes] for table in found.values()]
    table = xr.Dataset(coords={"quantity": _texts(study.quantities), "mesh": np.array(meshes, dtype=float)})
    table["mesh"].attrs.update(units="1", long_name="refinement factor of the mesh")
    table["useful_tolerance"] = (
        ("quantity", "mesh"),
        np.array(values, dtype=float).reshape(len(found), len(meshes)),
        {"units": "1", "long_name": "tolerance on sqrt(eta) below which a smaller one buys nothing"},
    )
    return table


def _windows(study: Study) -> xr.Dataset:
    lengths = list(dict.fromkeys(length for length, _ in study.windows))
    directions = list(dict.fromkeys(direction for _, direction in study.windows))
    missing = (np.nan, np.nan)
    cube = np.array([[study.windows.get((n, d), missing) for d in directions] for n in lengths], dtype=float)
    table = xr.Dataset(coords={"window": _texts(lengths), "search_direction": _texts(directions)})
    for i, (name, meaning) in enumerate((("iterations", "mean iterations of a window"), ("passes", "passes"))):
        attributes = {"units": "1", "long_name": meaning}
        table[name] = (("window", "search_direction"), cube[:, :, i], attributes)
    return table


def _texts(values: list[str]) -> np.ndarray:
    return np.array(values, dtype=np.str_)
