"""The summary figure of a run, drawn from its DataTree.

Only matplotlib's object interface is used: no window system, no global state.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import xarray as xr

from ..errors import Problem, ResultsError
from .files import written_whole
from .measures import InterfaceFields, friction_sum, normal_resultant
from .panels import FEW, count_panel, curve_panel, energy_panel, final_panel, force_panel, status_panel
from .quantities import prefix_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

FORMATS = (".png", ".pdf", ".svg")


@dataclass(frozen=True)
class _Panel:
    """One row of a column: its height in inches and what draws it."""

    height: float
    draw: Callable[[Axes], None]


def summary_figure(tree: xr.DataTree) -> Figure:
    """Forces, contact states, convergence and, when present, energy of a run.

    Normal resultant and friction of the interfaces; one strip per interface that can open, with the shares
    of its area that stick, slip and are open; convergence; energy of the assembly. Many strips get a column
    of their own.
    """
    from matplotlib.figure import Figure

    groups = _interfaces(tree)
    scale = _time_scale(groups)
    forces, strips = _force_panels(groups, scale), _strips(groups, scale)
    rest = _convergence_panels(tree, scale) + _energy_panels(tree, scale)
    columns = [forces + strips, rest] if len(strips) <= FEW else [forces + rest, strips]
    columns = [column for column in columns if column]
    height = max((sum(panel.height for panel in column) for column in columns), default=1.0) + 1.0
    figure = Figure(figsize=(6.2 * max(1, len(columns)), height), layout="constrained")
    unfinished = not tree.attrs.get("converged", 1)
    title = f"{tree.attrs.get('scene_name', 'run')}{' (NOT CONVERGED)' if unfinished else ''}"
    figure.suptitle(title, fontweight="bold", color="#B00000" if unfinished else "black")
    parts: list[SubFigure] = list(figure.subfigures(1, max(1, len(columns)), squeeze=False).flat)
    for part, column in zip(parts, columns, strict=False):
        _draw_column(part, column)
    if len(groups) > FEW:
        _legend(parts[0], parts[0].axes[0], "outside upper center", "interfaces")
    if strips:
        last = parts[0 if len(strips) <= FEW else -1]
        _legend(last, last.axes[-1], "outside lower center")
    return figure


def _draw_column(part: SubFigure, column: list[_Panel]) -> None:
    heights = [panel.height for panel in column]
    stack = part.subplots(len(column), 1, height_ratios=heights, squeeze=False)
    for axis, panel in zip(stack.flat, column, strict=True):
        panel.draw(axis)


def _legend(
    part: SubFigure,
    axis: Axes,
    place: Literal["outside upper center", "outside lower center"],
    title: str | None = None,
) -> None:
    handles, labels = axis.get_legend_handles_labels()
    part.legend(handles, labels, loc=place, ncols=4, fontsize="small", title=title)


def _interfaces(tree: xr.DataTree) -> dict[str, xr.Dataset]:
    if "interfaces" not in tree.children:
        return {}
    return {name: node.to_dataset() for name, node in tree["interfaces"].children.items()}


def _time_scale(groups: dict[str, xr.Dataset]) -> tuple[float, str]:
    end = max((float(dataset["time"].values[-1]) for dataset in groups.values()), default=1.0)
    return prefix_for(end, "s", micro="µ")


def _force_panels(groups: dict[str, xr.Dataset], scale: tuple[float, str]) -> list[_Panel]:
    fields = {name: InterfaceFields.of_dataset(dataset) for name, dataset in groups.items()}
    if not fields:
        return []
    time = next(iter(fields.values())).time
    normal = {name: normal_resultant(item) for name, item in fields.items()}
    reference = max(float(np.abs(curve).max(initial=0.0)) for curve in normal.values())
    draw = partial(force_panel, title="Normal resultant (compression > 0)", reference=reference)
    panels = [_Panel(2.4, partial(draw, time=time, curves=normal, scale=scale))]
    if any(float(dataset.attrs.get("friction_coefficient", 0.0)) > 0.0 for dataset in groups.values()):
        friction = {name: friction_sum(item) for name, item in fields.items()}
        draw = partial(force_panel, title="Friction, sum of magnitudes over the points", reference=reference)
        panels.append(_Panel(2.4, partial(draw, time=time, curves=friction, scale=scale)))
    return panels


def _strips(groups: dict[str, xr.Dataset], scale: tuple[float, str]) -> list[_Panel]:
    contacts = {name: dataset for name, dataset in groups.items() if "contact_status" in dataset}
    names = list(contacts)
    strips = []
    for name, dataset in contacts.items():
        draw = partial(status_panel, name=name, dataset=dataset, scale=scale)
        strips.append(_Panel(0.75, partial(draw, first=name == names[0], last=name == names[-1])))
    return strips


def _convergence_panels(tree: xr.DataTree, scale: tuple[float, str]) -> list[_Panel]:
    if "convergence" not in tree.children or "iterations" not in tree["convergence"]:
        return []
    convergence = tree["convergence"].to_dataset()
    if convergence.sizes["window"] == 1:
        return [_Panel(2.4, partial(curve_panel, convergence=convergence, tolerance=_tolerance(tree)))]
    final = partial(final_panel, tolerance=_tolerance(tree))
    return [_Panel(2.2, partial(draw, convergence=convergence, scale=scale)) for draw in (count_panel, final)]


def _tolerance(tree: xr.DataTree) -> float | None:
    """Tolerance on sqrt(eta), from the text of the scene the results keep; None if it does not tell."""
    try:
        return float(tomllib.loads(tree.attrs["scene"])["solver"]["tolerance"])
    except (KeyError, TypeError, ValueError):  # an unreadable text is a ValueError
        return None


def _energy_panels(tree: xr.DataTree, scale: tuple[float, str]) -> list[_Panel]:
    if "energy" not in tree.children:
        return []
    return [_Panel(2.6, partial(energy_panel, energy=tree["energy"].to_dataset(), scale=scale))]


def check_figure_path(path: str | Path) -> None:
    """Make sure the suffix names a format figures can be saved in.

    Raises
    ------
    ResultsError : another suffix.
    """
    suffix = Path(path).suffix
    if suffix.lower() not in FORMATS:
        problem = Problem(
            str(path),
            "figures cannot be saved in this format",
            suffix or "no suffix",
            ", ".join(FORMATS),
            "change the suffix",
        )
        raise ResultsError([problem], "cannot write the figure")


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write the figure, whole or not at all; the suffix chooses the format (png, pdf or svg).

    Raises
    ------
    ResultsError : the format is not known or the file cannot be written.
    """
    check_figure_path(path)
    with written_whole(path) as draft:
        figure.savefig(draft, dpi=150)
