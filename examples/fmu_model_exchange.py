"""Two FMUs of one scene: co-simulation (the scene itself, by LATIN) against Model Exchange (a reduced model, by CVode).

    python examples/fmu_model_exchange.py [--quick] [-o FOLDER]

The two share meshes and matrices only: contact is exact on every node here and a spring on a few patches there, time is
stepped by HHT here and by BDF with event location there. The impulse of a contact must not depend on any of that; the
front of a shock and the chatter of the last modes do.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import fmpy
import numpy as np
from example_tools import BLUE, MODELS, VERMILION, options, save, table, tidy
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

import latin_fmu
from fmu_build.build import build_fmu, build_model_exchange
from latin_fmu.scene.schema import Scene

COARSE = ["substructure.lower.box.elements=[3,3,3]", "substructure.upper.box.elements=[3,3,3]"]
CASES = {  # contact, what differs from the file, what --quick changes
    "impact_bar": ("wall", [], ["substructure.bar.box.elements=[1,1,40]", "time.instants=160"]),
    "beam_in_traction": ("contact", ["solver.window=1", "solver.acceleration=anderson"], []),
    "two_specimen_crushing": ("crush", [], COARSE),
}
TITLES = {
    "impact_bar": "a bar thrown against a wall",
    "beam_in_traction": "two bars with a gap",
    "two_specimen_crushing": "crushing of two specimens, friction 0.1",
}


class Pair(NamedTuple):
    """Results of both FMUs over time, states and CPU time of the reduced one."""

    full: Any
    reduced: Any
    states: int
    seconds: float


def simulated(scene: Scene, folder: Path) -> Pair:
    """Build and run both FMUs."""
    full = build_fmu(scene, folder / "co_simulation.fmu", "3")
    reduced = build_model_exchange(scene, folder / "model_exchange.fmu")
    step = 2 * scene.time.time_step
    reference = fmpy.simulate_fmu(str(full), output_interval=step)
    start = time.process_time()
    found = fmpy.simulate_fmu(str(reduced), output_interval=scene.time.end / 400)
    states = fmpy.read_model_description(str(reduced)).numberOfContinuousStates
    return Pair(reference, found, states, time.process_time() - start)


def draw(axis: Axes, pair: Pair, contact: str, title: str) -> None:
    """Contact force of both over time."""
    force = f"interface.{contact}.normalForce"
    axis.plot(pair.full["time"], pair.full[force], color=BLUE, linewidth=1.6, label="co-simulation (LATIN, full mesh)")
    axis.plot(
        pair.reduced["time"],
        pair.reduced[force],
        color=VERMILION,
        linewidth=0.8,
        label="Model Exchange (CVode, reduced model)",
    )
    axis.set_title(f"{title}\n{pair.states} states", fontsize="medium", loc="left")
    axis.xaxis.set_major_locator(MaxNLocator(4))
    axis.xaxis.set_major_formatter(EngFormatter(unit="s"))
    axis.yaxis.set_major_formatter(EngFormatter(unit="N"))
    tidy(axis)


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Run, show, draw; numbers that tests look at: impulse of Model Exchange against co-simulation, in per cent."""
    chosen = options(argv, __doc__)
    numbers: dict[str, float] = {}
    figure = Figure(figsize=(11.0, 3.8), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(CASES)))
    for axis, (model, (contact, changes, quick)) in zip(axes, CASES.items(), strict=True):
        overrides = [*changes, *(quick if chosen.quick else []), "output.fields=false", "output.stress=false"]
        scene = latin_fmu.load_scene(MODELS / model / "scene.toml", overrides)
        with tempfile.TemporaryDirectory() as folder:
            pair = simulated(scene, Path(folder))
        impulse = f"interface.{contact}.impulse[3]"
        numbers[f"{model}: impulse [N s]"] = float(pair.full[impulse][-1])
        ratio = pair.reduced[impulse][-1] / pair.full[impulse][-1]
        numbers[f"{model}: difference [%]"] = 100.0 * float(ratio - 1.0)
        numbers[f"{model}: states"] = pair.states
        numbers[f"{model}: events"] = float(pair.reduced["model.events"][-1])
        numbers[f"{model}: CPU time of CVode [s]"] = pair.seconds
        draw(axis, pair, contact, TITLES[model])
    axes[0].set_ylabel("contact force")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    print(table(numbers))
    print(save(figure, chosen.folder, "fmu_model_exchange"))
    return numbers


if __name__ == "__main__":
    main()
