"""Waves in two bars that meet across a gap: the stress in space and time.

A pressure pulse runs down bar 1 (two substructures), is turned back as tension by its free end until the gap
closes, then goes over into bar 2. To see: fronts beside the exact ones; the gap closes at 2.3 L/c, the contact opens at
3.0 L/c. ``the_paper.py`` shows the iterations that build them. Writes
  waves_in_bars.png  stress along the bars at six times, and over the whole of space and time
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from example_tools import BLUE, EXACT, MODELS, Array, halves, options, save, table, tidy
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import latin_fmu

BARS = ("bar1_a", "bar1_b", "bar2")
# The model: E, rho, length of a substructure, pressure, gap in units of 2 p/(rho c) x L/c.
YOUNG, DENSITY, LENGTH, PRESSURE, GAP = 210e9, 7800.0, 0.5, 100e6, 0.3
TRANSIT = LENGTH / np.sqrt(YOUNG / DENSITY)  # L/c
SHOWN = tuple(i / 21 for i in (16, 37, 46, 59, 68, 84))  # L/c, instants of the run
COARSER = ("time.instants=125", *(f"substructure.{name}.box.elements=[1, 1, 25]" for name in BARS))
CELLS = 420  # cells per substructure of the exact solution: its step is L/c / 420


@dataclass
class Stress:
    """Stress (MPa) at places x (m) and instants (L/c); ``values`` (n_time, n_place)."""

    x: Array
    time: Array
    values: Array

    def at(self, time: float) -> Array:
        """Stress along the bars at the instant nearest to ``time`` (L/c)."""
        row: Array = self.values[int(np.abs(self.time - time).argmin())]
        return row


def exact_stress(end: float) -> Stress:
    """d'Alembert's two waves moved one cell per step: exact, as all events fall on the grid.

    ``right`` and ``left`` are the stresses (in units of the pressure) of the two waves in each cell, the velocity is
    (left - right)/(rho c). The gap counts steps at the free velocity 2 p/(rho c).
    """
    n, steps = CELLS, round(end * CELLS)
    right, left, gap = np.zeros(3 * n), np.zeros(3 * n), GAP * n
    rows = [np.zeros(3 * n)]
    for step in range(steps):
        arriving, meeting, back = right[2 * n - 1], left[2 * n], left[0]
        end_of_bar_2 = right[-1]
        right[1:], left[:-1] = right[:-1].copy(), left[1:].copy()
        right[0] = -back - (1.0 if step < n else 0.0)  # loaded end
        left[-1] = -end_of_bar_2  # free end
        if gap > 0.0 or arriving + meeting > 0.0:  # open: both ends free
            gap = max(gap + arriving + meeting, 0.0)
            left[2 * n - 1], right[2 * n] = -arriving, -meeting
        rows.append(right + left)
    places = (np.arange(3 * n) + 0.5) * LENGTH / n
    return Stress(places, np.arange(steps + 1) / n, 1e-6 * PRESSURE * np.array(rows))


def bar_stress(nodes: Array, displacement: Array) -> tuple[Array, Array]:
    """Places (n_element,) and stress E du/dz (n_time, n_element) of a bar along z, mean over the section."""
    levels, level_of = np.unique(np.round(nodes[:, 2], 9), return_inverse=True)
    mean = np.stack([displacement[:, level_of == i, 2].mean(axis=1) for i in range(len(levels))], axis=1)
    strain = np.diff(mean, axis=1) / np.diff(levels)
    return 0.5 * (levels[1:] + levels[:-1]), YOUNG * strain


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)

    # scene
    scene = latin_fmu.load_scene(MODELS / "beam_in_traction" / "scene.toml", COARSER if arguments.quick else ())
    step = scene.time.time_step

    # solve
    solution = latin_fmu.solve(scene)

    # check
    time = solution.time / TRANSIT
    nodes = {name: solution.substructures[name].nodes for name in BARS}
    found = joined(nodes, {name: solution.substructures[name].displacement for name in BARS}, time)
    exact = exact_stress(time[-1])
    contact = solution.interfaces["contact"]
    force = contact.normal_resultant()
    area = contact.areas.sum()
    first = int(np.argmax(force > 0.01 * force.max()))
    tension = found.at(SHOWN[3])  # on its way back in bar 1
    impulse = -contact.impulse(solution.time)[-1, 2] / (0.7 * PRESSURE * TRANSIT * area)
    numbers = {
        "iterations": float(solution.windows[0].iterations),
        "error_indicator": solution.error_indicator,
        "contact_instant_error_in_steps": (time[first] - 2.3) * TRANSIT / step,
        "impulse_ratio": impulse,
        "stress_error": relative_error(found, exact),
        "tension_level_ratio": float(np.median(tension[tension > 50.0])) / 100.0,
    }

    # save
    save(figure_of_waves(found, exact), arguments.folder, "waves_in_bars")
    return numbers


def joined(nodes: Mapping[str, Array], displacement: Mapping[str, Array | None], time: Array) -> Stress:
    """The bars one after the other, in the coordinates of the reference state without the gap."""
    places, stresses = [], []
    for number, name in enumerate(BARS):
        moved = displacement[name]
        if moved is None:
            raise ValueError("the scene must request fields: output.fields = true")
        x, stress = bar_stress(nodes[name], moved)
        places.append(x - nodes[name][:, 2].min() + number * LENGTH)
        stresses.append(1e-6 * stress)
    return Stress(np.concatenate(places), time, np.concatenate(stresses, axis=1))


def relative_error(found: Stress, exact: Stress) -> float:
    """L2 distance over space and time, relative; the exact stress is averaged over each element."""
    rows = exact.values[np.round(found.time * CELLS).astype(int)]
    borders = np.linspace(0.0, 3 * LENGTH, len(exact.x) + 1)
    primitive = np.concatenate([np.zeros((len(rows), 1)), np.cumsum(rows, axis=1)], axis=1)
    edges = np.linspace(0.0, 3 * LENGTH, len(found.x) + 1)
    mean = np.array([np.diff(np.interp(edges, borders, row)) for row in primitive]) * len(found.x) / len(exact.x)
    return float(np.linalg.norm(found.values - mean) / np.linalg.norm(mean))


def draw_bars(axis: Axes) -> None:
    """The two bars as grey bodies behind the curves; the joint of the substructures as a dotted line."""
    axis.axvspan(0.0, 2 * LENGTH, color="0.93", zorder=-2, linewidth=0)
    axis.axvspan(2 * LENGTH, 3 * LENGTH, color="0.87", zorder=-2, linewidth=0)
    axis.axvline(LENGTH, color="0.6", linewidth=0.8, linestyle=":", zorder=-1)
    axis.axvline(2 * LENGTH, color="0.3", linewidth=1.2, zorder=-1)
    axis.axhline(0.0, color="0.6", linewidth=0.6, zorder=-1)
    axis.set(xlim=(0.0, 3 * LENGTH), ylim=(-150, 215), yticks=(-100, 0, 100))
    tidy(axis)


def name_bars(axis: Axes) -> None:
    """Names of the bodies above the first panel."""
    for place, text in ((LENGTH, "bar 1"), (2.5 * LENGTH, "bar 2")):
        axis.annotate(text, (place, 1.03), xycoords=("data", "axes fraction"), ha="center", fontsize="small")


def figure_of_waves(found: Stress, exact: Stress) -> Figure:
    """Six snapshots on the left, the plane of space and time on the right."""
    figure = Figure(figsize=(12.0, 7.5), layout="constrained")
    figure.suptitle("A pressure pulse crosses two bars with a gap between them", fontweight="bold")
    left, right = halves(figure, 1.15)
    axes = left.subplots(len(SHOWN), 1, sharex=True)
    notes = (
        "compression enters bar 1",
        "and runs through the joint",
        "the free end turns it into tension",
        "gap closed: the rest goes into bar 2",
        "tension back in bar 1, compression in bar 2",
        "the far end reflects",
    )
    for axis, time, note in zip(axes, SHOWN, notes, strict=True):
        draw_bars(axis)
        axis.plot(found.x, found.at(time), color=BLUE, linewidth=1.6, label="computed")
        axis.plot(exact.x, exact.at(time), **EXACT)
        axis.text(
            0.01,
            0.93,
            f"t = {time:.2f} L/c  ({1e6 * time * TRANSIT:.0f} µs): {note}",
            va="top",
            fontsize="small",
            transform=axis.transAxes,
        )
    name_bars(axes[0])
    axes[0].legend(loc="lower right", fontsize="small", ncols=2, frameon=False)
    left.supylabel("stress (MPa), tension > 0", fontsize="medium")
    axes[-1].set_xlabel("place along the bars (m)")
    draw_plane(right.subplots(), found)
    return figure


def draw_plane(axis: Axes, found: Stress) -> None:
    """Stress as colour over place and time, with the times of the snapshots."""
    image = axis.pcolormesh(found.x, found.time, found.values, cmap="RdBu_r", vmin=-120, vmax=120, rasterized=True)
    axis.figure.colorbar(image, ax=axis, label="stress (MPa): compression blue, tension red", shrink=0.8)
    axis.axvline(2 * LENGTH, color="black", linewidth=1.2)
    axis.axvline(LENGTH, color="0.4", linewidth=0.8, linestyle=":")
    axis.plot([2 * LENGTH] * 2, [2.3, 3.0], color="black", linewidth=6, solid_capstyle="butt")
    for time in SHOWN:
        axis.axhline(time, color="0.25", linewidth=0.6, linestyle=(0, (2, 3)))
    axis.annotate(
        "contact presses\n(exact: 2.3 to\n3.0 L/c)",
        (2 * LENGTH, 2.65),
        (2.2 * LENGTH, 0.95),
        fontsize="small",
        arrowprops={"arrowstyle": "->", "linewidth": 0.8},
    )
    name_bars(axis)
    axis.set(xlabel="place along the bars (m)", ylabel="time (L/c)", ylim=(0.0, found.time[-1]))


if __name__ == "__main__":
    print(table(main()))
