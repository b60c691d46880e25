"""What the adapters for co-simulation share: the life cycle, and setting numbers and strings."""

from __future__ import annotations

from typing import Any

from .adapter import Adapter


class CoSimulationAdapter(Adapter):
    """Functions the exporter's library calls, handed on to the participant. None raises."""

    def exit_initialization_mode(self) -> None:
        """Build; a failure is logged, and every step refused."""
        self.participant.initialize()

    def do_step(self, current_time: float, step_size: float) -> bool:
        """False is a discard."""
        return bool(self.participant.step(current_time, step_size))

    def terminate(self) -> None:
        """Write results, where asked for."""
        self.participant.terminate()

    def get_string(self, references: list[int]) -> list[str]:
        """Strings."""
        return as_long(self.participant.get_texts(references), len(references), "")

    def set_string(self, references: list[int], values: list[str]) -> None:
        """Strings."""
        self.participant.set_texts(references, values)

    def _numbers(self, references: list[int]) -> list[Any]:
        return as_long(self.participant.get(references), self.participant.size(references), 0.0)

    def _set_numbers(self, references: list[int], values: list[Any]) -> None:
        self.participant.set(references, values)


def as_long(found: Any, size: int, fill: Any) -> list[Any]:
    """As many values as the library reads: all found, or ``fill`` where reading failed."""
    values = list(found)
    return values if len(values) == size else [fill] * size
