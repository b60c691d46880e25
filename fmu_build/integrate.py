"""Integrates a Model Exchange FMU with CVode (fmpy), behind the same few methods as ``Drive``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from latin_fmu.errors import InputError, Problem

from .drive import Columns, Drive

_HEADING = "the FMU cannot be integrated"


class Integration:
    """One run of a Model Exchange FMU.

    Parameters
    ----------
    path : the FMU. start : values of inputs and parameters. inputs : columns over ``time``, linear in between.

    Attributes
    ----------
    outputs : names of the outputs. complaint : why a run ended early, else "".
    """

    def __init__(self, path: str | Path, start: Mapping[str, Any] | None = None, inputs: Columns | None = None) -> None:
        self._path, self._start, self._inputs = str(path), dict(start or {}), dict(inputs or {})
        description = fmpy.read_model_description(self._path)
        known = {v.name for v in description.modelVariables}
        unknown = [n for n in (*self._start, *self._inputs) if n not in known and n != "time"]
        if unknown:
            raise InputError([Problem(n, "no variable of this name") for n in unknown], _HEADING)
        self._rest = {v.name: float(v.start) for v in description.modelVariables if v.causality == "input"}
        self.outputs = [v.name for v in description.modelVariables if v.causality == "output"]
        self.stop_time = float(description.defaultExperiment.stopTime)
        self.step_size = float(description.defaultExperiment.stepSize)
        self._tolerance = float(description.defaultExperiment.tolerance)
        self.complaint = ""

    def run(self, step: float, stop: float) -> Iterator[list[float]]:
        """Time and outputs every ``step``; ends early where the integrator cannot go on."""
        if not (step > 0.0 and stop > 0.0):
            raise InputError([Problem("--step, --stop", "must be > 0", f"{step}, {stop}")])
        rows: list[list[float]] = []
        said: list[str] = []

        def keep(_time: float, recorder: Any) -> bool:
            rows[:] = [list(row) for row in recorder.rows]
            return True

        try:
            result = fmpy.simulate_fmu(
                self._path,
                stop_time=stop,
                output_interval=step,
                relative_tolerance=self._tolerance,
                start_values=self._start,
                input=self._signals(),
                output=self.outputs,
                step_finished=keep,
                record_events=False,
                logger=lambda _e, _s, _c, text: said.append(text.decode(errors="replace")),
            )
            rows = [list(row) for row in result]
        except Exception as error:  # fmpy and CVode raise bare exceptions
            self.complaint = (said or [str(error)])[-1].replace("%%", "%")
        yield from rows

    def _signals(self) -> Any:
        """All inputs over time: those without a column stay where they start (fmpy wants every one)."""
        if not self._inputs:
            return None
        columns = {"time": self._inputs["time"]}
        for name, start in self._rest.items():
            columns[name] = self._inputs.get(name, [self._start.get(name, start)] * len(columns["time"]))
        return np.array(list(zip(*columns.values(), strict=True)), dtype=[(name, float) for name in columns])

    def close(self) -> None:
        """Nothing stays open."""


def opened(
    path: str | Path, start: Mapping[str, Any] | None = None, inputs: Columns | None = None
) -> Drive | Integration:
    """An FMU for co-simulation to be stepped, or one for Model Exchange to be integrated.

    Raises InputError where it is neither, or lacks one of the variables.
    """
    try:
        description = fmpy.read_model_description(str(path))
        exchange = description.modelExchange is not None and description.coSimulation is None
    except Exception:  # Drive says what is wrong with it
        exchange = False
    return Integration(path, start, inputs) if exchange else Drive(path, start, inputs)
