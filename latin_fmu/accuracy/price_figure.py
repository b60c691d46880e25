"""Figure of a study: error of a quantity against CPU time, by what is refined, and what an accuracy costs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from ..pictures.style import DISTINCT, styled
from ..results.prices import TARGETS, Price, cpu_time
from ..scene.quantity_table import BOLT, FORCE_RMS, INTERFACE, SENSOR, definition_of
from ..scene.readable_numbers import percent
from .adaptive_resolution import is_target
from .study import REDUCTION, SPACE, TIME, TOGETHER, WAYS, Row, Study, cheapest

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_PANELS: Final = 4
_LEAST: Final = 1e-5  # an exact value has no place on a logarithmic axis
_LOWEST: Final = 0.01  # per cent, at which a panel ends
_LOOKS: Final[Mapping[str, tuple[str, str, str]]] = MappingProxyType(
    {TOGETHER: (DISTINCT[0], "-", "o"), SPACE: (DISTINCT[1], "--", "s"), TIME: (DISTINCT[2], "-.", "^")}
)
"""Colour, line and marker of a way."""
_STAR: Final = "#B00000"


@styled
def price_figure(studies: Sequence[Study], quantities: Sequence[str] = ()) -> Figure:
    """Panels, four at most: of each study its target quantity, or of one study the ``quantities`` (as far as it has
    them; else its target and headline ones)."""
    from matplotlib.figure import Figure

    shown = _shown(studies, quantities)
    columns = min(len(shown), 2)
    lines = math.ceil(len(shown) / max(columns, 1))
    figure = Figure(figsize=(6.2 * max(columns, 1), 4.3 * max(lines, 1)), layout="constrained")
    panels = figure.subplots(max(lines, 1), max(columns, 1), squeeze=False).ravel()
    for axes, (study, quantity) in zip(panels, shown, strict=False):
        price_panel(axes, study, quantity)
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    entries: dict[str, Artist] = {}
    for axes in panels[: len(shown)]:
        handles, labels = axes.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    rule = "star: this run and all finer ones of its line are within that error, with the error of the reference added"
    rule = f"{rule}\nelements, steps x 2: twice as many along an edge, and in time"
    look: dict[str, Any] = {"fontsize": 8, "title_fontsize": 8, "ncols": 3}
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", title=rule, **look)
    return figure


def _shown(studies: Sequence[Study], quantities: Sequence[str]) -> list[tuple[Study, str]]:
    chosen: list[tuple[Study, str]] = []
    for study in studies:
        asked = [q for name in quantities for q in study.quantities if q == name or q.endswith(f".{name}")]
        targets = [q for q in study.quantities if is_target(study.scene, q)]
        if len(studies) > 1:
            chosen += [(study, q) for q in (asked or targets or study.quantities)[:1]]
        else:
            chosen += [(study, q) for q in dict.fromkeys(asked or [*targets[:1], *_headlines(study)])]
    return chosen[:MOST_PANELS]


def _headlines(study: Study) -> list[str]:
    """The first headline quantity of each key; bolts before sensors before interfaces."""
    owners = (BOLT, SENSOR, INTERFACE)
    found = {definition_of(q).key: q for q in reversed(study.quantities) if definition_of(q).headline}
    return sorted(found.values(), key=lambda q: owners.index(definition_of(q).owner))


def price_panel(axes: Axes, study: Study, quantity: str) -> None:
    """Error against CPU time, log-log: a line for each of the three ways to refine, the run as written as a dot with
    its estimated error as a bar, stars where the cheapest run reaches 5, 2 and 1 % for good, and shaded what the
    reference does not know."""
    meshes = {row.resolution.mesh for row in study.of(TOGETHER)}
    for series, words in WAYS.items():
        # the steps alone, where no coarser mesh exists
        if len(meshes) == 1 and series != TIME:
            continue
        rows = [r for r in study.of(series) if math.isfinite(study.error(r, quantity))]
        colour, line, marker = _LOOKS[series]
        if len(rows) > 1:
            errors = [_shown_error(study.error(r, quantity)) for r in rows]
            axes.plot([r.run.cpu for r in rows], errors, line, color=colour, marker=marker, label=words, zorder=3)
    for row in (r for r in study.rows if r.series == REDUCTION and r.run.converged):
        error = _shown_error(study.error(row, quantity))
        axes.plot(row.run.cpu, error, "D", color=DISTINCT[3], markersize=7, label="without modes", zorder=3)
    _as_written(axes, study, quantity)
    _stars(axes, study, quantity)
    _scales(axes, _floor(study, quantity))
    of = " (rms)" if definition_of(quantity) is FORCE_RMS else ""
    axes.set_title(f"{study.scene.name}: error of {quantity}{of}")


def _shown_error(error: float) -> float:
    """Per cent."""
    return 100 * max(error, _LEAST)


def _floor(study: Study, quantity: str) -> float:
    """Relative error of the reference; 0 where it is exact."""
    own = study.reference.own_error
    if own is None or quantity not in own.by_quantity:
        return 0.0
    return own[quantity].error


def _as_written(axes: Axes, study: Study, quantity: str) -> None:
    row = next((r for r in study.of(TOGETHER) if r.resolution.mesh == r.resolution.time == 1.0), None)
    if row is None or not math.isfinite(error := study.error(row, quantity)):
        return
    bar = [[0.0], [0.0]]
    for search in study.searches:
        estimated = search.told.get(quantity, math.nan)
        if search.target is None and math.isfinite(estimated):
            bar = [[0.0], [max(_shown_error(estimated) - _shown_error(error), 0.0)]]
    axes.errorbar(
        row.run.cpu,
        _shown_error(error),
        yerr=bar,
        fmt="o",
        color="black",
        markersize=9,
        capsize=5,
        label="the run as written, bar: its estimated error",
        zorder=5,
    )


def _stars(axes: Axes, study: Study, quantity: str) -> None:
    """One star a run, with all the targets that it is the cheapest for."""
    cheapest_rows = {target: cheapest(study, quantity, target, study.main) for target in TARGETS}
    found: dict[int, tuple[Row, list[float]]] = {}
    for target, row in cheapest_rows.items():
        if row is not None:
            found.setdefault(id(row), (row, []))[1].append(target)
    unknown = [t for t, row in cheapest_rows.items() if row is None and t <= _floor(study, quantity)]
    missed = [t for t, row in cheapest_rows.items() if row is None and t not in unknown]
    for i, (row, targets) in enumerate(found.values()):
        setting = Price(math.nan, row.resolution.mesh, row.resolution.time).setting
        text = f"{_listed(targets)}: {cpu_time(row.run.cpu)}\n{setting}"
        place = row.run.cpu, _shown_error(study.error(row, quantity))
        label = "cheapest run for an error of 5, 2, 1 %" if i == 0 else None
        axes.plot(*place, "*", color=_STAR, markersize=15, label=label, zorder=6)
        box = {"facecolor": "white", "alpha": 0.8, "pad": 1.0, "linewidth": 0}
        style: dict[str, Any] = {"fontsize": 8, "color": _STAR, "va": "bottom", "zorder": 7, "bbox": box}
        axes.annotate(text, place, (8, 8 + 2 * i), textcoords="offset points", **style)
    texts = [(missed, "not reached"), (unknown, "the reference is not as accurate")]
    lines = [f"{_listed(targets)}: {why}" for targets, why in texts if targets]
    corner = {"ha": "right", "va": "top", "fontsize": 8, "color": _STAR, "transform": axes.transAxes}
    axes.text(0.98, 0.98, "\n".join(lines), corner)
    for target in TARGETS:
        axes.axhline(100 * target, color="0.75", linewidth=0.7, zorder=1)


def _listed(targets: Sequence[float]) -> str:
    """``5, 2 %``."""
    return f"{', '.join(percent(t).removesuffix(' %') for t in targets)} %"


def _scales(axes: Axes, floor: float) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        # times and errors span a decade or two, over which matplotlib labels every subdivision: they overlap
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    left, right = axes.get_xlim()
    # room for the texts beside the last star and above the first
    axes.set_xlim(left, max(right * 2.0, left * 10.0))
    low, high = axes.get_ylim()
    # what is far below the error of the reference says nothing
    low = max(low, _LOWEST, 100 * floor / 5.0)
    axes.set_ylim(low, max(2.5 * high, 10.0))
    if high <= _LOWEST:
        middle = {"ha": "center", "va": "center", "fontsize": 8, "color": _STAR, "transform": axes.transAxes}
        axes.text(0.5, 0.5, f"all errors below {_LOWEST:g} %", middle)
    if floor > 0.0:
        axes.axhspan(low, max(100 * floor, low), color="0.9", zorder=0, label="error of the reference")
    axes.set_xlabel("CPU time of the run (s)")
    axes.set_ylabel("error (%)")
