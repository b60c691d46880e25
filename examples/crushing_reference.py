"""A reference for the crushing of two specimens: what its quantities are, and how well they are known.

No closed solution exists. Explicit runs (central differences, lumped mass: another scheme than the scene's) on fine
meshes give every quantity but one; what depends on the step is extrapolated to none. The error is twice what the step
and a coarser mesh change, because single differences are now and then small by chance, and at least 1e-4.
The instant at which the force passes 1 % of its peak lies half a millimetre behind the head of the wave: meshes fine
along the path of the wave and coarse across it find it, on the first 2.2 us. Writes
  reference.json            for ``latin-fmu cost``, beside the scene in models/two_specimen_crushing
  crushing_reference.png    how the first contact and the separation converge
Three minutes and 2.5 GB; coarser with --quick.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from example_tools import BLUE, GREEN, MODELS, ORANGE, options, save, table, tidy
from matplotlib.figure import Figure

import latin_fmu
from latin_fmu.accuracy.study import FILE, physics_of
from latin_fmu.results.interface_fields import Force
from latin_fmu.run_quantities import Quantities, measure_solution

SCENE = MODELS / "two_specimen_crushing" / "scene.toml"
SPEED = float(np.sqrt(210e9 * 0.7 / (1.3 * 0.4) / 7800.0))  # pressure waves in steel, m/s
EDGE, EARLY = 0.01, 2.2e-6
SAFETY, LEAST = 2.0, 1e-4
FIRST, HISTORY = "crush.first_contact", "crush.force_rms"
POINTS = 601
"""Of the force history kept."""


@dataclass(frozen=True)
class Plan:
    """Elements along an edge, and steps for the steps of the scene on the same mesh; elements along and across the
    path of the wave for the first contact."""

    coarse: int
    fine: int
    along: tuple[int, int, int]
    across: tuple[int, int]


FULL, QUICK = Plan(15, 24, (120, 240, 360), (12, 18)), Plan(6, 12, (60, 120, 180), (4, 6))


def explicit(elements: Sequence[int], instants: int, end: float) -> Quantities:
    """Quantities of an explicit run."""
    mesh = [f"substructure.{body}.box.elements={list(elements)}" for body in ("lower", "upper")]
    time = ["time.scheme=central_difference", f"time.end={end}", f"time.step={end / instants}"]
    scene = latin_fmu.load_scene(SCENE, [*mesh, *time, "output.energy=false"])
    solution = latin_fmu.solve(scene)
    assert solution.converged, solution.status
    return measure_solution(scene, solution)


def cube(n: int, shorter: int) -> Quantities:
    """The whole interval with n elements along every edge, steps shorter than those of the scene for that mesh."""
    return explicit((n, n, n), 200 * n * shorter // 6, 30e-6)


def passing(across: int, along: int, level: float) -> float:
    """Instant at which the force passes a level (N) in the early run, s."""
    step = 0.5 * EDGE / along / SPEED
    instants = round(EARLY / step)
    force = explicit((across, across, along), instants, instants * step).forces["crush"]
    i = int(np.argmax(force.value > level))
    (a, b), (first, second) = force.value[i - 1 : i + 1], force.time[i - 1 : i + 1]
    return float(first + (level - a) / (b - a) * (second - first))


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, extrapolate, write, and return the values with their errors."""
    arguments = options(argv, __doc__)
    plan = QUICK if arguments.quick else FULL

    # solve: the whole interval
    coarse, fine, finest = cube(plan.coarse, 2), cube(plan.fine, 2), cube(plan.fine, 4)
    ratio = plan.fine / plan.coarse
    values, errors = {}, {}
    for quantity, value in finest.values.items():
        change = finest.distance(quantity, fine)  # by half the step: what is left is as much again
        mesh = fine.distance(quantity, coarse) / (ratio - 1.0)
        values[quantity] = value if quantity == HISTORY else 2.0 * value - fine.values[quantity]
        errors[quantity] = max(SAFETY * (change + mesh) / finest.scales[quantity], LEAST)

    # solve: the head of the wave
    level = 0.01 * values["crush.peak_force_raw"]
    (few, many), (rough, *sharp) = plan.across, plan.along
    base, wider = passing(few, rough, level), passing(many, rough, level)
    along = [passing(few, n, level) for n in sharp]
    wide = (wider - base) / (1.0 - few / many)  # first order in the size across, to none
    values[FIRST] = float(np.mean(along)) + wide
    errors[FIRST] = SAFETY * (0.5 * abs(along[1] - along[0]) + 0.5 * abs(wide)) / values[FIRST]

    # save
    write(arguments.folder / FILE, values, errors, finest.forces["crush"])
    early = {f"{few} x {few} x {n}": t for n, t in zip(sharp, along, strict=True)}
    save(figure(plan, (coarse, fine, finest), early, values, errors), arguments.folder, "crushing_reference")
    numbers = {q.rpartition(".")[2]: value for q, value in values.items()}
    return numbers | {f"error_of_{q.rpartition('.')[2]}": error for q, error in errors.items()}


def write(file: Path, values: dict[str, float], errors: dict[str, float], force: Force) -> None:
    """The reference as the program reads it."""
    scene = latin_fmu.load_scene(SCENE)
    time = np.linspace(0.0, scene.time.end, POINTS)
    data = {
        "scene": scene.name,
        "source": "explicit runs, extrapolated in the step (examples/crushing_reference.py)",
        "holds_for": physics_of(scene),
        "values": {q: float(f"{v:.6g}") for q, v in values.items() if q != HISTORY},
        "errors": {q: float(f"{e:.2g}") for q, e in errors.items()},
        "force": {
            "crush": {
                "time": [float(f"{t:.5g}") for t in time],
                "value": [float(f"{v:.5g}") for v in np.interp(time, force.time, force.value)],
            }
        },
    }
    lines = (f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in data.items())
    file.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def figure(
    plan: Plan, runs: Sequence[Quantities], early: dict[str, float], values: dict[str, float], errors: dict[str, float]
) -> Figure:
    """First contact and separation of the runs beside the value taken."""
    drawn = Figure(figsize=(9.5, 3.6), layout="constrained")
    names = [f"{plan.coarse}\nsteps x 2", f"{plan.fine}\nsteps x 2", f"{plan.fine}\nsteps x 4"]
    panels = drawn.subplots(1, 2, width_ratios=(1.5, 1.0))
    for axis, quantity in zip(panels, (FIRST, "crush.separation"), strict=True):
        value, error = 1e6 * values[quantity], errors[quantity]
        axis.axhspan(value * (1 - error), value * (1 + error), color=ORANGE, alpha=0.3, linewidth=0)
        axis.axhline(value, color=ORANGE, label="taken, and its error")
        axis.plot(names, [1e6 * run.values[quantity] for run in runs], "o", color=BLUE, label="whole interval")
        if quantity == FIRST:
            axis.plot(list(early), [1e6 * t for t in early.values()], "s", color=GREEN, label="first 2.2 us")
        axis.margins(y=0.15)
        axis.set(xlabel="elements along an edge", ylabel=f"{quantity.rpartition('.')[2].replace('_', ' ')} (us)")
        axis.legend(frameon=False, fontsize="small")
        tidy(axis)
    return drawn


if __name__ == "__main__":
    print(table(main()))
