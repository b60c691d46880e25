"""Files of a study: xarray dataset (one entry a run, derived tables beside it), plain data for JSON, and figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr

from ..machine import provenance
from ..pictures.style import BAD, SEQUENTIAL, curve_styles, styled
from ..results.groups import CONVENTIONS
from ..scene.quantity_table import FLOOR, FORCE_RMS, QUANTITIES_OF_INTEREST, definition_of
from ..scene.readable_numbers import percent
from .adaptive_resolution import is_target
from .study import TARGETS, TIGHT, TOGETHER, TOLERANCE, Study, cheapest, sources, useful_tolerances

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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


@styled
def cost_figure(study: Study) -> Figure:
    """Panels: error against CPU seconds per quantity, map of the tolerance, iterations, split of the cost."""
    from matplotlib.figure import Figure

    shown = quantities_shown(study)
    rows = -(-(len(shown) + 3) // 3)
    figure = Figure(figsize=(13, 3.7 * rows), layout="constrained")
    panels = list(figure.subplots(rows, 3, squeeze=False).ravel())
    for quantity in shown:
        work_precision(panels.pop(0), study, quantity)
    if shown:
        tolerance_map(panels.pop(0), study, shown[0])
    iterations(panels.pop(0), study)
    cost_split(panels.pop(0), study)
    for axes in panels:
        axes.set_axis_off()
    figure.suptitle(f"{study.scene.name}: cost of accuracy. Reference: {study.reference.text}", fontsize=10)
    return figure


def quantities_shown(study: Study) -> list[str]:
    """One quantity of each definition: of the target interface (or sensor) of the scene, else the first."""
    target = study.scene.accuracy.quantity.rpartition(".")[0]
    shown = []
    for definition in QUANTITIES_OF_INTEREST:
        candidates = [q for q in study.quantities if definition_of(q) is definition]
        if candidates:
            shown.append(next((q for q in candidates if q.startswith(f"{target}.")), candidates[0]))
    return shown


def work_precision(axes: Axes, study: Study, quantity: str) -> None:
    """Error against CPU seconds, log-log, one curve per scheme or propagator, that of the scene thick; stars: searches
    for an accuracy of this quantity, at their whole cost; a horizontal line at the estimated error of
    the run as written, from its CPU time to that with the estimate."""
    from matplotlib.ticker import LogLocator, NullFormatter

    names = dict.fromkeys(r.variant for r in study.rows if r.series == TOGETHER)
    for look, name in zip(curve_styles(len(names), markers=True), names, strict=True):
        rows = [r for r in study.of(TOGETHER, name) if np.isfinite(study.error(r, quantity))]
        cost = [r.run.cpu for r in rows]
        # 1e-5: an exact value has no place on a logarithmic axis
        errors = np.maximum([study.error(r, quantity) for r in rows], 1e-5)
        if name == study.main:
            width = 2.4
        else:
            width = 0.8
        axes.plot(cost, 100 * errors, label=name, linewidth=width, markersize=3.0 + width, **look)
    _searches(axes, study, quantity)
    estimate = study.reference.own_error
    if estimate is not None and quantity in study.reference.quantities.values:
        axes.axhspan(0, 100 * estimate[quantity].error, color="0.92", zorder=0, label="error of the reference")
    axes.axhline(100 * FLOOR, color="0.6", linewidth=0.8, linestyle=":")
    axes.set_xscale("log")
    axes.set_yscale("log")
    # times span a decade or two, over which matplotlib labels every subdivision: they overlap
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    title = quantity + (" (rms)" if definition_of(quantity) is FORCE_RMS else "")
    _label(axes, "CPU time (s)", "relative error (%)", title)
    axes.grid(color="0.92", which="both")
    axes.legend(fontsize=6)


def _searches(axes: Axes, study: Study, quantity: str) -> None:
    """Stars and the line of ``work_precision``."""
    errors = [study.error_of(s.quantities, s.resolution, quantity) for s in study.searches]
    for search in study.searches:
        if search.target is None and quantity in search.told and np.isfinite(search.told[quantity]):
            plain = [r.run.cpu for r in study.of(TOGETHER) if r.factor == 1.0]
            told = 100 * max(search.told[quantity], FLOOR)
            if plain:
                axes.plot([plain[0], search.cpu], [told, told], color="0.25", marker="|", label="estimated error")
    found = [(s, e) for s, e in zip(study.searches, errors, strict=True) if s.target is not None and np.isfinite(e)]
    if found and is_target(study.scene, quantity):
        places = [s.cpu for s, _ in found], [100 * max(e, 1e-5) for _, e in found]
        axes.plot(*places, linestyle="none", marker="*", markersize=11, color=BAD, label="searches", zorder=5)
        meshes = dict.fromkeys(s.resolution.mesh for s, _ in sorted(found, key=lambda f: f[0].cpu))
        for i, mesh in enumerate(meshes):  # one label for the searches that end on a mesh; the next one's opposite
            same = [(s, e) for s, e in found if s.resolution.mesh == mesh]
            targets = [f"{100 * (s.target or 0.0):g}" for s, _ in same]
            place = max(s.cpu for s, _ in same), 100 * max(same[-1][1], 1e-5)
            text, offset = f"{', '.join(targets)} %", (-2, 7 if i % 2 else -12)
            axes.annotate(text, place, offset, fontsize=6, color=BAD, textcoords="offset points")


def tolerance_map(axes: Axes, study: Study, quantity: str) -> None:
    """Error over tolerance and mesh; right of the line the iteration error is negligible."""
    rows = [r for r in study.of(TOLERANCE) if r.tolerance != TIGHT]
    useful = useful_tolerances(study, quantity)
    meshes = sorted(useful)
    tolerances = sorted({r.tolerance for r in rows}, reverse=True)
    table = np.full((len(meshes), len(tolerances)), np.nan)
    for r in rows:
        if r.factor in meshes:
            table[meshes.index(r.factor), tolerances.index(r.tolerance)] = study.error(r, quantity)
    if table.size and np.isfinite(table).any():
        image = axes.imshow(np.log10(np.maximum(table, 1e-5)), aspect="auto", cmap=f"{SEQUENTIAL}_r", origin="lower")
        axes.figure.colorbar(image, ax=axes, label="log10 relative error").ax.tick_params(labelsize=7)
        for i, j in np.ndindex(*table.shape):
            box = {"facecolor": "black", "alpha": 0.35, "pad": 1, "linewidth": 0}
            style = {"ha": "center", "va": "center", "fontsize": 7, "color": "white", "bbox": box}
            axes.text(j, i, percent(float(table[i, j])), style)
        _line(axes, [useful[m] for m in meshes], tolerances)
    axes.set_xticks(range(len(tolerances)), [f"{t:g}" for t in tolerances])
    axes.set_yticks(range(len(meshes)), [f"x {m:.2g}" for m in meshes])
    title = f"{quantity}: right of the line\nthe iteration error is negligible"
    _label(axes, "tolerance on sqrt(eta)", "mesh and steps", title, size=8)


def _label(axes: Axes, x: str, y: str, title: str, size: int = 9) -> None:
    axes.set_xlabel(x, fontsize=8)
    axes.set_ylabel(y, fontsize=8)
    axes.set_title(title, fontsize=size)
    axes.tick_params(labelsize=7)


def _line(axes: Axes, useful: Sequence[float], tolerances: Sequence[float]) -> None:
    """A staircase left of the largest useful tolerance of each mesh (beyond the right edge where there is none)."""
    # tolerances fall to the right: those right of their left edge suffice
    places = [tolerances.index(t) - 0.5 if t in tolerances else len(tolerances) - 0.5 for t in useful]
    xs = [x for x in places for _ in range(2)]
    ys = [y for i in range(len(places)) for y in (i - 0.5, i + 0.5)]
    axes.plot(xs, ys, color=BAD, linewidth=2.5)


def iterations(axes: Axes, study: Study) -> None:
    """Passes against window length, one curve per search direction."""
    lengths = list(dict.fromkeys(length for length, _ in study.windows))
    directions = list(dict.fromkeys(direction for _, direction in study.windows))
    for look, direction in zip(curve_styles(len(directions), markers=True), directions, strict=True):
        passes = [study.windows.get((n, direction), (np.nan, np.nan))[1] for n in lengths]
        axes.plot(range(len(lengths)), passes, label=direction, **look)
    axes.set_xticks(range(len(lengths)), lengths)
    axes.set_ylim(bottom=0)
    _label(axes, "instants in a window", "passes", "iterations, counted as sweeps over all substructures")
    axes.grid(color="0.92")
    if directions:
        axes.legend(fontsize=6)


def cost_split(axes: Axes, study: Study) -> None:
    """Shares of the CPU time along the refinement of the scene's own scheme."""
    rows = study.of(TOGETHER)
    labels = [f"x {r.factor:.2g}" for r in rows]
    table = np.array([[getattr(r.run.timings, part) for part, _ in _PARTS] for r in rows]).reshape(-1, len(_PARTS))
    shares = 100 * table / np.maximum(table.sum(axis=1, keepdims=True), 1e-12)
    bottom = np.zeros(len(rows))
    for i, (_, name) in enumerate(_PARTS):
        hatch = ("", "//", "..", "xx")[i % 4]
        axes.bar(range(len(rows)), shares[:, i], 0.7, bottom, label=name, edgecolor="black", linewidth=0.5, hatch=hatch)
        bottom += shares[:, i]
    axes.set_xticks(range(len(rows)), labels)
    _label(axes, "mesh and steps", "share of CPU time (%)", "parts of the CPU time")
    # room for the legend above bars of 100 %
    axes.set_ylim(0, 122)
    axes.legend(fontsize=6, loc="upper center", ncols=3)


@styled
def comparison_figure(studies: Sequence[Study]) -> Figure:
    """One row a scene: impulse, first contact and force history against CPU seconds, and the map of the tolerance."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 3.3 * len(studies)), layout="constrained")
    for panels, study in zip(figure.subplots(len(studies), 4, squeeze=False), studies, strict=True):
        shown = {definition_of(q).key: q for q in quantities_shown(study)}
        chosen = [shown[key] for key in ("impulse", "first_contact", "force_rms") if key in shown]
        for axes, quantity in zip(panels, chosen, strict=False):
            work_precision(axes, study, quantity)
            axes.set_title(f"{study.scene.name}: {quantity}", fontsize=8)
        if chosen:
            tolerance_map(panels[3], study, chosen[0])
        for axes in panels[len(chosen) : 3]:
            axes.set_axis_off()
    _one_legend(figure)
    return figure


def _one_legend(figure: Figure) -> None:
    """Replace the legends of all panels by one below them."""
    entries: dict[str, Artist] = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
        if (legend := axes.get_legend()) is not None:
            legend.remove()
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=len(entries), fontsize=8)


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
