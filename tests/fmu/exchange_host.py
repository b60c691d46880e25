"""Hosts of a Model Exchange FMU on top of fmpy: CVode, and one for single evaluations."""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping, Sequence
from ctypes import c_double
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Model


def integrate(
    fmu: Path,
    start: Mapping[str, Any] | None = None,
    events: list[float] | None = None,
    signals: Any = None,
    tolerance: float | None = None,
) -> tuple[Any, float]:
    """Result of fmpy with CVode and its CPU time, s; ``events`` takes the times of the events."""
    began = time.process_time()
    result = fmpy.simulate_fmu(
        str(fmu),
        start_values=dict(start or {}),
        input=signals,
        record_events=events is not None,
        relative_tolerance=tolerance,
    )
    if events is not None:
        events += result["time"][1:][np.diff(result["time"]) == 0.0].tolist()
    return result, time.process_time() - began


class ExchangeHost:
    """One instance, evaluated where a test needs it."""

    def __init__(self, fmu: Path) -> None:
        self.messages: list[tuple[int, str]] = []
        self.description = fmpy.read_model_description(str(fmu))
        self.folder = fmpy.extract(str(fmu))
        self._references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.fmu = FMU3Model(
            guid=self.description.guid,
            unzipDirectory=self.folder,
            instanceName="instance",
            modelIdentifier=self.description.modelExchange.modelIdentifier,
        )
        self.fmu.instantiate(loggingOn=True, logMessage=self._hear)
        self.n_state = self.description.numberOfContinuousStates

    def _hear(self, _environment: Any, status: int, _category: bytes, message: bytes) -> None:
        self.messages.append((status, message.decode()))

    def start(self, **values: float) -> None:
        self.fmu.enterInitializationMode()
        for name, value in values.items():
            self.set(name, value)
        self.fmu.exitInitializationMode()
        self.fmu.updateDiscreteStates()
        self.fmu.enterContinuousTimeMode()

    def update(self) -> Sequence[Any]:
        """What an event leaves, in the order of FMPy."""
        self.fmu.enterEventMode()
        left = self.fmu.updateDiscreteStates()
        self.fmu.enterContinuousTimeMode()
        return left

    def set(self, name: str, value: float) -> None:
        self.fmu.setFloat64([self._references[name]], [value])

    def read(self, name: str) -> float:
        return float(self.fmu.getFloat64([self._references[name]])[0])

    def states(self) -> np.ndarray:
        numbers = (c_double * self.n_state)()
        self.fmu.getContinuousStates(numbers, self.n_state)
        return np.array(numbers)

    def derivatives(self) -> np.ndarray:
        numbers = (c_double * self.n_state)()
        self.fmu.getContinuousStateDerivatives(numbers, self.n_state)
        return np.array(numbers)

    def go(self, t: float, states: np.ndarray) -> None:
        self.fmu.setTime(t)
        self.fmu.setContinuousStates((c_double * self.n_state)(*states), self.n_state)

    def look(self) -> np.ndarray:
        """All values that a host can read."""
        values = self.fmu.getFloat64(list(self._references.values()))
        return np.array([*values, *self.derivatives()])

    def close(self) -> None:
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)
