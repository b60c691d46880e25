"""Friction without inertia: partial slip against its closed form, and a stack whose iterations do not grow.

Left and middle: the bar of models/gripped_bar through a cycle of load, displacement of its end and slip at the turning
points against the exact shear lag. Right: mean iterations per increment for stacks of plates, pressed and then sheared,
with the coarse problem and without it. The end is within 0.1 % of the exact place at the turning points, the loss of a
cycle within 0.2 %. Writes static_friction.png.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from example_tools import BLUE, EXACT, MODELS, VERMILION, Array, options, pressed_plates, save, tidy
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import latin_fmu
from latin_fmu.latin.coarse_problem import CoarseProblem

SCENE = MODELS / "gripped_bar" / "scene.toml"
PULL, LOST, STIFFNESS, LENGTH = 150e3, 500e3, 80e6, 0.5
FULL, SHORT = (2, 4, 8, 16), (2, 8)


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)

    # scene and solve
    bar = latin_fmu.solve(latin_fmu.load_scene(SCENE))
    counts = SHORT if arguments.quick else FULL
    flat = {n: iterations(n) for n in counts}
    with without_coarse():
        growing = {n: iterations(n) for n in counts}

    # check
    force, moved = PULL * np.interp(bar.time, [0, 1, 3, 5], [0, 1, -1, 1]), end(bar)
    friction = bar.energy["friction_dissipation"] if bar.energy is not None else np.zeros(len(bar.time))
    cycle = float(friction[-1] - friction[np.searchsorted(bar.time, 1.0 - 1e-9)])
    numbers = {
        "end_error": float(np.abs(moved - exact(force, bar.time)).max() / np.abs(moved).max()),
        "loss_error": abs(cycle / (2 * PULL**3 / (3 * STIFFNESS * LOST)) - 1),
        **{f"iterations_{n}": value for n, value in flat.items()},
        **{f"iterations_{n}_without_coarse": value for n, value in growing.items()},
    }

    # save
    figure = Figure(figsize=(12.0, 4.2), layout="constrained")
    loop, slip, stack = figure.subplots(1, 3)
    draw_loop(loop, bar, force)
    draw_slip(slip, bar)
    draw_stack(stack, flat, growing)
    save(figure, arguments.folder, "static_friction")
    return numbers


def end(bar: latin_fmu.Solution) -> Array:
    """Displacement of the pulled end, (n_time,), m."""
    history = bar.substructures["bar"]
    assert history.displacement is not None
    mean: Array = history.displacement[:, history.nodes[:, 0] > 0.999 * LENGTH, 0].mean(axis=1)
    return mean


def exact(force: Array, time: Array) -> Array:
    """Displacement of the end: F^2 / (2 EA q) on the first pull, half as much per change of force after a turn."""
    top = PULL**2 / (2 * STIFFNESS * LOST)
    down = top - (PULL - force) ** 2 / (4 * STIFFNESS * LOST)
    up = -top + (PULL + force) ** 2 / (4 * STIFFNESS * LOST)
    first = force**2 / (2 * STIFFNESS * LOST)
    return np.where(time <= 1 + 1e-9, first, np.where(time <= 3 + 1e-9, down, up))


def iterations(n: int) -> float:
    """Mean iterations per increment of a stack to 1e-3, without Newton steps, body by body."""
    tables = pressed_plates(n)
    # energies are those of single bodies, which are solved one by one then
    tables["output"] = {**tables.get("output", {}), "energy": True}
    solver = {**tables.get("solver", {}), "newton": False, "tolerance": 1e-3}
    solution = latin_fmu.solve(latin_fmu.scene_from_dict({**tables, "solver": solver}))
    return float(np.mean([w.iterations for w in solution.windows]))


@contextmanager
def without_coarse() -> Iterator[None]:
    """The global stage as it would be without its coarse problem."""
    sizes = CoarseProblem.sizes
    CoarseProblem.sizes = {"n_coarse": 0, "n_coarse_here": 0, "n_coarse_own": 0}  # type: ignore[method-assign, assignment]
    try:
        yield
    finally:
        CoarseProblem.sizes = sizes  # type: ignore[method-assign]


def draw_loop(axis: Axes, bar: latin_fmu.Solution, force: Array) -> None:
    """Force against displacement of the end."""
    fine = np.linspace(0.0, 5.0, 501)
    pull = PULL * np.interp(fine, [0, 1, 3, 5], [0, 1, -1, 1])
    axis.plot(1e3 * exact(pull, fine), 1e-3 * pull, **EXACT)
    axis.plot(1e3 * end(bar), 1e-3 * force, "o", color=BLUE, markersize=3.5, label="computed")
    axis.set(title="A gripped bar through a cycle of load", xlabel="displacement of the end (mm)", ylabel="pull (kN)")
    axis.legend(fontsize="small", frameon=False)
    tidy(axis)


def draw_slip(axis: Axes, bar: latin_fmu.Solution) -> None:
    """Displacement along the bar at the turning points; the exact one is a parabola from the front of slip on."""
    history = bar.substructures["bar"]
    assert history.displacement is not None
    line = np.flatnonzero((history.nodes[:, 1] == 0.0) & (history.nodes[:, 2] == 0.0))
    x = history.nodes[line, 0]
    reach = np.maximum(x - (LENGTH - PULL / LOST), 0.0)
    for instant, sign, colour, name in ((10, 1, BLUE, "pulled"), (30, -1, VERMILION, "pushed")):
        axis.plot(x, 1e3 * history.displacement[instant, line, 0], "o", color=colour, markersize=3.5, label=name)
        axis.plot(x, sign * 1e3 * LOST * reach**2 / (2 * STIFFNESS), **{**EXACT, "label": None})
    axis.set(title="Along the bar, at the turning points", xlabel="x (m)", ylabel="displacement (mm)")
    axis.legend(fontsize="small", frameon=False)
    tidy(axis)


def draw_stack(axis: Axes, flat: dict[int, float], growing: dict[int, float]) -> None:
    """Mean iterations against the number of plates."""
    axis.plot(list(growing), list(growing.values()), "s--", color=VERMILION, label="without the coarse problem")
    axis.plot(list(flat), list(flat.values()), "o-", color=BLUE, label="with it")
    axis.set(title="Plates pressed and sheared", xlabel="plates", ylabel="iterations per increment, mean")
    axis.set_xscale("log", base=2)
    axis.set_xticks(list(flat), [str(n) for n in flat])
    axis.set_ylim(0.0, None)
    axis.legend(fontsize="small", frameon=False)
    tidy(axis)


if __name__ == "__main__":
    for key, value in main().items():
        print(f"{key:32} {value:.4g}")
