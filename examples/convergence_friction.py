"""Convergence of the iteration for several friction coefficients: sqrt(eta) against the iteration.

The crushing of two specimens as one window over the whole interval, started from zero: the published setting on
the left, with Anderson acceleration on the right. Writes convergence_friction.png.
"""

from __future__ import annotations

from collections.abc import Sequence

from example_tools import COLOURS, MODELS, options, save, table, tidy
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import latin_fmu

SCENE = MODELS / "two_specimen_crushing" / "scene.toml"
FRICTION = (0.0, 0.05, 0.1, 0.3, 10.0)
COARSER = ("substructure.lower.box.elements=[3, 3, 3]", "substructure.upper.box.elements=[3, 3, 3]")
TOLERANCE = 1e-3
# The figure shows the indicator, so the stopping rule on forces is out of the way here.
WINDOW = (
    "solver.window='whole'",
    "solver.start='zero'",
    "solver.max_iterations=120",
    f"solver.tolerance={TOLERANCE}",
    "solver.force_tolerance=1.0",
)
PANELS = {"none": "plain iteration, as published", "anderson": "with Anderson acceleration (depth 6)"}


def indicator(friction: float, acceleration: str, settings: Sequence[str]) -> list[float]:
    """sqrt(eta) after each iteration."""
    chosen = (f"interface.crush.friction_coefficient={friction}", f"solver.acceleration='{acceleration}'")
    solution = latin_fmu.solve(latin_fmu.load_scene(SCENE, (*chosen, *WINDOW, *settings)))
    return solution.windows[0].error_indicator


def iterations_to(errors: Sequence[float], level: float) -> float:
    """First iteration at or below ``level``; infinite when it is never reached."""
    return next((float(i) for i, e in enumerate(errors, 1) if e <= level), float("inf"))


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)

    # scene and solve
    settings = COARSER if arguments.quick else ()
    curves = {a: {mu: indicator(mu, a, settings) for mu in FRICTION} for a in PANELS}

    # check
    numbers = {
        f"{name}_iterations_to_{level:g}_mu_{mu:g}": iterations_to(errors, level)
        for name, rows in curves.items()
        for level in (1e-2, TOLERANCE)
        for mu, errors in rows.items()
    }

    # save
    save(figure_of_convergence(curves), arguments.folder, "convergence_friction")
    return numbers


def figure_of_convergence(curves: dict[str, dict[float, list[float]]]) -> Figure:
    """Plain and accelerated side by side, one curve per coefficient."""
    figure = Figure(figsize=(11.0, 5.0), layout="constrained")
    figure.suptitle("Crushing of two specimens, one window of 200 instants from zero", fontweight="bold")
    axes = figure.subplots(1, len(curves), sharex=True, sharey=True)
    for axis, (name, rows) in zip(axes, curves.items(), strict=True):
        draw_curves(axis, rows)
        axis.set(title=PANELS[name], xlabel="iteration")
    axes[0].set_ylabel("sqrt(eta)")
    axes[0].legend(fontsize="small", frameon=False)
    return figure


def draw_curves(axis: Axes, rows: dict[float, list[float]]) -> None:
    """sqrt(eta) against the iteration; a dot where the tolerance is met."""
    for (mu, errors), colour in zip(rows.items(), COLOURS, strict=True):
        axis.semilogy(range(1, len(errors) + 1), errors, color=colour, linewidth=1.5, label=f"$\\mu$ = {mu:g}")
        axis.plot(len(errors), errors[-1], "o", color=colour, markersize=5)
    for level in (1e-2, TOLERANCE):
        axis.axhline(level, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
    axis.set_xlim(left=0.0)
    axis.grid(axis="y", color="0.92", linewidth=0.6)
    tidy(axis)


if __name__ == "__main__":
    print(table(main()))
