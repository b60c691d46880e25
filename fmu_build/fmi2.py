"""FMI 2.0 adapter: the functions the exporter's library calls, handed on to the participant."""

from __future__ import annotations

from .co_simulation_adapter import CoSimulationAdapter


class Fmi2Adapter(CoSimulationAdapter):
    """Mixed into ``Fmi2Slave``. Every function takes and returns lists; none raises."""

    def setup_experiment(self, start_time: float, _stop_time: float | None, tolerance: float | None) -> None:
        """Start time and tolerance; the stop time is not needed."""
        self.participant.setup(start_time, tolerance)

    def get_real(self, references: list[int]) -> list[float]:
        """Reals."""
        return self._numbers(references)

    def get_integer(self, references: list[int]) -> list[int]:
        """Integers."""
        return [int(value) for value in self._numbers(references)]

    def get_boolean(self, references: list[int]) -> list[bool]:
        """Booleans."""
        return [bool(value) for value in self._numbers(references)]

    def set_real(self, references: list[int], values: list[float]) -> None:
        """Reals."""
        self._set_numbers(references, values)

    def set_integer(self, references: list[int], values: list[int]) -> None:
        """Integers."""
        self._set_numbers(references, values)

    def set_boolean(self, references: list[int], values: list[bool]) -> None:
        """Booleans."""
        self._set_numbers(references, values)
