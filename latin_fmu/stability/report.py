"""The stability report: a table and a figure for people, one list of objects for programs, time schemes compared."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..pictures.style import BAD, styled
from .case import Bench, CaseResult, energies, impulse, pressure_force
from .impact import bouncing, kept
from .scenes import thrown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_KEYS = ("case", "expected", "measured", "passed", "iterations", "fallbacks", "seconds")


def as_json(rows: Sequence[CaseResult]) -> str:
    """One list of objects with the keys case, expected, measured, passed, iterations, fallbacks, seconds."""
    lines = (json.dumps({key: _plain(getattr(row, key)) for key in _KEYS}, allow_nan=False) for row in rows)
    return "[\n  " + ",\n  ".join(lines) + "\n]"


def _plain(value: object) -> object:
    return round(value, 4) if isinstance(value, float) and math.isfinite(value) else value


def verdict(rows: Sequence[CaseResult], left_out: int = 0) -> str:
    """One sentence on the whole suite; ``left_out``: cases that a limit of CPU time has left out."""
    failed = [row.case + ", a known fault" * row.known for row in rows if not row.passed]
    seconds = sum(row.seconds for row in rows)
    kept = f"{len(rows) - len(failed)} of {len(rows)} hard cases hold ({seconds:.0f} s)"
    kept += f"; stopped by the limit of CPU time: {left_out} cases left out" * bool(left_out)
    return kept + (f"; failed: {'; '.join(failed)}" if failed else "")


def as_markdown(rows: Sequence[CaseResult], schemes: str, figure: str | None, left_out: int = 0) -> str:
    """The whole report: verdict, figure, one table of cases by family, the table of time schemes (not where a limit of
    CPU time has left out cases)."""
    parts = ["# Stability report", "", verdict(rows, left_out) + ".", ""]
    if figure is not None:
        parts += [f"![Margins and iterations of every case]({figure})", ""]
    parts += [
        "Every number is measured in this run and compared with an independent expectation: a closed form, a",
        "scaling, a symmetry, a balance, or the same discrete problem iterated to round-off. Iterations: largest in",
        "a window and mean; fall-backs: windows in which one was used.",
        "",
        "| case | expected | measured | holds | iterations | fall-backs | s |",
        "|---|---|---|---|---|---|---|",
    ]
    family = ""
    for row in rows:
        if row.family != family:
            family = row.family
            parts.append(f"| **{family}** | | | | | | |")
        holds = "yes" if row.passed else "no, a known fault" if row.known else "**no**"
        parts.append(
            f"| {_cell(row.case)} | {_cell(row.expected)} | {_cell(row.measured)} | {holds} "
            f"| {row.iterations} ({row.mean_iterations:.1f}) | {row.fallbacks} | {row.seconds:.1f} |"
        )
    return "\n".join([*parts, "", schemes]) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


_SMALLEST = 1e-8  # margins below it are drawn there
_GOOD, _QUIET = "#0072B2", "#adb5bd"


@styled
def stability_figure(rows: Sequence[CaseResult]) -> Figure:
    """Left: measured over allowed (1 is the limit); right: LATIN iterations per window, mean and largest."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 1.6 + 0.155 * len(rows)), layout="constrained")
    margins, counts = figure.subplots(1, 2, sharey=True, width_ratios=[1.25, 1])
    place = np.arange(len(rows))
    _margins(margins, rows, place)
    _counts(counts, rows, place)
    margins.set_yticks(place, [row.case for row in rows], fontsize=6.5)
    margins.set_ylim(len(rows) - 0.4, -0.6)
    starts = [i for i, row in enumerate(rows) if i == 0 or rows[i - 1].family != row.family]
    for axes in (margins, counts):
        for start in starts[1:]:
            axes.axhline(start - 0.5, color="0.75", linewidth=0.8)
        axes.grid(axis="x", color="0.92")
        axes.set_axisbelow(True)
    for start in starts:
        counts.text(1.01, start, rows[start].family, transform=counts.get_yaxis_transform(), fontsize=8, va="center")
    failed = sum(not row.passed for row in rows)
    figure.suptitle(f"Stability suite: {len(rows) - failed} of {len(rows)} hard cases hold", fontsize=11)
    return figure


def _margins(axes: Axes, rows: Sequence[CaseResult], place: np.ndarray) -> None:
    # infinite margins end at the edge of the figure
    values = np.clip([row.margin for row in rows], _SMALLEST, 1e3)
    axes.hlines(place, _SMALLEST, values, color="0.85", linewidth=1)
    passed = np.array([row.passed for row in rows], dtype=bool)
    axes.scatter(values[passed], place[passed], color=_GOOD, s=14, zorder=3)
    axes.scatter(values[~passed], place[~passed], color=BAD, marker="X", s=30, zorder=3)
    axes.axvline(1.0, color=BAD, linewidth=1.2)
    axes.set_xscale("log")
    axes.set_xlim(_SMALLEST / 2, max(4.0, 2 * float(values.max())))
    axes.set_xlabel("worst measured value over its limit (limit: red line)", fontsize=8)
    axes.tick_params(axis="x", labelsize=7)


