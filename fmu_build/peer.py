"""An FMU as a peer of ``latin_fmu.cosim.WaveformMaster``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from latin_fmu.cosim.settings import StepReport, refused

from .drive import Drive


class FmuPeer(Drive):
    """One instance, initialized at once. ``start``: values of inputs and parameters before initialization."""

    def __init__(self, path: str | Path, start: Mapping[str, Any] | None = None) -> None:
        super().__init__(path, start)
        self.initialize()

    def set_load(self, name: str, value: float, rate: float = 0.0) -> None:
        """Amplitude of a load at the start of the next step and its rate, 1/s."""
        self.set(f"load.{name}.value", value)
        self.set(f"load.{name}.rate", rate)

    def value(self, name: str) -> float:
        """A scalar output."""
        return self.read([name])[0]

    def step(self, t: float, h: float) -> StepReport:
        """Go on from t by h, s."""
        return StepReport(True) if self.advance(t, h) else refused(self.complaint)

    def snapshot(self) -> bytes:
        """The serialized state."""
        state = self._fmu.getFMUState() if self.three else self._fmu.getFMUstate()
        try:
            found = self._fmu.serializeFMUState(state) if self.three else self._fmu.serializeFMUstate(state)
            return bytes(found)
        finally:
            (self._fmu.freeFMUState if self.three else self._fmu.freeFMUstate)(state)

    def restore(self, blob: bytes) -> None:
        """Back to a state."""
        if self.three:
            state = self._fmu.deserializeFMUState(blob)
            self._fmu.setFMUState(state)
            self._fmu.freeFMUState(state)
        else:
            state = self._fmu.deSerializeFMUstate(blob)
            self._fmu.setFMUstate(state)
            self._fmu.freeFMUstate(state)
