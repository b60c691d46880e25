"""What a session exchanged and what it solved, as one DataTree with attributes from the variable table."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from ..accuracy.estimate import estimate_error
from ..accuracy.resolution import with_tolerance
from ..assembly.segments import Segment
from ..latin.record import Array, InterfaceHistory, Outcome, SubstructureHistory, Timings, WindowRecord
from ..results.dataset import AXES, datatree, provenance, result_groups
from ..results.estimates import ErrorEstimate
from ..results.groups import SCHEMA_VERSION
from ..results.quantities_of_interest import FLOOR
from ..results.solution import Solution
from ..scene.point_laws import TableLaw
from ..scene.schema import Scene
from .loads import Curve, curves_of
from .modes import Prescribed, Windowed
from .settings import Settings
from .step_history import AcceptedStep
from .variable import Variable

if TYPE_CHECKING:
    from .session import Session

_COMPONENT = re.compile(r"(.+)\[(\d)\]")


def session_tree(session: Session, engine: Windowed | Prescribed | None) -> xr.DataTree:
    """Results of the accepted steps; group ``exchange`` holds inputs and outputs at the communication points."""
    steps = list(session.chain)
    segments = _segments(engine, steps)
    if engine is None or engine.run is None or not segments:
        tree = xr.DataTree(name=session.scene.name)
        tree.attrs = {**provenance(), "scene_name": session.scene.name, "schema_version": SCHEMA_VERSION}
    else:
        outcome = joined(segments, engine.run.timings, engine.run.problem.warnings)
        name = session.scene.name
        recovered = engine.run.problem.recovered
        tree = datatree(result_groups(outcome, name, session.scene.text(), provenance(), recovered), name)
    tree["/exchange"] = xr.DataTree(exchange_dataset(session.table, steps))
    return tree


def _segments(engine: Windowed | Prescribed | None, steps: Sequence[AcceptedStep]) -> list[Segment]:
    found = [engine.segment] if isinstance(engine, Prescribed) else [step.segment for step in steps]
    return [segment for segment in found if segment is not None]


def exchange_dataset(table: Sequence[Variable], steps: Sequence[AcceptedStep]) -> xr.Dataset:
    """Inputs (held at the start of a step) and outputs (at its end) by step; dots in names become underscores."""
    outputs = [v for v in table if v.causality == "output"]
    rows = np.array([step.row for step in steps]).reshape(len(steps), len(outputs))
    columns: dict[str, tuple[tuple[str, ...], Array, dict[str, str]]] = {
        "step_start": (("time",), np.array([s.start for s in steps]), {"units": "s", "long_name": "start of the step"})
    }
    for variable in table:
        if variable.causality == "input":
            _, load, what = variable.name.split(".")
            values = np.array([getattr(step, what)[load] for step in steps])
            columns[_plain(variable.name)] = (("time",), values, attributes(variable))
    for i, variable in enumerate(outputs):
        match = _COMPONENT.fullmatch(variable.name)
        if match is None:
            columns[_plain(variable.name)] = (("time",), rows[:, i], attributes(variable))
        elif match[2] == "1":
            facts = attributes(variable) | {"long_name": variable.description.removesuffix(", x")}
            columns[_plain(match[1])] = (("time", "component"), rows[:, i : i + 3], facts)
    time = np.array([step.end for step in steps])
    dataset = xr.Dataset(columns, coords={"time": time, "component": AXES})
    dataset["time"].attrs = {"units": "s", "long_name": "communication point, end of the step"}
    dataset["component"].attrs = {"long_name": "global axis"}
    return dataset


def attributes(variable: Variable) -> dict[str, str]:
    """netCDF attributes of a variable."""
    facts = {"long_name": variable.description}
    return facts if variable.unit is None else {"units": variable.unit, **facts}


def _plain(name: str) -> str:
    return name.replace(".", "_")


def joined(segments: Sequence[Segment], timings: Timings, warnings: tuple[str, ...]) -> Outcome:
    """Segments that follow one another as one run."""
    time = np.concatenate([segments[0].time, *(s.time[1:] for s in segments[1:])])
    interfaces = {name: _joined_interface([s.interfaces[name] for s in segments]) for name in segments[0].interfaces}
    substructures = {
        name: _joined_fields([s.substructures[name] for s in segments]) for name in segments[0].substructures
    }
    energy = None
    if segments[0].energy is not None:
        energy = {
            term: np.concatenate([(s.energy or {})[term][(i > 0) :] for i, s in enumerate(segments)])
            for term in segments[0].energy
        }
    indicator = max(s.error_indicator for s in segments)
    return Outcome(
        time=time,
        interfaces=interfaces,
        substructures=substructures,
        windows=_joined_windows(segments),
        interface_indicator={},
        converged=all(s.converged for s in segments),
        status=f"{len(segments)} accepted segment(s), largest error indicator {indicator:.3g}",
        passes=float("nan"),
        energy=energy,
        timings=timings,
        warnings=warnings,
    )


def _joined_interface(parts: Sequence[InterfaceHistory]) -> InterfaceHistory:
    changes: dict[str, Array] = {}
    for key in ("traction", "velocity", "gap", "contact_status", "friction_power", "layer_energy", "joint_power"):
        if getattr(parts[0], key) is not None:
            changes[key] = np.concatenate([getattr(p, key)[(i > 0) :] for i, p in enumerate(parts)])
    return replace(parts[0], **changes)  # type: ignore[arg-type]


def _joined_fields(parts: Sequence[SubstructureHistory]) -> SubstructureHistory:
    changes: dict[str, Array] = {"time": np.concatenate([p.time[(i > 0) :] for i, p in enumerate(parts)])}
    for key in ("displacement", "velocity", "stress"):
        if getattr(parts[0], key) is not None:
            changes[key] = np.concatenate([getattr(p, key)[(i > 0) :] for i, p in enumerate(parts)])
    energy = None
    if parts[0].energy is not None:
        energy = {
            term: np.concatenate([(p.energy or {})[term][(i > 0) :] for i, p in enumerate(parts)])
            for term in parts[0].energy
        }
    return replace(parts[0], energy=energy, **changes)  # type: ignore[arg-type]


def _joined_windows(segments: Sequence[Segment]) -> list[WindowRecord]:
    windows, done = [], 0
    for segment in segments:
        windows += [
            replace(w, first_instant=w.first_instant + done, last_instant=w.last_instant + done)
            for w in segment.windows
        ]
        done += len(segment.time) - 1
    return windows


# -- The estimated error of what a session solved: the same as a plain run, judged by coarser ones.
_SAME_STEP = 1e-6


def session_error(session: Session, engine: Windowed | Prescribed | None) -> ErrorEstimate:
    """Estimated relative error of every quantity of the interval solved.

    The loads set from outside become tables of what was set, jumps at communication points included; the coarser runs
    then are runs of a plain scene (see ``estimate_error``). Steps inside the communication steps must be equal; what
    comes after the first other one is left out, and told.
    """
    if engine is None or engine.run is None:
        return _none("nothing was solved")
    if isinstance(engine, Prescribed):
        segments = [] if engine.segment is None else [engine.segment]
        curves = session.given_curves()
    else:
        steps = list(session.chain)
        segments = [step.segment for step in steps if step.segment is not None]
        if not segments or len(segments) < len(steps) or segments[0].time[0] > 0.0:
            return _none("the steps from the start on are not known: nothing was solved, or a state was restored")
        curves = curves_of(steps, session.settings.interpolation, session.given_curves())
    equal = list(takewhile(lambda s: abs(_step(s) / _step(segments[0]) - 1.0) <= _SAME_STEP, segments))
    scene = plain_scene(session.scene, session.settings, curves, equal)
    found = estimate_error(
        scene, Solution(joined(equal, engine.run.timings, engine.run.problem.warnings), scene.text(), scene.name)
    )
    if len(equal) == len(segments):
        return found
    remark = f"steps of unequal length: estimated up to {equal[-1].time[-1]:.6g} s after the start"
    return ErrorEstimate(found.quantities, (*found.remarks, remark), found.cpu, found.floor)


def plain_scene(scene: Scene, settings: Settings, curves: dict[str, Curve], segments: Sequence[Segment]) -> Scene:
    """The scene with the loads that were set, over the instants of equal segments from the start on."""
    loads = {
        name: load.model_copy(update={"law": TableLaw(times=curves[name][0], values=curves[name][1])})
        if name in curves
        else load
        for name, load in scene.load.items()
    }
    n = sum(len(segment.time) - 1 for segment in segments)
    time = scene.time.model_copy(update={"end": float(segments[-1].time[-1]), "step": None, "instants": n})
    changes: dict[str, object] = {"load": loads, "time": time}
    if settings.tolerance is not None:
        changes["solver"] = with_tolerance(scene, settings.tolerance)
    return scene.model_copy(update=changes)


def _step(segment: Segment) -> float:
    return float(segment.time[-1] - segment.time[0]) / (len(segment.time) - 1)


def _none(why: str) -> ErrorEstimate:
    return ErrorEstimate((), (f"no estimate: {why}",), 0.0, FLOOR)