def _counts(axes: Axes, rows: Sequence[CaseResult], place: np.ndarray) -> None:
    # 0 has no place on a logarithmic axis
    largest = np.array([max(row.iterations, 0.8) for row in rows], dtype=float)
    mean = np.array([max(row.mean_iterations, 0.8) for row in rows])
    axes.hlines(place, mean, largest, color=_QUIET, linewidth=1.5)
    axes.scatter(largest, place, marker="|", color="0.3", s=22, label="largest", zorder=3)
    axes.scatter(mean, place, color=_GOOD, s=10, label="mean", zorder=3)
    helped = [i for i, row in enumerate(rows) if row.fallbacks]
    hollow: dict[str, Any] = {"marker": "D", "facecolors": "none", "edgecolors": BAD, "zorder": 4}
    axes.scatter(largest[helped], place[helped], s=26, label="fall-back used", **hollow)
    axes.set_xscale("log")
    axes.set_xlim(0.7, max(300.0, 1.3 * float(largest.max())))
    axes.set_xticks([1, 3, 10, 30, 100, 300], ["1", "3", "10", "30", "100", "300"], fontsize=7)
    axes.minorticks_off()
    axes.set_xlabel("LATIN iterations per window", fontsize=8)
    axes.legend(loc="lower right", fontsize=7)


SCHEMES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "generalized_alpha (default for bodies that land)": {"type": "generalized_alpha"},
        "generalized_alpha, landing_damping 0": {"type": "generalized_alpha", "landing_damping": 0.0},
        "hht, alpha -0.1": {"type": "hht", "alpha": -0.1},
        "hht, alpha -0.3": {"type": "hht", "alpha": -0.3},
        "massless_contact": {"type": "massless_contact"},
        "newmark, undamped": {"type": "newmark", "beta": 0.25, "gamma": 0.5},
        "newmark, gamma 0.6": {"type": "newmark", "beta": 0.3025, "gamma": 0.6},
        "newmark, gamma 0.7": {"type": "newmark", "beta": 0.36, "gamma": 0.7},
    }
)
_SPEED, _FORCE, _IMPULSE = 10.0, 300.0, 200.0
_SCHEME_TABLE = """\
## Time schemes on impact

Bar of length 10 (wave speed 30) against rigid ground: thrown at speed 10 (exact force 300 for 2/3, impulse
200, one rise and one fall: variation 600), then dropped under gravity (energy kept). Same mesh and step.

| scheme | impulse off by | peak over 300 | variation over 600 | energy kept after the throw \
| penetration (steps x speed) | bounces | energy kept after them | iterations |
|---|---|---|---|---|---|---|---|---|"""


def compare_schemes(elements: int = 50, bounces: int = 3) -> str:
    """Markdown table of all time schemes; the step is 0.6 of the transit of an element."""
    return "\n".join([_SCHEME_TABLE, *(_line(n, dict(scheme), elements, bounces) for n, scheme in SCHEMES.items())])


def _line(name: str, scheme: dict[str, Any], elements: int, bounces: int) -> str:
    """One scheme: error of the impulse, peak and total variation of the force over the exact ones, energy kept."""
    bench = Bench()
    scene = thrown(elements, round(2.0 / (0.6 / 3 / elements)), 2.0, 5.0, -_SPEED, 0.0)
    scene["time"]["scheme"] = scheme
    solution = bench.solve(scene)
    force, energy = pressure_force(solution, "wall"), energies(solution)
    stored = energy["kinetic"] + energy["elastic"]
    dropped = bench.solve(bouncing(bounces, elements, scheme))
    cells = (
        name,
        f"{100 * (impulse(solution, 'wall') / _IMPULSE - 1):.2f} %",
        f"{float(force.max()) / _FORCE:.2f}",
        f"{float(np.abs(np.diff(force)).sum()) / (2 * _FORCE):.2f}",
        f"{100 * float(stored[-1] / stored[0]):.1f} %",
        f"{solution.outcome.penetration() / (float(solution.time[1]) * _SPEED):.2f}",
        str(bounces),
        f"{100 * kept(dropped):.1f} %",
        f"{sum(bench.iterations) / len(bench.iterations):.1f}",
    )
    return f"| {' | '.join(cells)} |"
