"""The stability report: a page of families and a figure, all cases as JSON, time schemes compared."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..pictures.style import BAD, styled
from .case import Bench, CaseResult, energies, impulse, pressure_force
from .impact import bouncing, energy_share
from .scenes import thrown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_KEYS = ("family", "case", "expected", "measured", "margin", "passed", "iterations", "fallbacks", "seconds")

FAMILIES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "contrast": (
            "Young's modulus and density of neighbours up to 1e6, lengths up to 100",
            "closed form to what mesh and step leave; the same problem at round-off to the force tolerance of 1 %; "
            "three times the iterations without contrast",
        ),
        "gap": (
            "0, 1e-16 to 0.5 lengths, never closed, overlap, grazing, preload",
            "closed form: an impulse to 0.75 of a step, a contact to 1.5 steps; nothing at all without load",
        ),
        "friction": (
            "0 to 1e6, oblique impacts, a corner of three walls, no_slip",
            "Coulomb's law and momentum to round-off; up to twice the passes without friction",
        ),
        "joint": (
            "clamped pairs that ride up to 3 km/s or turn, friction at resonance, loads that go and come back, fronts "
            "through 8 joints, cradles",
            "the joint at rest, to what the tolerance leaves; closed forms to mesh and step",
        ),
        "surface": (
            "faces of quadratic cells and edges across them, sliver tetrahedra, a shaft in a sleeve, a curved foot "
            "that bounces",
            "uniform pressure and equilibrium at a tolerance of 1e-9; Lame's cylinder to the mesh",
        ),
        "shape": (
            "elements of aspect 10 to 1000, Poisson's ratio -0.9 to 0.4999, planes of symmetry across interfaces, "
            "interfaces given twice, stacks of 4 and 16 blocks",
            "the same problem at round-off to the force tolerance of 1 %; symmetry at a tolerance of 1e-9",
        ),
        "settings": (
            "search direction times 0.01 to 100, windows of 2 instants to all, units from km to nm, steps",
            "the same result to the tolerance; in other units to round-off",
        ),
        "duration": (
            "20 bounces, 50 transits in contact, landings at Courant numbers 0.05 to 30",
            "exact force and instants to mesh and step; energy lost by the scheme, as measured on refined meshes",
        ),
        "bad input": ("values that are not finite, unknown faces, no elements", "a message for every mistake"),
    }
)
"""What a family of cases varies, and where its limits come from."""


def _nearness(row: CaseResult) -> float:
    """Order of cases by how near they are to their limits; a fault that is known does not stand for its family."""
    if row.passed:
        return row.margin
    if row.known_fault:
        return -1.0
    return math.inf


def as_json(rows: Sequence[CaseResult]) -> str:
    """One list of objects with family, case, expectation with every limit, measured values, the largest of them over
    its limit (null where it is not finite), whether the case holds, iterations, fall-backs and seconds."""
    lines = (json.dumps({key: _plain(getattr(row, key)) for key in _KEYS}, allow_nan=False) for row in rows)
    return "[\n  " + ",\n  ".join(lines) + "\n]"


def _plain(value: object) -> object:
    if not isinstance(value, float):
        return value
    if math.isfinite(value):
        return float(f"{value:.4g}")
    return None


def verdict(rows: Sequence[CaseResult], left_out: int = 0) -> str:
    """One sentence on the whole suite; ``left_out``: cases that a limit of CPU time has left out."""
    failed = [row.case + ", a known fault" * row.known_fault for row in rows if not row.passed]
    seconds = sum(row.seconds for row in rows)
    sentence = f"{len(rows) - len(failed)} of {len(rows)} hard cases hold ({seconds:.0f} s)"
    sentence += f"; stopped by the limit of CPU time: {left_out} cases omitted" * bool(left_out)
    if failed:
        sentence += f"; failed: {'; '.join(failed)}"
    return sentence


def as_markdown(
    rows: Sequence[CaseResult], schemes: str, figure: str | None, left_out: int = 0, data: str | None = None
) -> str:
    """The report, a page: verdict, figure, a row for each family, the table of time schemes (not where a limit of CPU
    time has left out cases). ``data`` : name of the file with all cases."""
    parts = ["# Stability report", "", verdict(rows, left_out) + ".", ""]
    if figure is not None:
        parts += [f"![Margins and iterations of the cases, by family]({figure})", ""]
    parts += [
        "Every number is measured in this run and compared with an independent expectation: a closed form, a",
        "scaling, a symmetry, a balance, or the same discrete problem iterated to round-off. In every run nothing",
        "pulls, friction is within its cone, and energies balance, to ten times the largest error of all cases; so",
        "are limits that the mesh or the tolerance leaves far away.",
        "",
        "| family | varied | hold | nearest to its limit | limits from | iterations: largest, mean | s |",
        "|---|---|---|---|---|---|---|",
    ]
    for family in dict.fromkeys(row.family for row in rows):
        members = [row for row in rows if row.family == family]
        near = max(members, key=_nearness)
        varied, limits = FAMILIES.get(family, ("", ""))
        mean = sum(row.mean_iterations for row in members) / len(members)
        parts.append(
            f"| **{family}** | {varied} | {sum(row.passed for row in members)} of {len(members)} "
            f"| {_cell(near.case)}: {_cell(near.nearest)} | {limits} "
            f"| {max(row.iterations for row in members)}, {mean:.1f} | {sum(row.seconds for row in members):.1f} |"
        )
    if data is not None:
        parts += ["", f"All cases with every limit and measured value: [{data}]({data})."]
    return "\n".join([*parts, "", schemes]) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


_SMALLEST = 1e-4  # margins below it are drawn there
_GOOD, _QUIET = "#0072B2", "#adb5bd"


@styled
def stability_figure(rows: Sequence[CaseResult]) -> Figure:
    """A line for each family. Left: measured over allowed of every case (1 is the limit); right: LATIN iterations per
    window, mean and largest."""
    from matplotlib.figure import Figure

    families = list(dict.fromkeys(row.family for row in rows))
    figure = Figure(figsize=(9, 1.4 + 0.42 * len(families)), layout="constrained")
    margins, counts = figure.subplots(1, 2, sharey=True, width_ratios=[1.25, 1])
    # the cases of a family one below the other around its line
    place = np.zeros(len(rows))
    for line, family in enumerate(families):
        members = [i for i, row in enumerate(rows) if row.family == family]
        if len(members) > 1:
            place[members] = line + np.linspace(-0.32, 0.32, len(members))
        else:
            place[members] = line
    _margins(margins, rows, place)
    _counts(counts, rows, place)
    margins.set_yticks(range(len(families)), families, fontsize=8)
    # downwards: the first family on top, as in the table
    margins.set_ylim(len(families) - 0.5, -0.5)
    for axes in (margins, counts):
        for line in range(1, len(families)):
            axes.axhline(line - 0.5, color="0.8", linewidth=0.8)
        axes.grid(axis="x", color="0.92")
        axes.set_axisbelow(True)
    failed = sum(not row.passed for row in rows)
    figure.suptitle(f"Stability suite: {len(rows) - failed} of {len(rows)} hard cases hold", fontsize=11)
    return figure


def _margins(axes: Axes, rows: Sequence[CaseResult], place: np.ndarray) -> None:
    # infinite margins end at the edge of the figure
    values = np.clip([row.margin for row in rows], _SMALLEST, 10.0)
    passed = np.array([row.passed for row in rows], dtype=bool)
    axes.scatter(values[passed], place[passed], color=_GOOD, s=8, zorder=3)
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
    axes.hlines(place, mean, largest, color=_QUIET, linewidth=0.8)
    axes.scatter(mean, place, color=_GOOD, s=6, label="mean to largest", zorder=3)
    helped = [i for i, row in enumerate(rows) if row.fallbacks]
    hollow: dict[str, Any] = {"marker": "D", "facecolors": "none", "edgecolors": BAD, "zorder": 4}
    axes.scatter(largest[helped], place[helped], s=20, label="fall-back used", **hollow)
    axes.set_xscale("log")
    axes.set_xlim(0.7, max(300.0, 1.3 * float(largest.max(initial=0.0))))
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
_SPEED = 10.0
_FORCE = 300.0
_IMPULSE = 200.0
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
    # transit of an element: 10 / elements / 30
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
        f"{100 * energy_share(dropped):.1f} %",
        f"{sum(bench.iterations) / len(bench.iterations):.1f}",
    )
    return f"| {' | '.join(cells)} |"
