"""Results of a session: what was solved and exchanged as one DataTree, and its estimated errors."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import takewhile

import numpy as np
import xarray as xr

from ..assembly.segments import Segment
from ..latin.record import Array
from ..machine import provenance
from ..results.dataset import AXES, datatree, result_groups
from ..results.estimates import ErrorEstimate
from ..results.groups import SCHEMA_VERSION
from ..results.solution import Solution
from ..scene.laws import TableLaw
from ..scene.schema import Scene
from .loads import Curve
from .prescribed import Prescribed
from .settings import Settings
from .step_history import AcceptedStep, curves_of, joined
from .variable import Variable, input_of
from .variables import with_laws
from .windowed import Windowed

_COMPONENT = re.compile(r"(.+)\[(\d)\]")
_SAME_STEP = 1e-6  # relative difference of time steps that count as equal


def result_tree(
    scene: Scene, table: Sequence[Variable], steps: Sequence[AcceptedStep], mode: Windowed | Prescribed | None
) -> xr.DataTree:
    """Results of the accepted steps; group ``exchange`` holds inputs and outputs at the communication points."""
    segments = [] if mode is None else _segments(mode, steps)
    if mode is None or mode.run is None or not segments:
        tree = xr.DataTree(name=scene.name)
        tree.attrs = {**provenance(), "scene_name": scene.name, "schema_version": SCHEMA_VERSION}
    else:
        problem = mode.run.problem
        outcome = joined(segments, mode.run.timings, problem.warnings)
        given = outcome, scene.name, scene.text(), provenance(), problem.recovered, scene.sensor
        groups = result_groups(*given, surfaces=scene.output.surfaces)
        tree = datatree(groups, scene.name)
    tree["/exchange"] = xr.DataTree(exchange_dataset(table, steps))
    return tree


def _segments(mode: Windowed | Prescribed, steps: Sequence[AcceptedStep]) -> list[Segment]:
    segments = [mode.segment] if isinstance(mode, Prescribed) else [step.segment for step in steps]
    return [segment for segment in segments if segment is not None]


def exchange_dataset(table: Sequence[Variable], steps: Sequence[AcceptedStep]) -> xr.Dataset:
    """Inputs (held at the start of a step) and outputs (at its end) by step; dots in names become underscores."""
    outputs = [v for v in table if v.causality == "output"]
    rows = np.array([step.row for step in steps]).reshape(len(steps), len(outputs))
    columns: dict[str, tuple[tuple[str, ...], Array, dict[str, str]]] = {
        "step_start": (("time",), np.array([s.start for s in steps]), {"units": "s", "long_name": "start of the step"})
    }
    for variable in table:
        if variable.causality == "input":
            name, what = input_of(variable.name)
            values = np.array([getattr(step, what)[name] for step in steps])
            columns[_plain(variable.name)] = (("time",), values, _attributes(variable))
    places = {variable.name: i for i, variable in enumerate(outputs)}
    for i, variable in enumerate(outputs):
        match = _COMPONENT.fullmatch(variable.name)
        three = [places.get(f"{match[1]}[{k}]", -1) for k in (1, 2, 3)] if match else [-1]
        if match is None or min(three) < 0:  # a port may have one or two components
            columns[_plain(variable.name)] = (("time",), rows[:, i], _attributes(variable))
        elif match[2] == "1":
            attributes = _attributes(variable) | {"long_name": variable.description.removesuffix(", x")}
            columns[_plain(match[1])] = (("time", "component"), rows[:, three], attributes)
    time = np.array([step.end for step in steps])
    dataset = xr.Dataset(columns, coords={"time": time, "component": AXES})
    dataset["time"].attrs = {"units": "s", "long_name": "communication point, end of the step"}
    dataset["component"].attrs = {"long_name": "global axis"}
    return dataset


def _attributes(variable: Variable) -> dict[str, str]:
    """netCDF attributes of a variable."""
    meaning = {"long_name": variable.description}
    return meaning if variable.unit is None else {"units": variable.unit, **meaning}


def _plain(name: str) -> str:
    return name.replace(".", "_").replace("[", "_").removesuffix("]")


def estimated_error(
    scene: Scene,
    settings: Settings,
    steps: Sequence[AcceptedStep],
    mode: Windowed | Prescribed | None,
    given: dict[str, Curve],
) -> ErrorEstimate:
    """Estimated relative error of every quantity of the solved interval.

    The loads set from outside become tables, jumps at communication points included; the coarser runs then are runs of
    a plain scene (see ``estimate_error``). Time steps must be equal; the interval ends at the first other one, with a
    remark.

    given : loads when the session was initialized: histories, else constants.
    """
    from ..accuracy.estimate import estimate_error

    if mode is None or mode.run is None:
        return _no_estimate("nothing was solved")
    segments = _segments(mode, steps)
    if isinstance(mode, Windowed):
        if not segments or len(segments) < len(steps) or segments[0].time[0] > 0.0:
            return _no_estimate(
                "the steps from the start on are not known: nothing was solved, or a state was restored"
            )
        given = curves_of(steps, settings.interpolation, given)
    equal = list(takewhile(lambda s: abs(_step(s) / _step(segments[0]) - 1.0) <= _SAME_STEP, segments))
    plain = _plain_scene(scene, settings, given, equal)
    solved = Solution(joined(equal, mode.run.timings, mode.run.problem.warnings), plain.text(), plain.name)
    estimate = estimate_error(plain, solved)
    if len(equal) == len(segments):
        return estimate
    remark = f"steps of unequal length: estimated up to {equal[-1].time[-1]:.6g} s after the start"
    return ErrorEstimate(estimate.quantities, (*estimate.remarks, remark), estimate.cpu)


def _plain_scene(scene: Scene, settings: Settings, curves: dict[str, Curve], segments: Sequence[Segment]) -> Scene:
    """The scene with the loads that were set, over the instants of equal segments from the start on."""
    from ..accuracy.resolution import with_tolerance

    scene = with_laws(scene, {name: TableLaw(times=times, values=values) for name, (times, values) in curves.items()})
    n = sum(len(segment.time) - 1 for segment in segments)
    time = scene.time.model_copy(update={"end": float(segments[-1].time[-1]), "step": None, "instants": n})
    changes: dict[str, object] = {"time": time}
    if settings.tolerance is not None:
        changes["solver"] = with_tolerance(scene, settings.tolerance)
    return scene.model_copy(update=changes)


def _step(segment: Segment) -> float:
    return float(segment.time[-1] - segment.time[0]) / (len(segment.time) - 1)


def _no_estimate(reason: str) -> ErrorEstimate:
    return ErrorEstimate((), (f"no estimate: {reason}",))
