"""The error of a run, told by a few coarser ones."""

from __future__ import annotations

import time as clock
from collections.abc import Callable

from ..errors import LatinError
from ..results.estimates import ErrorEstimate
from ..results.solution import Solution
from ..scene.schema import Scene
from .bench import told
from .companions import Companions, companions_of
from .differences import judged
from .kinds import FLOOR
from .measured import Measured
from .refinement import Resolution, in_short_windows
from .runs import measure_solution, run_at

Tell = Callable[[str], None]


def estimate_error(scene: Scene, solution: Solution, tell: Tell | None = None) -> ErrorEstimate:
    """Estimated relative error of every quantity of a finished run of ``scene``.

    Costs three coarser runs: mesh and step halved together (1/16 of the cost of the run in 3-D), quartered together
    (1/256), mesh alone halved (1/8). Sensors need the fields of the run (``output.fields``).

    Parameters
    ----------
    tell : hears what is being run.
    """
    start = clock.process_time()
    companions = companions_of(scene)
    if companions is None:
        return ErrorEstimate((), ("too few time steps for an estimate",), 0.0, FLOOR)
    remarks = list(companions.remarks)
    found = _coarser_runs(scene, companions, remarks, tell)
    run = measure_solution(scene, solution)
    estimates = judged(scene, run, found, companions) if "half" in found else ()
    if not run.values:
        remarks.append("no interface and no sensor whose fields are kept: no quantity to judge")
    if not solution.converged:
        remarks.append("the run did not converge: the estimate does not cover what that leaves")
    return ErrorEstimate(estimates, tuple(remarks), clock.process_time() - start, FLOOR)


def _coarser_runs(scene: Scene, companions: Companions, remarks: list[str], tell: Tell | None) -> dict[str, Measured]:
    """Quantities of the coarser runs that can be made and converge, by name; a remark for each other."""
    lean = in_short_windows(scene)
    found: dict[str, Measured] = {}
    for name, resolution in _wanted(companions).items():
        text = f"mesh x {resolution.mesh:.3g}, steps x {resolution.time:.3g}"
        if tell is not None:
            tell(f"error estimate: {text}")
        try:
            run = run_at(lean, resolution)
        except LatinError as error:
            remarks.append(f"no coarser run ({text}): {told(error)}")
            continue
        if run.converged:
            found[name] = run.measured
        else:
            remarks.append(f"a coarser run ({text}) did not converge")
    return found


def _wanted(companions: Companions) -> dict[str, Resolution]:
    runs = {"half": companions.half, "quarter": companions.quarter, "half_mesh": companions.half_mesh}
    return {name: resolution for name, resolution in runs.items() if resolution is not None}
