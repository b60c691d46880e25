"""Runs of a study: each once, failures kept, cost foreseen."""

from __future__ import annotations

import contextlib
import math
import tempfile
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from .. import api
from ..errors import LatinError
from ..scene.schema import Scene
from .refinement import Resolution, at_resolution, counts_that_vary
from .runs import Run, as_run
from .variants import Variant

Tell = Callable[[str], None]


@dataclass
class Row:
    """One run of the study: who, at which resolution, and the run; ``failure`` says why there is none."""

    series: str
    variant: str
    resolution: Resolution
    tolerance: float
    run: Run | None
    failure: str = ""


@dataclass
class Bench:
    """Solves the points of a study, each once.

    Attributes
    ----------
    budget : CPU seconds the whole study may take. tell : hears each run as it is done. rows : all points so far.
    """

    budget: float
    tell: Tell
    rows: list[Row] = field(default_factory=list)
    spent: float = 0.0
    _known: dict[tuple[str, Resolution], tuple[Run | None, str]] = field(default_factory=dict)

    def run(self, series: str, variant: Variant, resolution: Resolution, save: bool = False) -> Run | None:
        """The run of a variant at a resolution; None where it failed (the row says why).

        ``save``: its results are written to a temporary file, so that the cost of output is known.
        """
        key = (variant.name, resolution)
        if key not in self._known:
            self._known[key] = self._solve(variant, resolution, save)
        run, failure = self._known[key]
        scene = variant.scene
        tolerance = resolution.tolerance or (math.nan if scene is None else scene.solver.tolerance)
        self.rows.append(Row(series, variant.name, resolution, tolerance, run, failure))
        return run if run is not None and not failure else None

    def warm_up(self, variant: Variant, resolution: Resolution) -> None:
        """One run that no row holds: what is compiled at first use costs no row anything."""
        if variant.scene is not None:
            with contextlib.suppress(LatinError):
                api.solve(at_resolution(variant.scene, resolution))

    def _solve(self, variant: Variant, resolution: Resolution, save: bool) -> tuple[Run | None, str]:
        label = f"{variant.name}, mesh x {resolution.mesh:.3g}, steps x {resolution.time:.3g}"
        if resolution.tolerance is not None:
            label += f", tolerance {resolution.tolerance:g}"
        if variant.scene is None:
            self.tell(f"refused  {label}: {variant.refusal}")
            return None, variant.refusal
        start = clock.process_time()
        try:
            solution = api.solve(at_resolution(variant.scene, resolution))
        except LatinError as error:
            failure = told(error)
            self.tell(f"refused  {label}: {failure}")
            return None, failure
        cpu = clock.process_time() - start
        if save:
            with tempfile.TemporaryDirectory() as folder:
                solution.save(Path(folder) / "out.nc")
        run = as_run(variant.scene, solution, resolution, cpu)
        self.spent += clock.process_time() - start
        self.tell(f"{cpu:7.2f} s  {label}" + ("" if run.converged else f": {run.status}"))
        return run, "" if run.converged else run.status

    @property
    def left(self) -> float:
        """CPU seconds left of the budget."""
        return self.budget - self.spent


def told(error: LatinError) -> str:
    """The problems of an error in one line."""
    problems = getattr(error, "problems", ())
    return "; ".join(f"{p.where}: {p.what}" for p in problems) or str(error)


@dataclass(frozen=True)
class CostModel:
    """CPU seconds of a run foreseen from those made: fixed + per-work x work.

    Work = steps x cells^(4/3) for solids, steps x cells where one direction is refined (banded factors): what half
    solves cost on such meshes. The exponent is that of the scene, the factors are fitted to the runs.
    """

    fixed: float
    rate: float
    exponent: float

    @classmethod
    def fitted(cls, scene: Scene, runs: list[Run]) -> CostModel:
        """From runs at different resolutions (at least one): the largest and the cheapest.

        The first run of a process also pays for loading kernels: it may be neither the smallest nor cheap.
        """
        exponent = exponent_of(scene)
        work = [r.resolution.mesh**exponent * r.resolution.time for r in runs]
        large = max(range(len(runs)), key=work.__getitem__)
        cheap = min(range(len(runs)), key=lambda i: runs[i].cpu)
        if work[cheap] == work[large]:
            return cls(0.0, runs[large].cpu / work[large], exponent)
        rate = (runs[large].cpu - runs[cheap].cpu) / (work[large] - work[cheap])
        return cls(max(runs[cheap].cpu - rate * work[cheap], 0.0), rate, exponent)

    def seconds(self, mesh: float, time: float) -> float:
        """Foreseen CPU seconds at a resolution."""
        return float(self.fixed + self.rate * mesh**self.exponent * time)


def exponent_of(scene: Scene) -> float:
    """How the cost of a step grows with the number of elements along an edge: 1 for bars, 2 x 1.2 for plates, 4 for
    solids."""
    directions = {i for b in scene.substructure.values() if b.box for i, n in enumerate(b.box.elements) if n > 1}
    return {0: 0.0, 1: 1.0, 2: 2.4, 3: 4.0}[len(directions)] if counts_that_vary(scene) else 0.0
