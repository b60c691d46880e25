"""What a session exchanged and what it solved, as one DataTree with attributes from the variable table."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from ..assembly.segments import Segment
from ..latin.record import Array, InterfaceHistory, Outcome, SubstructureHistory, Timings, WindowRecord
from ..results.dataset import AXES, datatree, provenance, result_groups
from ..results.groups import SCHEMA_VERSION
from .accepted import AcceptedStep
from .prescribed import Prescribed
from .variable import Variable
from .windowed import Windowed

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
