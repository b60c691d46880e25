"""Figure of the comparison with CalculiX: contact forces above, CPU times below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from example_tools import BLUE, EXACT, GREEN, ORANGE, VERMILION, Array, tidy
from matplotlib.figure import Figure


class Curve(Protocol):
    """One code's answer."""

    name: str
    seconds: float
    time: Array
    force: Array


def figure(found: Mapping[str, tuple[Curve, Sequence[Curve]]]) -> Figure:
    """One column for each case: normal contact force against time, and bars of the CPU time."""
    drawing = Figure(figsize=(4.6 * len(found), 6.4), layout="constrained")
    drawing.suptitle("The same scenes by this package and by CalculiX", fontweight="bold")
    grid = drawing.subplots(2, len(found), height_ratios=(1.6, 1.0), squeeze=False)
    colours = (BLUE, ORANGE, VERMILION, GREEN)
    for column, (title, (exact, answers)) in enumerate(found.items()):
        above, below = grid[:, column]
        for order, (answer, colour) in enumerate(zip(answers, colours, strict=False)):
            curve = {"color": colour, "linewidth": 1.3, "zorder": 3 - 0.1 * order}  # the first one on top
            above.plot(1e6 * answer.time, 1e-3 * answer.force, label=answer.name, **curve)
        above.plot(1e6 * exact.time, 1e-3 * exact.force, **{**EXACT, "label": "reference", "zorder": 4})
        above.set(
            title=f"{title} (reference: {exact.name})", xlabel="time (µs)", ylabel="normal contact force (kN)"
        )
        places = range(len(answers))
        below.barh(places, [a.seconds for a in answers], color=colours[: len(answers)], height=0.6)
        below.set_yticks(places, [a.name.replace(", ", ",\n") for a in answers])
        below.invert_yaxis()
        below.set(xscale="log", xlabel="CPU time (s), one thread")
        for place, answer in zip(places, answers, strict=True):
            label = f" {answer.seconds / answers[0].seconds:.0f} x" if place else f" {answer.seconds:.2g} s"
            below.annotate(label, (answer.seconds, place), va="center")
        below.set_xlim(right=6.0 * max(a.seconds for a in answers))
        tidy(above)
        tidy(below)
    drawing.legend(
        *grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False
    )
    return drawing
