"""FMI 3.0 Model Exchange adapter: the functions the exporter's library calls, handed on to the reduced model.

Runs inside the host. None of the functions may raise: the exporter frees the instance then, and the next call of the
host would meet freed memory.
"""

from __future__ import annotations

import importlib
import os
from dataclasses import dataclass
from typing import Any, ClassVar

from .adapter import Adapter


@dataclass(frozen=True)
class DiscreteStates:
    """What the library reads after an event, under the names it looks for (the exporter's own class has others)."""

    terminateSimulation: bool  # noqa: N815
    nextEventTimeDefined: bool  # noqa: N815
    nextEventTime: float  # noqa: N815
    discreteStatesNeedUpdate: bool = False  # noqa: N815
    valuesOfContinuousStatesChanged: bool = True  # noqa: N815  they have not, but some hosts restart only then
    nominalContinuousStatesChanged: bool = False  # noqa: N815


class ModelExchangeAdapter(Adapter):
    """Mixed into ``Fmi3SlaveBase``. The exporter drops start time, stop time and tolerance."""

    needed: ClassVar[tuple[str, ...]] = ("numpy", "pydantic")

    def _open(self) -> Any:
        resources = self.resources  # type: ignore[attr-defined]
        home = f"{self.package}.latin_fmu.model_exchange"
        instance, system = (importlib.import_module(f"{home}.{name}") for name in ("fmi_instance", "system"))
        with open(os.path.join(resources, "reduced.bin"), "rb") as file:
            reduced = system.ReducedSystem.from_bytes(file.read())
        with open(os.path.join(resources, "variables.json"), encoding="utf-8") as file:
            found = system.Names.from_text(file.read())
        return instance.ExchangeModel(reduced, found, self.tell)

    def exit_initialization_mode(self) -> None:
        """Parameters are fixed."""
        self.participant.initialize()

    def terminate(self) -> None:
        """Nothing is left to do."""

    # -- variables ------------------------------------------------------------------------------------------------
    def get_float64(self, references: list[int]) -> list[float]:
        """Numbers."""
        found: list[float] = self.participant.get(references)
        return found

    def set_float64(self, references: list[int], values: list[float]) -> None:
        """Numbers."""
        self.participant.set(references, values)

    # -- continuous time ------------------------------------------------------------------------------------------
    def set_time(self, time: float) -> None:
        """Time, s."""
        self.participant.set_time(time)

    def get_number_of_continuous_states(self) -> int:
        """How many states there are."""
        return int(self.participant.n_state)

    def set_continuous_states(self, values: list[float]) -> None:
        """States."""
        self.participant.set_states(values)

    def get_continuous_states(self) -> list[float]:
        """States."""
        found: list[float] = self.participant.y.tolist()
        return found

    def get_continuous_state_derivatives(self) -> list[float]:
        """Their derivatives."""
        found: list[float] = self.participant.derivatives()
        return found

    def get_nominals_of_continuous_states(self, _size: int) -> list[float]:
        """Their expected sizes."""
        found: list[float] = self.participant.nominals()
        return found

    # -- events ---------------------------------------------------------------------------------------------------
    def get_number_of_event_indicators(self) -> int:
        """How many indicators there are."""
        return int(self.participant.n_indicator)

    def get_event_indicators(self) -> list[float]:
        """Indicators."""
        found: list[float] = self.participant.indicators()
        return found

    def update_discrete_states(self) -> DiscreteStates:
        """Contact states and time laws after an event."""
        update = self.participant.update()
        knot = update.next_event
        return DiscreteStates(update.terminate, knot is not None, knot or 0.0)

    # -- states of the FMU ------------------------------------------------------------------------------------------
    @staticmethod
    def _fmu_state_to_bytes(state: Any) -> bytes:
        return state or b""

    @classmethod
    def _fmu_state_from_bytes(cls, block: bytes) -> Any:
        return bytes(block)
