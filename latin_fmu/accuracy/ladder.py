"""Runs of one scene on ever finer meshes and steps at one ratio."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field

from .. import api
from ..fem.elasticity import wave_speeds
from ..results.solution import Solution
from ..scene.output_settings import Output
from ..scene.schema import Scene
from .refinement import Resolution, at_resolution, counts_that_vary, meshed_by_the_program
from .runs import Run, as_run
from .sampling import aligned

COURANT = 0.75
"""Courant number c_p dt / h aimed at: with the same mesh, a step twice as short gains nothing (impulse of the impact
bar: 1.1 % off at 1.5, 0.51 % at 0.75, 0.56 % at 0.4)."""

_FEWEST_STEPS = 8


@dataclass
class Ladder:
    """Runs by resolution; each is made once.

    Attributes
    ----------
    scene : in short windows, with the tolerance to be used. tell : hears each run as it is done.
    seconds : CPU seconds of all runs. solution : of the run last asked for with its output.
    """

    scene: Scene
    tell: Callable[[str], None]
    seconds: float = 0.0
    solution: Solution | None = None
    _runs: dict[Resolution, Run] = field(default_factory=dict)
    _dearer: set[Resolution] = field(default_factory=set)
    _finest: tuple[Resolution, Output, Solution] | None = None

    @property
    def refines_mesh(self) -> bool:
        """Whether the mesh can change at all."""
        return bool(counts_that_vary(self.scene)) and meshed_by_the_program(self.scene)

    def factor(self, wanted: float) -> float:
        """The factor nearest to one wanted that leaves the largest number of elements whole."""
        if not self.refines_mesh:
            return wanted
        largest = max(counts_that_vary(self.scene))
        return max(1, round(largest * wanted)) / largest

    def at(self, factor: float) -> Resolution:
        """Mesh and steps of a factor: the Courant number goes towards 0.75, by shorter steps only."""
        mesh = factor if self.refines_mesh else 1.0
        return Resolution(mesh, aligned(self.scene, factor * step_ratio(self.scene)))

    def possible(self, factor: float) -> bool:
        """Whether a factor leaves enough steps to learn from."""
        return self.scene.time.n_step * self.at(factor).time >= _FEWEST_STEPS

    def chain(self, factor: float) -> list[float]:
        """A factor, its half, quarter and eighth as far as they exist and differ."""
        found = [factor]
        for part in (0.5, 0.25, 0.125):
            f = self.factor(factor * part)
            if f < 0.8 * found[-1] and self.possible(f):
                found.append(f)
        return found

    def made(self, resolution: Resolution) -> bool:
        """Whether there is a run at a resolution."""
        return resolution in self._runs

    def run(self, resolution: Resolution) -> Run:
        """The run at a resolution, with no output but what its quantities need.

        Raises
        ------
        LatinError : the scene cannot be built or solved there.
        """
        if resolution not in self._runs:
            scene = at_resolution(self.scene, resolution)
            run, solution = self._solved(scene, resolution)
            self._runs[resolution] = run
            if self._finest is None or resolution.time >= self._finest[0].time:
                self._finest = resolution, scene.output, solution
        return self._runs[resolution]

    def whole(self, resolution: Resolution, output: Output) -> Run:
        """The run with the output asked for, kept as ``solution``: the finest made where it holds all of it.

        Raises
        ------
        LatinError : the scene cannot be built or solved there.
        """
        scene = at_resolution(self.scene, resolution)
        output = output.model_copy(update={"fields": output.keeps_fields or bool(self.scene.sensor)})
        kept = output.fields and (output.every > 1 or not scene.output.fields)
        if output.stress or output.energy or output.recovers or kept:
            scene = scene.model_copy(update={"output": output})
        if self._finest is None or self._finest[:2] != (resolution, scene.output):
            run, solution = self._solved(scene, resolution, ", with its output")
            self._finest = resolution, scene.output, solution
            if resolution not in self._runs:
                self._runs[resolution] = run
                self._dearer.add(resolution)
        self.solution = self._finest[2]
        return self._runs[resolution]

    def _solved(self, scene: Scene, resolution: Resolution, note: str = "") -> tuple[Run, Solution]:
        start = clock.process_time()
        solution = api.solve(scene)
        run = as_run(self.scene, solution, resolution, clock.process_time() - start)
        self.seconds += run.cpu
        label = f"{run.cpu:7.2f} s  mesh x {resolution.mesh:.3g}, steps x {resolution.time:.3g}{note}"
        self.tell(label if run.converged else f"{label}: {run.status}")
        return run, solution

    @property
    def runs(self) -> list[Run]:
        """The runs made without output, one a resolution, cheapest first."""
        lean = (run for at, run in self._runs.items() if at not in self._dearer)
        return sorted(lean, key=lambda run: run.cpu)


def step_ratio(scene: Scene) -> float:
    """How many times shorter steps bring the largest Courant number to 0.75; between 1 and 2."""
    largest = 0.0
    for body in scene.substructure.values():
        if body.box is None:
            continue
        material = scene.material[body.material]
        speed = wave_speeds(material.young_modulus, material.poisson_ratio, material.density)[0]
        sizes = [s / n for s, n in zip(body.box.size, body.box.elements, strict=True) if n > 1]
        if sizes:
            largest = max(largest, speed * scene.time.time_step / min(sizes))
    return min(max(largest / COURANT, 1.0), 2.0)
