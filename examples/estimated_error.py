"""CPU time of a run, the error it estimates and its true error: a landing, a slip and a bolted stack.

Three scenes on meshes and steps from coarse to fine. Each run estimates its error from coarser runs, as every
``latin-fmu run`` does; the true error is that against the closed solution, of the bolted stack against a run half as
coarse again as the finest.

  landing  models/impact_bar, a bar lands on a wall: impulse
  slip     models/shear_interface, a shear wave makes a joint slip: friction work
  bolts    two plates between two yokes, tightened by two bolts and sheared by a pulse: impulse and friction work
           between the plates

Writes estimated_error.png and prints the table. A minute; coarse runs alone with --quick.
"""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass

from example_tools import COLOURS, MODELS, options, save, tidy
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

import latin_fmu
from latin_fmu.accuracy.runs import Resolution, aligned, at_resolution, run_at
from latin_fmu.accuracy.study import declared
from latin_fmu.run_quantities import Quantities, measure_solution
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import STEEL, Description, bolted_stack, half_sine

QUANTITIES = {
    "landing": ("wall.impulse",),
    "slip": ("fault.friction_work",),
    "bolts": ("joint.impulse", "joint.friction_work"),
}
MESHES = {"landing": (0.5, 1.0, 2.0, 4.0), "slip": (0.4, 0.8, 1.6, 3.2), "bolts": (1.0, 1.5, 2.0)}
FINER = 1.5  # of the reference of the bolts, over the finest mesh


@dataclass(frozen=True)
class Case:
    """One quantity of a run: scene, factor on its mesh, CPU seconds of the run and of its estimate, estimated and true
    error; ``bound``: the estimate is only a bound."""

    scene: str
    quantity: str
    mesh: float
    seconds: float
    estimating: float
    estimated: float
    true: float
    bound: bool


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Run, estimate, compare, draw; the checked numbers."""
    arguments = options(argv, __doc__)
    print("| scene, quantity | mesh | CPU of the run, s | of the estimate, s | estimated error, % | true error, % |")
    print("|---|---|---|---|---|---|")
    cases = []
    for name, scene in scenes().items():
        meshes = MESHES[name][: 2 if arguments.quick else None]
        truth = reference(scene, FINER * meshes[-1])
        for mesh in meshes:
            for one in compared(name, scene, mesh, truth):
                cases.append(one)
                print(line(one), flush=True)
    save(figure(cases), arguments.folder, "estimated_error")
    return {f"{key}_{c.quantity}_{c.mesh:g}": getattr(c, key) for c in cases for key in ("estimated", "true")}


def scenes() -> dict[str, Scene]:
    """The three scenes without fields and energies."""
    bare = ("output.fields=false", "output.energy=false")
    return {
        "landing": latin_fmu.load_scene(MODELS / "impact_bar" / "scene.toml", bare),
        "slip": latin_fmu.load_scene(MODELS / "shear_interface" / "scene.toml", bare),
        "bolts": latin_fmu.scene_from_dict(bolted()),
    }


def bolted() -> Description:
    """Two plates 20 x 20 x 6 mm between two yokes, which two bolts of 4 kN beside the plates pull together."""
    shear = {"face": "upper.ymin", "force": [0.0, 6e3, 0.0], "law": half_sine(60e-6)}
    time = {"end": 120e-6, "instants": 120}
    return bolted_stack(STEEL, 4e3, 0.2, time, load={"shear": shear}, accuracy={"estimate": False})


def reference(scene: Scene, mesh: float) -> Quantities:
    """The closed solution declared with the scene, else a run on this mesh."""
    exact = declared(scene)
    return run_at(scene, Resolution(mesh, aligned(scene, mesh))).quantities if exact is None else exact.quantities


def compared(name: str, scene: Scene, mesh: float, truth: Quantities) -> list[Case]:
    """One run, each of its quantities with its estimated and its true error."""
    start = clock.process_time()
    there = at_resolution(scene, Resolution(mesh, aligned(scene, mesh)))
    solution = latin_fmu.solve(there)
    seconds = clock.process_time() - start
    estimate = latin_fmu.estimate_error(there, solution)
    measured = measure_solution(scene, solution)
    return [
        Case(
            name,
            quantity,
            mesh,
            seconds,
            estimate.cpu,
            estimate[quantity].relative_error,
            measured.error(quantity, truth),
            estimate[quantity].bound_only,
        )
        for quantity in QUANTITIES[name]
    ]


def line(case: Case) -> str:
    """One row of the table."""
    estimated = f"{100 * case.estimated:.2g}{', only a bound' if case.bound else ''}"
    numbers = f"{case.seconds:.2g} | {case.estimating:.2g} | {estimated} | {100 * case.true:.2g}"
    return f"| {case.scene}, `{case.quantity}` | {case.mesh:g} | {numbers} |"


def figure(cases: Sequence[Case]) -> Figure:
    """Errors against the CPU time of run and estimate: estimated open and dashed, true filled."""
    drawn = Figure(figsize=(6.4, 4.2), layout="constrained")
    axis = drawn.subplots()
    lines = dict.fromkeys((c.scene, c.quantity) for c in cases)
    for (name, quantity), colour, mark in zip(lines, COLOURS, "os^v", strict=False):
        own = [c for c in cases if c.quantity == quantity]
        seconds = [c.seconds + c.estimating for c in own]
        label = f"{name}: {quantity.split('.')[1].replace('_', ' ')}"
        axis.plot(seconds, [100 * c.estimated for c in own], f"{mark}--", color=colour, markerfacecolor="white")
        axis.plot(seconds, [100 * c.true for c in own], f"{mark}-", color=colour, label=label)
    axis.plot([], [], "o--", color="0.3", markerfacecolor="white", label="estimated")
    axis.plot([], [], "o-", color="0.3", label="true")
    axis.set(xscale="log", yscale="log", xlabel="CPU time of run and estimate, s", ylabel="error, %")
    for ticks, ends in ((axis.xaxis, (0.1, 0.2, 0.5, 1, 2, 5)), (axis.yaxis, (0.001, 0.01, 0.1, 1, 10))):
        ticks.set_major_locator(FixedLocator(ends))
        ticks.set_major_formatter("{x:g}")
        ticks.set_minor_formatter("")
    axis.legend(frameon=False, fontsize="small")
    tidy(axis)
    return drawn


if __name__ == "__main__":
    main()
