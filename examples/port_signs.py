"""Signs of a port and what a host sets: the figure of docs/join_your_tool.md.

Nothing is run. A force is the one on the body, positive along the global axis whatever the normal of the face; a port
whose motion is given returns the force on the model that moves it; of an input the value is that at the start of the
step, the rate its slope over the step; outputs are those at its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from example_tools import BLUE, GREEN, VERMILION, options, save, tidy
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

FACE = 5.2  # place of the face of the port along x
POINTS = (0.5, 1.25, 1.55, 1.2)  # values of an input at the communication points 0, 1, 2, 3


@dataclass(frozen=True)
class Causality:
    """Title of a picture, name and colour of the signal to the body and of the one back, units."""

    title: str
    given: tuple[str, str]
    returned: tuple[str, str]
    units: str


CASES = (
    Causality("force_in", ("force[1] = F", VERMILION), ("velocity[1] = v", BLUE), "F in N, forceRate[1] in N/s"),
    Causality(
        "motion_in", ("velocity[1] = v", BLUE), ("force[1] = $-$F", VERMILION), "v in m/s, velocityRate[1] in m/s$^2$"
    ),
    Causality(
        "wave", ("incident[1] = F + Z v", GREEN), ("reflected[1] = Z v $-$ F", GREEN), "in N; impedance Z in N s/m"
    ),
)


def port(axes: Axes, case: Causality) -> None:
    """The other model at the left, the body with its face at the right, x to the right."""
    for x, width, text, shade in ((0.0, 1.5, "other\nmodel", "0.95"), (FACE, 2.3, "", "0.88")):
        axes.add_patch(Rectangle((x, 0.0), width, 2.6, facecolor=shade, edgecolor="0.4"))
        axes.text(x + width / 2, 1.3, text, ha="center", va="center", fontsize=10)
    axes.text(FACE + 1.15, 2.3, "body", ha="center", va="center", fontsize=10)
    axes.plot([FACE, FACE], [0.0, 2.6], color="black", linewidth=3.5)
    for y, name, colour in ((1.6, "F", VERMILION), (0.7, "v", BLUE)):
        arrow(axes, (FACE, y), (FACE + 1.3, y), colour)
        axes.text(FACE + 1.55, y, name, ha="center", va="center", color=colour, fontsize=12, style="italic")
    for y, (name, colour), ends in ((1.95, case.given, (1.5, FACE)), (0.5, case.returned, (FACE, 1.5))):
        arrow(axes, (ends[0], y), (ends[1], y), colour, linestyle="--")
        axes.text((1.5 + FACE) / 2, y + 0.1, name, ha="center", va="bottom", fontsize=9.5, color=colour)
    arrow(axes, (2.7, -0.35), (4.0, -0.35), "0.3")
    axes.text(4.15, -0.35, "x (1)", va="center", fontsize=9, color="0.3")
    axes.text((FACE + 2.3) / 2, -0.75, case.units, ha="center", va="top", fontsize=9.5)
    axes.set(xlim=(-0.1, FACE + 2.4), ylim=(-1.2, 2.7), aspect="equal")
    axes.set_title(f'causality = "{case.title}"', fontsize=11)
    axes.axis("off")


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: str, linestyle: str = "-") -> None:
    """An arrow; signals are broken lines, quantities at the face full ones."""
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.8, "linestyle": linestyle, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops={**style, "mutation_scale": 15})


def times(axes: Axes) -> None:
    """An input over three communication steps, with rates and without, and when outputs are read."""
    for i, (value, end) in enumerate(pairwise(POINTS)):
        slope = value - POINTS[i - 1] if i else 0.0
        axes.plot([i, i + 1], [value, end], color=VERMILION, label="value and rate" if i == 0 else None)
        alone = {"color": "0.45", "linestyle": ":", "label": "value alone (inputInterpolation = 3)" if i == 0 else None}
        axes.plot([i, i + 1], [value, value + slope], **alone)
    axes.plot(range(3), POINTS[:3], "o", color=VERMILION)
    axes.plot(range(1, 4), [0.12] * 3, "s", color=BLUE)
    note = {"fontsize": 9.5, "arrowprops": {"arrowstyle": "-", "color": "0.6"}}
    axes.annotate("value: of the start of the step", (1.0, POINTS[1]), (0.06, 1.72), color=VERMILION, **note)
    axes.annotate("rate: slope over the step", (1.5, 1.4), (1.35, 0.75), color=VERMILION, **note)
    axes.annotate("outputs: of the end of the step", (1.0, 0.12), (0.08, 0.2), color=BLUE, **note)
    axes.annotate("time steps of the FMU, inside", (2.3, 0.0), (2.45, 0.27), color="0.4", **note)
    axes.set_xticks(range(4), ["$t_n$", "$t_n + h$", "$t_n + 2h$", "$t_n + 3h$"])
    axes.set_xticks([i / 5 for i in range(15)], minor=True)
    axes.tick_params(axis="x", which="minor", length=6, color="0.4")
    axes.set_yticks([])
    axes.set(xlim=(0.0, 3.1), ylim=(0.0, 2.05), ylabel="an input", xlabel="time; h is the communication step")
    axes.legend(frameon=False, fontsize="small", loc="center right", bbox_to_anchor=(1.0, 0.42))
    tidy(axes)


def main(argv: Sequence[str] | None = None) -> None:
    """Draw and save."""
    arguments = options(argv, __doc__)
    figure = Figure(figsize=(11.0, 5.4), layout="constrained")
    grid = figure.add_gridspec(2, 3, height_ratios=(1.15, 1.0))
    for i, case in enumerate(CASES):
        port(figure.add_subplot(grid[0, i]), case)
    times(figure.add_subplot(grid[1, :]))
    print(f"figure: {save(figure, arguments.folder, 'port_signs')}")


if __name__ == "__main__":
    main()
