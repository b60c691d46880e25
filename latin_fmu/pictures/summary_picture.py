"""The summary figure of a run, drawn from its DataTree, and the figure of spectra."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
import xarray as xr

from ..latin.outcome import Array
from ..results.dataset import has_friction
from ..results.groups import datasets_of, unit_of
from ..results.interface_fields import InterfaceFields, friction_resultant, normal_resultant, status_shares
from ..results.owner_records import InterfaceRecord
from ..results.sensors import loss_text, share_lost
from ..results.spectra import FAINT, ShockSpectrum, axes_in_order, shock_axis, stored_spectra
from ..scene.quantity_table import PEAK_FORCE
from ..scene.readable_numbers import percent, prefix_for, readable
from ..scene.units import SI, UnitSystem
from .style import BAD, DISTINCT, TimeAxis, curve_styles, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

FEW = 4
"""Up to this many curves a legend fits inside its panel, and as many strips below the forces."""

_FRICTION: Final = "friction force"
_SEEN: Final = 0.005  # of the largest term of the energy
_FEW_BOLTS: Final = 2  # their labels are long
_SMALL: Final = 0.15  # of the clamp force: changes up to it are drawn as such
_PRELOADED: Final = 0.1  # of the largest elastic energy, there from the start
STATUS_COLOURS = ("#0072B2", "#E69F00", "#EEEEEE")
STATUS_LABELS = ("stick", "slip, or closed without friction", "separation")


def history_panel(
    axis: Axes,
    time: Array,
    curves: dict[str, Array],
    scale: TimeAxis,
    reference: float = 0.0,
    unit: str = "N",
    what: str = "force",
) -> None:
    """One curve over time each; ``time`` (n_time,) in s, ``curves`` (n_time,) in ``unit``.

    Curves below 1e-9 of ``reference`` are round-off and are not enlarged to the height of the panel.
    """
    peak = max((float(np.abs(curve).max(initial=0.0)) for curve in curves.values()), default=0.0)
    # a body at rest would fill the panel with round-off
    if peak < 1e-9 * reference:
        peak = reference
        axis.set_ylim(-1.0, 1.0)
    size, label = prefix_for(peak, unit, figure=True)
    axis.axhline(0.0, color="0.6", linewidth=0.6, zorder=0)
    for (name, curve), look in zip(curves.items(), curve_styles(len(curves)), strict=True):
        axis.plot(time / scale.divisor, curve / size, label=name, linewidth=1.3, **look)
    axis.set(ylabel=f"{what} ({label})")
    # a unit without a prefix has large numbers; no offset, which nobody reads
    axis.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True, useOffset=False)
    scale.set(axis, time[0], time[-1])
    # many interfaces have one legend for all their panels, and friction has that of the panel above
    if what not in ("force", _FRICTION) or (what == "force" and len(curves) <= FEW):
        _own_legend(axis, _FEW_BOLTS if "tension" in what else FEW)


def bolt_panel(axis: Axes, time: Array, curves: dict[str, Array], scale: TimeAxis, unit: str) -> None:
    """Tension of bolts over time: as change in % of the clamp force at the start where it is small for all of them,
    else without the line of 0."""
    starts = {name: float(curve[0]) for name, curve in curves.items()}
    small = all(
        start > 0.0 and np.abs(curve - start).max() <= _SMALL * start
        for start, curve in zip(starts.values(), curves.values(), strict=True)
    )
    if small:
        changes = {name: 100.0 * (curve / starts[name] - 1.0) for name, curve in curves.items()}
        history_panel(axis, time, changes, scale, unit="%", what="change of tension")
        low, high = (float(pick([pick(curve) for curve in changes.values()])) for pick in (np.min, np.max))
        # at least 1 %: less is no change that a bolt shows; above the curves room for the legend
        margin = max(0.05 * (high - low), 0.5 - 0.5 * (high - low))
        legend = 0.0  # share of the panel
        if len(curves) <= _FEW_BOLTS:
            legend = 0.06 + 0.11 * len(curves)
        axis.set_ylim(low - margin, high + margin + legend / (1.0 - legend) * (high - low + 2.0 * margin))
        return
    history_panel(axis, time, curves, scale, unit=unit, what="tension")
    low, high = (float(pick([pick(curve) for curve in curves.values()])) for pick in (np.min, np.max))
    size = prefix_for(max(abs(low), abs(high)), unit)[0]
    margin = 0.05 * (high - low) or size
    axis.set_ylim((low - margin) / size, (high + margin) / size)


def status_panel(axis: Axes, name: str, dataset: xr.Dataset, scale: TimeAxis, first: bool, last: bool) -> None:
    """Shares of the area that stick, slip and are open, stacked; ``first`` and ``last`` strip of a column."""
    fields = InterfaceFields.of_dataset(dataset)
    curves = 100.0 * status_shares(fields)[:, [1, 2, 0]].T  # stick, slip, separation
    # statuses hold over the step that ends at their instant
    style: dict[str, Any] = {"colors": STATUS_COLOURS, "labels": STATUS_LABELS, "step": "pre", "linewidth": 0}
    axis.stackplot(fields.time / scale.divisor, *curves, **style)
    scale.set(axis, fields.time[0], fields.time[-1])
    axis.set(ylim=(0, 100), yticks=(0, 100))
    axis.set_ylabel(name, rotation=0, ha="right", va="center", labelpad=4)
    axis.tick_params(axis="y", labelsize="x-small")
    axis.tick_params(axis="x", labelbottom=last)
    if first:
        axis.set_title("Contact state, % of the area")
    if not last:
        axis.set_xlabel("")


def curve_panel(axis: Axes, convergence: xr.Dataset, tolerance: float | None) -> None:
    """One window: sqrt(eta) and interface force residual over the iterations."""
    count = max(1, int(convergence["iterations"].values[0]))
    steps = convergence["iteration"].values[:count]
    errors = convergence["error_indicator"].values[0, :count]
    axis.plot(steps, errors, "o-", color=DISTINCT[0], markersize=3, linewidth=1.2, label=r"$\sqrt{\eta}$")
    mismatch = convergence["force_mismatch"].values[0, :count]
    if np.isfinite(mismatch).any():
        axis.plot(steps, mismatch, "s", color=DISTINCT[1], markersize=3, label="interface force residual")
    _tolerance_line(axis, tolerance)
    axis.set(title="Convergence", xlabel="iteration", yscale="log", ylabel="relative error")
    axis.locator_params(axis="x", integer=True)
    axis.legend(fontsize="small")


def count_panel(axis: Axes, convergence: xr.Dataset, scale: TimeAxis) -> None:
    """Many windows: iterations of each, at the time of its end; those not converged are marked."""
    ends, counts = convergence["end_time"].values, convergence["iterations"].values
    axis.plot(ends / scale.divisor, counts, ".", color=DISTINCT[0], markersize=4)
    failed = convergence["converged"].values == 0
    if failed.any():
        axis.plot(ends[failed] / scale.divisor, counts[failed], "x", color=DISTINCT[1], label="not converged")
        axis.legend(fontsize="small")
    title = f"Iterations of each of {counts.size} windows"
    axis.set(title=title, ylabel="iterations", ylim=(0, 1.1 * max(1, counts.max()) + 0.5))
    scale.set(axis, 0.0, ends[-1])
    axis.locator_params(axis="y", integer=True)


def final_panel(axis: Axes, convergence: xr.Dataset, tolerance: float | None, scale: TimeAxis) -> None:
    """Many windows: sqrt(eta) at the last iteration of each, at the time of its end."""
    ends, counts = convergence["end_time"].values, convergence["iterations"].values.astype(int)
    # rows are padded to the longest window: the last iteration of each
    last = convergence["error_indicator"].values[np.arange(counts.size), np.maximum(counts - 1, 0)]
    errors = np.where((counts > 0) & (last > 0.0), last, np.nan)  # a logarithmic axis has no 0
    axis.plot(ends / scale.divisor, errors, ".", color=DISTINCT[0], markersize=3, label=r"$\sqrt{\eta}$")
    _tolerance_line(axis, tolerance)
    axis.set(title=r"Final $\sqrt{\eta}$ of each window", ylabel=r"$\sqrt{\eta}$", yscale="log")
    scale.set(axis, 0.0, ends[-1])
    low, high = axis.get_ylim()
    if high < 100.0 * low:  # at least two powers of ten
        middle = (low * high) ** 0.5
        axis.set_ylim(middle / 12.0, middle * 12.0)
    axis.legend(fontsize="small")


def _tolerance_line(axis: Axes, tolerance: float | None) -> None:
    if tolerance is not None:
        axis.axhline(tolerance, color="0.3", linestyle="--", linewidth=0.9, label="tolerance")


def energy_panel(axis: Axes, energy: xr.Dataset, scale: TimeAxis) -> None:
    """Energies of the assembly over time; left out are small ones and, in a preloaded assembly, the elastic energy of
    the start, beside which no other would be seen."""
    time = energy["time"].values
    terms = {str(name).replace("_", " "): np.asarray(values.values) for name, values in energy.data_vars.items()}
    unit = next((unit_of(v, "J") for v in energy.data_vars.values()), "J")
    if "elastic" in terms:
        preload = float(terms["elastic"][0])
    else:
        preload = 0.0
    if preload > _PRELOADED * float(np.abs(terms.get("elastic", 0.0)).max(initial=0.0)):
        terms[f"elastic, less {readable(preload, unit, 3, figure=True)} of the start"] = terms.pop("elastic") - preload
    largest = max((float(np.abs(term).max(initial=0.0)) for term in terms.values()), default=0.0)
    size, label = prefix_for(largest, unit, figure=True)
    # smaller ones would lie on the axis
    shown = {name: x for name, x in terms.items() if np.abs(x).max(initial=0.0) > _SEEN * largest}
    for (name, term), look in zip(shown.items(), curve_styles(len(shown)), strict=True):
        axis.plot(time / scale.divisor, term / size, linewidth=1.3, label=name, **look)
    axis.set(title=f"Energy of the assembly (terms above {100 * _SEEN:g} % of the largest)", ylabel=f"energy ({label})")
    scale.set(axis, time[0], time[-1])
    _own_legend(axis)


def _own_legend(axis: Axes, few: int = FEW) -> None:
    """Legend of a panel: in it for few curves, below it for more, so that all panels of a column are of one width."""
    n = len(axis.get_legend_handles_labels()[1])
    if 0 < n <= few:
        axis.legend(fontsize="small")
    elif n:
        from matplotlib.transforms import ScaledTranslation

        # inches, below the label of the axis
        below = axis.transAxes + ScaledTranslation(0.0, -0.42, axis.figure.dpi_scale_trans)
        place: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "bbox_transform": below}
        axis.legend(fontsize="x-small", frameon=False, ncols=3, borderaxespad=0.0, **place)


@dataclass(frozen=True)
class _Panel:
    """One row of a column: its height in inches, the function that draws it, and a title where that gives none."""

    height: float
    draw: Callable[[Axes], None]
    title: str | None = None


PART_NAMES: Final = ("interfaces", "sensors", "bolts", "energy", "convergence")
"""Parts of the summary figure."""


@styled
def part_figure(tree: xr.DataTree, part: str) -> Figure | None:
    """One of the ``PART_NAMES`` of the summary figure alone; None where the run has none of it."""
    from matplotlib.figure import Figure

    groups = _shown_interfaces(tree)
    scale = _time_axis(tree, groups)
    strips = []
    if part == "interfaces":
        strips = _strips(groups, scale)
        panels = _force_panels(groups, scale, _errors(tree)) + strips
    elif part == "sensors":
        panels = _sensor_panels(tree, scale)
    elif part == "bolts":
        panels = _bolt_panels(tree, scale)
    elif part == "energy":
        panels = _energy_panels(tree, scale)
    else:
        panels = _convergence_panels(tree, scale)
    if not panels:
        return None
    figure = Figure(figsize=(7.6, sum(panel.height for panel in panels) + 0.5), layout="constrained")
    drawn: SubFigure = figure.subfigures(1, 1, squeeze=False).flat[0]
    _draw_column(drawn, panels)
    if part == "interfaces" and len(groups) > FEW:
        _legend(drawn, drawn.axes[0], "outside upper center", "interfaces")
    if strips:
        _legend(drawn, drawn.axes[-1], "outside lower center")
    return figure


def _shown_interfaces(tree: xr.DataTree) -> dict[str, xr.Dataset]:
    """Interfaces that may open; bonded faces carry what their bodies carry, and are drawn where nothing may."""
    groups = datasets_of(tree, "interfaces")
    return {name: dataset for name, dataset in groups.items() if "contact_status" in dataset} or groups


def _time_axis(tree: xr.DataTree, groups: Mapping[str, xr.Dataset]) -> TimeAxis:
    timed = [*groups.values(), *(d for kind in ("sensors", "bolts") for d in datasets_of(tree, kind).values())]
    end = max((float(dataset["time"].values[-1]) for dataset in timed), default=1.0)
    return TimeAxis(*prefix_for(end, "s", figure=True))


@styled
def summary_figure(tree: xr.DataTree, details: bool = False) -> Figure:
    """Forces and contact states of the interfaces, motions and spectra of sensors, tension of bolts and, when present,
    energy.

    Normal resultant and friction of the interfaces; one strip per interface that can open, with the shares
    of its area that stick, slip and are open. Many strips get a column of their own. ``details`` : convergence, too;
    it is drawn of a run that did not converge in any case.
    """
    from matplotlib.figure import Figure

    groups = _shown_interfaces(tree)
    scale = _time_axis(tree, groups)
    forces, strips = _force_panels(groups, scale, _errors(tree)), _strips(groups, scale)
    rest = (
        _sensor_panels(tree, scale) + _spectrum_panels(tree) + _bolt_panels(tree, scale) + _energy_panels(tree, scale)
    )
    converged = tree.attrs.get("converged", 1)
    if details or not converged or not groups:
        rest += _convergence_panels(tree, scale)
    if len(strips) <= FEW:
        columns = [forces + strips, rest]
    else:
        columns = [forces + rest, strips]
    columns = [column for column in columns if column]
    height = max((sum(panel.height for panel in column) for column in columns), default=1.0) + 1.0
    figure = Figure(figsize=(6.2 * max(1, len(columns)), height), layout="constrained")
    unfinished = not tree.attrs.get("trustworthy", converged)
    if not unfinished:
        mark = ""
    else:
        if converged:
            mark = " (NOT TRUSTWORTHY)"
        else:
            mark = " (NOT CONVERGED)"
    if tree.attrs.get("interrupted"):
        mark = " (STOPPED BEFORE ITS END)"
    title = f"{tree.attrs.get('scene_name', 'run')}{mark}"
    figure.suptitle(title, fontweight="bold", color=BAD if unfinished else "black")
    parts: list[SubFigure] = list(figure.subfigures(1, max(1, len(columns)), squeeze=False).flat)
    for part, column in zip(parts, columns, strict=False):
        _draw_column(part, column)
    if len(groups) > FEW:
        _legend(parts[0], parts[0].axes[0], "outside upper center", "interfaces")
    if strips:
        # strips stand at the foot of the first column, or have one of their own
        last = parts[0 if len(strips) <= FEW else -1]
        _legend(last, last.axes[-1], "outside lower center")
    return figure


def _draw_column(part: SubFigure, column: list[_Panel]) -> None:
    heights = [panel.height for panel in column]
    stack = part.subplots(len(column), 1, height_ratios=heights, squeeze=False)
    for axis, panel in zip(stack.flat, column, strict=True):
        panel.draw(axis)
        if panel.title is not None:
            axis.set_title(panel.title)


_Place = Literal["outside upper center", "outside lower center"]


def _legend(part: SubFigure, axis: Axes, place: _Place, title: str | None = None) -> None:
    handles, labels = axis.get_legend_handles_labels()
    part.legend(handles, labels, loc=place, ncols=4, fontsize="small", title=title)


def _force_panels(groups: dict[str, xr.Dataset], scale: TimeAxis, errors: Mapping[str, float]) -> list[_Panel]:
    fields = {name: InterfaceFields.of_dataset(dataset) for name, dataset in groups.items()}
    if not fields:
        return []
    time = next(iter(fields.values())).time
    few, unit = len(fields) <= FEW, unit_of(next(iter(groups.values()))["force"], "N")
    labels = list(fields)
    if few:
        labels = [_with_peak(name, item, scale, unit, errors) for name, item in fields.items()]
    normal = dict(zip(labels, map(normal_resultant, fields.values()), strict=True))
    # one scale for both panels
    reference = max(float(np.abs(curve).max(initial=0.0)) for curve in normal.values())
    draw = partial(history_panel, time=time, scale=scale, reference=reference, unit=unit)
    panels = [_Panel(2.4, partial(draw, curves=normal), "Normal resultant (compression > 0)")]
    if any(map(has_friction, groups.values())):
        friction = {name: friction_resultant(item) for name, item in fields.items()}
        title = "Friction force (magnitude of the tangential resultant)"
        panels.append(_Panel(2.4, partial(draw, curves=friction, what=_FRICTION), title))
    return panels


def _errors(tree: xr.DataTree) -> dict[str, float]:
    """Estimated relative errors by quantity; none of a run without an estimate."""
    if "accuracy" not in tree.children:
        return {}
    estimates = tree["accuracy"].to_dataset()
    return dict(zip(estimates["quantity"].values.tolist(), estimates["relative_error"].values.tolist(), strict=True))


def _with_peak(name: str, fields: InterfaceFields, scale: TimeAxis, unit: str, errors: Mapping[str, float]) -> str:
    """Name of an interface with its peak force, the estimated error of that, and the duration of that mean."""
    record = InterfaceRecord.of_fields(fields)
    peak, duration = PEAK_FORCE.value(record) or 0.0, record.duration
    size, label = prefix_for(peak, unit, figure=True)
    error = errors.get(f"{name}.{PEAK_FORCE.key}", np.nan)
    if np.isfinite(error):
        uncertainty = f" ± {percent(error)}"
    else:
        uncertainty = ""
    if duration > 0.0:
        over = f", mean of {duration / scale.divisor:.2g} {scale.unit}"
    else:
        over = ""
    return f"{name}: peak {peak / size:.3g} {label}{uncertainty}{over}"


def _sensor_panels(tree: xr.DataTree, scale: TimeAxis) -> list[_Panel]:
    """Accelerations of the sensors (behind their filter where they have one), displacements where there are none: along
    the axis of the shock where the scene has one, else of each along that of its largest value."""
    sensors, panels, shock = datasets_of(tree, "sensors"), [], shock_axis(tree)
    for motion, choices in (("acceleration", ("acceleration_filtered", "acceleration")), ("displacement", None)):
        curves = {}
        unit = ""
        time = np.zeros(0)
        for name, dataset in sensors.items():
            stored = [choice for choice in choices or ("displacement",) if choice in dataset]
            if not stored or (choices is None and "acceleration" in dataset):
                continue
            values = dataset[stored[0]].values
            unit = unit_of(dataset[stored[0]], "")
            time = dataset["time"].values
            axis = shock
            if axis is None:
                axis = int(np.abs(values).max(axis=0).argmax())
            how = {"acceleration_filtered": ", behind its filter", "acceleration": ", unfiltered"}.get(stored[0], "")
            curves[f"{name}, along {'xyz'[axis]}{how}"] = values[:, axis]
        if curves:
            draw = partial(history_panel, time=time, curves=curves, scale=scale, unit=unit, what=motion)
            panels.append(_Panel(2.4, draw, f"{motion.capitalize()} of the sensors"))
    return panels


def _spectrum_panels(tree: xr.DataTree) -> list[_Panel]:
    """Shock response spectra of the sensors that request one."""
    spectra = stored_spectra(tree)
    if not spectra:
        return []
    node = tree[f"sensors/{next(iter(spectra))}/spectrum"].to_dataset()
    unit = unit_of(node["acceleration"], "m s-2")
    band = any(error is not None for _, error in spectra.values()) * " (band: estimated error)"
    panels = []
    for i, along in enumerate(axes_in_order(spectra, shock_axis(tree))):
        draw = partial(spectrum_panel, spectra=spectra, along=along, unit=unit)
        title = f"Shock response spectra along {'xyz'[along]}, maximax{band}"
        panels.append(_Panel(2.2 if i else 2.8, draw, title))
    return panels


def spectrum_panel(
    axis: Axes, spectra: Mapping[str, tuple[ShockSpectrum, Array | None]], along: int, unit: str
) -> None:
    """Maximax of each sensor along an axis (0, 1, 2), in ``unit`` (UDUNITS)."""
    top, low = 0.0, np.inf
    # one unit for all, without prefix: the axis is logarithmic
    size, label_of_unit = prefix_for(0.0, unit, figure=True)
    largest = max(float(spectrum.acceleration[0][:, along].max()) for spectrum, _ in spectra.values())
    for (name, (spectrum, error)), look in zip(spectra.items(), curve_styles(len(spectra)), strict=True):
        values = spectrum.acceleration[0][:, along] / size
        # a base that moves along another axis has nothing but round-off here
        if values.max() * size < FAINT * largest:
            continue
        if error is not None:
            _error_band(axis, spectrum.frequency, values, error[0, :, along], color=look["color"], alpha=0.18)
        axis.plot(spectrum.frequency, values, label=f"{name}, Q = {spectrum.quality:g}", linewidth=1.3, **look)
        top, low = max(top, float(values.max())), min(low, float(values.min()))
    axis.set(ylabel=f"acceleration ({label_of_unit})")
    spectrum_axes(axis, low, max(top, 1e-300))
    _own_legend(axis)


def _bolt_panels(tree: xr.DataTree, scale: TimeAxis) -> list[_Panel]:
    """Tension of the bolts, with what each has lost at the end of the run."""
    if not (bolts := datasets_of(tree, "bolts")):
        return []
    curves = {}
    unit = "N"
    time = np.zeros(0)
    for name, dataset in bolts.items():
        tension = dataset["force"].values
        unit = unit_of(dataset["force"], "N")
        time = dataset["time"].values
        last = float(dataset["end_force"])
        # the mean of the last periods where it oscillates
        if last == tension[-1]:
            words = " at the end"
        else:
            words = " by the mean at the end"
        if share_lost(tension, last) is None:
            end = ""
        else:
            end = words
        clamp = readable(float(tension[0]), unit, figure=True)
        curves[f"{name}: {clamp}, {loss_text(tension, last)}{end}"] = tension
    draw = partial(bolt_panel, time=time, curves=curves, scale=scale, unit=unit)
    return [_Panel(2.4, draw, "Tension of the bolts")]


def _strips(groups: dict[str, xr.Dataset], scale: TimeAxis) -> list[_Panel]:
    contacts = {name: dataset for name, dataset in groups.items() if "contact_status" in dataset}
    names = list(contacts)
    strips = []
    for name, dataset in contacts.items():
        draw = partial(status_panel, name=name, dataset=dataset, scale=scale)
        strips.append(_Panel(0.75, partial(draw, first=name == names[0], last=name == names[-1])))
    return strips


def _convergence_panels(tree: xr.DataTree, scale: TimeAxis) -> list[_Panel]:
    if "convergence" not in tree.children or "iterations" not in tree["convergence"]:
        return []
    convergence = tree["convergence"].to_dataset()
    if convergence.sizes["window"] == 1:
        return [_Panel(2.4, partial(curve_panel, convergence=convergence, tolerance=_tolerance(tree)))]
    final = partial(final_panel, tolerance=_tolerance(tree))
    return [_Panel(2.2, partial(draw, convergence=convergence, scale=scale)) for draw in (count_panel, final)]


def _tolerance(tree: xr.DataTree) -> float | None:
    """Tolerance on sqrt(eta), from the text of the scene in the results; None where it has none."""
    try:
        return float(tomllib.loads(tree.attrs["scene"])["solver"]["tolerance"])
    except (KeyError, TypeError, ValueError):  # ValueError: not TOML
        return None


def _energy_panels(tree: xr.DataTree, scale: TimeAxis) -> list[_Panel]:
    if "energy" not in tree.children:
        return []
    return [_Panel(2.6, partial(energy_panel, energy=tree["energy"].to_dataset(), scale=scale))]


@styled
def spectra_figure(
    spectra: Mapping[str, tuple[ShockSpectrum, Array | None]],
    along: str | None = None,
    units: UnitSystem = SI,
    shock: int | None = None,
) -> Figure:
    """Spectra of sensors, one row each: absolute acceleration and pseudo-velocity, with the estimated error as a band.

    Parameters
    ----------
    spectra : by sensor, with the relative error (5, n, 3) or None. along : x, y or z; where None the axis of the shock,
        the same for all sensors, and of a single sensor the other axes below it. units : of the run. shock : its axis
        (0, 1, 2), that of the largest acceleration where None.
    """
    from matplotlib.figure import Figure

    if along is None:
        axes = axes_in_order(spectra, shock)
    else:
        axes = ["xyz".index(along)]
    if len(spectra) > 1:
        axes = axes[:1]
    shown = [(name, axis) for axis in axes for name in spectra]
    figure = Figure(figsize=(7.6, 3.3 * len(shown)), layout="constrained")
    rows = figure.subplots(len(shown), 2, squeeze=False)
    for (name, axis), panels in zip(shown, rows, strict=True):
        spectrum, error = spectra[name]
        kinds = (("absolute acceleration", "acceleration", "m s-2"), ("pseudo-velocity", "pseudo_velocity", "m s-1"))
        for panel, (what, kind, unit) in zip(panels, kinds, strict=True):
            size, label = prefix_for(0.0, units.shown(unit), figure=True)
            values = getattr(spectrum, kind)[:, :, axis] / size
            _draw_spectrum(panel, spectrum.frequency, values, None if error is None else error[0, :, axis])
            title = f"{name}, along {'xyz'[axis]}, Q = {spectrum.quality:g}"
            panel.set(title=title, ylabel=f"{what} ({label})")
        panels[0].legend(fontsize="small")
    return figure


def _draw_spectrum(panel: Axes, frequency: Array, values: Array, error: Array | None) -> None:
    """Maximax, primary and residual of rows (5, n) on logarithmic axes, which differ by line and grey, too."""
    styles = (("maximax", "#000000", "-", 2.2), ("primary", "#56B4E9", "--", 1.3), ("residual", "#D55E00", ":", 1.8))
    top = max(float(values[0].max(initial=0.0)), 1e-300)
    if error is not None:
        _error_band(panel, frequency, values[0], error, color="0.82", label="estimated error of maximax")
    # positive and negative ones stay with the tables
    for row, (label, colour, line, width) in zip(values, styles, strict=False):
        # a residual may be 0, which a logarithmic axis does not have
        panel.plot(frequency, np.maximum(row, 1e-12 * top), line, color=colour, linewidth=width, label=label)
    spectrum_axes(panel, float(values[0].min(initial=top)), top)


def _error_band(panel: Axes, frequency: Array, values: Array, error: Array, **look: Any) -> None:
    """A relative error of either sign, symmetric on a logarithmic axis."""
    panel.fill_between(frequency, values / (1 + error), values * (1 + error), linewidth=0, **look)


def spectrum_axes(panel: Axes, lowest: float, top: float) -> None:
    """Logarithmic axes over whole decades from ``lowest`` to ``top``, five at most, with a grid; frequencies in kHz."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    panel.set(xscale="log", yscale="log")
    last = np.ceil(np.log10(top))
    panel.set_ylim(10.0 ** max(np.floor(np.log10(max(lowest, 1e-5 * top))), last - 5), 10.0**last)
    panel.yaxis.set_minor_formatter(NullFormatter())
    size, unit = 1.0, "Hz"
    if panel.get_xlim()[1] > 3e4:
        size, unit = 1e3, "kHz"
    panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda f, _: f"{f / size:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.set_xlabel(f"natural frequency ({unit})")
    panel.grid(which="major", color="0.75", linewidth=0.6)
    panel.grid(which="minor", color="0.9", linewidth=0.4)
