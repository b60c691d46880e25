"""Crushing of two specimens with friction: what friction does to them.

A steel specimen is pressed on an aluminium one by a half-sine pressure (quarter model). To see: friction changes the
slip, hardly the normal force, and hardly the number of iterations; faces that slip for small coefficients stick for
large ones. ``the_paper.py`` shows the iterations. Writes
  crushing_friction.png  force, friction, slip and contact states for mu = 0, 0.05, 0.1 and 10
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from example_tools import COLOURS, MODELS, Array, halves, options, save, table, tidy
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import latin_fmu
from latin_fmu.latin.outcome import InterfaceHistory
from latin_fmu.pictures.style import LINES

SCENE = MODELS / "two_specimen_crushing" / "scene.toml"
FRICTION = (0.0, 0.05, 0.1, 10.0)
STATES = (("stick", "#4D4D4D"), ("slip", "#F6D55C"), ("separation", "#EAEAEA"))
NEGLIGIBLE = 1e-3  # of the largest pressure: below it a point counts as open (numerical waves ahead of the front)
COARSER = ("substructure.lower.box.elements=[3, 3, 3]", "substructure.upper.box.elements=[3, 3, 3]")


@dataclass(frozen=True)
class Crush:
    """Histories of the contact between the specimens (quarter model).

    ``normal`` compression > 0 and ``friction`` along x on the lower specimen, N; ``slip`` distance slipped while
    pressed, mean over the face, m; ``states`` (n_time, 3) share of the face that sticks, slips, is open.
    """

    time: Array
    normal: Array
    friction: Array
    slip: Array
    states: Array

    @property
    def separation(self) -> float:
        """Last instant at which the normal force exceeds 1 % of its peak, s."""
        return float(self.time[np.flatnonzero(self.normal > 0.01 * self.normal.max())[-1]])


def crush(time: Array, history: InterfaceHistory) -> Crush:
    """Resultants, slip and states from the local-stage fields; a window without its start gets it as zero."""
    force, status, share = history.force(), history.contact_status, history.areas / history.areas.sum()
    if status is None:
        raise ValueError("not a contact")
    sliding = (history.velocity[:, 1] - history.velocity[:, 0])[:, :, :2]  # N is z
    speed = np.where(status > 0, np.linalg.norm(sliding, axis=2), 0.0) @ share
    pressure = -history.traction[:, :, 2]
    status = np.where(pressure > NEGLIGIBLE * pressure.max(), status, 0)
    states = np.stack([(status == state) @ share for state in (1, 2, 0)], axis=1)
    columns = np.column_stack([-force[:, 2], force[:, 0], speed, states])
    if len(columns) < len(time):
        columns = np.vstack([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0], columns])
    slip = np.concatenate([[0.0], np.cumsum(np.diff(time) * columns[1:, 2])])
    return Crush(time, columns[:, 0], columns[:, 1], slip, columns[:, 3:])


def solve(friction: float, settings: Sequence[str]) -> tuple[Crush, latin_fmu.Solution]:
    """The model with another friction coefficient and other settings."""
    scene = latin_fmu.load_scene(SCENE, (f"interface.crush.friction_coefficient={friction}", *settings))
    solution = latin_fmu.solve(scene)
    return crush(solution.time, solution.interfaces["crush"]), solution


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)

    # scene and solve: default settings, several coefficients
    settings = COARSER if arguments.quick else ()
    found, passes = {}, []
    for friction in FRICTION:
        found[friction], solution = solve(friction, settings)
        passes.append(solution.passes)

    # check
    separations = [c.separation for c in found.values()]
    step = float(np.diff(solution.time)[0])
    numbers = {
        "stick_without_friction": float(found[0.0].states[:, 0].max()),
        "slip_ratio_mu_10_to_0": float(found[10.0].slip[-1] / found[0.0].slip[-1]),
        "states_met_at_mu_0.1": float((found[0.1].states.max(axis=0) > 0.0).sum()),
        "separation_us": 1e6 * float(np.mean(separations)),
        "separation_spread_in_steps": (max(separations) - min(separations)) / step,
        "peak_normal_kN": 1e-3 * float(found[0.1].normal.max()),
        "passes_ratio": max(passes) / min(passes),
        "passes": max(passes),
    }

    # save
    save(figure_of_friction(found), arguments.folder, "crushing_friction")
    return numbers


def quantities(found: Crush) -> Iterator[tuple[str, Array]]:
    """What the line panels show, with its label."""
    yield "normal force (kN)", 1e-3 * found.normal
    yield "friction force along x (kN)", 1e-3 * found.friction
    yield "mean slip (µm)", 1e6 * found.slip


def figure_of_friction(found: dict[float, Crush]) -> Figure:
    """Histories of every coefficient on the left, contact states on the right."""
    figure = Figure(figsize=(12.5, 8.0), layout="constrained")
    figure.suptitle("Crushing of two specimens: the influence of friction", fontweight="bold")
    left, right = halves(figure, 1.1)
    lines = left.subplots(3, 1, sharex=True)
    for (friction, curves), colour, line in zip(found.items(), COLOURS, LINES, strict=False):
        style = {"color": colour, "linestyle": line, "linewidth": 1.5, "label": f"$\\mu$ = {friction:g}"}
        for axis, (label, values) in zip(lines, quantities(curves), strict=True):
            axis.plot(1e6 * curves.time, values, **style)
            axis.set_ylabel(label)
    for axis in lines:
        axis.axhline(0.0, color="0.6", linewidth=0.6, zorder=0)
        axis.set_xlim(0.0, 1e6 * curves.time[-1])
        tidy(axis)
    lines[0].legend(fontsize="small", frameon=False)
    lines[-1].set_xlabel("time (µs)")
    strips = right.subplots(len(found), 1, sharex=True)
    for axis, (friction, curves), colour in zip(strips, found.items(), COLOURS, strict=False):
        draw_states(axis, curves)
        axis.set_title(f"$\\mu$ = {friction:g}", loc="left", fontsize="medium", color=colour, fontweight="bold")
    strips[0].legend(fontsize="small", loc="lower right", ncols=3, bbox_to_anchor=(1.0, 1.0), frameon=False)
    strips[-1].set_xlabel("time (µs)")
    return figure


def draw_states(axis: Axes, found: Crush) -> None:
    """Shares of the contact face that stick, slip and are open, stacked."""
    labels, shades = zip(*STATES, strict=True)
    axis.stackplot(1e6 * found.time, 100.0 * found.states.T, labels=labels, colors=shades, step="post")
    axis.set(ylim=(0, 100), ylabel="% of the face", xlim=(0.0, 1e6 * found.time[-1]), yticks=(0, 50, 100))


if __name__ == "__main__":
    print(table(main()))
