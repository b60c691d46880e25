"""Figure of the comparison with CalculiX: contact forces above, CPU times below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from example_tools import BLUE, EXACT, GREEN, ORANGE, VERMILION, Array, tidy
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator


class Curve(Protocol):
    """One code's result."""

    name: str
    seconds: float
    time: Array
    force: Array


Stacks = Sequence[tuple[int, Mapping[str, tuple[float, float]]]]


def figure(found: Mapping[str, tuple[Curve, Sequence[Curve]]], stacks: Stacks = ()) -> Figure:
    """One column for each case: normal contact force against time, and bars of the CPU time; one for statics."""
    count = len(found) + bool(stacks)
    drawing = Figure(figsize=(4.6 * count, 6.4), layout="constrained")
    drawing.suptitle("The same scenes by this package and by CalculiX", fontweight="bold")
    grid = drawing.subplots(2, count, height_ratios=(1.6, 1.0), squeeze=False)
    if stacks:
        statics(grid[0, -1], grid[1, -1], stacks)
    names = dict.fromkeys(a.name for _, results in found.values() for a in results)
    colour_of = dict(zip(names, (BLUE, ORANGE, VERMILION, GREEN), strict=False))
    for column, (title, (exact, results)) in enumerate(found.items()):
        above, below = grid[:, column]
        for order, result in enumerate(results):
            curve = {
                "color": colour_of[result.name],
                "linewidth": 1.3,
                "zorder": 3 - 0.1 * order,
            }  # the first one on top
            above.plot(1e6 * result.time, 1e-3 * result.force, label=result.name, **curve)
        above.plot(1e6 * exact.time, 1e-3 * exact.force, **{**EXACT, "label": "reference", "zorder": 4})
        above.set(title=f"{title} (reference: {exact.name})", xlabel="time (µs)", ylabel="normal contact force (kN)")
        places = range(len(results))
        below.barh(places, [a.seconds for a in results], color=[colour_of[a.name] for a in results], height=0.6)
        below.set_yticks(places, [a.name.replace(", ", ",\n") for a in results])
        below.invert_yaxis()
        below.set(xscale="log", xlabel="CPU time (s), one thread")
        for place, result in zip(places, results, strict=True):
            label = f" {result.seconds / results[0].seconds:.0f} x" if place else f" {result.seconds:.2g} s"
            below.annotate(label, (result.seconds, place), va="center")
        below.set_xlim(right=6.0 * max(a.seconds for a in results))
        tidy(above)
        tidy(below)
    drawing.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)
    return drawing


def statics(above: Axes, below: Axes, stacks: Stacks) -> None:
    """CPU time and error against the number of plates."""
    counts = [count for count, _ in stacks]
    for name, colour in zip(stacks[0][1], (BLUE, GREEN, ORANGE), strict=True):
        seconds, errors = zip(*(rows[name] for _, rows in stacks), strict=True)
        above.plot(counts, seconds, "o-", color=colour, label=name)
        below.plot(counts, errors, "o-", color=colour)
    above.set(title="plates pressed and sheared, statics", ylabel="CPU time (s), one thread")
    below.set(xlabel="plates", ylabel="error of the displacements")
    for axis in (above, below):
        axis.set(xscale="log", yscale="log")
        axis.set_xticks(counts, [str(c) for c in counts])
        axis.xaxis.set_minor_locator(NullLocator())
        tidy(axis)
    above.legend(fontsize="small", frameon=False)
