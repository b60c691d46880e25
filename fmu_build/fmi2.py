"""FMI 2.0 adapter: the functions the exporter's library calls, handed on to the participant."""

from __future__ import annotations

from typing import Any

from .adapter import Adapter


class Fmi2Adapter(Adapter):
    """Mixed into ``Fmi2Slave``. Every function takes and returns lists; none raises."""

    def setup_experiment(self, start_time: float, _stop_time: float | None, tolerance: float | None) -> None:
        """Start time and tolerance; the stop time is not needed."""
        self.participant.setup(start_time, tolerance)

    def exit_initialization_mode(self) -> None:
        """Build; a failure is logged, and every step refused."""
        self.participant.initialize()

    def do_step(self, current_time: float, step_size: float) -> bool:
        """False is a discard."""
        return bool(self.participant.step(current_time, step_size))

    def terminate(self) -> None:
        """Write results, where asked for."""
        self.participant.terminate()

    def get_real(self, references: list[int]) -> list[float]:
        """Reals."""
        return _as_long(self.participant.get(references), references, 0.0)

    def get_integer(self, references: list[int]) -> list[int]:
        """Integers."""
        return [int(value) for value in _as_long(self.participant.get(references), references, 0.0)]

    def get_boolean(self, references: list[int]) -> list[bool]:
        """Booleans."""
        return [bool(value) for value in _as_long(self.participant.get(references), references, 0.0)]

    def get_string(self, references: list[int]) -> list[str]:
        """Strings."""
        return _as_long(self.participant.get_texts(references), references, "")

    def set_real(self, references: list[int], values: list[float]) -> None:
        """Reals."""
        self.participant.set(references, values)

    def set_integer(self, references: list[int], values: list[int]) -> None:
        """Integers."""
        self.participant.set(references, values)

    def set_boolean(self, references: list[int], values: list[bool]) -> None:
        """Booleans."""
        self.participant.set(references, values)

    def set_string(self, references: list[int], values: list[str]) -> None:
        """Strings."""
        self.participant.set_texts(references, values)


def _as_long(values: Any, references: list[int], fill: Any) -> list[Any]:
    """As many values as references: the library reads that many."""
    found = list(values)
    return found if len(found) == len(references) else [fill] * len(references)
